"""What a page shows of one design beyond its points: figures, decision surfaces, example recordings.

Surfaces are rows of the study's table of points, so that their numbers are those of `dse skyline`; the rest
comes from the artefacts of the trial's runs. A part that the study did not record, or that is damaged, is
left out.
"""

from __future__ import annotations

import contextlib
import functools
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse import store
from dse.config import ConfigError
from dse.dashboard.budgets import budget_columns
from dse.dashboard.write import packed
from dse.figures.breakdown import draw_breakdown, gather_breakdown
from dse.figures.confusion import draw_confusion, gather_confusion
from dse.figures.core_map import draw_core_map, gather_core_map
from dse.figures.front import numbers
from dse.figures.learning import draw_learning, gather_learning
from dse.figures.precision import BITS, PRUNED, draw_precision, gather_precision
from dse.figures.raster import draw_recording, gather_recording
from dse.hardware.cost import NotApplicable, cost
from dse.hardware.profile import Profile
from dse.measure import decision
from dse.measure.run import read_out
from dse.records import Array, DecisionSurface, Operations, Workload
from dse.store import StoreError
from dse.study import pricing
from dse.study.precision import AS_TRAINED
from dse.study.results import Study

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

MOST_EXAMPLES = 6
_MEASURED = ("accuracy", "accuracy_se", "decision_latency_ms", "undecided")
_MOST_EPOCHS = 120  # that a line draws: more is finer than a pixel or two
_DIGITS = 6  # as float32 has; a page shows three

# The panel of a design is about 400 px wide.
_HEIGHT = 280
_MARGIN = {"l": 56, "r": 12, "t": 28, "b": 40}
_LEGEND = {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0}

Record = Mapping[str, Any]


@dataclass(frozen=True)
class _Source:
    """Where details come from: a study, its points, objectives and limited columns, profiles by name."""

    study: Study
    points: pandas.DataFrame
    limited: Sequence[str]
    chip: Callable[[str], Profile]


@dataclass(frozen=True)
class _Run:
    """One training run of a trial, as far as its record could be read."""

    folder: Path
    record: Record

    def arrays(self, name: str) -> dict[str, Array] | None:
        """Return the arrays of a file, None where the run has none of that name.

        Raises:
            StoreError: the file is damaged or missing.
        """
        return store.load_arrays(self.folder / name) if name in self.record["files"] else None


def gather_details(
    study: Study, points: pandas.DataFrame, trial: int, hardware: Sequence[str] = ()
) -> dict[str, Any]:
    """Gather what a page shows of one trial, as plain values that JSON can hold.

    Args:
        study: where the trial is from.
        points: its table of design points (`study.points(hardware)`).
        trial: number of the trial.
        hardware: names or files of the profiles that the points are priced on; none: those of the study.

    Returns:
        trial: as given;
        notes: what could not be read, a sentence each;
        tasks: {task: figures, surfaces, examples}, each only where it was recorded.

        figures: `confusion` (counts of the full read-out, summed over repeats), `learning`, `bits`, and per
        hardware `energy` and `cores`, both of the full read-out as trained.
        surfaces: for each precision, `phi`, `theta`, and per hardware ('' where the table names none) columns
        of the rows of the table, theta fastest; `first_point` is the value of `point` of the first.
        examples: recordings of the first repeat, some that the full read-out gets right and some that it does
        not.
        misfits: hardware -> what does not fit it, where something does not.

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
    """Return the details of as many trials as there is room for, in their order.

    Surfaces are those of the weights as trained: a dozen other precisions would leave room for few designs.

    Args:
        study: where the trials are from.
        points: its table of design points.
        trials: those that matter most first; one of which there is nothing to draw is left out.
        room_bytes: that the texts may take together; a trial that does not fit is left out, and so are all
            after it.
        hardware: as of `gather_details`.

    Returns:
        Number of a trial -> its document, packed as a page's own (`dse.dashboard.write.packed`).
    """
    source, found, room = _source(study, points, hardware), {}, room_bytes
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
        found[str(trial)] = text
    return found


def shown_first(page: Mapping[str, Any]) -> list[int]:
    """Return the trials of a page, those first that are on most of its fronts, then by number."""
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
        str(task): _of_task(source, runs, str(task), own, notes)
        for task, own in rows.groupby("task", sort=False)
    }
    return {"trial": int(trial), "notes": list(dict.fromkeys(notes)), "tasks": tasks}


def _runs(study: Study, trial: int, repeats: int, notes: list[str]) -> list[_Run]:
    """Return the runs that the table's rows are means of, but for those whose records are damaged."""
    found = []
    for repeat in range(repeats):
        folder = store.run_folder(study.folder, trial, repeat)
        try:
            record = store.read_json(folder / "record.json")
        except StoreError:
            record = None
        if _is_record(record):
            found.append(_Run(folder, record))
        else:
            notes.append(f"The record of repeat {repeat} cannot be read; the figures show the other repeats.")
    return found


def _is_record(record: Any) -> bool:
    """Return whether this is the record of a run, as far as it is read here."""

    def are_names(classes: Any) -> bool:
        return isinstance(classes, list) and all(isinstance(name, str) for name in classes)

    if not isinstance(record, dict) or not isinstance(record.get("files"), dict):
        return False
    heads = record.get("heads", {})
    return (
        are_names(record.get("classes"))
        and isinstance(heads, dict)
        and all(isinstance(head, dict) and are_names(head.get("classes")) for head in heads.values())
    )


def _of_task(
    source: _Source, runs: Sequence[_Run], task: str, rows: pandas.DataFrame, notes: list[str]
) -> dict[str, Any]:
    """Return what there is of one task of a trial."""

    def attempted(what: str, gather: Callable[..., Any], *given: Any) -> Any:
        """Return what is gathered; nothing, with a note, where an artefact is damaged."""
        try:
            return gather(*given)
        except (ConfigError, StoreError, KeyError, IndexError, TypeError, ValueError):
            notes.append(f"{what} cannot be shown: a file of the study is damaged or incomplete.")
            return None

    surfaces = attempted("The decision surface", _surfaces, rows, source.limited) or []
    figures = {"bits": attempted("Accuracy against bits", _bits, rows)}
    found: dict[str, Any] = {"figures": figures, "surfaces": surfaces}
    if runs:
        heads = runs[0].record.get("heads", {})
        head = task if task in heads else ""
        classes = heads[head]["classes"] if head else runs[0].record["classes"]
        figures["confusion"] = attempted("The confusion matrix", _confusion, runs, head, classes)
        figures["learning"] = attempted("The learning curve", _learning, runs)
        loads = attempted("Energy by cause", _loads, runs, head)
        names = map(str, rows["hardware"].unique()) if loads and "hardware" in rows else ()
        on = {name: attempted(f"Energy on {name}", _on, source.chip, name, loads) or {} for name in names}
        for part, where in (("energy", figures), ("cores", figures), ("misfits", found)):
            where[part] = {name: parts[part] for name, parts in on.items() if parts.get(part)}
        examples = attempted("An example", _examples, runs[0], head, classes, _best(surfaces))
        found["examples"] = examples
    found["figures"] = {name: figure for name, figure in figures.items() if figure}
    return {name: part for name, part in found.items() if part or name in ("figures", "surfaces")}


def _surfaces(rows: pandas.DataFrame, limited: Sequence[str]) -> list[dict[str, Any]]:
    """Return the decision surface of every precision, from the rows of one trial and task."""
    if not {"phi", "theta"} <= set(rows):
        return []
    grid = rows[np.isfinite(numbers(rows, "phi")) & np.isfinite(numbers(rows, "theta"))]
    by = [name for name in (BITS, PRUNED) if name in grid]
    if grid.empty:
        return []
    precisions = grid.groupby(by, sort=False, dropna=False) if by else [((None, None), grid)]
    found = []
    for precision, own in precisions:
        on = own.groupby("hardware", sort=False) if "hardware" in own else [("", own)]
        surface: dict[str, Any] = dict(zip(("weight_bits", "pruned_after"), _values(precision), strict=False))
        for name, each in on:
            surface |= _grid_of(each)
            surface.setdefault("hardware", {})[str(name)] = _columns(each, limited)
        found.append(surface)
    return found


def _grid_of(rows: pandas.DataFrame) -> dict[str, Any]:
    """Return the axes of a grid of which these are all rows, theta fastest, and its first point.

    Raises:
        StoreError: they are no such grid.
    """
    phi, theta = (numbers(rows, name) for name in ("phi", "theta"))
    axes = [list(dict.fromkeys(values.tolist())) for values in (phi, theta)]
    whole = np.array(np.meshgrid(*axes, indexing="ij")).reshape(2, -1)
    if not np.array_equal(whole, [phi, theta]):
        raise StoreError(f"trial {rows['trial'].iloc[0]}: the table lacks points of its decision surface")
    point = numbers(rows, "point")[:1]
    return {"first_point": _values(point)[0], "phi": _values(axes[0]), "theta": _values(axes[1])}


def _columns(rows: pandas.DataFrame, limited: Sequence[str]) -> dict[str, list[Any]]:
    """Return the columns of a surface: what was measured, what budgets limit, and its intervals."""
    ends = [f"{name}_{end}" for name in limited for end in ("low", "high")]
    wanted = dict.fromkeys([*_MEASURED, *limited, *ends])
    return {name: _values(numbers(rows, name), _DIGITS) for name in wanted if name in rows}


def _values(values: Iterable[Any], digits: int | None = None) -> list[Any]:
    """Return numbers as JSON holds them: whole ones as such, None for what is missing."""
    given = values.tolist() if isinstance(values, np.ndarray) else values
    return [_value(x, digits) for x in given]


def _value(x: float | None, digits: int | None) -> float | int | None:
    if x is None or not math.isfinite(x):
        return None
    if float(x).is_integer() and abs(x) < 2**53:
        return int(x)
    return float(x) if digits is None else float(f"{x:.{digits}g}")


def _best(surfaces: Sequence[Mapping[str, Any]]) -> tuple[float, float] | None:
    """Return the phi and theta of t_p, of the weights as trained; None without a surface."""
    surface = next(filter(_is_trained, surfaces), None)
    if surface is None:
        return None
    columns = next(iter(surface["hardware"].values()))
    phi, theta = (np.array(surface[name], np.float64) for name in ("phi", "theta"))
    accuracy, latency_ms = (
        np.array(columns[name], np.float64).reshape(len(phi), len(theta))
        for name in ("accuracy", "decision_latency_ms")
    )
    none = np.full(accuracy.shape, np.nan)  # of what plays no part
    best = decision.t_p(DecisionSurface(phi, theta, accuracy, none, latency_ms, none, none, work=np.empty(0)))
    return best.phi, best.theta


def _is_trained(surface: Mapping[str, Any]) -> bool:
    """Return whether a surface is of the weights as they were trained, or of nothing that has precisions."""
    return surface.get("weight_bits") in (None, AS_TRAINED[0]) and not surface.get("pruned_after")


def _bits(rows: pandas.DataFrame) -> Any:
    """Return accuracy over the bits per weight; None where no other precision was evaluated."""
    if not {BITS, PRUNED} <= set(rows) or len(rows[[BITS, PRUNED]].dropna().drop_duplicates()) < 2:
        return None
    own = rows[rows["hardware"] == rows["hardware"].iloc[0]] if "hardware" in rows else rows
    found = gather_precision(own)
    figure = draw_precision(replace(found, costs={BITS: found.costs[BITS]}))
    figure.update_layout(height=_HEIGHT, margin=_MARGIN, legend=_LEGEND)
    return _plain(figure)


def _confusion(runs: Sequence[_Run], head: str, classes: Sequence[str]) -> Any:
    suffix = f"_{head}" if head else ""
    found = [arrays["validation"] for run in runs if (arrays := run.arrays(f"confusion{suffix}.npz"))]
    if not found:
        return None
    figure = draw_confusion(gather_confusion(np.sum(found, axis=0), classes))
    figure.update_traces(showscale=False)
    figure.update_layout(height=_HEIGHT, margin=_MARGIN)
    figure.update_xaxes(tickangle=-45)  # any other lets the last name stick out of the panel
    return _plain(figure)


def _learning(runs: Sequence[_Run]) -> Any:
    histories = [run.arrays("history.npz") or {} for run in runs]
    if not any(len(curve) > 1 for history in histories for curve in history.values() if np.ndim(curve)):
        return None  # what is fitted in closed form has no epochs
    figure = draw_learning(gather_learning(histories))
    for trace in figure.data:
        every = -(-len(trace.x) // _MOST_EPOCHS)
        trace.update(x=trace.x[::every], y=trace.y[::every])
    return _plain(figure)


def _loads(runs: Sequence[_Run], head: str) -> list[Workload | Operations]:
    """Return each run's work of the full read-out; nothing where a file is missing."""
    suffix = f"_{head}" if head else ""
    found = []
    for run in runs:
        arrays = run.arrays(f"read_out{suffix}.npz")
        if arrays is None:
            return []
        found.append(store.work_of(arrays).mapped(lambda counts: counts[-1:]))
    return found


def _on(
    profiles: Callable[[str], Profile], name: str, loads: Sequence[Workload | Operations]
) -> dict[str, Any]:
    """Return the energy and the cores of a design on one hardware, and what does not fit it."""
    found: dict[str, Any] = {"energy": None, "cores": None, "misfits": []}
    chip = profiles(name)
    with contextlib.suppress(NotApplicable):
        costs = [cost(chip, load) for load in loads]
        found["energy"] = _plain(draw_breakdown(gather_breakdown(costs)))
        found["misfits"] = [str(misfit) for misfit in costs[0].misfits]
        if isinstance(loads[0], Workload):
            found["cores"] = _plain(draw_core_map(gather_core_map(chip, loads[0])))
    return found


def _examples(
    run: _Run,
    head: str,
    classes: Sequence[str],
    setting: tuple[float, float] | None,
) -> list[dict[str, Any]]:
    """Return a few recordings as a run answered them; none of what has no output spikes."""
    arrays = run.arrays("response.npz")
    if arrays is None or "output" not in arrays:
        return []
    response, index = store.response_of(arrays), arrays["index"]
    first = 0
    if head:
        heads = list(run.record["heads"])
        first = sum(len(run.record["heads"][name]["classes"]) for name in heads[: heads.index(head)])
    output = response.output[..., first : first + len(classes)]
    said = read_out(output)
    true = arrays["target"]
    if head:
        true = np.asarray(run.record["heads"][head]["of_class"])[true]
    chosen = [
        sample
        for among in (np.flatnonzero(said == true), np.flatnonzero(said != true))
        for sample in _first_of_each(true, among, MOST_EXAMPLES // 2)
    ]
    found = []
    for sample in chosen:
        meant = int(true[sample])
        drawn = gather_recording(
            output[sample], response.spikes[sample], response.step_ms, classes, meant, setting
        )
        found.append(
            {
                "title": _title(int(index[sample]), classes, meant, int(said[sample])),
                "true": classes[meant],
                "figure": _plain(draw_recording(drawn)),
                "step_ms": response.step_ms,
                "n_steps": len(output[sample]),
                "spikes": drawn.spikes.tolist(),
                "classes": list(classes),
            }
        )
    return found


def _title(number: int, classes: Sequence[str], true: int, said: int) -> str:
    return f"recording {number}: {classes[true]}" + (
        f", classified as {classes[said]}" if said != true else ""
    )


def _first_of_each(label: Array, among: Array, most: int) -> list[int]:
    """Return the first sample of each class among some samples, at most so many, in the order of samples."""
    _, first = np.unique(label[among], return_index=True)
    return [int(sample) for sample in np.sort(among[first])[:most]]


def _plain(figure: plotly.graph_objects.Figure) -> Any:
    """Return a figure as JSON holds it, without the template: the page has a face of its own."""
    figure.layout.template = None
    return json.loads(figure.to_json(validate=False))
