"""The details of one design on a page: figures, decision surfaces, example recordings.

Surfaces are rows of the study's table of points, so their numbers are those of `dse skyline`. Figures are
those of `dse figure`, of one task of the trial on the validation set. A part is left out if the study did not
record it or if its file is damaged.
"""

from __future__ import annotations

import functools
import html
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, cast

import numpy as np
import pandas

from dse import store
from dse.base import registry
from dse.base.records import Array, Head
from dse.config import ConfigError
from dse.measure.hardware.plan import NotApplicable
from dse.measure.hardware.profile import Profile
from dse.measure.run import read_out
from dse.show.dashboard.budgets import budget_columns
from dse.show.dashboard.gather import ENERGY, INSTEAD, plain
from dse.show.dashboard.write import packed, plain_figure, without_template
from dse.show.figures import NothingRecorded
from dse.show.figures.front import numbers
from dse.show.figures.labels import Drawing, short
from dse.show.figures.precision import BITS, PRUNED
from dse.store import StoreError
from dse.study import pricing
from dse.study.precision import AS_TRAINED, RunFile, common
from dse.study.record import RunRecord
from dse.study.results import Study

MOST_EXAMPLES = 6
_MEASURED = ("accuracy", "accuracy_se", "decision_latency_ms", "undecided")
_DIGITS = 6  # of a float32; a page shows three
_exact = functools.partial(plain, digits=17)
_DAMAGED = (ConfigError, StoreError, KeyError, IndexError, TypeError, ValueError)
_OF_HEADS = ("confusion", "read_out")  # files that a joint net has one of for each head


class _Tab(NamedTuple):
    """A tab of a design: which figure it is.

    words: what it is, for its text alternative, and for a note where it is damaged. note: what it is of.
    keys: of the figure. on_hardware: whether there is one for each.
    has: whether a record is worth a tab.
    family: the only one that has it. layout, traces: what a panel of some 400 px needs otherwise.
    """

    figure: str
    words: str
    note: str = ""
    keys: Mapping[str, Any] = MappingProxyType({})
    on_hardware: bool = False
    family: str = ""
    has: Callable[[Any], bool] = lambda _: True
    layout: Mapping[str, Any] = MappingProxyType({})
    traces: Mapping[str, Any] = MappingProxyType({})


_ENERGY = "Energy by cause"
_AT_END = "Answers at the end of the recording."
TABS = {
    "bits": _Tab(
        "precision",
        "Accuracy against bits",
        _AT_END,
        {"costs": (BITS,)},
        has=lambda record: record.accuracy.size > 1,
    ),
    "power": _Tab("power", "Power"),
    "confusion": _Tab(
        "confusion",
        "The confusion matrix",
        f"{_AT_END} All repeats.",
        layout={"xaxis": {"tickangle": -45}},  # at other angles the last name leaves the panel
        traces={"showscale": False},
    ),
    "recognition": _Tab("recognition", "Accuracy over time", "Mean of all repeats. The ring is t_c."),
    "energy": _Tab("energy", _ENERGY, _AT_END, on_hardware=True),
    "energy_at_period": _Tab("energy", _ENERGY, _AT_END, {"pace": "period"}, on_hardware=True),
    "cores": _Tab("cores", _ENERGY, on_hardware=True),
    "first_spike": _Tab("first_spike", "The first output spike", "Median and range of each class."),
    "histograms": _Tab(
        "histograms", "How often each prototype is nearest", "First repeat.", {"per_row": 2}, family="hots"
    ),
    "learning": _Tab("learning", "The learning curve"),
}
"""Tabs of a design that are figures, by name."""

_OF_PRECISION = ("confusion", "recognition", "energy", "energy_at_period", "cores")


@dataclass(frozen=True)
class _Source:
    """The source of details: a study, its points, the limited columns, and hardware profiles by name.

    precisions: whether figures of other precisions are gathered.
    """

    study: Study
    points: pandas.DataFrame
    limited: Sequence[str]
    chip: Callable[[str], Profile]
    precisions: bool = True


@dataclass(frozen=True)
class _Part(Study):
    """One task of a trial at one precision, as figures read a study.

    rows: its points. answered: archive and record of each run at the precision. load: returns the arrays
    of a file.
    """

    source: _Source
    task: str
    rows: pandas.DataFrame
    answered: Sequence[RunFile]
    load: Callable[[Path], dict[str, Array]]

    @property
    def head(self) -> Head | None:
        """The head of the task in a joint net."""
        heads = self.answered[0][1].heads if self.answered else ()
        return next((head for head in heads if head.name == self.task), None)

    def points(self, hardware: Sequence[str] = ()) -> pandas.DataFrame:
        return self.rows

    def classes(self, trial: int) -> tuple[str, ...]:
        return self.head.classes if self.head else self.answered[0][1].classes

    def chip(self, name: str) -> Profile:
        return self.source.chip(name)

    def arrays(self, trial: int, name: str) -> list[dict[str, Array]]:
        """Return the arrays of a file of the task, of each run that has it; a page shows no test set."""
        stem = name.removesuffix(".npz")
        if self.head and stem in _OF_HEADS:
            name = f"{stem}_{self.head.name}.npz"
        if stem == "response_test":
            return []
        found = [self.load(folder / name) for folder, record in self.answered if name in record.files]
        return [self._of_head(arrays) for arrays in found] if stem == "response" else found

    def _of_head(self, arrays: dict[str, Array]) -> dict[str, Array]:
        """Return a response with the outputs and targets of the head alone."""
        if self.head is None or "output" not in arrays:
            return arrays
        before = itertools.takewhile(lambda head: head.name != self.task, self.answered[0][1].heads)
        first = sum(len(head.classes) for head in before)
        response = store.response_of(arrays)
        output = response.output[..., first : first + len(self.head.classes)]
        own = store.response_arrays(replace(response, output=output), arrays["index"])
        return {**arrays, **own, "target": self.head.of_class[arrays["target"]]}


def gather_details(
    study: Study, points: pandas.DataFrame, trial: int, hardware: Sequence[str] = ()
) -> dict[str, Any]:
    """Gather the details of one trial, as plain values that JSON can hold.

    points are those of `study.points(hardware)`.

    Returns:
        trial: its number;
        notes: one sentence for each part that cannot be read;
        tasks: {task: figures, surfaces, examples, misfits, precisions}, each only if it was recorded.

        figures: by the name of their tab; `energy`, `energy_at_period` and `cores` per hardware.
        surfaces: for each precision, `phi`, `theta`, and per hardware ('' if the table names none) columns
        of the rows of the table, theta fastest; `first_point` is the value of `point` in the first row,
        `best` the place of t_p in them.
        examples: recordings of the first repeat, some with the right answer of the full read-out and some
        with a wrong one.
        misfits: hardware -> the parts of the design that do not fit it.
        precisions: `figures` of each other precision, with its `weight_bits` and `pruned_after`.
    """
    return _document(_source(study, points, hardware), trial)


def packed_details(
    study: Study,
    points: pandas.DataFrame,
    trials: Sequence[int],
    room_bytes: int,
    hardware: Sequence[str] = (),
) -> dict[str, str]:
    """Return the details of the first trials that fit into the room, in their order.

    Surfaces and figures are those of the trained precision: a dozen more would leave room for few designs.

    trials: the most important first; a trial without a figure is skipped. room_bytes: largest total length of
    the texts; the first trial that does not fit ends the list.

    Returns:
        Number of a trial -> its document, packed like the page's data (`dse.show.dashboard.write.packed`).
    """
    source = replace(_source(study, points, hardware), precisions=False)
    documents, room = {}, room_bytes
    for trial in trials:
        try:
            document = _document(source, trial)
        except StoreError:
            continue
        if not any(task["figures"] for task in document["tasks"].values()):
            continue
        for task in document["tasks"].values():
            task["surfaces"] = [surface for surface in task["surfaces"] if _is_trained(surface)]
        text = packed(document)
        room -= len(text)
        if room < 0:
            break
        documents[str(trial)] = text
    return documents


def shown_first(page: Mapping[str, Any]) -> list[int]:
    """Return the trials of a page: those on a front first, then those that budgets can put on one."""
    if "trial" not in page["columns"]:
        return []
    trials = page["columns"]["trial"]["values"]
    best = [{trials[row] for row in rows} for rows in (page["front"], page["budgets"]["contenders"])]
    known = {trial for trial in trials if trial is not None}
    return sorted(known, key=lambda trial: (*(trial not in among for among in best), trial))


def _source(study: Study, points: pandas.DataFrame, hardware: Sequence[str]) -> _Source:
    objectives = {name: way for name, way in study.objectives if name in points}
    limited = list(dict.fromkeys([*objectives, *budget_columns(points, objectives)]))
    if ENERGY in limited:
        limited.append(INSTEAD)
    named = {chip.name: chip for chip in pricing.profiles(study.folder, hardware)}

    @functools.cache  # reading a profile takes longer than pricing on it
    def chip(name: str) -> Profile:
        return named.get(name) or pricing.profile(study.folder, name)

    return _Source(study, points, limited, chip)


@without_template()
def _document(source: _Source, trial: int) -> dict[str, Any]:
    folder = source.study.folder
    points = source.points  # without columns where no design was trained
    rows = points[points["trial"] == trial] if "trial" in points else points
    if rows.empty:
        raise StoreError(f"{folder}: has no finished trial {trial}")
    notes: list[str] = []
    runs = []
    known = store.runs_in(folder).get(trial, [])
    for repeat in known if len(known) >= rows["repeats"].iloc[0] else range(int(rows["repeats"].iloc[0])):
        place = store.run_file(folder, trial, repeat)
        try:
            runs.append((place, RunRecord.from_plain(store.read_record(place), place / store.RECORD)))
        except StoreError:
            notes.append(f"The record of repeat {repeat} cannot be read; the figures show the other repeats.")
    load = functools.cache(store.load_arrays)
    tasks = {
        str(task): _of_task(_Part(folder, source, str(task), of_task, runs, load), int(trial), notes)
        for task, of_task in rows.groupby("task", sort=False)
    }
    return {"trial": int(trial), "notes": list(dict.fromkeys(notes)), "tasks": tasks}


def _of_task(part: _Part, trial: int, notes: list[str]) -> dict[str, Any]:
    """Return the details of one task of a trial."""

    def attempted(words: str, gather: Callable[[], Any]) -> Any:
        """Return a part of the details; None if it was not recorded, or, with a note, if it is damaged."""
        try:
            return gather()
        except (NothingRecorded, NotApplicable):
            return None
        except _DAMAGED:
            notes.append(f"{words} cannot be shown: a file of the study is damaged or incomplete.")
            return None

    def drawn(at: _Part, tabs: Sequence[str]) -> tuple[dict[str, Any], dict[str, list[str]]]:
        """Return figures, and what does not fit on each hardware."""
        figures: dict[str, Any] = {}
        misfits: dict[str, list[str]] = {}
        chips = list(map(str, at.rows["hardware"].unique())) if "hardware" in at.rows else []
        for name in tabs:
            tab = TABS[name]
            if tab.family and tab.family not in set(at.rows.get("family", ())):
                continue
            for chip in chips if tab.on_hardware else [""]:
                made = attempted(tab.words, functools.partial(_figure, at, tab, trial, chip))
                if made is None:
                    continue
                record, figure = made
                if not tab.on_hardware:
                    figures[name] = figure
                    continue
                figures.setdefault(name, {})[chip] = figure
                if name == "energy" and record.misfits:
                    misfits[chip] = list(record.misfits)
        return figures, misfits

    surfaces = attempted("The decision surface", lambda: _surfaces(part.rows, part.source.limited)) or []
    figures, misfits = drawn(part, list(TABS))
    precisions = []
    if part.answered and part.source.precisions:
        trained = [run for run, _ in part.answered]
        evaluated = attempted("Other precisions", lambda: common(trained)) or {}
        for (bits, pruned), each in evaluated.items():
            own = drawn(replace(part, answered=each), _OF_PRECISION)[0]
            precisions.append({"weight_bits": bits, "pruned_after": pruned, "figures": own})
    examples = attempted("An example", lambda: _examples(part, trial, _best(surfaces)))
    more = {"misfits": misfits, "examples": examples, "precisions": precisions}
    return {
        "figures": figures,
        "surfaces": surfaces,
        **{name: value for name, value in more.items() if value},
    }


def _figure(part: _Part, tab: _Tab, trial: int, chip: str) -> tuple[Any, dict[str, Any]]:
    """Return the record of a tab's figure, and the figure as JSON holds it."""
    kinds = registry.known("figures")
    if tab.figure not in kinds:
        raise NothingRecorded(f"no figure {tab.figure}")
    figure = kinds[tab.figure](trial=trial, **({"hardware": chip} if chip else {}), **tab.keys)
    record = figure.gather(part)
    if not tab.has(record):
        raise NothingRecorded(f"too little for figure {tab.figure}")
    return record, of_tab(tab, figure.draw(record))


def of_tab(tab: _Tab, figure: Drawing) -> dict[str, Any]:
    """Return the figure of a tab as JSON holds it: for a panel, with its words and its note as `meta`."""
    figure.update_layout(tab.layout, meta={"words": _said(tab, figure), "note": tab.note})
    figure.update_traces(tab.traces)
    return plain_figure(figure)


def _said(tab: _Tab, figure: Drawing) -> str:
    """Return what a figure shows: of a matrix what counts, of curves their ends, else what is written."""
    layout, first = figure.layout, figure.data[0]
    if tab.figure == "confusion":
        names, counts = [_words(x) for x in layout.xaxis.ticktext], np.array(first.text).astype(int)
        right, wrong = np.trace(counts), counts - np.diag(np.diag(counts))
        most = [divmod(int(at), len(names)) for at in np.argsort(-wrong, axis=None, kind="stable")[:3]]
        errors = [
            f"{names[i]} taken for {names[j]} {short(int(wrong[i, j]))} times" for i, j in most if wrong[i, j]
        ]
        often = f"; most often wrong: {', '.join(errors)}" if errors else ""
        return f"{tab.words} of {len(names)} classes: {right} of {counts.sum()} right{often}."
    parts = []
    for trace in figure.data:
        known = () if trace.y is None else trace.y
        y = [float(x) for x in known if isinstance(x, int | float | np.number) and np.isfinite(x)]
        if y:
            axis = layout[f"yaxis{(trace.yaxis or 'y')[1:]}"].title.text or ""
            of = [_words(x) for x in (axis, trace.name if len(figure.data) > 1 else "") if x]
            parts.append(f"{' of '.join(of)} {_in_digits(y[0])} to {_in_digits(y[-1])}".strip())
    beside = np.ravel(first.customdata).tolist() if first.customdata is not None else []
    written = [*(layout.yaxis.ticktext or ()), *(note.text for note in layout.annotations), *beside]
    return f"{tab.words}: {'; '.join([*parts, *(_words(x) for x in written if isinstance(x, str))])}."


def _words(text: str) -> str:
    """Return plotly's text as plain words."""
    return html.unescape(text.replace("<br>", " "))


def _in_digits(value: float) -> str:
    """Return a number as the page's words have it: a fraction with its zeros."""
    return f"{value:.3f}" if 0.01 <= abs(value) < 0.9995 else short(value)


def _surfaces(rows: pandas.DataFrame, limited: Sequence[str]) -> list[dict[str, Any]]:
    """Return the decision surface of every precision, from the rows of one trial and task."""
    if not {"phi", "theta"} <= set(rows):
        return []
    grid = rows[np.isfinite(numbers(rows, "phi")) & np.isfinite(numbers(rows, "theta"))]
    by = [name for name in (BITS, PRUNED) if name in grid]
    if grid.empty:
        return []
    surfaces = []
    for precision, of_precision in (
        grid.groupby(by, sort=False, dropna=False) if by else [((None,) * 2, grid)]
    ):
        values = map(_exact, cast("tuple[float | None, ...]", precision))
        surface: dict[str, Any] = dict(zip(("weight_bits", "pruned_after"), values, strict=False))
        is_priced = "hardware" in of_precision
        for name, each in of_precision.groupby("hardware", sort=False) if is_priced else [("", of_precision)]:
            surface |= _grid_of(each)
            surface.setdefault("hardware", {})[str(name)] = _columns(each, limited)
        surfaces.append(surface | {"best": _fastest(surface)})
    return surfaces


def _grid_of(rows: pandas.DataFrame) -> dict[str, Any]:
    """Return the axes of a grid and its first point.

    rows: all rows of the grid, theta fastest.
    """
    phi, theta = (numbers(rows, name) for name in ("phi", "theta"))
    axes = [list(dict.fromkeys(values.tolist())) for values in (phi, theta)]
    whole = np.array(np.meshgrid(*axes, indexing="ij")).reshape(2, -1)
    if not np.array_equal(whole, [phi, theta]):
        raise StoreError(f"trial {rows['trial'].iloc[0]}: the table lacks points of its decision surface")
    first = _exact(float(numbers(rows, "point")[0]))
    return {"first_point": first, "phi": [*map(_exact, axes[0])], "theta": [*map(_exact, axes[1])]}


def _columns(rows: pandas.DataFrame, limited: Sequence[str]) -> dict[str, list[object]]:
    """Return the columns of a surface: measured ones, and those with a budget with their intervals."""
    ends = [f"{name}_{end}" for name in limited for end in ("low", "high")]
    names = [name for name in dict.fromkeys([*_MEASURED, *limited, *ends]) if name in rows]
    return {name: [plain(x, _DIGITS) for x in numbers(rows, name).tolist()] for name in names}


def _best(surfaces: Sequence[Mapping[str, Any]]) -> tuple[float, float] | None:
    """Return the phi and theta of t_p (`dse.measure.decision.t_p`) as trained; None without a surface."""
    surface = next(filter(_is_trained, surfaces), None)
    return None if surface is None else _settings(surface)[surface["best"]]


def _settings(surface: Mapping[str, Any]) -> list[tuple[float, float]]:
    """Return the phi and theta of each point of a surface."""
    return [*itertools.product(surface["phi"], surface["theta"])]


def _fastest(surface: Mapping[str, Any]) -> int:
    """Return the point of t_p: the fastest of the most accurate; of several, the smallest phi, then theta."""
    columns = next(iter(surface["hardware"].values()))
    ranked = [*zip(columns["accuracy"], columns["decision_latency_ms"], _settings(surface), strict=True)]
    return min(range(len(ranked)), key=lambda k: (-ranked[k][0], *ranked[k][1:]))


def _is_trained(surface: Mapping[str, Any]) -> bool:
    """Return whether a surface is at the trained precision, or of a classifier without precisions."""
    return surface.get("weight_bits") in (None, AS_TRAINED[0]) and not surface.get("pruned_after")


def _examples(part: _Part, trial: int, setting: tuple[float, float] | None) -> list[dict[str, Any]]:
    """Return a few recordings of the first run with its answers."""
    first = replace(part, answered=part.answered[:1])
    runs = first.arrays(trial, "response.npz")
    if not runs or "output" not in runs[0]:
        raise NothingRecorded(f"trial {trial} has no output spikes")
    answers, true = read_out(store.response_of(runs[0]).output), runs[0]["target"]
    chosen = [
        sample
        for among in (np.flatnonzero(answers == true), np.flatnonzero(answers != true))
        for sample in _first_of_each(true, among, MOST_EXAMPLES // 2)
    ]
    keys = {} if setting is None else {"phi": setting[0], "theta": setting[1]}
    examples = []
    for sample in chosen:
        figure = registry.known("figures")["recording"](trial=trial, sample=sample, **keys)
        record = figure.gather(first)
        name, answer = (record.classes[k] for k in (record.true, answers[sample]))
        mistake = "" if answer == name else f", classified as {answer}"
        examples.append(
            {
                "title": f"recording {int(runs[0]['index'][sample])}: {name}{mistake}",
                "true": name,
                "figure": plain_figure(figure.draw(record)),
                "step_ms": record.step_ms,
                "n_steps": len(record.confidence),
                "spikes": record.spikes.tolist(),
                "classes": list(record.classes),
            }
        )
    return examples


def _first_of_each(label: Array, among: Array, most: int) -> list[int]:
    """Return the first sample of each class among some samples, at most `most`, in ascending order."""
    _, first = np.unique(label[among], return_index=True)
    return [int(sample) for sample in np.sort(among[first])[:most]]
