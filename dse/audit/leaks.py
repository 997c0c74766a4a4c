"""Evaluations that have seen their answers: windows with common steps, and encoders that read labels."""

from __future__ import annotations

import numpy as np

from dse.audit.material import Material
from dse.audit.readers import NEAREST, classes_of, nearest
from dse.audit.rows import AuditRow
from dse.recordings.splits import NUMBER, ORIGINAL

PROBE = "label leak"


def rows(material: Material) -> list[AuditRow]:
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
