"""How a sample was recorded: twins and groups that training has met, and answers that it has seen.

A column whose every value has one class (a session that recorded one fabric) may stand for the class; a
column that crosses the classes (force) is a condition that a classifier should generalise over.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dse.base.records import Array, Bools, Ints
from dse.config.resolved import LeftOut
from dse.config.settings import Groups
from dse.data.recordings.splits import NUMBER, ORIGINAL, folds, shared_reach, without
from dse.study.audit.material import Material
from dse.study.audit.numbers import best_of_readers
from dse.study.audit.readers import NEAREST, TREES, classes_of, nearest, trees
from dse.study.audit.rows import HALF, AuditRow, is_above, is_above_rate, is_lower, loss, percent

MOST_FOLDS = 8
"""Values that are left out one by one; of more values, `FOLDS` groups of them."""
FOLDS = 5


def rows(material: Material) -> list[AuditRow]:
    """Return the rows of twins, of a leak, and of the label columns."""
    return [*_twins(material), *_leaks(material), *_groups(material)]


def _groups(material: Material) -> list[AuditRow]:
    """Return a row per label column that neither the target nor the split reads."""
    audit = []
    for name, values in material.columns.items():
        if name in (*material.target_columns, *material.split_columns, NUMBER):
            continue
        n_values = len(np.unique(values[material.train]))
        if n_values < 2:
            continue
        if n_values * FEW <= len(material.train):
            audit.append(_group(material, name, values))
        elif values.dtype.kind in "iuf":
            audit.append(_order(material, name, values))
    return audit


def _group(material: Material, name: str, values: Array) -> AuditRow:
    """Return what the better reader of counts over time reaches on values that training has not met."""
    nested = _is_nested(material, values)
    probe = f"identity: {name}" if nested else f"unseen {name}"
    shared = np.isin(values[material.validation], values[material.train])
    if not shared.any():
        verdict = f"training and validation have no value of {name} in common"
        return material.row(probe, material.best, verdict)
    trained = _class_elsewhere(material, values)
    chosen = shared & trained
    if chosen.mean() < HALF:
        return _inseparable(material, name, values)
    before = material.best.of(chosen, material.truth)
    answers = _unseen(material, name)
    after = material.score(before.reader, answers).of(chosen, material.truth)
    shortcut, verdict = loss(
        before, after, is_lower(before.correct, after.correct),
        f"recognition of known {name}", f" on known {name} too", f" on {name} that training has not met",
    )  # fmt: skip
    remedy = f"evaluation: {{leave_out: {name}}}"
    return material.row(probe, before, verdict, shortcut=shortcut, remedy=remedy, without=after)


def _is_nested(material: Material, values: Array) -> bool:
    """Return whether every value of a column has one class in training."""
    _, group = np.unique(values[material.train], return_inverse=True)
    pairs = np.unique(np.stack([group, material.codes], axis=1), axis=0)
    return len(pairs) == len(np.unique(group))


def _class_elsewhere(material: Material, values: Array) -> Bools:
    """Return (validation,) bool: whether training has the sample's class with another value too."""
    known = values[material.train]
    other = values[material.validation][:, None] != known
    return np.asarray((other & (material.truth[:, None] == material.codes)).any(axis=1))


def _inseparable(material: Material, name: str, values: Array) -> AuditRow:
    """Return the row of a column whose values hold whole classes: a look-up answers in place of the label."""
    known, group = np.unique(values[material.train], return_inverse=True)
    frequent = np.array([np.bincount(material.codes[group == k]).argmax() for k in range(len(known))])
    looked_up = values[material.validation]
    place = np.minimum(np.searchsorted(known, looked_up), len(known) - 1)
    guesses = np.where(known[place] == looked_up, frequent[place], -1)
    score = material.score(f"look-up of {name}", guesses)
    shortcut = is_above(score)
    verdict = f"{name} names the class with {score.accuracy:.3f}"
    if shortcut:
        verdict += ", and most classes have one value of it: the two cannot be told apart"
    remedy = f"recordings of each class with several values of {name}, split by them"
    return material.row(f"identity: {name}", score, verdict, shortcut=shortcut, remedy=remedy)


def _unseen(material: Material, name: str) -> Ints:
    """Return the answer to each validation sample of a reader trained without the sample's group."""
    if material.best.reader == NEAREST:
        values = material.columns[name]
        allowed = values[material.validation][:, None] != values[material.train]
        return classes_of(material.codes, nearest(material.distances, allowed))
    x, query = (material.seen(TREES, samples) for samples in (material.train, material.validation))
    answers = np.full(len(material.validation), -1)
    for fold in _folds(material, name):
        rest, _, unseen = without(material.columns, fold, material.train, material.validation)
        trained, unknown = np.isin(material.train, rest), np.isin(material.validation, unseen)
        if trained.any():
            answers[unknown] = trees(x[trained], material.codes[trained], query[unknown])
    return answers


def _folds(material: Material, name: str) -> list[LeftOut]:
    """Return the folds of a column as `evaluation.leave_out` makes them."""
    values = np.unique(material.columns[name][material.validation])
    if len(values) < 2:
        return [LeftOut(name, tuple(values.tolist()))]
    settings = Groups(name, FOLDS if len(values) > MOST_FOLDS else None)
    codes = material.dataset.target
    return folds(material.columns, settings, codes, material.train, material.validation)


def _order(material: Material, name: str, values: Array) -> AuditRow:
    """Return whether a number of every sample, such as the order of trials, tells the class, and shows.

    It shows where the nearest training sample of the same class has a nearer number than half of them.
    """
    number = values.astype(np.float64)[:, None]
    score = best_of_readers(material, number[material.train], number[material.validation])
    tells = is_above(score, readers=3)
    apart = np.abs(number[material.validation] - number[material.train].T)
    same = material.truth[:, None] == material.codes
    chosen = np.flatnonzero(same.any(axis=1))
    place = nearest(material.distances, same)[chosen]
    median = np.nanmedian(np.where(same, apart, np.nan)[chosen], axis=1)
    closer = apart[chosen, place] < median
    shows = is_above_rate(closer, 0.5)
    verdict = (
        f"{name} tells the class with {score.accuracy:.3f}"
        if tells
        else f"{name} tells the class no better than chance"
    )
    verdict += ", and spikes of near numbers are alike" if shows else ", and spikes do not show it"
    remedy = f"a split by blocks of {name}"
    return material.row(f"identity: {name}", score, verdict, shortcut=tells and shows, remedy=remedy)


FEW = 4
"""A column describes conditions where each value has this many samples or more, on average."""


def _conditions(material: Material) -> list[str]:
    """Return the label columns that describe how a sample was recorded, those of the target included.

    Columns that the split reads differ between training and validation by design, and so do numbers of
    recordings.
    """
    return [
        name
        for name, values in material.columns.items()
        if name not in (*material.split_columns, ORIGINAL, NUMBER)
        and len(np.unique(values)) * FEW <= len(values)
    ]


def _twins(material: Material) -> list[AuditRow]:
    """Return the row of twins; none without a label column besides the target."""
    names = _conditions(material)
    others = [name for name in names if name not in material.target_columns]
    if all(len(np.unique(material.columns[name][material.train])) < 2 for name in others):
        return []
    twin = _agree(material, names)
    place = nearest(material.distances)
    is_twin = twin[np.arange(len(place)), place]
    share = float(is_twin.mean())
    same_class = material.truth[:, None] == material.codes
    expected = float(((twin & same_class).sum(axis=1) / np.maximum(same_class.sum(axis=1), 1)).mean())
    before = material.scores[NEAREST]
    without = material.score(NEAREST, classes_of(material.codes, nearest(material.distances, ~twin)))
    shortcut = (
        share >= HALF and is_above_rate(is_twin, expected) and is_lower(before.correct, without.correct)
    )
    labels = ", ".join(names)
    verdict = (
        f"{percent(share)} of the nearest training samples are twins, alike in {labels} ({percent(expected)} "
        "of their class are)"
    )
    remedy = f"evaluation: {{leave_out: {_most_telling(material, others, place)}}}"
    return [material.row("twins", before, verdict, shortcut=shortcut, remedy=remedy, without=without)]


def _agree(material: Material, names: Sequence[str]) -> Bools:
    """Return (validation, train) bool: which samples have the same values of some columns."""
    agree = np.ones((len(material.validation), len(material.train)), bool)
    for name in names:
        values = material.columns[name]
        agree &= values[material.validation][:, None] == values[material.train]
    return agree


def _most_telling(material: Material, names: Sequence[str], place: np.ndarray) -> str:
    """Return the column in which nearest samples agree most, against samples drawn at random."""

    def lift(name: str) -> float:
        agree = _agree(material, [name])
        return float(agree[np.arange(len(place)), place].mean() - agree.mean())

    return max(names, key=lift)


PROBE = "label leak"


def _leaks(material: Material) -> list[AuditRow]:
    """Return the row of a leak, if there is one.

    Where windows have common steps, `without` is the accuracy of nearest neighbours that share none.
    """
    if not material.leak:
        return []
    original, number = material.columns.get(ORIGINAL), material.columns.get(NUMBER)
    reach = shared_reach(material.window)
    if original is None or number is None or not reach:
        return [of_encoder(material)]
    same = original[material.validation][:, None] == original[material.train]
    near = np.abs(number[material.validation][:, None] - number[material.train]) <= reach
    place = nearest(material.distances, ~(same & near))
    without = material.score(NEAREST, classes_of(material.codes, place))
    remedy = f"split by column '{ORIGINAL}', e.g. split.stratified.group: {ORIGINAL}"
    before = material.scores[NEAREST]
    return [material.row(PROBE, before, material.leak, shortcut=True, remedy=remedy, without=without)]


def of_encoder(leaky: Material, honest: Material | None = None) -> AuditRow:
    """Return the row of an encoder that reads labels, beside the best reader of one that does not."""
    without = None if honest is None else honest.best
    remedy = "an encoder that reads no labels"
    return leaky.row(PROBE, leaky.best, leaky.leak, shortcut=True, remedy=remedy, without=without)
