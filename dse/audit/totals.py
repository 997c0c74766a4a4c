"""How many spikes a sample has, all together and by channel; how long it lasts, and where its spikes end."""

from __future__ import annotations

import numpy as np

from dse.audit.material import Material, percent, spikes_per_step
from dse.audit.readers import READERS
from dse.audit.rows import HALF, AuditRow, Score, is_above, share_explained
from dse.records import Floats, Ints


def best_of_readers(material: Material, train: Floats, validation: Floats) -> Score:
    """Return the most accurate reader of a few numbers per sample.

    Args:
        material: with the classes.
        train: (train, feature).
        validation: (validation, feature).
    """
    scores = [
        material.score(name, reader(train, material.codes, validation)) for name, reader in READERS.items()
    ]
    return max(scores, key=lambda score: score.accuracy)


def is_shortcut(material: Material, score: Score) -> bool:
    """Return whether a few numbers explain half of what counts over time reach, and not by accident."""
    explained = share_explained(score, material.best.accuracy)
    return is_above(score, len(READERS)) and explained >= HALF


def weight_of(material: Material, score: Score) -> str:
    """Return how much of the accuracy above chance a few numbers explain, in words."""
    explained = share_explained(score, material.best.accuracy)
    if is_above(score, len(READERS)):
        return percent(explained)
    if explained >= HALF:
        return f"{percent(explained)}, which {score.n} samples cannot tell from chance"
    return "nothing"


def rows(material: Material) -> list[AuditRow]:
    """Return a row for the total of a sample, and one for the totals of its channels.

    The latter is for information: which channels spike is touch, and the row says what order in time adds.
    """
    train, validation = (material.counts(x, 1) for x in (material.train, material.validation))
    total = best_of_readers(material, *(x.sum(axis=1, keepdims=True) for x in (train, validation)))
    audit = [
        material.row(
            "spike total",
            total,
            f"the number of spikes explains {weight_of(material, total)}",
            shortcut=is_shortcut(material, total),
            remedy="encoder or preprocessing, so that classes have equally many spikes",
        )
    ]
    if train.shape[1] > 1:
        channels = best_of_readers(material, train, validation)
        audit.append(
            material.row(
                "totals per channel",
                channels,
                f"which channels spike, without order in time, explains {weight_of(material, channels)}",
            )
        )
    return audit


def only_class(material: Material) -> bool:
    """Return whether nothing can be told apart: one class in training."""
    return len(np.unique(material.codes)) < 2


def ends(material: Material) -> list[AuditRow]:
    """Return a row for the length of recordings, where it varies, and one for the active part of windows.

    The length of a recording is no shortcut of windows that all have one length; the active part may show it.
    """
    audit = []
    lengths = np.log(np.maximum(material.lengths, 1.0))[:, None]
    if np.ptp(lengths[material.train]):
        score = material.read_alone(lengths)
        explained = weight_of(material, score)
        verdict = f"the length of a recording explains {explained}; windows of one length hide it"
        audit.append(material.row("length of the recording", score, verdict))
    train, validation = (_active(material, samples) for samples in (material.train, material.validation))
    if np.ptp(train, axis=0).any():
        score = best_of_readers(material, train, validation)
        verdict = f"where the spikes of a window begin and end explains {weight_of(material, score)}"
        audit.append(
            material.row(
                "active part of the window",
                score,
                verdict,
                shortcut=is_shortcut(material, score),
                remedy="window.n_steps: no longer than the shortest touch",
            )
        )
    return audit


def _active(material: Material, samples: Ints) -> Floats:
    """Return the first and the last step with a spike, (samples, 2); both -1 where there is none."""
    data = material.dataset
    active = spikes_per_step(data.spikes, samples, data.start[samples], data.n_steps) > 0
    last = data.n_steps - 1 - active[:, ::-1].argmax(axis=1)
    ends = np.stack([active.argmax(axis=1), last], axis=1).astype(np.float64)
    ends[~active.any(axis=1)] = -1
    return ends
