"""What a confusion matrix says of the full read-out: means over the classes, and information in bits.

    recall_c = n_cc / sum_r n_cr        precision_c = n_cc / sum_l n_lc
    F1_c = 2 n_cc / (sum_r n_cr + sum_l n_lc)           n_lr samples of class l that were answered r

The mean is over the classes that have samples. A class that has samples and is never answered has precision 0
(0 / 0); a class without samples has no recall and is left out of all three means.

    I(R; L) = sum over classes L and answers R of p(R|L) p(L) log2 (p(R|L) / p(R))

with the probabilities of the confusion matrix; 0 log 0 = 0. It is log2 n for n classes that are equally
frequent and always right, and 0 where the answer does not depend on the class. Few samples bias it upwards,
by about (n - 1)^2 / (2 N ln 2) bits for N samples of an answer that says nothing.

Sources: Brayshaw et al., real-time texture classification, section IV.A; Rasouli et al., an extreme learning
machine for texture recognition, Eq. (11) (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dse.base.registry import Column, register
from dse.measure.objectives import FullReadOut


class Macro(NamedTuple):
    """Means over the classes."""

    recall: float
    precision: float
    f1: float


@register("objectives", "recognition")
@dataclass(frozen=True)
class Recognition:
    """Macro means of the validation and of the test set, and information per answer and second of touch."""

    needs = "full_read_out"
    columns = (
        Column("recall_macro", "", "max", "Recall, mean over the classes."),
        Column("precision_macro", "", "max", "Precision, mean over the classes; 0 for one never answered."),
        Column("f1_macro", "", "max", "F1, mean over the classes."),
        Column("recall_macro_test", "", "max", "Macro recall on the test set.", selects=False),
        Column("precision_macro_test", "", "max", "Macro precision on the test set.", selects=False),
        Column("f1_macro_test", "", "max", "Macro F1 on the test set.", selects=False),
        Column(
            "itr_bits",
            "bit",
            "max",
            "Information about the class per prediction; NaN without samples.",
        ),
        Column(
            "itr_bits_per_s",
            "bit/s",
            "max",
            "Information per second of touch: bits per prediction divided by the decision time.",
        ),
    )

    def measure(self, answer: FullReadOut) -> Mapping[str, float]:
        columns: dict[str, float] = {}
        for matrix, end in ((answer.confusion, ""), (answer.confusion_test, "_test")):
            if matrix is not None:
                columns |= {f"{name}_macro{end}": x for name, x in macro(matrix)._asdict().items()}
        bits = itr_bits(answer.confusion)
        of_time = itr_bits_per_s(bits, answer.decision_latency_ms)
        return columns | {"itr_bits": bits, "itr_bits_per_s": of_time}


def macro(confusion: ArrayLike) -> Macro:
    """Return recall, precision and F1, mean over the classes that have samples; NaN without samples.

    Args:
        confusion: (true class, answered class) counts; further columns hold answers that are no class.
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


def itr_bits(confusion: ArrayLike) -> float:
    """Return the information about the class per prediction; NaN without samples.

    Args:
        confusion: (true class, answered class) counts; classes without samples do not matter.
    """
    counts = np.asarray(confusion, dtype=np.float64)
    if counts.ndim != 2 or not (np.isfinite(counts) & (counts >= 0)).all():
        raise ValueError(f"confusion must be a matrix of counts >= 0, got shape {counts.shape}")
    n = counts.sum()
    if n == 0:
        return float("nan")
    joint = counts / n
    independent = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0, keepdims=True)
    seen = joint > 0
    bits = float((joint[seen] * np.log2(joint[seen] / independent[seen])).sum())
    return max(0.0, bits)  # rounding may leave less than nothing


def itr_bits_per_s(bits: float, decision_ms: float) -> float:
    """Return the information per second of touch: bits of an answer over the time that it takes.

    Args:
        bits: per answer; NaN stays NaN.
        decision_ms: mean time of the decision.
    """
    if not decision_ms > 0:
        raise ValueError(f"decision_ms must be > 0, got {decision_ms}")
    return bits * 1000 / decision_ms
