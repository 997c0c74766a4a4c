"""Twins, recorded under the same conditions as a validation sample; evaluations that have seen answers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dse.audit.material import Material, percent
from dse.audit.readers import NEAREST, classes_of, nearest
from dse.audit.rows import HALF, AuditRow, is_above_rate, is_lower
from dse.recordings.splits import NUMBER, ORIGINAL
from dse.records import Bools

FEW = 4
"""A column describes conditions where each value has this many samples or more, on average."""


def conditions(material: Material) -> list[str]:
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


def rows(material: Material) -> list[AuditRow]:
    """Return the row of twins; none without a label column besides the target."""
    names = conditions(material)
    others = [name for name in names if name not in material.target_columns]
    if not others or not is_repeated(material, others):
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


def is_repeated(material: Material, names: Sequence[str]) -> bool:
    """Return whether any of some columns has several values."""
    return any(len(np.unique(material.columns[name][material.train])) > 1 for name in names)


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


def leaks(material: Material) -> list[AuditRow]:
    """Return the row of a leak, if there is one.

    Where windows have common steps, `without` is the accuracy of nearest neighbours that share none.
    """
    if not material.leak:
        return []
    original, number = material.columns.get(ORIGINAL), material.columns.get(NUMBER)
    if original is None or number is None or not material.reach:
        return [of_encoder(material)]
    same = original[material.validation][:, None] == original[material.train]
    near = np.abs(number[material.validation][:, None] - number[material.train]) <= material.reach
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
