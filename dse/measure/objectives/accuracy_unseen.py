"""Accuracy on groups of recordings, such as a force or a fabric, that training left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats
from dse.base.registry import Column, register
from dse.measure.objectives import FullReadOut, flat
from dse.measure.objectives.accuracy import seeds_se

Unseen = Mapping[str, Mapping[str, float]]
"""Label column -> fold of its values -> accuracy of a net that was trained without the fold."""


@register("objectives", "accuracy_unseen")
@dataclass(frozen=True)
class AccuracyUnseen:
    """Accuracy on groups that training leaves out (`evaluation.leave_out`)."""

    needs = "full_read_out"
    columns = (
        Column(
            "accuracy_unseen",
            "",
            "max",
            "Accuracy on groups without training recordings (evaluation.leave_out), mean over the folds; of "
            "several label columns, mean over these.",
            of_section="evaluation.leave_out",
        ),
        Column(
            "accuracy_unseen_se",
            "",
            "min",
            "Standard error of accuracy_unseen over the folds.",
            of_section="evaluation.leave_out",
        ),
    )

    def measure(self, answer: FullReadOut) -> Mapping[str, float]:
        columns = flat(unseen_columns(as_arrays(answer.unseen)))
        return {column.name: columns[column.name] for column in self.columns if columns}


def unseen_name(number: int) -> str:
    """Return the name of an array of accuracies of a fold, by its number among the folds of `unseen`."""
    return f"unseen/{number}"


def as_arrays(unseen: Unseen) -> dict[str, dict[str, Floats]]:
    """Return accuracies of one point as arrays without axes."""
    return {column: {fold: np.asarray(x) for fold, x in of.items()} for column, of in unseen.items()}


def merged(runs: Sequence[Mapping[str, Mapping[str, Floats]]]) -> dict[str, dict[str, Floats]]:
    """Return the accuracies of all runs of a design: of each fold, the mean over the runs that trained it.

    Args:
        runs: of each, label column -> fold -> accuracies (...), a number per design point.
    """
    of_columns: dict[str, dict[str, Floats]] = {}
    for column in dict.fromkeys(column for run in runs for column in run):
        parts = [run[column] for run in runs if column in run]
        folds = dict.fromkeys(fold for part in parts for fold in part)
        of_columns[column] = {
            fold: np.mean([part[fold] for part in parts if fold in part], axis=0) for fold in folds
        }
    return of_columns


def unseen_columns(unseen: Mapping[str, Mapping[str, Floats]]) -> dict[str, Floats]:
    """Return accuracy_unseen, accuracy_unseen_NAME of each label column, and their errors, (...) each.

        accuracy_unseen_NAME = mean over the folds,  se = s / sqrt(folds);  NaN with one fold
        accuracy_unseen      = mean over the m label columns,  se = sqrt(sum of se^2) / m

    Args:
        unseen: label column -> fold -> accuracies (...); empty where nothing is left out: no columns.
    """
    if not unseen:
        return {}
    columns: dict[str, Floats] = {}
    means, errors = [], []
    for name, folds in unseen.items():
        values = np.array(list(folds.values()), np.float64)
        means.append(values.mean(axis=0))
        errors.append(seeds_se(values) if len(values) > 1 else np.full(values.shape[1:], np.nan))
        columns |= {f"accuracy_unseen_{name}": means[-1], f"accuracy_unseen_{name}_se": errors[-1]}
    error = np.sqrt(np.square(errors).sum(axis=0)) / len(errors)
    return {"accuracy_unseen": np.mean(means, axis=0), "accuracy_unseen_se": error} | columns
