"""How the set-up of a design of ours differs from the printed one, and how large it was run.

A difference need not be why a result differs: `dse.report.known` has the causes that measurements show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.recordings.scene import SceneTrials
from dse.report.designs import sections_of
from dse_papers.report.digits import agrees, printed_text, text_of
from dse_papers.report.facts import Fact
from dse_papers.report.ours import Side
from dse_papers.report.papers import Number, Publication, Redrawn

if TYPE_CHECKING:
    import pandas

_LETTERS = "abcdefghijklmnopqrstuvwxyz"
_SHORTEST_RUN = 3


class Setups:
    """The differences between our set-ups and the printed one; each gets a letter where it first appears."""

    def __init__(self, paper: Publication) -> None:
        self._paper = paper
        self._setup = [number for number in paper.numbers() if number.kind == "setup"]
        self._places: dict[str, int] = {}

    def of_result(self, side: Side, row: pandas.Series[Any], condition: Mapping[str, str]) -> list[str]:
        """Return the differences that may bear on a result of one design, those of the recordings first."""
        data = sections_of(side.part.study.folder, int(row["trial"])).data
        touch = "simulated touch"
        if not isinstance(data, SceneTrials):
            touch = f"recordings {Path(side.part.data).name}"
        numbers = [x for x in self._setup if self._bears(x, condition, str(row["family"]))]
        texts = [text for number in numbers for text in self.of_setting(side, number, row)]
        return [f"{touch}; the paper's recordings {self._paper.recordings}", *texts]

    def of_setting(self, side: Side, number: Number, row: pandas.Series[Any] | None = None) -> list[str]:
        """Return how a design differs in a number of the set-up; nothing if it does not.

        Args:
            side: its study.
            number: of the set-up.
            row: the design; None: the best one.
        """
        fact = fact_beside(number, side, row)
        if fact is None or not fits(number, side) or agrees(number.value, fact):
            return []
        unit = f" {number.entry.unit}".rstrip()
        return [f"{number.entry.quantity}: {text_of(fact)} instead of {printed_text(number.value)}{unit}"]

    def code(self, texts: Sequence[str]) -> str:
        """Return the letters of differences, of three or more in a row the first and the last."""
        runs: list[list[int]] = []
        for place in sorted(self._places.setdefault(text, len(self._places)) for text in texts):
            if runs and place == runs[-1][-1] + 1:
                runs[-1].append(place)
            else:
                runs.append([place])
        names = [list(map(_letter, run)) for run in runs]
        return " ".join(f"{x[0]}-{x[-1]}" if len(x) >= _SHORTEST_RUN else " ".join(x) for x in names)

    def legend(self) -> list[str]:
        """Return what every letter stands for."""
        return [f"{_letter(place)}: {text}" for text, place in self._places.items()]

    def scale(self, side: Side, row: pandas.Series[Any] | None = None) -> str:
        """Return how large a design was run, against the printed sizes; row None: the best one."""
        sizes = []
        for number in self._setup:
            fact = fact_beside(number, side, row)
            if number.entry.scale and fact is not None and fits(number, side):
                unit = f" {number.entry.unit}".rstrip()
                sizes.append(
                    f"{number.entry.quantity} {text_of(fact)} (printed {printed_text(number.value)}){unit}"
                )
        return "; ".join(sizes)

    def _bears(self, setting: Number, condition: Mapping[str, str], family: str) -> bool:
        """Return whether a setting bears on a result: of the same conditions, and not of another family."""
        alike = all(condition.get(name, value) == value for name, value in setting.condition.items())
        of = setting.entry.reads.partition(".")[0]
        return alike and (of == family or of not in self._paper.holds.families)


def fits(number: Number | Redrawn, side: Side) -> bool:
    """Return whether the conditions of a number or a figure are not those of another side."""
    return all(side.labels.get(name, value) == value for name, value in number.condition.items())


def fact_beside(number: Number, side: Side, row: pandas.Series[Any] | None = None) -> Fact:
    """Return what a design has beside a number of the set-up, under its conditions where facts have them."""
    facts, reads = side.facts(row), number.entry.reads
    return facts.get(".".join([reads, *number.condition.values()]), facts.get(reads))


def _letter(place: int) -> str:
    """Return a, b, ..., z, aa, ab, ..."""
    n = len(_LETTERS)
    return _LETTERS[place] if place < n else _letter(place // n - 1) + _LETTERS[place % n]
