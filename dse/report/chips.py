"""Designs on a chip: which ones fit, their energy in every sample of the chip's numbers, and the cheapest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dse.measure.objectives.accuracy import wilson_se
from dse.records import Bools, Floats
from dse.report.designs import StudyTask, best, full_read_outs
from dse.report.rows import number
from dse.skyline.front import front_mask
from dse.study import pricing

if TYPE_CHECKING:
    import pandas

QUANTILES = (0.5, 0.05, 0.95)

FLAT_OUT, AT_PERIOD = "energy_uj", "energy_throttled_uj"
"""Energies: with all input at once, or with one step per period of the sensor, waiting included."""


class Ratio(NamedTuple):
    """The ratio of two energies over samples of the chips' numbers.

    median, low, high: median, 5 % and 95 % quantile.
    share: fraction of the samples in which it is above 1.
    """

    median: float
    low: float
    high: float
    share: float

    @property
    def is_beyond(self) -> bool:
        """Whether the energies differ beyond the uncertainty: both quantiles are on one side of 1."""
        return self.low > 1 or self.high < 1


class Level(NamedTuple):
    """An accuracy and its error."""

    accuracy: float
    error: float

    @property
    def least(self) -> float:
        """The lowest accuracy that counts as equal."""
        return self.accuracy - self.error


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
    def accuracies(self) -> Floats:
        """Accuracy of each design, (design,)."""
        return np.asarray(self.designs["accuracy"], dtype=np.float64)

    def medians_uj(self, column: str = FLAT_OUT) -> Floats:
        """Return the median energy of each design, (design,)."""
        return np.asarray(np.median(self.energies_uj[column], axis=0))

    @property
    def has_values(self) -> bool:
        """Whether energies have a value; for some chips only intervals are known."""
        return bool(np.isfinite(self.designs[FLAT_OUT].astype(float)).any())

    def front(self) -> set[int]:
        """Return the trials on the front of accuracy and median energy, among the designs that fit."""
        import pandas

        goals = {"accuracy": "max", FLAT_OUT: "min"}
        table = pandas.DataFrame({"accuracy": self.accuracies, FLAT_OUT: self.medians_uj()})
        on_front = front_mask(table, goals.items(), among=self.fits)
        return set(self.designs["trial"].to_numpy()[on_front].tolist())

    def ranked(self, least: float, column: str = FLAT_OUT) -> list[int]:
        """Return the designs that fit and reach an accuracy, sorted by median energy.

        Energies that agree in three digits are a tie, which goes to fewer weights, then to the more accurate,
        then to the earlier trial: medians of dependent energies that hardly differ are in no certain order.
        """
        medians = self.medians_uj(column)
        candidates = np.flatnonzero(self.fits & (self.accuracies >= least) & np.isfinite(medians))
        keys = (
            self.designs["trial"].to_numpy()[candidates],
            -self.accuracies[candidates],
            self.designs["n_weights"].to_numpy(np.float64)[candidates],
            np.array([float(f"{median:.3g}") for median in medians[candidates]]),
        )
        designs: list[int] = candidates[np.lexsort(keys)].tolist()
        return designs


class Choice(NamedTuple):
    """A design on a chip, by its place there."""

    chip: Chip
    design: int

    @property
    def row(self) -> pandas.Series[Any]:
        """Its columns."""
        return self.chip.designs.iloc[self.design]

    @property
    def name(self) -> str:
        """Its family and trial."""
        return f"{self.row['family']}, trial {self.row['trial']}"

    @property
    def fits(self) -> bool:
        """Whether the chip can run and hold it."""
        return bool(self.chip.fits[self.design])

    def drawn_uj(self, column: str = FLAT_OUT) -> Floats:
        """Return its energy in every draw, (draw,)."""
        energies: Floats = self.chip.energies_uj[column][:, self.design]
        return energies

    def median_uj(self, column: str = FLAT_OUT) -> float:
        """Return its median energy."""
        return float(self.chip.medians_uj(column)[self.design])

    def over(self, other: Choice, column: str) -> tuple[Ratio, bool]:
        """Return the ratio of its energy to that of a design on another chip, and whether both have values.

        The figures of two chips are drawn independently: every draw of one meets every draw of the other.
        """
        factor = ratio(other.drawn_uj(column)[:, None], self.drawn_uj(column)[None, :])
        return factor, self.chip.has_values and other.chip.has_values


def chips(part: StudyTask, points: pandas.DataFrame, hardware: Sequence[str] = ()) -> list[Chip]:
    """Return the honest designs of a task on every chip of some design points.

    Args:
        part: a study's designs of the task.
        points: as priced.
        hardware: names or files of the profiles that they were priced on; none: those of the study.
    """
    if "hardware" not in points:
        return []
    rows = full_read_outs(points[points["task"] == part.task])
    rows = rows[~rows["transductive"] & np.isfinite(rows["accuracy"].astype(float))]
    of_chips = []
    for name, rows_there in rows.groupby("hardware", sort=False):
        designs = rows_there.sort_values("trial").reset_index(drop=True)
        energies = pricing.drawn(part.study.folder, designs, (FLAT_OUT, AT_PERIOD), hardware=hardware)
        # Profiles that only count operations have no limits.
        is_held = designs["fits"].astype("boolean").fillna(True).to_numpy(bool) if "fits" in designs else True
        runs = np.isfinite(energies[FLAT_OUT]).all(axis=0)
        of_chips.append(Chip(str(name), designs, energies, np.asarray(is_held & runs)))
    return of_chips


def reached(part: StudyTask, chip: Chip) -> Level | None:
    """Return the accuracy of the best design that fits, with its error; None if no design fits."""
    top = best(chip.designs[chip.fits])
    return None if top is None else Level(float(top["accuracy"]), accuracy_error(part, top))


def accuracy_error(part: StudyTask, row: pandas.Series[Any]) -> float:
    """Return the larger of the error over runs and the error of the sample size; 0 if neither is known.

    Runs of a design answer the same recordings, so that more runs do not make up for few recordings.
    """
    over_runs, n = number(row.get("accuracy_se")) or 0.0, part.n_validation
    return max(over_runs, float(wilson_se(round(row["accuracy"] * n), n)) if n else 0.0)


def common_level(levels: Sequence[Level]) -> Level:
    """Return the highest accuracy that every chip reaches; among equals, the one with the larger error."""
    return min(levels, key=lambda level: (level.accuracy, level.least))


def cheapest(chips: Sequence[Chip], least: float, column: str = FLAT_OUT) -> list[Choice]:
    """Return the cheapest design that fits and reaches an accuracy on every chip that has one."""
    ranks = [(chip, chip.ranked(least, column)) for chip in chips]
    return [Choice(chip, designs[0]) for chip, designs in ranks if designs]


def ratio(energies_uj: Floats, other: Floats) -> Ratio:
    """Return the ratio of two energies in uJ, draw by draw, broadcast together.

    Two energies of 0 are equal.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(other == energies_uj, 1.0, other / energies_uj)
    median, low, high = np.quantile(ratios, QUANTILES, method="inverted_cdf")
    return Ratio(float(median), float(low), float(high), float(np.mean(ratios > 1)))
