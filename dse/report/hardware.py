"""One study on several chips: which design wins on each, and whether by more than the chip's figures vary.

On a chip, of designs that fit and are within a standard error of the most accurate one that fits, the one
of least energy wins: median over draws of the chip's figures, ties to fewer weights. The winner of another
chip is set against it under the same draws: the ratio of their energies, here, draw by draw.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dse import pricing
from dse.correlation import spearman
from dse.pareto import non_dominated
from dse.records import Array
from dse.report.designs import Found, best, described, full_read_outs
from dse.report.rows import HARDWARE, Row, measured, number, standard_error

if TYPE_CHECKING:
    import pandas

_QUANTILES = (0.5, 0.05, 0.95)


class Ratio(NamedTuple):
    """How many times one design's energy another's is, over draws of a chip's figures.

    median, low, high: with the 5 % and the 95 % quantile.
    share: of the draws in which it is above 1.
    """

    median: float
    low: float
    high: float
    share: float


@dataclass(frozen=True)
class Chip:
    """The designs of a study and task on one chip.

    designs: their full read-outs there, the same designs in the same order on every chip.
    energies_uj: (draw, design), of the same draws for all; NaN where the chip cannot run it.
    fits: (design,) bool, whether the chip can run and hold it.
    """

    name: str
    designs: pandas.DataFrame
    energies_uj: Array
    fits: NDArray[np.bool_]

    @property
    def medians_uj(self) -> Array:
        """Median energy of each design, (design,)."""
        return np.asarray(np.median(self.energies_uj, axis=0))

    def front(self) -> set[int]:
        """Return the trials that no other one that fits beats in both accuracy and median energy."""
        own = np.flatnonzero(self.fits)
        if not own.size:
            return set()
        costs = np.stack([-_accuracies(self.designs), self.medians_uj], axis=1)[own]
        return set(self.designs["trial"].to_numpy()[own[non_dominated(costs)]].tolist())


def on_chips(part: Found, points: pandas.DataFrame) -> tuple[list[Row], list[str]]:
    """Return what wins on each chip and whether fronts differ, and the same in sentences.

    Args:
        part: a study's designs of one task.
        points: its design points on one chip or several; fewer than two leave nothing to say.
    """
    chips = _chips(part, points)
    if len(chips) < 2:
        return [], []
    winners = [winner(part, chip) for chip in chips]
    rows: list[Row] = []
    notes: list[str] = []
    for chip, own in zip(chips, winners, strict=True):
        if own is None:
            notes.append(f"{part.name}, {part.task}: {chip.name}: no design fits")
            continue
        found = _won(part, chip, own)
        told = [_told_winner(part, chip, own)]
        for other, theirs in zip(chips, winners, strict=True):
            if other is not chip and theirs is not None:
                more, verdict = _against(part, chip, own, other.name, theirs)
                found += more
                told.append(verdict)
        rows += [replace(row, hardware=chip.name) for row in found]
        notes.append("; ".join(told))
    more, note = _fronts(part, chips)
    return rows + more, [*notes, note]


def winner(part: Found, chip: Chip) -> int | None:
    """Return which design wins on a chip; None where none fits."""
    if not chip.fits.any():
        return None
    accuracies = _accuracies(chip.designs)
    near = np.flatnonzero(chip.fits & (accuracies >= _least_accuracy(part, chip)))
    keys = (
        chip.designs["trial"].to_numpy()[near],
        -accuracies[near],
        chip.designs["n_weights"].to_numpy(np.float64)[near],
        chip.medians_uj[near],
    )
    return int(near[np.lexsort(keys)[0]])


def _least_accuracy(part: Found, chip: Chip) -> float:
    """Return the accuracy of the best design that fits, less its standard error."""
    top = best(chip.designs[chip.fits])
    assert top is not None  # designs have accuracies, and one fits
    return float(top["accuracy"]) - (standard_error(part, top) or 0.0)


def ratio(energies_uj: Array, other: Array) -> Ratio:
    """Return how many times one design's energy another's is, from both in each draw, (draw,) uJ.

    Two energies of 0 are equal.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(other == energies_uj, 1.0, other / energies_uj)
    median, low, high = np.quantile(ratios, _QUANTILES, method="inverted_cdf")
    return Ratio(float(median), float(low), float(high), float(np.mean(ratios > 1)))


def _chips(part: Found, points: pandas.DataFrame) -> list[Chip]:
    """Return the honest designs of a task on every chip."""
    if "hardware" not in points:
        return []
    rows = full_read_outs(points[points["task"] == part.task])
    rows = rows[~rows["transductive"] & np.isfinite(_accuracies(rows))]
    chips = []
    for name, own in rows.groupby("hardware", sort=False):
        designs = own.sort_values("trial").reset_index(drop=True)
        energies = pricing.energies_uj(part.study.folder, designs, str(name))
        # What counts operations alone has no limits.
        held = designs["fits"].astype("boolean").fillna(True).to_numpy(bool) if "fits" in designs else True
        chips.append(Chip(str(name), designs, energies, held & np.isfinite(energies).all(axis=0)))
    return chips


def _won(part: Found, chip: Chip, own: int) -> list[Row]:
    row = chip.designs.iloc[own]
    columns = ("accuracy", "n_weights", "energy_uj", "latency_ms")
    found = {
        name: measured(part, HARDWARE, f"winner: {name}", None, row, name)
        for name in columns
        if name in row.index
    }
    found["energy_uj"] = _with_range(found["energy_uj"], row)
    return list(found.values())


def _against(part: Found, chip: Chip, own: int, name: str, theirs: int) -> tuple[list[Row], str]:
    """Return what a chip's winner is to the winner of another chip, priced on this one."""
    if theirs == own:
        return [], f"it wins on {name} too"
    mine, row = chip.designs.iloc[own], chip.designs.iloc[theirs]
    them, figure = f"the winner of {name} ({_name(row)})", f"winner of {name}"
    runs, fits = bool(np.isfinite(chip.energies_uj[:, theirs]).all()), bool(chip.fits[theirs])
    less = float(mine["accuracy"] - row["accuracy"])
    se = math.hypot(*(standard_error(part, x) or 0.0 for x in (mine, row)))
    accuracy = measured(part, HARDWARE, f"{figure}: accuracy below", None, row)
    energy = measured(part, HARDWARE, f"{figure}: energy_uj", None, row, "energy_uj")
    rows = [
        replace(accuracy, ours=less, se=se, test=None),
        replace(energy, figure=f"{figure}: fits", ours=float(fits)),
    ]
    if not runs:
        return rows, f"{them} cannot run here"
    found = ratio(chip.energies_uj[:, own], chip.energies_uj[:, theirs])
    times = replace(energy, figure=f"{figure}: energy ratio", ours=found.median)
    share = replace(energy, figure=f"{figure}: share dearer", ours=found.share)
    rows += [_with_range(energy, row), replace(times, low=found.low, high=found.high), share]
    took = f"{_short(found.median)} times the energy ({_short(found.low)} to {_short(found.high)})"
    if not fits:
        return rows, f"{them} does not fit"
    if row["accuracy"] < _least_accuracy(part, chip):
        how = "beyond" if less > se else "within"
        return rows, f"{them} is less accurate by {less:.3g} ± {se:.2g}, {how} the error, at {took}"
    how = "beyond" if found.low > 1 else "within"
    return rows, f"{them} takes {took}, more in {found.share:.0%} of draws, {how} the uncertainty"


def _fronts(part: Found, chips: Sequence[Chip]) -> tuple[list[Row], str]:
    """Return how many designs are on each chip's front, how many on two, and how alike energies rank."""
    fronts = [chip.front() for chip in chips]
    base = Row(HARDWARE, "", part.task, split=part.split, study=part.name)
    rows = []
    told = [f"{chip.name} {len(front)}" for chip, front in zip(chips, fronts, strict=True)]
    for chip, front in zip(chips, fronts, strict=True):
        figure = "designs on the front"
        rows.append(replace(base, figure=figure, ours=float(len(front)), hardware=chip.name))
    for (a, b), (x, y) in zip(combinations(chips, 2), combinations(fronts, 2), strict=True):
        both = np.isfinite(a.medians_uj) & np.isfinite(b.medians_uj)
        alike = number(spearman(a.medians_uj, b.medians_uj))
        shared = f"designs on the front of {b.name} too"
        ranks = f"Spearman of energies, {b.name}, {both.sum()} designs"
        rows.append(replace(base, figure=shared, ours=float(len(x & y)), hardware=a.name))
        rows.append(replace(base, figure=ranks, ours=alike, hardware=a.name))
        differ = "are the same" if x == y else f"share {len(x & y)}"
        told.append(f"{a.name} and {b.name} {differ}")
    return (
        rows,
        f"{part.name}, {part.task}: designs on the fronts of accuracy and energy_uj: {', '.join(told)}",
    )


def _told_winner(part: Found, chip: Chip, own: int) -> str:
    row = chip.designs.iloc[own]
    se = standard_error(part, row)
    median, low, high = np.quantile(chip.energies_uj[:, own], _QUANTILES, method="inverted_cdf")
    accuracy = f"{row['accuracy']:.3g}" + ("" if se is None else f" ± {se:.2g}")
    energy = f"{_short(median)} uJ ({_short(low)} to {_short(high)})"
    design = f"{_name(row)}: {described(row)}" if described(row) else _name(row)
    return f"{part.name}, {part.task}: {chip.name}: {design} wins, accuracy {accuracy}, {energy}"


def _name(row: pandas.Series[Any]) -> str:
    return f"{row['family']}, trial {row['trial']}"


def _short(value: float) -> str:
    return f"{value:.0f}" if 1000 <= value < math.inf else f"{value:.3g}"


def _with_range(found: Row, row: pandas.Series[Any]) -> Row:
    return replace(found, low=number(row.get("energy_uj_low")), high=number(row.get("energy_uj_high")))


def _accuracies(rows: pandas.DataFrame) -> Array:
    return np.asarray(rows["accuracy"], dtype=np.float64)
