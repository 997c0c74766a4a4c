"""What a recording shows without touch: its resting level and drift, and what comes before contact."""

from __future__ import annotations

import numpy as np

from dse.audit.material import Levels, Material, percent, spikes_per_step
from dse.audit.readers import COUNT_READERS
from dse.audit.rows import HALF, AuditRow, Score, is_lower, share_lost
from dse.audit.totals import best_of_readers, is_shortcut, weight_of
from dse.records import Floats, Ints, Spikes

BINS = 16
"""Equal bins of the window in which counts are compared."""
QUIET = 0.25
"""Before contact, steps have at most this share of the spikes that steps have from contact on."""


def rows(material: Material) -> list[AuditRow]:
    """Return the rows of sampled signals: level and drift; of other recordings: what is before contact."""
    levels = material.levels
    if levels is None:
        return _before_contact(material)
    nothing = np.zeros_like(levels.level)
    return [
        _row(
            material, levels, "resting level", material.read_alone(levels.level), (levels.level, nothing),
            "window.remove_mean: true",
        ),
        _row(
            material, levels, "drift",
            best_of_readers(material, levels.slope[material.train], levels.slope[material.validation]),
            (nothing, levels.slope), "a split by session, e.g. split.stratified.group",
        ),
    ]  # fmt: skip


def _row(
    material: Material,
    levels: Levels,
    probe: str,
    score: Score,
    removed: tuple[Floats, Floats],
    remedy: str,
) -> AuditRow:
    """Return the row of a property of the signals that is a shortcut where spikes show it.

    They do where readers lose half of their accuracy above chance without it, or half of the counts change.
    """
    sentence = f"the {probe} of the signals explains {weight_of(material, score)}"
    if not is_shortcut(material, score):
        return material.row(probe, score, sentence)
    changed = levels.encoded(*removed)
    share = _share_changed(material, changed)
    without = _read(material, changed)
    before = material.best
    needed = share_lost(before, without) >= HALF and is_lower(before.correct, without.correct)
    if not needed and share < HALF:
        sentence += f", but readers do without it ({percent(share)} of the spike counts follow it)"
        return material.row(probe, score, sentence, without=without)
    sentence += f", and {percent(share)} of the spike counts follow it"
    return material.row(probe, score, sentence, shortcut=True, remedy=remedy, without=without)


def _share_changed(material: Material, changed: Spikes) -> float:
    """Return the difference of the counts per bin and region, as a share of the spikes of both."""
    samples = np.concatenate([material.train, material.validation])
    before, after = (material.counts(samples, BINS, spikes=x) for x in (None, changed))
    both = before.sum() + after.sum()
    return float(np.abs(before - after).sum() / both) if both else 0.0


def _read(material: Material, spikes: Spikes) -> Score:
    """Return what the better reader of counts over time reaches on other spikes of the same windows."""
    reader = material.best.reader
    x, query = (material.seen(reader, part, spikes=spikes) for part in (material.train, material.validation))
    return material.score(reader, COUNT_READERS[reader](x, material.codes, query))


def _before_contact(material: Material) -> list[AuditRow]:
    """Return the row of the step of contact and the spikes before it.

    There is none where windows begin at contact, or where it is not quieter before.
    """
    train, validation = (_contact(material, samples) for samples in (material.train, material.validation))
    step, before, after = train.T
    quiet = before.sum() <= QUIET * after.sum()
    if material.at_contact or not quiet or not np.ptp(step):
        return []
    score = best_of_readers(material, train[:, :2], validation[:, :2])
    verdict = f"the step of contact, and the spikes before, explain {weight_of(material, score)}"
    shortcut, remedy = is_shortcut(material, score), "window.at: contact_onset"
    return [material.row("before contact", score, verdict, shortcut=shortcut, remedy=remedy)]


def _contact(material: Material, samples: Ints) -> Floats:
    """Return the step of contact, and the spikes per step before it and from it on, (samples, 3).

    Contact is the first step with `contact_events` spikes; the end of the window where there is none.
    """
    data = material.dataset
    spikes = spikes_per_step(data.spikes, samples, data.start[samples], data.n_steps)
    touched = spikes >= material.contact_events
    step = np.where(touched.any(axis=1), touched.argmax(axis=1), data.n_steps)
    before = (spikes * (np.arange(data.n_steps) < step[:, None])).sum(axis=1)
    after = spikes.sum(axis=1) - before
    rates = before / np.maximum(step, 1), after / np.maximum(data.n_steps - step, 1)
    return np.stack([step, *rates], axis=1).astype(np.float64)
