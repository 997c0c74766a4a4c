"""The heads of a joint target: which output neurons serve them, and what they answer together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dse.base.records import Array, Dataset, Floats, Head


def head_sizes(dataset: Dataset) -> tuple[int, ...]:
    """Return the classes of each head; of a single target, its classes."""
    return tuple(len(head.classes) for head in dataset.heads) or (len(dataset.classes),)


def head_slices(dataset: Dataset) -> list[slice]:
    """Return the output neurons of each head, side by side in their order; of a single target, all."""
    sizes = head_sizes(dataset)
    return [slice(end - n, end) for n, end in zip(sizes, np.cumsum(sizes).tolist(), strict=True)]


def head_targets(dataset: Dataset, samples: Array) -> Array:
    """Return the true class of each head, (n, head); of a single target, (n, 1)."""
    target = dataset.target[samples]
    if not dataset.heads:
        return np.asarray(target[:, None])
    return np.stack([head.of_class[target] for head in dataset.heads], axis=1)


def output_labels(dataset: Dataset, samples: Array) -> Array:
    """Return the output neurons that are to fire: (n,) for one head, (n, head) for several."""
    neurons = head_targets(dataset, samples) + np.array([part.start for part in head_slices(dataset)])
    return np.asarray(neurons if neurons.shape[1] > 1 else neurons[:, 0])


def head_answers(dataset: Dataset, counts: Array) -> Array:
    """Return the most active output of each head (the lowest on ties), (n, head), from (n, output) counts."""
    return np.stack([counts[:, part].argmax(axis=1) for part in head_slices(dataset)], axis=1)


def joint_label(labels: Array, heads: Sequence[Head]) -> Array:
    """Return the joint class of the heads' classes (n, head); -1 where no joint class has the combination."""
    sizes = tuple(len(head.classes) for head in heads)
    table = np.full(sizes, -1, np.int64)
    table[tuple(head.of_class for head in heads)] = np.arange(len(heads[0].of_class))
    return np.asarray(table[tuple(labels.T)])


def softmax(scores: Floats) -> Floats:
    """Return probabilities from log-odds, along the last axis."""
    powers = np.exp(scores - scores.max(axis=-1, keepdims=True))
    return np.asarray(powers / powers.sum(axis=-1, keepdims=True))


def head_scores(dataset: Dataset, scores: Floats) -> Floats:
    """Return log-odds of each head's classes, (n, output), from those of joint classes, (n, class)."""
    if not dataset.heads:
        return scores
    p = softmax(scores)
    parts = [p @ (head.of_class[:, None] == np.arange(len(head.classes))) for head in dataset.heads]
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.concatenate(parts, axis=1)))
