"""Probes of a few numbers per sample: spike totals, level and drift, contact, length, where spikes end."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from dse.base.records import Floats, Ints
from dse.study.audit.material import Levels, Material, spikes_per_step
from dse.study.audit.readers import COUNT_READERS, NEIGHBOURS, READERS, Reader
from dse.study.audit.rows import (
    HALF,
    AuditRow,
    Score,
    is_above,
    is_lower,
    percent,
    share_explained,
    share_lost,
)

BINS = 16
"""Equal bins of the window in which counts are compared."""
QUIET = 0.25
"""Before contact, steps have at most this share of the spikes that steps have from contact on."""

_ALONE = {NEIGHBOURS: READERS[NEIGHBOURS]}
"""The reader of `doubts.shortcuts`."""


def rows(material: Material) -> list[AuditRow]:
    """Return a row per probe that the recordings allow.

    The totals per channel are for information: which channels spike is touch, and the row says what order in
    time adds. So is the length of a recording: windows that all have one length hide it, but their active
    part may show it.
    """

    def each(numbers: Callable[[Ints], Floats]) -> tuple[Floats, Floats]:
        return numbers(material.train), numbers(material.validation)

    def row(
        probe: str,
        numbers: tuple[Floats, Floats],
        says: str,
        remedy: str = "",
        readers: Mapping[str, Reader] = READERS,
    ) -> AuditRow:
        score = best_of_readers(material, *numbers, readers)
        shortcut = remedy != "" and is_shortcut(material, score)
        verdict = says.format(weight_of(material, score))
        return material.row(probe, score, verdict, shortcut=shortcut, remedy=remedy)

    channels = each(lambda samples: material.counts(samples, 1))
    total = each(lambda samples: material.counts(samples, 1).sum(axis=1, keepdims=True))
    remedy = "encoder or preprocessing, so that classes have equally many spikes"
    audit = [row("spike total", total, "the number of spikes explains {}", remedy)]
    if channels[0].shape[1] > 1:
        says = "which channels spike, without order in time, explains {}"
        audit.append(row("totals per channel", channels, says))
    if material.levels is not None:
        audit += _of_signals(material, material.levels)
    else:
        contact = each(lambda samples: _contact(material, samples))
        step, before, after = contact[0].T
        if material.window.at != "contact_onset" and before.sum() <= QUIET * after.sum() and np.ptp(step):
            says = "the step of contact, and the spikes before, explain {}"
            numbers = contact[0][:, :2], contact[1][:, :2]
            audit.append(row("before contact", numbers, says, "window.at: contact_onset"))
    length = each(lambda samples: np.log(np.maximum(material.lengths[samples], 1.0))[:, None])
    if np.ptp(length[0]):
        says = "the length of a recording explains {}; windows of one length hide it"
        audit.append(row("length of the recording", length, says, readers=_ALONE))
    active = each(lambda samples: _active(material, samples))
    if np.ptp(active[0], axis=0).any():
        says = "where the spikes of a window begin and end explains {}"
        remedy = "window.n_steps: no longer than the shortest touch"
        audit.append(row("active part of the window", active, says, remedy))
    return audit


def best_of_readers(
    material: Material, train: Floats, validation: Floats, readers: Mapping[str, Reader] = READERS
) -> Score:
    """Return the most accurate reader of a few numbers per sample, (train or validation, feature)."""
    scores = [
        material.score(name, reader(train, material.codes, validation)) for name, reader in readers.items()
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


def _of_signals(material: Material, levels: Levels) -> list[AuditRow]:
    """Return the rows of the resting level and the drift of sampled signals.

    They are a shortcut where spikes show them: readers lose half of their accuracy above chance without them,
    or half of the counts change.
    """
    nothing, audit = np.zeros_like(levels.level), []
    for probe, numbers, removed, readers, remedy in (
        ("resting level", levels.level, (levels.level, nothing), _ALONE, "window.remove_mean: true"),
        ("drift", levels.slope, (nothing, levels.slope), READERS,
         "a split by session, e.g. split.stratified.group"),
    ):  # fmt: skip
        score = best_of_readers(material, numbers[material.train], numbers[material.validation], readers)
        verdict = f"the {probe} of the signals explains {weight_of(material, score)}"
        shortcut, without = is_shortcut(material, score), None
        if shortcut:
            share, without = _without(material, levels, removed)
            needed = share_lost(material.best, without) >= HALF
            needed = needed and is_lower(material.best.correct, without.correct)
            shortcut = needed or share >= HALF
            verdict += (
                f", and {percent(share)} of the spike counts follow it"
                if shortcut
                else f", but readers do without it ({percent(share)} of the spike counts follow it)"
            )
        audit.append(material.row(probe, score, verdict, shortcut=shortcut, remedy=remedy, without=without))
    return audit


def _without(material: Material, levels: Levels, removed: tuple[Floats, Floats]) -> tuple[float, Score]:
    """Return what changes in spikes without a part of the signals.

    It is the share of counts per bin and region that changes, and what the better reader of counts reaches.
    """
    changed, reader = levels.encoded(*removed), material.best.reader
    samples = np.concatenate([material.train, material.validation])
    before, after = (material.counts(samples, BINS, spikes=x) for x in (None, changed))
    both = before.sum() + after.sum()
    share = float(np.abs(before - after).sum() / both) if both else 0.0
    x, query = (material.seen(reader, part, spikes=changed) for part in (material.train, material.validation))
    return share, material.score(reader, COUNT_READERS[reader](x, material.codes, query))


def _contact(material: Material, samples: Ints) -> Floats:
    """Return the step of contact, and the spikes per step before it and from it on, (samples, 3).

    Contact is the first step with `window.onset_threshold` spikes; the end of the window where there is none.
    """
    data = material.dataset
    spikes = spikes_per_step(data.spikes, samples, data.start[samples], data.n_steps)
    touched = spikes >= material.window.onset_threshold
    step = np.where(touched.any(axis=1), touched.argmax(axis=1), data.n_steps)
    before = (spikes * (np.arange(data.n_steps) < step[:, None])).sum(axis=1)
    after = spikes.sum(axis=1) - before
    rates = before / np.maximum(step, 1), after / np.maximum(data.n_steps - step, 1)
    return np.stack([step, *rates], axis=1).astype(np.float64)


def _active(material: Material, samples: Ints) -> Floats:
    """Return the first and the last step with a spike, (samples, 2); both -1 where there is none."""
    data = material.dataset
    active = spikes_per_step(data.spikes, samples, data.start[samples], data.n_steps) > 0
    last = data.n_steps - 1 - active[:, ::-1].argmax(axis=1)
    ends = np.stack([active.argmax(axis=1), last], axis=1).astype(np.float64)
    ends[~active.any(axis=1)] = -1
    return ends
