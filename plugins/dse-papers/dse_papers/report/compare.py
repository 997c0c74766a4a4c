"""One paper: every number that it prints beside ours, how large ours was run, and why they differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType

from dse.config.sections import front_end
from dse.report import ReportError
from dse.report.designs import StudyTask, described, sections_of, tasks_of
from dse.report.known import shown_causes
from dse.study.results import Study
from dse_papers.report.causes import Setups, fact_beside, fits
from dse_papers.report.digits import WITHIN, as_number, gap_of, printed_text, text_of
from dse_papers.report.facts import Fact
from dse_papers.report.ours import Measure, Ours, Side, missing
from dse_papers.report.papers import Entry, Holds, Number, publication
from dse_papers.report.tables import TABLES

_TEXTURE = ("texture", "fabric", "material", "textile", "surface")
_CITED = "quoted from another work"
_HOW = (
    "designs are selected on validation; se, low and high are over the runs (folds or repeats) of a design; "
    "of one run, se is Wilson's of the accuracy; same: whether it is the same quantity; causes: what "
    "measurements of the study show; setup: how set-ups differ, as below, which need not be why"
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
    module = TABLES[paper.name]
    sides, others = sides_of(studies, key)
    if not sides:
        raise ReportError("\n".join(others))
    setups = Setups(paper)
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
        tasks = tasks_of(study)
        reasons = {part.task: why_not(part, paper.holds) for part in tasks}
        parts = [part for part in tasks if not reasons[part.task]]
        sides += [Side(part, labels(part), paper.holds.families) for part in parts]
        if not parts:
            why = "; ".join(dict.fromkeys(reasons.values())) or "it has no finished design"
            others.append(f"{study.folder.name}: is of another set-up than paper {key} ({paper.name}): {why}")
    return sides, others


def why_not(part: StudyTask, holds: Holds) -> str:
    """Return why the designs of a task do not stand beside a paper; '' if they do."""
    families = list(dict.fromkeys(part.table["family"]))
    if not set(families) & set(holds.families):
        return f"its models are {', '.join(families)}, not {' or '.join(holds.families)}"
    if part.joint:
        return f"{part.task} is answered by a joint network"
    is_texture = any(word in column for column in part.target for word in _TEXTURE)
    task = "movement" if part.of_movement else "texture" if is_texture else ""
    if len(part.target) > 1 or task not in holds.tasks:
        return f"it predicts {' and '.join(part.target)}, not {' or '.join(f'a {x}' for x in holds.tasks)}"
    n, needed = len(part.classes(int(part.table["trial"].iloc[0]))), holds.tasks[task]
    if needed is not None and n != needed:
        return f"{part.task} has {n} classes, not {needed}"
    source = sections_of(part.study.folder, int(part.table["trial"].iloc[0])).data
    if holds.events is not None and holds.events != (front_end(type(source)) == "preprocessing"):
        return f"its recordings are {'not ' if holds.events else ''}events"
    return ""


def _rows(number: Number, sides: Sequence[Side], module: ModuleType, setups: Setups) -> Iterator[PaperRow]:
    if number.kind == "cited":
        yield _row(number, None, missing(_CITED), setups)
    elif number.kind == "result":
        yield from _result_rows(number, sides, module.OURS[number.key], setups)
    else:
        yield from _setup_rows(number, sides, setups)


def _result_rows(
    number: Number, sides: Sequence[Side], measure: Measure, setups: Setups
) -> Iterator[PaperRow]:
    """Yield a row per side that has a value, or one row that says why none has."""
    several = [(side, measure(side, number.condition)) for side in sides if fits(number, side)]
    known = [(side, ours) for side, ours in several if ours.value is not None]
    for side, ours in known or several[:1]:
        yield _row(number, side, ours, setups)
    if not several:
        yield _row(number, None, missing(_absent(number, sides)), setups)


def _absent(number: Number, sides: Sequence[Side]) -> str:
    """Return that no side is of the conditions of a number; '' if one is."""
    if any(fits(number, side) for side in sides):
        return ""
    labels = [name for name in number.condition if any(name in side.labels for side in sides)]
    return f"no study of {' and '.join(number.entry.by[x].format(number.condition[x]) for x in labels)}"


def _setup_rows(number: Number, sides: Sequence[Side], setups: Setups) -> Iterator[PaperRow]:
    """Yield a row per value of ours; studies of one value share it."""
    several: dict[Fact, list[Side]] = {}
    for side in sides:
        fact = fact_beside(number, side)
        if fact is not None and fits(number, side):
            several.setdefault(fact, []).append(side)
    for fact, alike in several.items():
        names = (
            "all" if 1 < len(alike) == len(sides) else ", ".join(dict.fromkeys(x.part.name for x in alike))
        )
        value = (
            fact if isinstance(fact, str) else text_of(fact) if isinstance(fact, tuple) else float(fact or 0)
        )
        yield _row(number, alike[0], Ours(value), setups, study=names)
    if not several:
        of_none = _absent(number, sides)
        yield _row(
            number, None, missing(number.entry.lacks or of_none or "the study does not show it"), setups
        )


def _row(number: Number, side: Side | None, ours: Ours, setups: Setups, study: str = "") -> PaperRow:
    entry, design = number.entry, ours.row
    printed, value = as_number(number.value), as_number(ours.value)
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
        quantity=f"{entry.quantity}, {entry.unit}" if entry.unit else entry.quantity,
        condition=number.about,
        printed=printed_text(number.value),
        ours=text_of(ours.value),
        se=ours.se,
        low=ours.low,
        high=ours.high,
        runs=ours.runs,
        same=ours.same if has_value and is_result and printed is not None else None,
        why=ours.why,
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
