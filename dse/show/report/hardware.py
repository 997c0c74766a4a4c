"""One study on several chips: the cheapest design on each at an accuracy that all reach, and ratios.

On a chip, the designs that fit are candidates; the accuracy is the highest that every chip reaches, less its
error. What is best on one chip alone `dse pick` says, and its rivals with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dse.base.records import Bools, Floats
from dse.measure.hardware.interval import is_open
from dse.measure.objectives.accuracy import wilson_se
from dse.show.report.designs import StudyTask, best, full_read_outs
from dse.show.report.rows import HARDWARE, Row, measured, number
from dse.study import pricing
from dse.study.question import DRAWS

if TYPE_CHECKING:
    import pandas

QUANTILES = (0.5, 0.05, 0.95)

FLAT_OUT, AT_PERIOD = "energy_uj", "energy_throttled_uj"
"""Energies: with all input at once, or with one step per period of the sensor, waiting included."""

_MODES = {FLAT_OUT: "flat out", AT_PERIOD: "at the sensor's period"}

HOW = (
    f"{HARDWARE}: equal accuracy is the highest accuracy that all chips with a fitting design reach, within "
    "±, the larger of the standard error over runs and Wilson's error for the number of recordings; for each "
    "chip the cheapest design of that accuracy is compared; the uncertain numbers of two chips are sampled "
    "independently",
    f"{HARDWARE}: low and high are the ends of an energy interval, or the 5 % and 95 % quantiles of a ratio; "
    "beyond the uncertainty: both quantiles are on one side of 1; the uncertainty is that of the chips' "
    "numbers, not of the activity over runs",
)
"""Explanations of the rows and sentences."""


class Ratio(NamedTuple):
    """The ratio of two energies over samples of the chips' numbers.

    median, low, high: median, 5 % and 95 % quantile.
    share: fraction of the samples in which it is above 1.
    has_value: whether both energies have one; for some chips only intervals are known.
    """

    median: float
    low: float
    high: float
    share: float
    has_value: bool

    def __str__(self) -> str:
        """Return the ratio in words, and whether it exceeds the uncertainty: no quantile passes 1."""
        how = "beyond" if self.low > 1 or self.high < 1 else "within"
        times = _in_range(self.median, self.low, self.high, " times the energy", self.has_value)
        return f"{times}, more in {self.share:.0%} of draws, {how} the uncertainty"


@dataclass(frozen=True)
class Chip:
    """The designs of a study and task on one chip.

    designs: their full read-outs there, the same designs in the same order on every chip.
    energies_uj: FLAT_OUT and AT_PERIOD -> (draw, design), of the same draws for all; NaN where the chip
        cannot run it.
    fits: (design,) bool, whether the chip can run and hold it.
    """

    name: str
    designs: pandas.DataFrame
    energies_uj: Mapping[str, Floats]
    fits: Bools

    @property
    def has_values(self) -> bool:
        """Whether energies have a value; for some chips only intervals are known."""
        return bool(np.isfinite(self.designs[FLAT_OUT].astype(float)).any())

    def cheapest(self, least: float, column: str = FLAT_OUT) -> Choice | None:
        """Return the design of least median energy among those that fit and reach an accuracy.

        Energies that agree in three digits are a tie, which goes to fewer weights, then to the more accurate,
        then to the earlier trial: medians of dependent energies that hardly differ are in no certain order.
        """
        medians = np.median(self.energies_uj[column], axis=0)
        accuracies = np.asarray(self.designs["accuracy"], dtype=np.float64)
        candidates = np.flatnonzero(self.fits & (accuracies >= least) & np.isfinite(medians))
        keys = (
            self.designs["trial"].to_numpy()[candidates],
            -accuracies[candidates],
            self.designs["n_weights"].to_numpy(np.float64)[candidates],
            np.array([float(f"{median:.3g}") for median in medians[candidates]]),
        )
        return Choice(self, int(candidates[np.lexsort(keys)[0]]), column) if len(candidates) else None


class Choice(NamedTuple):
    """A design on a chip, by its place there, and the energy that it was chosen by."""

    chip: Chip
    design: int
    column: str

    @property
    def row(self) -> pandas.Series[Any]:
        """Its columns."""
        return self.chip.designs.iloc[self.design]

    @property
    def drawn_uj(self) -> Floats:
        """Its energy in every draw, (draw,)."""
        energies: Floats = self.chip.energies_uj[self.column][:, self.design]
        return energies

    def over(self, other: Choice) -> Ratio:
        """Return the ratio of its energy to that of a design on another chip; two energies of 0 are equal.

        The figures of two chips are drawn independently: every draw of one meets every draw of the other.
        """
        ours, theirs = self.drawn_uj[None, :], other.drawn_uj[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(ours == theirs, 1.0, ours / theirs)
        median, low, high = map(float, np.quantile(ratios, QUANTILES, method="inverted_cdf"))
        has_value = self.chip.has_values and other.chip.has_values
        return Ratio(median, low, high, float(np.mean(ratios > 1)), has_value)

    def __str__(self) -> str:
        """Return its chip, energy, family and trial in words.

        The range of the chip's numbers says whether that of the energy is open, not the draws.
        """
        ends = [number(self.row.get(f"{self.column}_{end}")) or 0.0 for end in ("low", "high")]
        energy = f"at least {_short(ends[0])} uJ"
        if not is_open(*ends):
            median, low, high = np.quantile(self.drawn_uj, QUANTILES, method="inverted_cdf")
            energy = _in_range(median, low, high, " uJ", self.chip.has_values)
        return f"{self.chip.name} {energy}, {self.row['family']}, trial {self.row['trial']}"


def chips(part: StudyTask, points: pandas.DataFrame, hardware: Sequence[str] = ()) -> list[Chip]:
    """Return the honest designs of a task on every chip of some design points.

    hardware: names or files of the profiles that they were priced on; none: those of the study.
    """
    if "hardware" not in points:
        return []
    rows = full_read_outs(points[points["task"] == part.task])
    rows = rows[~rows["transductive"] & np.isfinite(rows["accuracy"].astype(float))]
    of_chips = []
    for name, rows_there in rows.groupby("hardware", sort=False):
        designs = rows_there.sort_values("trial").reset_index(drop=True)
        energies = pricing.drawn(part.study.folder, designs, tuple(_MODES), DRAWS, hardware)
        # Profiles that only count operations have no limits.
        is_held = designs["fits"].astype("boolean").fillna(True).to_numpy(bool) if "fits" in designs else True
        runs = np.isfinite(energies[FLAT_OUT]).all(axis=0)
        of_chips.append(Chip(str(name), designs, energies, np.asarray(is_held & runs)))
    return of_chips


def reached(part: StudyTask, chip: Chip) -> tuple[float, float] | None:
    """Return the accuracy of the best design that fits, with its error; None if no design fits."""
    top = best(chip.designs[chip.fits])
    return None if top is None else (float(top["accuracy"]), accuracy_error(part, top))


def accuracy_error(part: StudyTask, row: pandas.Series[Any]) -> float:
    """Return the larger of the error over runs and the error of the sample size; 0 if neither is known.

    Runs of a design answer the same recordings, so that more runs do not make up for few recordings.
    """
    over_runs, n = number(row.get("accuracy_se")) or 0.0, part.n_validation
    return max(over_runs, float(wilson_se(round(row["accuracy"] * n), n)) if n else 0.0)


def on_chips(
    part: StudyTask, points: pandas.DataFrame, hardware: Sequence[str]
) -> tuple[list[Row], list[str]]:
    """Return the cheapest designs at equal accuracy, flat out and at the sensor's period, and sentences.

    points: of the study; on fewer than two chips, the result is empty. hardware: as of `chips`.
    """
    of_chips = chips(part, points, hardware)
    if len(of_chips) < 2:
        return [], []
    levels = [(chip, reached(part, chip)) for chip in of_chips]
    about, fitting = f"{part.name}, {part.task}", [(chip, level) for chip, level in levels if level]
    notes = [*HOW, *(f"{about}: {chip.name}: no design fits" for chip, level in levels if level is None)]
    if len(fitting) < 2:
        return [], notes
    # Of equal accuracies the one with the larger error.
    accuracy, error = min((level for _, level in fitting), key=lambda level: (level[0], -level[1]))
    rows: list[Row] = []
    orders: list[list[str]] = []
    for column, how in _MODES.items():
        several = [chip.cheapest(accuracy - error, column) for chip, _ in fitting]
        choices = [one for one in several if one is not None]
        rows += [row for one in choices for row in _figures(part, one)]
        rows += [_ratio_row(part, one, other) for one, other in combinations(choices, 2)]
        choices.sort(key=lambda one: float(np.median(one.drawn_uj)))
        described = "; ".join([*map(str, choices), *_ratios(choices)])
        notes.append(f"{about}: at accuracy {accuracy:.3g} ± {error:.2g}, {how}: {described}")
        orders.append([one.chip.name for one in choices])
    if orders[0] != orders[1]:
        notes[-1] += f"; flat out the order is {', '.join(orders[0])}"
    return rows, notes


def _ratios(choices: Sequence[Choice]) -> list[str]:
    """Return how each of some designs, cheapest first, compares with the one before and the first."""
    pairs = [(one, choices[place]) for k, one in enumerate(choices[1:]) for place in dict.fromkeys((k, 0))]
    return [f"{one.chip.name} over {other.chip.name}: {one.over(other)}" for one, other in pairs]


def _figures(part: StudyTask, choice: Choice) -> list[Row]:
    """Return a design's energy on a chip with its interval; flat out, also accuracy, weights and latency."""
    row, column = choice.row, choice.column
    names = ("accuracy", "n_weights", FLAT_OUT, "latency_ms") if column == FLAT_OUT else (column,)
    return [
        replace(
            measured(part, HARDWARE, f"equal accuracy: {name}", None, row, name),
            hardware=choice.chip.name,
            low=number(row.get(f"{name}_low")),
            high=number(row.get(f"{name}_high")),
        )
        for name in names
        if name in row.index
    ]


def _ratio_row(part: StudyTask, one: Choice, other: Choice) -> Row:
    figure, ratio = f"equal accuracy: {one.column} over that on {other.chip.name}", one.over(other)
    row = measured(part, HARDWARE, figure, None, one.row, FLAT_OUT)
    ours = number(ratio.median) if ratio.has_value else None
    return replace(row, hardware=one.chip.name, ours=ours, low=number(ratio.low), high=number(ratio.high))


def _in_range(median: float, low: float, high: float, unit: str, has_value: bool) -> str:
    """Return `10 uJ (8 to 12)`; `8 to 12 uJ` where there is no value, or one in a range that is open."""
    ends = f"{_short(low)} to {_short(high)}"
    return f"{_short(median)}{unit} ({ends})" if has_value and not is_open(low, high) else f"{ends}{unit}"


def _short(value: float) -> str:
    return f"{value:.0f}" if 1000 <= value < math.inf else f"{value:.3g}"
