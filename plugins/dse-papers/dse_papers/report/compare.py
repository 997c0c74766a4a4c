"""One paper: every number that it prints beside ours, how large ours was run, and how the set-ups differ.

How set-ups differ need not be why a result differs: `dse.show.report.rows` has the causes that measurements
show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from dse.config.resolved import front_end
from dse.data.recordings.scene import SceneTrials
from dse.show.report import ReportError
from dse.show.report.designs import StudyTask, described, sections_of, tasks_of
from dse.show.report.rows import shown_causes
from dse.study.results import Study
from dse_papers.report.facts import Fact, of_movement
from dse_papers.report.ours import Measure, Ours, Side, missing
from dse_papers.report.papers import Entry, Holds, Number, Publication, Redrawn, Value, publication
from dse_papers.report.tables import TABLES

if TYPE_CHECKING:
    import pandas

WITHIN = "within one standard error"
_LETTERS = "abcdefghijklmnopqrstuvwxyz"
_SHORTEST_RUN = 3
_LARGE = 1e5
_TEXTURE = ("texture", "fabric", "material", "textile", "surface")
_CITED = "quoted from another work"
_HOW = (
    "designs are selected on validation; se, low and high are over the runs (folds or repeats) of a design; "
    "of one run, or runs that agree, se is Wilson's of the accuracy; same: whether it is the same quantity; "
    "causes: what measurements of the study show; setup: how set-ups differ, as below, which need not be why"
)


@dataclass(frozen=True)
class PaperRow:
    """One printed number beside ours.

    kind: result, set-up or cited. where, also: its first place in the paper, and others.
    quantity, condition: what it is, with its unit.
    printed, ours: as text; printed_value, ours_value: as numbers, None for ranges and texts.
    se, low, high: standard error and range of ours over the runs, or the range of an uncertain figure.
    scale: how large ours was run, against the printed sizes. same: whether it is the same quantity.
    why: why ours is missing or another quantity. causes: why it is lower, as far as measurements show it.
    setup: letters of the differences between the set-ups, which need not be why.
    differs: all of that as a sentence; '' where both agree.
    """

    kind: str
    where: str
    also: str
    quantity: str
    condition: str
    printed: str
    ours: str
    se: float | None
    low: float | None
    high: float | None
    runs: int | None
    same: bool | None
    why: str
    causes: str
    setup: str
    differs: str
    scale: str
    printed_value: float | None
    ours_value: float | None
    task: str
    family: str
    trial: int | None
    design: str
    study: str

    @property
    def columns(self) -> dict[str, object]:
        """The row as columns."""
        return dict(vars(self))


@dataclass(frozen=True)
class PaperReport:
    """The rows of a paper in its order: results, set-up, quotations; and sentences about them."""

    rows: list[PaperRow]
    notes: list[str] = field(default_factory=list)


def paper_report(studies: Sequence[Study], key: str) -> PaperReport:
    """Return every number of a paper beside what studies of its set-up measured.

    Args:
        studies: those of another set-up are named in the notes.
        key: number of the paper.

    Raises:
        ReportError: no study is of the paper's set-up.
        StoreError: a study's folder is damaged.
    """
    paper = publication(key)
    sides, others = sides_of(studies, key)
    if not sides:
        raise ReportError("\n".join(others))
    module, setups = TABLES[paper.name], _Setups(paper)
    rows = [row for number in paper.numbers() for row in _rows(number, sides, module, setups)]
    unprinted: Mapping[str, Measure] = getattr(module, "UNPRINTED", {})
    for name, measure in unprinted.items():
        number = Number("result", name, Entry(name, "not printed", ""), {}, "")
        rows += _result_rows(number, sides, measure, setups)
    rows.sort(key=lambda row: row.kind != "result")  # stable
    about = [f"paper {key}: {paper.title} ({paper.source}); its recordings {paper.recordings}", _HOW]
    scales = [f"{side.part.name}, {side.part.task}: {setups.scale(side)}" for side in sides]
    errors = [f"{side.part.name}, {side.part.task}: {text}" for side in sides if (text := side.confused())]
    return PaperReport(rows, [*about, *dict.fromkeys(scales), *setups.legend(), *errors, *others])


def sides_of(studies: Sequence[Study], key: str) -> tuple[list[Side], list[str]]:
    """Return the tasks of studies that stand beside a paper, and a sentence about every other study."""
    paper = publication(key)
    labels: Callable[[StudyTask], Mapping[str, str]] = getattr(TABLES[paper.name], "labels", lambda part: {})
    sides: list[Side] = []
    others = []
    for study in studies:
        reasons = [(part, _why_not(part, paper.holds)) for part in tasks_of(study)]
        parts = [part for part, reason in reasons if not reason]
        sides += [Side(part, labels(part), paper.holds.families) for part in parts]
        if not parts:
            why = "; ".join(dict.fromkeys(why for _, why in reasons)) or "it has no finished design"
            others.append(f"{study.folder.name}: is of another set-up than paper {key} ({paper.name}): {why}")
    return sides, others


def fits(number: Number | Redrawn, side: Side) -> bool:
    """Return whether the conditions of a number or a figure are not those of another side."""
    return all(side.labels.get(name, value) == value for name, value in number.condition.items())


def _why_not(part: StudyTask, holds: Holds) -> str:
    """Return why the designs of a task do not stand beside a paper; '' if they do."""
    families = list(dict.fromkeys(part.table["family"]))
    if not set(families) & set(holds.families):
        return f"its models are {', '.join(families)}, not {' or '.join(holds.families)}"
    if part.joint:
        return f"{part.task} is answered by a joint network"
    is_texture = any(word in column for column in part.target for word in _TEXTURE)
    task = "movement" if of_movement(part) else "texture" if is_texture else ""
    if len(part.target) > 1 or task not in holds.tasks:
        return f"it predicts {' and '.join(part.target)}, not {' or '.join(f'a {x}' for x in holds.tasks)}"
    first = int(part.table["trial"].iloc[0])
    n, needed = len(part.classes(first)), holds.tasks[task]
    if needed is not None and n != needed:
        return f"{part.task} has {n} classes, not {needed}"
    source = sections_of(part.study.folder, first).data
    if holds.events is not None and holds.events != (front_end(type(source)) == "preprocessing"):
        return f"its recordings are {'not ' if holds.events else ''}events"
    return ""


def _rows(number: Number, sides: Sequence[Side], module: ModuleType, setups: _Setups) -> Iterator[PaperRow]:
    if number.kind == "cited":
        yield _row(number, None, missing(_CITED), setups)
    elif number.kind == "result":
        yield from _result_rows(number, sides, module.OURS[number.key], setups)
    else:
        yield from _setup_rows(number, sides, setups)


def _result_rows(
    number: Number, sides: Sequence[Side], measure: Measure, setups: _Setups
) -> Iterator[PaperRow]:
    """Yield a row per side that has a value, or one row that says why none has."""
    several = [(side, measure(side, number.condition)) for side in sides if fits(number, side)]
    known = [(side, ours) for side, ours in several if ours.value is not None]
    for side, ours in known or several[:1]:
        yield _row(number, side, ours, setups)
    if not several:
        yield _row(number, None, missing(_absent(number, sides)), setups)


def _setup_rows(number: Number, sides: Sequence[Side], setups: _Setups) -> Iterator[PaperRow]:
    """Yield a row per value of ours; studies of one value share it."""
    several: dict[Fact, list[Side]] = {}
    for side in sides:
        fact = side.fact(number)
        if fact is not None and fits(number, side):
            several.setdefault(fact, []).append(side)
    for fact, alike in several.items():
        names = dict.fromkeys(x.part.name for x in alike)
        study = "all" if 1 < len(alike) == len(sides) else ", ".join(names)
        value = text_of(fact) if isinstance(fact, str | tuple) else float(fact or 0)
        yield _row(number, alike[0], Ours(value), setups, study=study)
    if not several:
        why = number.entry.lacks or _absent(number, sides) or "the study does not show it"
        yield _row(number, None, missing(why), setups)


def _absent(number: Number, sides: Sequence[Side]) -> str:
    """Return that no side is of the conditions of a number; '' if one is."""
    if any(fits(number, side) for side in sides):
        return ""
    labels = [name for name in number.condition if any(name in side.labels for side in sides)]
    return f"no study of {' and '.join(number.entry.by[x].format(number.condition[x]) for x in labels)}"


def _row(number: Number, side: Side | None, ours: Ours, setups: _Setups, study: str = "") -> PaperRow:
    entry, design = number.entry, ours.row
    printed, value = _as_number(number.value), _as_number(ours.value)
    is_result, has_value = number.kind == "result", ours.value is not None
    gap = "" if printed is None or value is None else gap_of(printed, value, ours.se)
    texts: list[str] = []
    shown: list[str] = []
    if side is not None and has_value and not is_result:
        texts = setups.of_setting(side, number)
    elif side is not None and has_value and (printed is None or gap not in ("", WITHIN)):
        chosen = side.chosen if design is None else design
        if chosen is not None:
            accuracy = value if ours.is_accuracy else None
            shown = shown_causes(side.part, chosen, accuracy, printed)
            texts = setups.of_result(side, chosen, number.condition)
    set_up = f"set-up: {'; '.join(texts)}" if texts and is_result else "".join(texts)
    reasons = "; ".join(filter(None, [ours.why, *shown, set_up]))
    return PaperRow(
        kind="set-up" if number.kind == "setup" else number.kind,
        where=entry.where,
        also=entry.also,
        quantity=", ".join(filter(None, [entry.quantity, entry.unit])),
        condition=number.about,
        printed=_printed_text(number.value),
        ours=text_of(ours.value),
        **{name: getattr(ours, name) for name in ("se", "low", "high", "runs", "why")},
        same=ours.same if has_value and is_result and printed is not None else None,
        causes="; ".join(shown),
        setup=setups.code(texts),
        differs=": ".join(filter(None, [gap if is_result else "", reasons])),
        scale=setups.scale(side, design) if side is not None and is_result else "",
        printed_value=printed,
        ours_value=value,
        task="" if side is None else side.part.task,
        family="" if design is None else str(design["family"]),
        trial=None if design is None else int(design["trial"]),
        design="" if design is None else described(design),
        study=study or ("" if side is None else side.part.name),
    )


class _Setups:
    """The differences between our set-ups and the printed one; each gets a letter where it first appears."""

    def __init__(self, paper: Publication) -> None:
        self._paper = paper
        self._setup = [number for number in paper.numbers() if number.kind == "setup"]
        self._places: dict[str, int] = {}

    def of_result(self, side: Side, row: pandas.Series[Any], condition: Mapping[str, str]) -> list[str]:
        """Return the differences that may bear on a result of one design, those of the recordings first."""
        is_simulated = isinstance(sections_of(side.part.study.folder, int(row["trial"])).data, SceneTrials)
        touch = "simulated touch" if is_simulated else f"recordings {Path(side.part.data).name}"
        numbers = [x for x in self._setup if self._bears(x, condition, str(row["family"]))]
        texts = [text for number in numbers for text in self.of_setting(side, number, row)]
        return [f"{touch}; the paper's recordings {self._paper.recordings}", *texts]

    def of_setting(self, side: Side, number: Number, row: pandas.Series[Any] | None = None) -> list[str]:
        """Return how a design (None: the best one) differs in a number of the set-up, if it does."""
        fact = side.fact(number, row)
        if fact is None or not fits(number, side) or agrees(number.value, fact):
            return []
        unit = f" {number.entry.unit}".rstrip()
        return [f"{number.entry.quantity}: {text_of(fact)} instead of {_printed_text(number.value)}{unit}"]

    def scale(self, side: Side, row: pandas.Series[Any] | None = None) -> str:
        """Return how large a design was run, against the printed sizes; row None: the best one."""
        facts = [(x, side.fact(x, row)) for x in self._setup if x.entry.scale and fits(x, side)]
        return "; ".join(
            f"{x.entry.quantity} {text_of(fact)} (printed {_printed_text(x.value)}) {x.entry.unit}".rstrip()
            for x, fact in facts
            if fact is not None
        )

    def code(self, texts: Sequence[str]) -> str:
        """Return the letters of differences, of three or more in a row the first and the last."""
        places = sorted(self._places.setdefault(text, len(self._places)) for text in texts)
        runs = [list(run) for _, run in groupby(places, key=lambda place: place - places.index(place))]
        names = [list(map(_letter, run)) for run in runs]
        return " ".join(f"{x[0]}-{x[-1]}" if len(x) >= _SHORTEST_RUN else " ".join(x) for x in names)

    def legend(self) -> list[str]:
        """Return what every letter stands for."""
        return [f"{_letter(place)}: {text}" for text, place in self._places.items()]

    def _bears(self, setting: Number, condition: Mapping[str, str], family: str) -> bool:
        """Return whether a setting bears on a result: of the same conditions, and not of another family."""
        alike = all(condition.get(name, value) == value for name, value in setting.condition.items())
        of = setting.entry.reads.partition(".")[0]
        return alike and (of == family or of not in self._paper.holds.families)


def _letter(place: int) -> str:
    """Return a, b, ..., z, aa, ab, ..."""
    n = len(_LETTERS)
    return _LETTERS[place] if place < n else _letter(place // n - 1) + _LETTERS[place % n]


def _as_number(value: Value | None) -> float | None:
    """Return a number; None for a range, a text or nothing."""
    return float(value) if isinstance(value, int | float) else None


def text_of(value: Value | Fact) -> str:
    """Return a number as text, a range as `1 to 6`."""
    if isinstance(value, tuple):
        return " to ".join(map(text_of, value))
    if isinstance(value, str) or value is None:
        return value or ""
    return f"{value:.0f}" if 10_000 <= abs(value) < 1e6 else f"{value:.4g}"


def _printed_text(value: Value) -> str:
    """Return a printed number as text, with all of its digits."""
    return f"{value:.6g}" if isinstance(value, int | float) else text_of(value)


def agrees(printed: Value, ours: Value | Fact) -> bool:
    """Return whether ours is the printed value of a set-up: a number to half a per cent, all else exactly."""
    if isinstance(printed, tuple) and isinstance(ours, tuple):
        return len(printed) == len(ours) and all(map(agrees, printed, ours))
    if isinstance(printed, int | float) and isinstance(ours, int | float):
        return math.isclose(ours, printed, rel_tol=0.005, abs_tol=1e-12)
    return printed == ours


def rounds_to(printed: float, ours: float) -> bool:
    """Return whether a result of ours is the printed one, to the digits that are printed.

    Fractions are printed in per cent, weights and spikes in 10 000.
    """
    if abs(printed) >= _LARGE:
        return round(ours / 1e4) == round(printed / 1e4)
    decimals = len(f"{printed:.9f}".rstrip("0").partition(".")[2])
    return math.isclose(round(ours, max(decimals, 2) if abs(printed) <= 1 else decimals), printed)


def gap_of(printed: float, ours: float, se: float | None) -> str:
    """Return how far ours is from the printed value: a difference of fractions, else a ratio; '' if alike."""
    difference = ours - printed
    if rounds_to(printed, ours):
        return ""
    if se is not None and abs(difference) <= se:
        return WITHIN
    if (abs(printed) <= 1 and abs(ours) <= 1) or printed == 0:
        return f"{abs(difference):.2g} {'above' if difference > 0 else 'below'}"
    return f"{ours / printed:.2g} times the printed value"
