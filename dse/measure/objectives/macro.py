"""Recall, precision and their harmonic mean F1 of each class, averaged over the classes.

    recall_c = n_cc / sum_r n_cr        precision_c = n_cc / sum_l n_lc
    F1_c = 2 n_cc / (sum_r n_cr + sum_l n_lc)           n_lr samples of class l that were answered r

The mean is over the classes that have samples. A class that has samples and is never answered has precision 0
(0 / 0); a class without samples has no recall and is left out of all three means.

Source: Brayshaw et al., real-time texture classification, section IV.A (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dse.measure.objectives import FullReadOut
from dse.registry import Column, register


class Macro(NamedTuple):
    """Means over the classes."""

    recall: float
    precision: float
    f1: float


@register("objectives", "macro")
@dataclass(frozen=True)
class MacroMeans:
    """Macro recall, precision and F1 of the full read-out, of the validation set and of the test set."""

    needs = "full_read_out"
    columns = (
        Column("recall_macro", "", "max", "Recall, mean over the classes."),
        Column("precision_macro", "", "max", "Precision, mean over the classes; 0 for one never answered."),
        Column("f1_macro", "", "max", "F1, mean over the classes."),
        Column("recall_macro_test", "", "max", "Macro recall on the test set.", selects=False),
        Column("precision_macro_test", "", "max", "Macro precision on the test set.", selects=False),
        Column("f1_macro_test", "", "max", "Macro F1 on the test set.", selects=False),
    )

    def measure(self, answer: FullReadOut) -> Mapping[str, float]:
        of_test = answer.confusion_test
        return _columns(answer.confusion, "") | ({} if of_test is None else _columns(of_test, "_test"))


def macro(confusion: ArrayLike) -> Macro:
    """Return recall, precision and F1, mean over the classes that have samples; NaN without samples.

    Args:
        confusion: (true class, answered class) counts; further columns hold answers that are no class.

    Raises:
        ValueError: not a matrix with a column for each class, or a count that is negative or no number.
    """
    counts = np.asarray(confusion, dtype=np.float64)
    if counts.ndim != 2 or counts.shape[1] < counts.shape[0] or not (counts >= 0).all():
        raise ValueError(f"confusion must be a matrix of counts >= 0, got shape {counts.shape}")
    right, true, answered = np.diag(counts), counts.sum(axis=1), counts.sum(axis=0)[: len(counts)]
    among = true > 0
    if not among.any():
        return Macro(np.nan, np.nan, np.nan)
    right, true, answered = right[among], true[among], answered[among]
    precision = np.divide(right, answered, out=np.zeros_like(right), where=answered > 0)
    means = ((right / true).mean(), precision.mean(), (2 * right / (true + answered)).mean())
    return Macro(*map(float, means))


def _columns(confusion: ArrayLike, suffix: str) -> dict[str, float]:
    return {f"{name}_macro{suffix}": x for name, x in macro(confusion)._asdict().items()}
