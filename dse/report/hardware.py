"""One study on several chips: which design wins on each, by how much, and which chip is cheapest.

On a chip, of the designs that fit and are as accurate as the best that fits, the one of least energy wins. It
is compared with its runner-up and with the winners of other chips under the same samples of this chip's
uncertain numbers. Chips are compared by their cheapest designs at an accuracy that all of them reach.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dse.hardware.interval import column_names, is_open
from dse.measure.objectives.accuracy import wilson_se
from dse.records import Bools, Floats
from dse.report.designs import StudyTask, best, described, full_read_outs
from dse.report.rows import HARDWARE, Row, measured, number
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


HOW = (
    f"{HARDWARE}: the winner on a chip is the design with the least energy, flat out, among those that fit "
    "and are as accurate as the best that fits, within ±, the larger of the standard error over runs and "
    "Wilson's error for the number of recordings; rivals are compared under the same samples of the chip's "
    "uncertain numbers",
    f"{HARDWARE}: equal accuracy is the highest accuracy that all chips with a fitting design reach; for "
    "each chip the cheapest design of that accuracy is compared; the uncertain numbers of two chips are "
    "sampled independently",
    f"{HARDWARE}: low and high are the ends of an energy interval, or the 5 % and 95 % quantiles of a ratio; "
    "beyond the uncertainty: both quantiles are on one side of 1; the uncertainty is that of the chips' "
    "numbers, not of the activity over runs",
)
"""Explanations of the rows and sentences."""

_MODES = {FLAT_OUT: "flat out", AT_PERIOD: "at the sensor's period"}


def on_chips(
    part: StudyTask, points: pandas.DataFrame, hardware: Sequence[str] = ()
) -> tuple[list[Row], list[str]]:
    """Return the winner on each chip and the cheapest chip, as rows and as sentences.

    Args:
        part: a study's designs of one task.
        points: its design points; on fewer than two chips, the result is empty.
        hardware: names or files of the profiles that points are priced on; empty: those of the study.
    """
    of_chips = chips(part, points, hardware)
    if len(of_chips) < 2:
        return [], []
    levels = {chip.name: level for chip in of_chips if (level := reached(part, chip)) is not None}
    ranks = {chip.name: chip.ranked(levels[chip.name].least) for chip in of_chips if chip.name in levels}
    rows: list[Row] = []
    notes = list(HOW)
    for chip in of_chips:
        if chip.name in levels:
            of_chip, note = _winner(part, chip, levels[chip.name], ranks)
            rows += of_chip
            notes.append(note)
        else:
            notes.append(f"{part.name}, {part.task}: {chip.name}: no design fits")
    reaching = [chip for chip in of_chips if chip.name in levels]
    of_chip, sentences = _at_equal_accuracy(part, reaching, list(levels.values()))
    return [*rows, *of_chip], [*notes, *sentences]


def _winner(
    part: StudyTask, chip: Chip, level: Level, ranks: Mapping[str, Sequence[int]]
) -> tuple[list[Row], str]:
    """Return the winner on a chip and its margins.

    Args:
        part: a study's designs of one task.
        chip: some design fits it.
        level: the accuracy that it reaches.
        ranks: for every chip that some design fits, the designs as accurate as its best, cheapest first.
    """
    first, *others = ranks[chip.name]
    winner = Choice(chip, first)
    rows = _figures(part, winner, "winner")
    sentences = [_winner_sentence(part, winner)]
    if not others:
        sentences.append("no other design that fits is as accurate")
    for design, titles in _rivals(chip, ranks).items():
        if design == first:
            sentences.append(f"it wins on {', '.join(titles)} too")
            continue
        rival = Choice(chip, design)
        if rival.fits:
            over, has_values = ratio(winner.drawn_uj(), rival.drawn_uj()), chip.has_values
            figures = [f"{title}: energy_uj over the winner's" for title in titles]
            rows += [_ratio_row(part, rival, figure, over, has_values) for figure in figures]
        sentences.append(f"the {', '.join(titles)} ({rival.name}) {_verdict(part, level, winner, rival)}")
    return rows, "; ".join(sentences)


def _rivals(chip: Chip, ranks: Mapping[str, Sequence[int]]) -> dict[int, list[str]]:
    """Return the designs that a chip's winner is compared with, and the role of each.

    The winner itself is included, with the names of the other chips on which it wins.
    """
    winner, *others = ranks[chip.name]
    family = chip.designs["family"]
    titles: dict[int, list[str]] = {}
    if others:
        titles[others[0]] = ["runner-up"]
    stranger = next((design for design in others if family[design] != family[winner]), None)
    if stranger is not None:
        titles.setdefault(stranger, ["best of another family"])
    for name, designs in ranks.items():
        if name != chip.name:
            title = name if designs[0] == winner else f"winner of {name}"
            titles.setdefault(designs[0], []).append(title)
    return titles


def _verdict(part: StudyTask, level: Level, winner: Choice, rival: Choice) -> str:
    """Compare a rival with a chip's winner, in words."""
    if not np.isfinite(rival.drawn_uj()).all():
        return "cannot run on this chip"
    if not rival.fits:
        return "does not fit"
    over_winner, has_value = ratio(winner.drawn_uj(), rival.drawn_uj()), winner.chip.has_values
    if rival.row["accuracy"] >= level.least:
        return f"takes {_compared(over_winner, has_value)}"
    less = float(winner.row["accuracy"] - rival.row["accuracy"])
    error = math.hypot(accuracy_error(part, winner.row), accuracy_error(part, rival.row))
    how = "beyond" if less > error else "within"
    return (
        f"is less accurate by {less:.3g} ± {error:.2g}, {how} the error, at {_times(over_winner, has_value)}"
    )


def _at_equal_accuracy(
    part: StudyTask, fitting: Sequence[Chip], levels: Sequence[Level]
) -> tuple[list[Row], list[str]]:
    """Return the cheapest designs at an accuracy that all chips reach, flat out and at the sensor's period.

    Args:
        part: a study's designs of one task.
        fitting: chips that some design fits; with fewer than two, the result is empty.
        levels: the accuracy that each of them reaches.
    """
    if len(fitting) < 2:
        return [], []
    level = common_level(levels)
    about = f"{part.name}, {part.task}: at accuracy {level.accuracy:.3g} ± {level.error:.2g}"
    rows: list[Row] = []
    notes: list[str] = []
    orders: list[list[str]] = []
    for column, how in _MODES.items():
        choices = cheapest(fitting, level.least, column)
        rows += [row for one in choices for row in _figures(part, one, "equal accuracy", column)]
        for one, other in combinations(choices, 2):
            figure = f"equal accuracy: {column} over that on {other.chip.name}"
            rows.append(_ratio_row(part, one, figure, *one.over(other, column)))
        choices.sort(key=lambda one: one.median_uj(column))
        notes.append(f"{about}, {how}: {'; '.join(_order_sentences(choices, column))}")
        orders.append([one.chip.name for one in choices])
    if orders[0] != orders[1]:
        notes[1] += f"; flat out the order is {', '.join(orders[0])}"
    return rows, notes


def _order_sentences(choices: Sequence[Choice], column: str) -> list[str]:
    """Return the energies on some chips, cheapest first, with ratios to the one before and the first."""
    sentences = [f"{one.chip.name} {_energy(one, column)}, {one.name}" for one in choices]
    for before, one in enumerate(choices[1:]):
        for other in (choices[place] for place in dict.fromkeys((before, 0))):
            times = _compared(*one.over(other, column))
            sentences.append(f"{one.chip.name} over {other.chip.name}: {times}")
    return sentences


def _figures(part: StudyTask, choice: Choice, title: str, column: str = FLAT_OUT) -> list[Row]:
    """Return a design's energy on a chip with its interval; flat out, also accuracy, weights and latency."""
    row = choice.row
    names = ("accuracy", "n_weights", FLAT_OUT, "latency_ms") if column == FLAT_OUT else (column,)
    return [
        replace(
            measured(part, HARDWARE, f"{title}: {name}", None, row, name),
            hardware=choice.chip.name,
            low=number(row.get(f"{name}_low")),
            high=number(row.get(f"{name}_high")),
        )
        for name in names
        if name in row.index
    ]


def _ratio_row(part: StudyTask, choice: Choice, figure: str, factor: Ratio, has_value: bool) -> Row:
    row = measured(part, HARDWARE, figure, None, choice.row, FLAT_OUT)
    ours = number(factor.median) if has_value else None
    return replace(
        row, hardware=choice.chip.name, ours=ours, low=number(factor.low), high=number(factor.high)
    )


def _winner_sentence(part: StudyTask, choice: Choice) -> str:
    axes = described(choice.row)
    design = f"{choice.name}: {axes}" if axes else choice.name
    here = f"{choice.row['accuracy']:.3g} ± {accuracy_error(part, choice.row):.2g}"
    accuracy = f"accuracy {here}"
    value, low, high = (number(choice.row.get(x)) for x in column_names("accuracy_corrected"))
    if value is not None:
        accuracy = f"corrected accuracy {value:.3g} ({low:.3g} to {high:.3g}), measured {here}"
    return f"{part.name}, {part.task}: {choice.chip.name}: {design} wins, {accuracy}, {_energy(choice)}"


def _energy(choice: Choice, column: str = FLAT_OUT) -> str:
    """Return an energy in words; the range of the chip's numbers says whether it is open, not the draws."""
    ends = [number(choice.row.get(f"{column}_{end}")) or 0.0 for end in ("low", "high")]
    if is_open(*ends):
        return f"at least {_short(ends[0])} uJ"
    median, low, high = np.quantile(choice.drawn_uj(column), QUANTILES, method="inverted_cdf")
    return _in_range(median, low, high, " uJ", choice.chip.has_values)


def _times(factor: Ratio, has_value: bool) -> str:
    """Return a ratio of energies in words."""
    return _in_range(factor.median, factor.low, factor.high, " times the energy", has_value)


def _in_range(median: float, low: float, high: float, unit: str, has_value: bool) -> str:
    """Return `10 uJ (8 to 12)`; `8 to 12 uJ` where there is no value, or one in a range that is open."""
    ends = f"{_short(low)} to {_short(high)}"
    return f"{_short(median)}{unit} ({ends})" if has_value and not is_open(low, high) else f"{ends}{unit}"


def _compared(factor: Ratio, has_value: bool) -> str:
    """Return a ratio of energies in words, and whether it exceeds the uncertainty."""
    how = "beyond" if factor.is_beyond else "within"
    return f"{_times(factor, has_value)}, more in {factor.share:.0%} of draws, {how} the uncertainty"


def _short(value: float) -> str:
    return f"{value:.0f}" if 1000 <= value < math.inf else f"{value:.3g}"
