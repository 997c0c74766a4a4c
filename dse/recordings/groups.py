"""Groups that training leaves out in turn: which values go together, and what is left without them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dse import seeds
from dse.config.faults import known_names
from dse.config.resolved import LeftOut
from dse.config.settings import Groups
from dse.recordings import RecordingError
from dse.recordings.splits import dealt
from dse.records import Array, Ints


def folds(
    columns: Mapping[str, Array], groups: Groups, codes: Ints, train: Ints, validation: Ints
) -> list[LeftOut]:
    """Return the folds of a label column, each with values of its own, in the order of their first values.

    The values are those of validation recordings. Folds of several values have near equal shares of every
    class of the validation recordings (`splits.dealt`); they follow from the seed and the labels.

    Args:
        columns: label columns, each (n,).
        groups: settings.
        codes: (n,) class of every recording.
        train: indices of the training recordings.
        validation: indices of the validation recordings.

    Raises:
        RecordingError: an unknown column, or fewer values than folds.
    """
    name = groups.column
    if name not in columns:
        raise RecordingError(
            f"evaluation.leave_out: no column '{name}' among data.columns; {known_names(name, columns)}"
        )
    labels = columns[name][validation]
    values, number = np.unique(labels, return_inverse=True)
    n = groups.folds or max(2, len(values))
    if len(values) < n:
        raise RecordingError(
            f"evaluation.leave_out: column '{name}' must have at least {n} values in validation, "
            f"got {len(values)}"
        )
    fold = np.arange(len(values))
    if groups.folds is not None:
        rng = seeds.generator(groups.seed, {}, f"left out {name}")
        fold[number] = dealt(codes[validation], number, [1 / n] * n, rng)
    members = [tuple(values[fold == k].tolist()) for k in np.unique(fold)]
    return [LeftOut(name, x) for x in sorted(members)]


def without(
    columns: Mapping[str, Array], left_out: LeftOut, train: Ints, validation: Ints
) -> tuple[Ints, Ints, Ints]:
    """Return the training and validation recordings outside a fold, and the validation recordings in it."""
    values = columns[left_out.column]
    held = np.isin(values, np.asarray(left_out.values, values.dtype))
    return train[~held[train]], validation[~held[validation]], validation[held[validation]]


def fault(
    columns: Mapping[str, Array],
    left_out: LeftOut,
    codes: Ints,
    classes: tuple[str, ...],
    train: Ints,
    validation: Ints,
) -> str:
    """Return a sentence if a fold's absence leaves a class untrained; '' if not."""
    rest, _, _ = without(columns, left_out, train, validation)
    lacking = np.setdiff1d(codes[train], codes[rest])
    if not lacking.size:
        return ""
    names = ", ".join(f"'{classes[code]}'" for code in lacking)
    return (
        f"evaluation.leave_out: without {left_out.column} {left_out.name} there is no training recording of "
        f"class {names}"
    )
