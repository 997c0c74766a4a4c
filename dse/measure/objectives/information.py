"""Information transfer rate: what an answer tells about the class, in bits.

    I(R; L) = sum over classes L and answers R of p(R|L) p(L) log2 (p(R|L) / p(R))

with the probabilities of the confusion matrix; 0 log 0 = 0. It is log2 n for n classes that are equally
frequent and always right, and 0 where the answer does not depend on the class. Few samples bias it upwards,
by about (n - 1)^2 / (2 N ln 2) bits for N samples of an answer that says nothing.

Source: Rasouli et al., an extreme learning machine for texture recognition, Eq. (11) (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dse.measure.objectives import FullReadOut
from dse.registry import Column, register


@register("objectives", "information")
@dataclass(frozen=True)
class InformationTransfer:
    """Information that an answer carries about the class, per answer and per second of touch."""

    needs = "full_read_out"
    columns = (
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
        bits = itr_bits(answer.confusion)
        return {"itr_bits": bits, "itr_bits_per_s": itr_bits_per_s(bits, answer.decision_latency_ms)}


def itr_bits(confusion: ArrayLike) -> float:
    """Return the information about the class per prediction; NaN without samples.

    Args:
        confusion: (true class, answered class) counts; classes without samples do not matter.

    Raises:
        ValueError: not a matrix, or a count that is negative or no number.
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

    Raises:
        ValueError: the time is not > 0.
    """
    if not decision_ms > 0:
        raise ValueError(f"decision_ms must be > 0, got {decision_ms}")
    return bits * 1000 / decision_ms
