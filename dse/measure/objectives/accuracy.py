"""Accuracy and its standard error: Wilson for one run, the spread of the runs for several."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dse.base.records import Floats
from dse.base.registry import Column, register
from dse.measure.objectives import Points


@register("objectives", "accuracy")
@dataclass(frozen=True)
class Accuracy:
    """Fraction of samples that are answered correctly."""

    needs = "points"
    columns = (
        Column("accuracy", "", "max", "Fraction of samples answered correctly."),
        Column(
            "accuracy_se",
            "",
            "min",
            "Standard error of the accuracy: over seeds or folds, Wilson for a single run.",
        ),
        Column("accuracy_strict", "", "max", "Accuracy where undecided samples count as wrong."),
        Column(
            "accuracy_test",
            "",
            "max",
            "Accuracy on the test set, which selection never sees.",
            selects=False,
        ),
    )

    def measure(self, points: Points) -> Mapping[str, Floats]:
        n = points.n_samples
        columns = {"accuracy": points.accuracy, "accuracy_se": wilson_se(np.rint(points.accuracy * n), n)}
        if points.decisions is not None:
            columns["accuracy_strict"] = points.decisions.accuracy_strict
        if points.accuracy_test is not None:
            columns["accuracy_test"] = points.accuracy_test
        return columns


def wilson_se(k: ArrayLike, n: ArrayLike) -> Floats:
    """Return the standard error of k successes in n: half the Wilson score interval at z = 1.

        sqrt(p (1 - p) / n + 1 / (4 n^2)) / (1 + 1 / n),  p = k / n

    Unlike sqrt(p (1 - p) / n) it is not zero where every answer is right.

    Source: Wilson, J. Am. Stat. Assoc. 22, 1927.

    Args:
        k: successes, 0 <= k <= n, any shape.
        n: trials, >= 1, broadcast against k.

    Raises:
        ValueError: counts out of range.
    """
    successes, trials = np.asarray(k, dtype=np.float64), np.asarray(n, dtype=np.float64)
    if not ((trials >= 1) & (successes >= 0) & (successes <= trials)).all():
        raise ValueError(f"counts must be 0 <= k <= n with n >= 1, got k = {successes}, n = {trials}")
    p = successes / trials
    return np.asarray(np.sqrt(p * (1 - p) / trials + 0.25 / trials**2) / (1 + 1 / trials))


def wilson_interval(p: ArrayLike, n: ArrayLike, z: float) -> tuple[Floats, Floats]:
    """Return the ends of the Wilson score interval of a fraction p of n, z standard errors to each side.

    Source: Wilson, J. Am. Stat. Assoc. 22, 1927.
    """
    fraction, share = np.asarray(p, dtype=np.float64), z**2 / np.asarray(n, dtype=np.float64)
    middle = (fraction + share / 2) / (1 + share)
    half = np.sqrt(fraction * (1 - fraction) * share + share**2 / 4) / (1 + share)
    return np.asarray(middle - half), np.asarray(middle + half)


def seeds_se(values: ArrayLike) -> Floats:
    """Return the standard error of the mean over seeds or folds: s / sqrt(r), s with r - 1.

    Args:
        values: (run, ...), two runs or more.

    Returns:
        (...,).

    Raises:
        ValueError: fewer than two runs.
    """
    runs = np.asarray(values, dtype=np.float64)
    if runs.ndim < 1 or len(runs) < 2:
        raise ValueError(f"values must be at least two runs, got shape {runs.shape}")
    spread = runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    return np.where(np.ptp(runs, axis=0) == 0, 0.0, spread)  # a mean that is rounded would leave a trace
