"""Columns of what accuracies are expected to be on other recordings: `accuracy_corrected`, with an interval.

Validation recordings are few, and designs are chosen for their accuracy on them: the best of many trials and
of many settings of one trial owes part of it to luck. What is expected of a point given its accuracy and
those of all points of its task (`dse.skyline.posterior.expected`) needs no correction for having been chosen,
whatever the budgets. What it cannot know is whether these recordings are easier than others for all designs;
the interval includes that. Of points that measured the same, those count for less that the settings beside
them support least (`unsupported`): the best of many is where luck peaks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dse.base.records import Array, Bools, Floats

if TYPE_CHECKING:
    import pandas

    from dse.config import SearchSpace
    from dse.study.record import RunRecord

ACCURACIES = ("accuracy", "accuracy_strict", "accuracy_shifted", "accuracy_shifted_min")
"""Accuracies on the validation recordings."""

Z = 1.645
"""Standard errors on each side of the shown value: an interval of 90 %."""

_PARTS = 1000  # accuracies that are closer than one of them count as equal
_DECIMALS = 6  # the last bits of an exponential differ between processors

_LOST = 0.05
"""Of what no neighbour supports, what is taken away: enough to order equal accuracies, and no more."""
_KERNEL = np.array([1, 8, 28, 56, 70, 56, 28, 8, 1]) / 256
"""Weights of a setting and of four on either side: binomial, as wide as a Gaussian of 1.4 settings."""

Part = Mapping[str, Array]
Key = tuple[str, str, int, int]
"""Column, group, number of answers, and accuracy in parts of `_PARTS`."""


class Asked(NamedTuple):
    """How many recordings the accuracies of a trial are of; 0 where it is not known.

    Repeats answer the same recordings again, and every fold of a cross-validation has its own. Luck between
    designs is that of all answers; whether the recordings are easy is that of the recordings.
    """

    recordings: int
    answers: int


def corrected_of(name: str) -> tuple[str, str, str]:
    """Return the columns of a corrected accuracy: its value, and the ends of its interval."""
    return f"{name}_corrected", f"{name}_corrected_low", f"{name}_corrected_high"


def lacking(rows: pandas.DataFrame, names: Iterable[str]) -> list[str]:
    """Return a note on every corrected accuracy that points lack.

    Args:
        rows: points, of a study or of any table.
        names: columns, of which accuracies are corrected.
    """
    notes = []
    for name in [name for name in ACCURACIES if name in set(names) and name in rows]:
        column = corrected_of(name)[0]
        if column not in rows or (rows[name].notna() & rows[column].isna()).any():
            notes.append(
                f"no {column}: a table does not say how many recordings its {name} is of; a study does "
                "(one of an earlier version has the column after `dse run`)"
            )
    return notes


def names(space: SearchSpace) -> list[str]:
    """Return the accuracies of a study that are corrected: `accuracy`, and those among the objectives."""
    objectives = {name for name, _ in space.objectives}
    return [name for name in ACCURACIES if name == "accuracy" or name in objectives]


def asked(space: SearchSpace, trials: Mapping[int, Sequence[RunRecord]]) -> dict[int, Asked]:
    """Return what the accuracies of each trial are of."""
    k = 1 if space.split.k_fold is None else space.split.k_fold.k
    sizes = {t: [x.samples.get("validation", 0) for x in runs] for t, runs in trials.items()}
    return {trial: Asked(sum(n[:k]), sum(n)) for trial, n in sizes.items()}


def tally(part: Part, names: Sequence[str], of: Mapping[int, Asked]) -> Counter[Key]:
    """Return how often some points of a trial have each accuracy."""
    counted: Counter[Key] = Counter()
    n = of[int(part["trial"][0])].answers
    for name, group, rows in _groups(part, names, n):
        values, times = np.unique(_rounded(part[name][rows]), return_counts=True)
        counted.update({(name, group, n, int(x)): int(k) for x, k in zip(values, times, strict=True)})
    return counted


def values(counted: Mapping[Key, int]) -> dict[Key, float]:
    """Return what each accuracy of a tally is expected to be on other recordings."""
    from dse.skyline.posterior import expected

    found: dict[Key, float] = {}
    for group in dict.fromkeys(key[:2] for key in counted):
        keys = sorted(key for key in counted if key[:2] == group)
        n, accuracy, number = np.array([[key[2], key[3] / _PARTS, counted[key]] for key in keys]).T
        found |= dict(zip(keys, expected(accuracy, n, number).tolist(), strict=True))
    return found


def with_corrected(
    part: Part, names: Sequence[str], of: Mapping[int, Asked], known: Mapping[Key, float]
) -> dict[str, Array]:
    """Return columns of points with those of corrected accuracies; NaN where recordings are not known.

    Args:
        part: columns of points of one trial.
        names: accuracies that are corrected.
        of: trial -> what its accuracies are of.
        known: `values` of the tally of all points.
    """
    from dse.measure.objectives.accuracy import wilson_interval

    n_recordings, n = of[int(part["trial"][0])]
    nothing = np.full((3, len(part["trial"])), np.nan)
    columns = {name: nothing.copy() for name in names if name in part}
    for name, group, rows in _groups(part, names, n):
        measured = part[name][rows].astype(np.float64)
        places = _rounded(measured)
        luck = {x: x / _PARTS - known[name, group, n, x] for x in np.unique(places).tolist()}
        lost = np.array([luck[x] for x in places.tolist()])
        # Bad luck is not credited: what a tight budget leaves may be no better than it looks.
        lost = np.maximum(lost, 0.0) + _LOST * unsupported(part, name, rows, n)
        value = np.where(lost > 0, (measured - lost).clip(0.0).round(_DECIMALS), measured)
        low, high = wilson_interval(value, n_recordings, Z)
        if part["repeats"][0] > 1 and f"{name}_se" in part:  # seeds may matter more than recordings
            error = Z * np.nan_to_num(part[f"{name}_se"][rows].astype(np.float64))
            low, high = np.minimum(low, value - error), np.maximum(high, value + error)
        columns[name][:, rows] = value, np.maximum(low, 0.0), np.minimum(high, 1.0)
    added = {
        column: x
        for name, ends in columns.items()
        for column, x in zip(corrected_of(name), ends, strict=True)
    }
    return {**part, **added}


def unsupported(part: Part, name: str, rows: Bools, n: int) -> Floats:
    """Return by how much accuracies of a trial's points exceed what settings beside theirs support, (row,).

        min(1, e / v) max(0, m - s)

    m is what was measured and s the mean of m and its neighbours' (`_KERNEL`), over read-outs in the order
    of time, and over phi and theta. v is the mean square of m - s over the settings, e that of binomial
    errors: where accuracy changes faster than errors explain, more is supported.

    Args:
        part: columns of points of one trial on one chip.
        name: of the accuracy.
        rows: (point,) which points.
        n: recordings that it is of.
    """
    measured = part[name][rows].astype(np.float64)
    phi, theta, read_out, *others = (
        part[key][rows].astype(np.float64) if key in part else np.full(len(measured), np.nan)
        for key in ("phi", "theta", "read_out_ms", "weight_bits", "pruned_after")
    )
    excess = np.zeros(len(measured))
    kinds = np.nan_to_num(np.stack([np.isnan(phi), *others]), nan=-1)
    _, kind = np.unique(kinds, axis=1, return_inverse=True)
    for one in range(kind.max(initial=-1) + 1):
        here = np.flatnonzero(kind.ravel() == one)
        here = here[np.lexsort((theta[here], phi[here], read_out[here]))]  # NaN, the whole window, last
        m, n_theta = measured[here], len(np.unique(theta[here]))  # of read-outs all are NaN: one value
        grid = m.reshape(-1, n_theta) if len(m) % n_theta == 0 else m[:, None]
        above = m - _smooth(_smooth(grid).T).T.ravel()
        bends, error = float((above**2).mean()), float((m * (1 - m)).mean()) / n
        excess[here] = np.maximum(above, 0.0) * (min(1.0, error / bends) if bends else 0.0)
    return excess


def _smooth(values: Floats) -> Floats:
    """Return means with what lies beside along the first axis; beyond its ends lies what is there."""
    half = len(_KERNEL) // 2
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    return np.asarray(sum(w * padded[k : k + len(values)] for k, w in enumerate(_KERNEL)))


def _groups(part: Part, names: Sequence[str], n: int) -> Iterator[tuple[str, str, Array]]:
    """Yield accuracy, group, and which points of the group have this accuracy, (row,).

    A group is a task; points that have seen their labels are one of their own.
    """
    groups = part["task"].astype(str)
    if "transductive" in part:
        groups = np.where(part["transductive"].astype(bool), np.char.add(groups, " (seen)"), groups)
    for name in names if n else ():
        if name in part:
            is_known = np.isfinite(part[name].astype(np.float64))
            for group in np.unique(groups[is_known]).tolist():
                yield name, group, is_known & (groups == group)


def _rounded(accuracy: Floats) -> Array:
    return np.rint(_PARTS * accuracy.astype(np.float64)).astype(np.int64)
