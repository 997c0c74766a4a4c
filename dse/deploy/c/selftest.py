"""Windows of spikes that the C makes for its self-test, and what the engine answers to them.

Channel c of window `seed` spikes in a step if a number of 8 bits is below that of the channel, halved
`halvings` times; numbers are those of a counter, mixed. So channels differ, windows differ, and flash holds
nothing of them.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from dse.base.records import Bools, Ints, Network
from dse.deploy.classifier import Classifier
from dse.deploy.form import Frame
from dse.deploy.reference import Reference, of_spikes

_TRIED, _KEPT = 24, 3


class Window(NamedTuple):
    """A window and its answer, as the C has them.

    spikes: sum of the output spikes after every step, the step by which they come included; FNV-1a of words.
    """

    seed: int
    halvings: int
    label: int
    steps: int
    confident: int
    spikes: int


def windows(bundle: Classifier, frame: Frame) -> list[Window]:
    """Return three windows whose answers differ, if those to 24 do; windows with output spikes come first."""
    tried = [(1 + k * frame.n_steps * frame.n_channels, 1 + k % 6) for k in range(_TRIED)]
    fired = [spikes_of(seed % 2**32, halvings, frame.n_steps, frame.n_channels) for seed, halvings in tried]
    reference = of_spikes(bundle, np.stack(fired), frame.step_ms)
    steps = np.rint(reference.time_ms / reference.step_ms).astype(np.int64)
    labels = np.where(reference.label < 0, -2, reference.label).tolist()
    answers = list(zip(labels, steps.tolist(), map(int, reference.decided), strict=True))
    counts = _counts(bundle, reference, steps)
    of_label: Counter[int] = Counter()
    of_answer: Counter[tuple[int, int, int]] = Counter()
    ranks = []
    for k, answer in enumerate(answers):
        ranks.append((not counts[k][-1:].any(), of_label[answer[0]], of_answer[answer], k))
        of_label[answer[0]] += 1
        of_answer[answer] += 1
    kept = [k for *_, k in sorted(ranks)[:_KEPT]]
    return [Window(tried[k][0] % 2**32, tried[k][1], *answers[k], _summed(counts[k])) for k in kept]


def spikes_of(seed: int, halvings: int, n_steps: int, n_channels: int) -> Bools:
    """Return the spikes of a window, (step, channel)."""
    below = _mixed(~(np.uint32(seed) + np.arange(n_channels, dtype=np.uint32))) & 255
    numbers = _mixed(np.uint32(seed) + np.arange(n_steps * n_channels, dtype=np.uint32)) & 255
    return np.asarray(numbers.reshape(n_steps, n_channels) < below >> halvings)


def _mixed(x: Ints) -> Ints:
    """Return numbers of 32 bits, each made of one."""
    x = x * np.uint32(2654435761)
    x = (x ^ x >> np.uint32(15)) * np.uint32(2246822519)
    return x ^ x >> np.uint32(13)


def _counts(bundle: Classifier, reference: Reference, steps: Ints) -> list[Ints]:
    """Return the output spikes so far after every input step until the answer, (step, output) per window."""
    net = bundle.fitted
    if not isinstance(net, Network):
        return [np.zeros((int(n), 0), np.uint32) for n in steps]
    counts = np.zeros((len(steps), reference.n_steps + 1, net.sizes[-1]), np.uint32)
    recording, step, neuron = reference.fired[-1].T
    np.add.at(counts, (recording, step + 1, neuron), 1)
    counts = counts.cumsum(axis=1, dtype=np.uint32)
    each = net.steps_per_sample
    # The answer is made from the spikes before its step, and none is counted after it.
    return [
        x[np.minimum(np.arange(each, n + each, each), n - 1)]
        for x, n in zip(counts, steps.tolist(), strict=True)
    ]


def _summed(numbers: Ints) -> int:
    total = 2166136261
    for x in numbers.ravel().tolist():
        total = (total ^ x) * 16777619 % 2**32
    return total
