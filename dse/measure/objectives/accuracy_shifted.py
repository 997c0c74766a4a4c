"""Accuracy on windows at other places of the recordings, which training may never have seen.

A classifier that recalls where along a surface a window lies answers the evaluated window and fails a moved
one. The answers of one recording at several places are not independent: the Wilson standard error of a run
counts recordings, not windows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.base.registry import Column, register
from dse.measure.objectives import Points
from dse.measure.objectives.accuracy import wilson_se

_ERROR = "Standard error of {}: over seeds, Wilson for a single run."


@register("objectives", "accuracy_shifted")
@dataclass(frozen=True)
class AccuracyShifted:
    """Accuracy on windows that are moved by `evaluation.shifts`, without further training."""

    needs = "points"
    columns = tuple(
        Column(name, "", "min" if name.endswith("_se") else "max", doc, of_section="evaluation.shifts")
        for name, doc in (
            ("accuracy_shifted", "Accuracy on moved windows (evaluation.shifts), mean over the shifts."),
            ("accuracy_shifted_se", _ERROR.format("accuracy_shifted")),
            ("accuracy_shifted_min", "Accuracy at the worst of the shifts, of each run its own."),
            ("accuracy_shifted_min_se", _ERROR.format("accuracy_shifted_min")),
            (
                "accuracy_unshifted",
                "Accuracy on the unmoved windows of the recordings that accuracy_shifted is of.",
            ),
            (
                "n_shifted",
                "Validation recordings that have room for every shift, which accuracy_shifted is of.",
            ),
        )
    )

    def measure(self, points: Points) -> Mapping[str, Array]:
        if points.shifted is None or points.unshifted is None:
            return {}
        mean, worst, n = points.shifted.mean(axis=0), points.shifted.min(axis=0), points.n_shifted
        return {
            "accuracy_shifted": mean,
            "accuracy_shifted_se": wilson_se(np.minimum(mean * n, n), n),
            "accuracy_shifted_min": worst,
            "accuracy_shifted_min_se": wilson_se(np.rint(worst * n), n),
            "accuracy_unshifted": points.unshifted,
            "n_shifted": np.full(np.shape(mean), n),
        }
