"""The details of one design on a page: figures, decision surfaces, example recordings.

Surfaces are rows of the study's table of points, so their numbers are those of `dse skyline`. Everything else
comes from the artefacts of the trial's runs. A part is left out if the study did not record it or if its file
is damaged.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, TypeVarTuple, cast

import numpy as np

from dse import store
from dse.config import ConfigError
from dse.dashboard.budgets import budget_columns
from dse.dashboard.gather import ENERGY, INSTEAD
from dse.dashboard.verdicts import sentences
from dse.dashboard.write import packed, plain_figure
from dse.figures import full_read_outs, mean_of
from dse.figures.breakdown import draw_breakdown, gather_breakdown
from dse.figures.confusion import draw_confusion, gather_confusion
from dse.figures.core_map import draw_core_map, gather_core_map
from dse.figures.first_spike import draw_first_spikes, gather_first_spikes
from dse.figures.front import numbers
from dse.figures.histograms import draw_histograms, gather_histograms
from dse.figures.learning import draw_learning, gather_learning
from dse.figures.power import IDLE, RUNNING, draw_power, gather_power
from dse.figures.precision import BITS, PRUNED, draw_precision, gather_precision
from dse.figures.raster import draw_recording, gather_recording
from dse.figures.recognition import draw_recognition, gather_recognition
from dse.hardware.cost import NotApplicable, cost
from dse.hardware.profile import Profile
from dse.measure import decision
from dse.measure.objectives.first_spike import first_spike_ms
from dse.measure.run import read_out
from dse.records import Array, DecisionSurface, Operations, Parameters, Workload
from dse.store import StoreError
from dse.study import pricing
from dse.study.precision import AS_TRAINED, common
from dse.study.results import Study

if TYPE_CHECKING:
    import pandas

MOST_EXAMPLES = 6
_MOST_HISTOGRAMS = 12  # a panel each
_OF_HOTS = "hots_prototypes"  # a column that HOTS alone has
_MEASURED = ("accuracy", "accuracy_se", "decision_latency_ms", "undecided")
_MOST_EPOCHS = 120  # points of a line: more are finer than a pixel or two
_DIGITS = 6  # of a float32; a page shows three

# The panel of a design is about 400 px wide.
_HEIGHT = 280
_MARGIN = {"l": 56, "r": 12, "t": 28, "b": 40}
_LEGEND = {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0}

_T = TypeVar("_T")
_Arguments = TypeVarTuple("_Arguments")


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
class _Head:
    """A head of a joint net: its classes, and its class in each joint class."""

    classes: list[str]
    of_class: list[int]


@dataclass(frozen=True)
class _Run:
    """One training run of a trial: the part of its record that details need.

    folder: of the run. files: names of its artefacts. classes, heads: of its answers. evaluated: name of a
    file -> its arrays, at another precision than the trained one.
    """

    folder: Path
    files: frozenset[str]
    classes: list[str]
    heads: Mapping[str, _Head]
    evaluated: Mapping[str, Mapping[str, Array]] | None = None

    def arrays(self, name: str) -> Mapping[str, Array] | None:
        """Return the arrays of a file, None if the run has no file of this name.

        Raises:
            StoreError: the file is damaged or missing.
        """
        if self.evaluated is not None:
            return self.evaluated.get(name)
        return store.load_arrays(self.folder / name) if name in self.files else None


@dataclass(frozen=True)
class _OnHardware:
    """A design on one hardware: figures of its energy and its cores, and what does not fit."""

    energy: dict[str, Any] | None = None
    energy_at_period: dict[str, Any] | None = None
    cores: dict[str, Any] | None = None
    misfits: Sequence[str] = ()


def gather_details(
    study: Study, points: pandas.DataFrame, trial: int, hardware: Sequence[str] = ()
) -> dict[str, Any]:
    """Gather the details of one trial, as plain values that JSON can hold.

    Args:
        study: the study of the trial.
        points: its table of design points (`study.points(hardware)`).
        trial: number of the trial.
        hardware: names or files of the profiles of the points; empty: the profiles of the study.

    Returns:
        trial: its number;
        notes: one sentence for each part that cannot be read;
        tasks: {task: figures, surfaces, examples, misfits, precisions}, each only if it was recorded;
        targets: verdicts on targets, for each its `point` and `text`, if any bundle has them.

        figures: `confusion` (counts of the full read-out, summed over repeats), `recognition` (after shorter
        recordings, mean over repeats), `first_spike` and `histograms` (of the first repeat), `power` (on all
        hardware), `learning`, `bits`, and per hardware `energy` and `cores`, both of the full read-out as
        trained.
        surfaces: for each precision, `phi`, `theta`, and per hardware ('' if the table names none) columns
        of the rows of the table, theta fastest; `first_point` is the value of `point` in the first row.
        examples: recordings of the first repeat, some with the right answer of the full read-out and some
        with a wrong one.
        misfits: hardware -> the parts of the design that do not fit it.
        precisions: `figures` (confusion, recognition, energy and cores) of each other precision, with its
        `weight_bits` and `pruned_after`.

    Raises:
        StoreError: the study has no such trial, or it failed.
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

    Args:
        study: the study of the trials.
        points: its table of design points.
        trials: the most important first; a trial without a figure is skipped.
        room_bytes: largest total length of the texts; the first trial that does not fit ends the list.
        hardware: as in `gather_details`.

    Returns:
        Number of a trial -> its document, packed like the page's data (`dse.dashboard.write.packed`).
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
    """Return the trials of a page, those on the most fronts first, then by number."""
    if "trial" not in page["columns"]:
        return []
    trials = page["columns"]["trial"]["values"]
    n_fronts = Counter(trial for rows in page["fronts"].values() for trial in {trials[row] for row in rows})
    return sorted(
        {trial for trial in trials if trial is not None}, key=lambda trial: (-n_fronts[trial], trial)
    )


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


def _document(source: _Source, trial: int) -> dict[str, Any]:
    rows = source.points[source.points["trial"] == trial]
    if rows.empty:
        raise StoreError(f"{source.study.folder}: has no finished trial {trial}")
    notes: list[str] = []
    runs = _runs(source.study, trial, int(rows["repeats"].iloc[0]), notes)
    tasks = {
        str(task): _of_task(source, runs, str(task), of_task, notes)
        for task, of_task in rows.groupby("task", sort=False)
    }
    of_targets = sentences(source.study.folder, int(trial))
    targets = {"targets": of_targets} if of_targets else {}
    return {"trial": int(trial), "notes": list(dict.fromkeys(notes)), "tasks": tasks, **targets}


def _runs(study: Study, trial: int, repeats: int, notes: list[str]) -> list[_Run]:
    """Return the runs behind the table's rows, without those with a damaged record."""
    runs = []
    for repeat in range(repeats):
        folder = store.run_folder(study.folder, trial, repeat)
        if (run := _run(folder)) is not None:
            runs.append(run)
        else:
            notes.append(f"The record of repeat {repeat} cannot be read; the figures show the other repeats.")
    return runs


def _run(folder: Path) -> _Run | None:
    """Return the run in a folder; None if its record is damaged."""

    def are_names(classes: object) -> bool:
        return isinstance(classes, list) and all(isinstance(name, str) for name in classes)

    try:
        record = store.read_record(folder)
    except StoreError:
        return None
    heads = record.get("heads", {})
    if not (
        are_names(record.get("classes"))
        and isinstance(heads, dict)
        and all(isinstance(head, dict) and are_names(head.get("classes")) for head in heads.values())
    ):
        return None
    return _Run(
        folder=folder,
        files=frozenset(record["files"]),
        classes=record["classes"],
        heads={name: _Head(head["classes"], head.get("of_class", [])) for name, head in heads.items()},
    )


def _of_task(
    source: _Source, runs: Sequence[_Run], task: str, rows: pandas.DataFrame, notes: list[str]
) -> dict[str, Any]:
    """Return the details of one task of a trial."""

    def attempted(part: str, gather: Callable[[*_Arguments], _T], *arguments: *_Arguments) -> _T | None:
        """Return a part of the details; None, with a note, if an artefact is damaged."""
        try:
            return gather(*arguments)
        except (ConfigError, StoreError, KeyError, IndexError, TypeError, ValueError):
            notes.append(f"{part} cannot be shown: a file of the study is damaged or incomplete.")
            return None

    surfaces = attempted("The decision surface", _surfaces, rows, source.limited) or []
    figures: dict[str, dict[str, Any] | None] = {
        "bits": attempted("Accuracy against bits", _bits, rows),
        "power": attempted("Power", _power, rows),
    }
    misfits: dict[str, Sequence[str]] = {}
    examples: list[dict[str, Any]] = []
    precisions: list[dict[str, Any]] = []
    if runs:
        heads = runs[0].heads
        head = task if task in heads else ""
        classes = heads[head].classes if head else runs[0].classes
        hardware = list(map(str, rows["hardware"].unique())) if "hardware" in rows else []

        def measured(at: Sequence[_Run]) -> tuple[dict[str, Any], dict[str, Sequence[str]]]:
            """Return the figures of what networks of one precision answer and cost, and what does not fit."""
            drawn: dict[str, Any] = {
                "confusion": attempted("The confusion matrix", _confusion, at, head, classes),
                "recognition": attempted("Accuracy over time", _recognition, at, head),
            }
            loads = attempted("Energy by cause", _loads, at, head) or []
            priced = {
                name: on
                for name in hardware
                if loads and (on := attempted(f"Energy on {name}", _on, source.chip, name, loads))
            }
            for part in ("energy", "energy_at_period", "cores"):
                drawn[part] = {name: made for name, on in priced.items() if (made := getattr(on, part))}
            return drawn, {name: on.misfits for name, on in priced.items() if on.misfits}

        of_trained, misfits = measured(runs)
        figures |= of_trained
        folders = [run.folder for run in runs]
        evaluated = attempted("Other precisions", common, folders) if source.precisions else None
        for (weight_bits, pruned), each in evaluated or []:
            at = [replace(run, evaluated=one.files) for run, one in zip(runs, each, strict=True)]
            drawn = {name: figure for name, figure in measured(at)[0].items() if figure}
            precisions.append({"weight_bits": weight_bits, "pruned_after": pruned, "figures": drawn})
        if not heads:
            figures["first_spike"] = attempted("The first output spike", _first_spike, runs[0])
            if np.isfinite(numbers(rows, _OF_HOTS)).any():  # the weights of other families may be large
                figures["histograms"] = attempted("Class histograms", _histograms, runs[0])
        figures["learning"] = attempted("The learning curve", _learning, runs)
        examples = attempted("An example", _examples, runs[0], head, classes, _best(surfaces)) or []
    return {
        "figures": {name: figure for name, figure in figures.items() if figure},
        "surfaces": surfaces,
        **({"misfits": misfits} if misfits else {}),
        **({"examples": examples} if examples else {}),
        **({"precisions": precisions} if precisions else {}),
    }


def _surfaces(rows: pandas.DataFrame, limited: Sequence[str]) -> list[dict[str, Any]]:
    """Return the decision surface of every precision, from the rows of one trial and task."""
    if not {"phi", "theta"} <= set(rows):
        return []
    grid = rows[np.isfinite(numbers(rows, "phi")) & np.isfinite(numbers(rows, "theta"))]
    by = [name for name in (BITS, PRUNED) if name in grid]
    if grid.empty:
        return []
    precisions = grid.groupby(by, sort=False, dropna=False) if by else [((None, None), grid)]
    surfaces = []
    for precision, of_precision in precisions:
        is_priced = "hardware" in of_precision
        on = of_precision.groupby("hardware", sort=False) if is_priced else [("", of_precision)]
        values = _values(cast("tuple[float | None, ...]", precision))
        surface: dict[str, Any] = dict(zip(("weight_bits", "pruned_after"), values, strict=False))
        for name, each in on:
            surface |= _grid_of(each)
            surface.setdefault("hardware", {})[str(name)] = _columns(each, limited)
        surfaces.append(surface)
    return surfaces


def _grid_of(rows: pandas.DataFrame) -> dict[str, Any]:
    """Return the axes of a grid and its first point.

    Args:
        rows: all rows of the grid, theta fastest.

    Raises:
        StoreError: the rows are no such grid.
    """
    phi, theta = (numbers(rows, name) for name in ("phi", "theta"))
    axes = [list(dict.fromkeys(values.tolist())) for values in (phi, theta)]
    whole = np.array(np.meshgrid(*axes, indexing="ij")).reshape(2, -1)
    if not np.array_equal(whole, [phi, theta]):
        raise StoreError(f"trial {rows['trial'].iloc[0]}: the table lacks points of its decision surface")
    point = numbers(rows, "point")[:1]
    return {"first_point": _values(point)[0], "phi": _values(axes[0]), "theta": _values(axes[1])}


def _columns(rows: pandas.DataFrame, limited: Sequence[str]) -> dict[str, list[float | None]]:
    """Return the columns of a surface: measured ones, and those with a budget with their intervals."""
    ends = [f"{name}_{end}" for name in limited for end in ("low", "high")]
    names = dict.fromkeys([*_MEASURED, *limited, *ends])
    return {name: _values(numbers(rows, name), _DIGITS) for name in names if name in rows}


def _values(values: Iterable[float | None] | Array, digits: int | None = None) -> list[float | None]:
    """Return numbers as JSON holds them: integers without a fraction, None for missing ones."""
    numbers = values.tolist() if isinstance(values, np.ndarray) else values
    return [_value(x, digits) for x in numbers]


def _value(x: float | None, digits: int | None) -> float | None:
    if x is None or not math.isfinite(x):
        return None
    if float(x).is_integer() and abs(x) < 2**53:
        return int(x)
    return float(x) if digits is None else float(f"{x:.{digits}g}")


def _best(surfaces: Sequence[Mapping[str, Any]]) -> tuple[float, float] | None:
    """Return the phi and theta of t_p at the trained precision; None without a surface."""
    surface = next(filter(_is_trained, surfaces), None)
    if surface is None:
        return None
    columns = next(iter(surface["hardware"].values()))
    phi, theta = (np.array(surface[name], np.float64) for name in ("phi", "theta"))
    accuracy, latency_ms = (
        np.array(columns[name], np.float64).reshape(len(phi), len(theta))
        for name in ("accuracy", "decision_latency_ms")
    )
    none = np.full(accuracy.shape, np.nan)  # t_p does not depend on these
    best = decision.t_p(DecisionSurface(phi, theta, accuracy, none, latency_ms, none, none, work=np.empty(0)))
    return best.phi, best.theta


def _is_trained(surface: Mapping[str, Any]) -> bool:
    """Return whether a surface is at the trained precision, or of a classifier without precisions."""
    return surface.get("weight_bits") in (None, AS_TRAINED[0]) and not surface.get("pruned_after")


def _bits(rows: pandas.DataFrame) -> dict[str, Any] | None:
    """Return accuracy over the bits per weight; None if no other precision was evaluated."""
    if not {BITS, PRUNED} <= set(rows) or len(rows[[BITS, PRUNED]].dropna().drop_duplicates()) < 2:
        return None
    on_first = rows[rows["hardware"] == rows["hardware"].iloc[0]] if "hardware" in rows else rows
    precisions = gather_precision(on_first)
    figure = draw_precision(replace(precisions, costs={BITS: precisions.costs[BITS]}))
    figure.update_layout(height=_HEIGHT, margin=_MARGIN, legend=_LEGEND)
    return plain_figure(figure)


def _power(rows: pandas.DataFrame) -> dict[str, Any] | None:
    """Return power at rest and running on every hardware; None where no profile says it."""
    if not {"hardware", IDLE, RUNNING} <= set(rows):
        return None
    full = full_read_outs(rows)
    if not (np.isfinite(numbers(full, IDLE)) & np.isfinite(numbers(full, RUNNING))).any():
        return None
    figure = draw_power(gather_power(full))
    figure.update_layout(margin=_MARGIN, legend=_LEGEND)
    figure.update_xaxes(range=[0, 1.6 * figure.layout.xaxis.range[1]])  # the numbers beside the bars
    return plain_figure(figure)


def _recognition(runs: Sequence[_Run], head: str) -> dict[str, Any] | None:
    """Return accuracy over input length; None for a classifier that answers at the end alone."""
    suffix = f"_{head}" if head else ""
    read_outs = [arrays for run in runs if (arrays := run.arrays(f"read_out{suffix}.npz"))]
    if not read_outs or len(read_outs[0]["accuracy"]) < 2:
        return None
    time_ms, accuracy = (mean_of(read_outs, name) for name in ("decision_latency_ms", "accuracy"))
    figure = draw_recognition(gather_recognition({"accuracy": (time_ms, accuracy)}))
    figure.update_layout(height=_HEIGHT, margin=_MARGIN, showlegend=False)
    return plain_figure(figure)


def _first_spike(run: _Run) -> dict[str, Any] | None:
    """Return the first output spike of every class; None for a classifier without output spikes."""
    arrays = run.arrays("response.npz")
    if arrays is None or "output" not in arrays:
        return None
    times_ms = first_spike_ms(store.response_of(arrays))
    if not np.isfinite(times_ms).any():
        return None
    figure = draw_first_spikes(gather_first_spikes(times_ms, arrays["target"], run.classes))
    figure.update_layout(margin=_MARGIN)
    return plain_figure(figure)


def _histograms(run: _Run) -> dict[str, Any] | None:
    """Return the class histograms of a HOTS, of the first classes; None for any other family."""
    arrays = run.arrays("weights.npz")
    fitted = None if arrays is None else store.fitted_of(arrays)
    if not isinstance(fitted, Parameters) or "signatures" not in fitted.arrays:
        return None
    shown = run.classes[:_MOST_HISTOGRAMS]
    figure = draw_histograms(gather_histograms(fitted.arrays, run.classes, shown), n_columns=2)
    return plain_figure(figure)


def _confusion(runs: Sequence[_Run], head: str, classes: Sequence[str]) -> dict[str, Any] | None:
    suffix = f"_{head}" if head else ""
    matrices = [arrays["validation"] for run in runs if (arrays := run.arrays(f"confusion{suffix}.npz"))]
    if not matrices:
        return None
    figure = draw_confusion(gather_confusion(np.sum(matrices, axis=0), classes))
    figure.update_traces(showscale=False)
    figure.update_layout(height=_HEIGHT, margin=_MARGIN)
    figure.update_xaxes(tickangle=-45)  # at other angles the last name leaves the panel
    return plain_figure(figure)


def _learning(runs: Sequence[_Run]) -> dict[str, Any] | None:
    histories = [run.arrays("history.npz") or {} for run in runs]
    if not any(len(curve) > 1 for history in histories for curve in history.values() if np.ndim(curve)):
        return None  # a fit in closed form has no epochs
    figure = draw_learning(gather_learning(histories))
    for trace in figure.data:
        every = -(-len(trace.x) // _MOST_EPOCHS)
        trace.update(x=trace.x[::every], y=trace.y[::every])
    return plain_figure(figure)


def _loads(runs: Sequence[_Run], head: str) -> list[Workload | Operations]:
    """Return each run's work of the full read-out; an empty list if a file is missing."""
    suffix = f"_{head}" if head else ""
    loads = []
    for run in runs:
        arrays = run.arrays(f"read_out{suffix}.npz")
        if arrays is None:
            return []
        loads.append(store.work_of(arrays).mapped(lambda counts: counts[-1:]))
    return loads


def _on(profiles: Callable[[str], Profile], name: str, loads: Sequence[Workload | Operations]) -> _OnHardware:
    """Return a design on one hardware, from each run's work."""
    chip = profiles(name)
    try:
        costs = [cost(chip, load) for load in loads]
    except NotApplicable:
        return _OnHardware()
    cores = None
    if isinstance(loads[0], Workload):
        with contextlib.suppress(NotApplicable):  # the chip is not divided into cores
            cores = plain_figure(draw_core_map(gather_core_map(chip, loads[0])))
    energy = plain_figure(draw_breakdown(gather_breakdown(costs)))
    paced = gather_breakdown(costs, at_period=True)
    energy_at_period = plain_figure(draw_breakdown(paced)) if np.isfinite(paced.energy_uj) else None
    return _OnHardware(energy, energy_at_period, cores, [str(misfit) for misfit in costs[0].misfits])


def _examples(
    run: _Run,
    head: str,
    classes: Sequence[str],
    setting: tuple[float, float] | None,
) -> list[dict[str, Any]]:
    """Return a few recordings with a run's answers; an empty list for a classifier without output spikes."""
    arrays = run.arrays("response.npz")
    if arrays is None or "output" not in arrays:
        return []
    response, index = store.response_of(arrays), arrays["index"]
    first = 0
    if head:
        names = list(run.heads)
        first = sum(len(run.heads[name].classes) for name in names[: names.index(head)])
    output = response.output[..., first : first + len(classes)]
    answers = read_out(output)
    true = arrays["target"]
    if head:
        true = np.asarray(run.heads[head].of_class)[true]
    chosen = [
        sample
        for among in (np.flatnonzero(answers == true), np.flatnonzero(answers != true))
        for sample in _first_of_each(true, among, MOST_EXAMPLES // 2)
    ]
    examples = []
    for sample in chosen:
        target = int(true[sample])
        drawn = gather_recording(
            output[sample], response.spikes[sample], response.step_ms, classes, target, setting
        )
        examples.append(
            {
                "title": _title(int(index[sample]), classes, target, int(answers[sample])),
                "true": classes[target],
                "figure": plain_figure(draw_recording(drawn)),
                "step_ms": response.step_ms,
                "n_steps": len(output[sample]),
                "spikes": drawn.spikes.tolist(),
                "classes": list(classes),
            }
        )
    return examples


def _title(number: int, classes: Sequence[str], true: int, answer: int) -> str:
    return f"recording {number}: {classes[true]}" + (
        f", classified as {classes[answer]}" if answer != true else ""
    )


def _first_of_each(label: Array, among: Array, most: int) -> list[int]:
    """Return the first sample of each class among some samples, at most `most`, in ascending order."""
    _, first = np.unique(label[among], return_index=True)
    return [int(sample) for sample in np.sort(among[first])[:most]]
