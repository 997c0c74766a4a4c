"""Where in the recording the window lies: readers that train on the windows of the split meet moved ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dse.base.records import Bools
from dse.data.dataset.shifts import has_room
from dse.study.audit.material import Material
from dse.study.audit.readers import COUNT_READERS, NEAREST, distances, nearest
from dse.study.audit.rows import HALF, AuditRow, Score, is_lower, loss

FRACTIONS = (8, 16, 32)
"""Windows are moved by an eighth of their length, or less where fewer than half of them have room."""
CROPS = 17
"""Positions of each training window, for a reader that has seen crops."""


def usual_shifts(material: Material) -> tuple[int, ...]:
    """Return the shifts of an audit in steps, later and earlier; none where windows have no room."""
    for fraction in FRACTIONS:
        steps = max(1, material.dataset.n_steps // fraction)
        with_room = [
            s for s in (steps, -steps) if has_room(material.dataset, s)[material.validation].mean() >= HALF
        ]
        if with_room:
            return tuple(with_room)
    return ()


def rows(material: Material, shifts: Sequence[int] = ()) -> list[AuditRow]:
    """Return a row per reader, for the usual shifts together; with shifts, one per reader and shift.

    Samples without room for all of the shifts take no part: each row compares the same windows, unmoved and
    moved. Where training windows are moved too, a further reader has seen crops, and meets windows beyond.
    """
    steps = tuple(shifts) or usual_shifts(material)
    room = has_room_for(material, steps)
    if not room.any():
        return []
    audit = []
    for reader in COUNT_READERS:
        after = _moved(material, reader, steps)
        for group in [(s,) for s in steps] if shifts else [steps]:
            audit.append(_row(material, room, material.scores[reader], {s: after[s] for s in group}))
    if material.window.jitter_steps:
        beyond = tuple(shifts) or (furthest(material.window.jitter_steps, material.dataset.n_steps),)
        room = has_room_for(material, beyond)
        if room.any():
            before, after = _of_crops(material, beyond)
            audit += [_row(material, room, before, {s: after[s]}) for s in beyond]
    return audit


def furthest(jitter_steps: int, n_steps: int) -> int:
    """Return a shift just beyond the crops of training."""
    return jitter_steps + max(1, n_steps // 16)


def has_room_for(material: Material, steps: Sequence[int]) -> Bools:
    """Return (validation,) bool: which windows have room for all of the shifts."""
    has = [has_room(material.dataset, s)[material.validation] for s in steps]
    return np.asarray(np.all(has, axis=0)) if has else np.zeros(len(material.validation), bool)


def _row(material: Material, room: Bools, before: Score, after: Mapping[int, Score]) -> AuditRow:
    """Return the row of one reader: before windows are moved, and after, by shift."""
    before = before.of(room, material.truth)
    moved = [score.of(room, material.truth) for score in after.values()]
    every = np.concatenate([score.correct for score in moved])
    mean = Score(before.reader, every, before.chance, repeats=len(moved))
    shortcut, verdict = loss(
        before, mean, all(is_lower(before.correct, score.correct) for score in moved),
        "where in the recording the window lies", ", wherever the window lies",
    )  # fmt: skip
    by = " or ".join(f"{s:+d}" for s in after)
    time_ms = max(map(abs, after)) * material.dataset.spikes.step_ms
    verdict += f" (windows moved by {by} steps, {time_ms:.4g} ms)"
    return material.row(
        "position in time",
        before,
        verdict,
        shortcut=shortcut,
        remedy=f"window.jitter_steps, and evaluation: {{shifts: [{', '.join(map(str, after))}]}}",
        without=mean,
    )


def _moved(material: Material, reader: str, steps: Sequence[int]) -> dict[int, Score]:
    """Return what a reader of the windows of the split answers to moved ones, by shift."""
    x = material.seen(reader, material.train)
    queries = [material.seen(reader, material.validation, s) for s in steps]
    answers = np.split(COUNT_READERS[reader](x, material.codes, np.concatenate(queries)), len(steps))
    return {s: material.score(reader, answer) for s, answer in zip(steps, answers, strict=True)}


def _of_crops(material: Material, steps: Sequence[int]) -> tuple[Score, dict[int, Score]]:
    """Return what nearest neighbours among crops of training answer to unmoved windows, and by shift."""
    most = material.window.jitter_steps
    crops = np.unique(np.linspace(-most, most, CROPS).round().astype(int))
    queries = {s: material.seen(NEAREST, material.validation, s) for s in (0, *steps)}
    least = {s: np.full(len(query), np.inf) for s, query in queries.items()}
    answers = {s: np.full(len(query), -1) for s, query in queries.items()}
    for crop in crops.tolist():
        x = material.seen(NEAREST, material.train, crop)
        for s, query in queries.items():
            squared = distances(x, query)
            nearer = squared.min(axis=1) < least[s]
            answers[s][nearer] = material.codes[nearest(squared)][nearer]
            least[s] = np.minimum(least[s], squared.min(axis=1))
    scores = {s: material.score(f"{NEAREST}, crops", answer) for s, answer in answers.items()}
    return scores[0], {s: scores[s] for s in steps}
