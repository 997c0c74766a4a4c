"""Racing: which trainings may stop at a rung, since nothing that they may still become is on the front.

What a training gains from a rung to its end is predicted from the finished trainings of the study, per
objective, on a scale on which gains are alike: log-odds of an accuracy, logarithm of a cost. With x at the
rung and y at the end (larger is better),

    y - x = a + b x + noise        by least squares,

the gain of another training is at most  a + b x + t s sqrt(1 + 1/n + (x - mean)^2 / Sxx),  the upper end of
the prediction interval (Student's t, n - 2 degrees of freedom), but counted as 0 where that is less. The
residuals s hold what differs between designs and the noise of few recordings, at the rung and at the end; the
third term grows for designs unlike those that have finished. Fewer than `LEAST` of these predict nothing.

Source: prediction interval of a linear regression, e.g. Seber and Lee, Linear Regression Analysis, 2003, 5.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dse.records import Bools, Floats

LEAST = 8
"""Finished trainings without which no gain is predicted."""
_CELLS = 1 << 21


@dataclass(frozen=True)
class Scale:
    """How an objective is compared: larger is better, and gains are alike everywhere.

    kind: 'odds', 'log' or 'plain'. sign: 1 to maximise, -1 to minimise.
    end: least distance of odds from 0 and 1.
    """

    kind: str
    sign: int
    end: float = 0.0

    @classmethod
    def of(cls, values: Floats, direction: str, end: float) -> Scale:
        """Return the scale of an objective from values of it.

        Args:
            values: finite.
            direction: 'max' or 'min'.
            end: least distance of odds from 0 and 1, half a recording.
        """
        if direction == "max" and values.size and values.min() >= 0 and values.max() <= 1:
            return cls("odds", 1, end)
        return cls("log" if (values > 0).all() else "plain", 1 if direction == "max" else -1)

    def to(self, values: Floats) -> Floats:
        """Return values on the scale; those that have no place on it are NaN."""
        values = np.asarray(values, np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.kind == "odds":
                share = np.clip(values, self.end, 1 - self.end)
                return np.asarray(np.log(share) - np.log1p(-share))
            return np.asarray(self.sign * (np.log(values) if self.kind == "log" else values))

    def back(self, scaled: Floats) -> Floats:
        """Return the values of places on the scale."""
        if self.kind == "odds":
            return np.asarray(1 / (1 + np.exp(-scaled)))
        return np.asarray(np.exp(self.sign * scaled) if self.kind == "log" else self.sign * scaled)


def most_gain(at_rung: Floats, at_end: Floats, x: Floats, confidence: float) -> Floats:
    """Return what trainings at x gain at most by the end, (k,); infinite while too few have finished.

    Args:
        at_rung: (n,) finished trainings at the rung, on a `Scale`.
        at_end: (n,) the same at their ends.
        x: (k,) trainings at the rung.
        confidence: probability that a gain is not larger.
    """
    from scipy.special import stdtrit

    n = len(at_rung)
    if n < LEAST:
        return np.full(len(x), math.inf)
    gain, centred = at_end - at_rung, at_rung - at_rung.mean()
    spread = float(centred @ centred)
    slope = float(centred @ gain) / spread if spread > 0 else 0.0
    residual = gain - gain.mean() - slope * centred
    free = n - 2 if spread > 0 else n - 1
    error = math.sqrt(float(residual @ residual) / free)
    away = x - at_rung.mean()
    unlike = away**2 / spread if spread > 0 else np.where(away == 0, 0.0, math.inf)
    with np.errstate(invalid="ignore"):
        most = gain.mean() + slope * away + stdtrit(free, confidence) * error * np.sqrt(1 + 1 / n + unlike)
    return np.asarray(np.maximum(np.nan_to_num(most, nan=0.0, posinf=math.inf), 0.0))


def is_certain(at_rung: Floats, at_end: Floats) -> bool:
    """Return whether an objective never changed after the rung, such as a number of weights."""
    return bool(np.array_equal(at_rung, at_end))


def covered(points: Floats, front: Floats) -> Bools:
    """Return which points (k, d) a row of a front (n, d) dominates: as good everywhere, better in one goal.

    Larger is better.
    """
    dominated = np.zeros(len(points), bool)
    step = max(1, _CELLS // max(1, front.size))
    for first in range(0, len(points), step):
        ahead = points[first : first + step, None, :] - front[None]
        by_row = np.all(ahead <= 0, axis=2) & np.any(ahead < 0, axis=2)
        dominated[first : first + step] = np.any(by_row, axis=1)
    return dominated


def evenly(ranked: Sequence[int], n: int) -> list[int]:
    """Return n of some numbers, spread evenly over their order, the first and the last among them."""
    if len(ranked) <= n:
        return list(ranked)
    return [ranked[i] for i in dict.fromkeys(np.linspace(0, len(ranked) - 1, n).round().astype(int).tolist())]
