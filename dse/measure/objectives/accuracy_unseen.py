"""Accuracy on groups of recordings, such as a force or a fabric, that training left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dse.measure.objectives import FullReadOut
from dse.measure.objectives.accuracy import seeds_se
from dse.registry import Column, register

Unseen = Mapping[str, Mapping[str, float]]
"""Label column -> fold of its values -> accuracy of a net that was trained without the fold."""


@register("objectives", "accuracy_unseen")
@dataclass(frozen=True)
class AccuracyUnseen:
    """Accuracy of the full read-out on groups that training leaves out (`evaluation.leave_out`)."""

    needs = "full_read_out"
    columns = (
        Column(
            "accuracy_unseen",
            "",
            "max",
            "Accuracy on groups without training recordings (evaluation.leave_out), mean over the folds; of "
            "several label columns, mean over these.",
            of_evaluation="leave_out",
        ),
        Column(
            "accuracy_unseen_se",
            "",
            "min",
            "Standard error of accuracy_unseen over the folds.",
            of_evaluation="leave_out",
        ),
    )

    def measure(self, answer: FullReadOut) -> Mapping[str, float]:
        columns = unseen_columns(answer.unseen)
        return {column.name: columns[column.name] for column in self.columns if columns}


def merged(runs: Sequence[Unseen]) -> Unseen:
    """Return the accuracies of all runs of a design: of each fold, the mean over the runs that trained it."""
    merged: dict[str, dict[str, float]] = {}
    for column in dict.fromkeys(column for run in runs for column in run):
        parts = [run[column] for run in runs if column in run]
        folds = dict.fromkeys(fold for part in parts for fold in part)
        merged[column] = {f: float(np.mean([part[f] for part in parts if f in part])) for f in folds}
    return merged


def unseen_columns(unseen: Unseen) -> dict[str, float]:
    """Return accuracy_unseen, accuracy_unseen_NAME of each label column, and their standard errors.

        accuracy_unseen_NAME = mean over the folds,  se = s / sqrt(folds);  NaN with one fold
        accuracy_unseen      = mean over the m label columns,  se = sqrt(sum of se^2) / m

    Args:
        unseen: empty where nothing is left out, which has no columns.
    """
    columns: dict[str, float] = {}
    for name, folds in unseen.items():
        values = list(folds.values())
        columns[f"accuracy_unseen_{name}"] = float(np.mean(values))
        columns[f"accuracy_unseen_{name}_se"] = float(seeds_se(values)) if len(values) > 1 else math.nan
    if not unseen:
        return {}
    means, errors = list(columns.values())[::2], list(columns.values())[1::2]
    error = math.hypot(*errors) / len(errors)
    return {"accuracy_unseen": float(np.mean(means)), "accuracy_unseen_se": error} | columns
