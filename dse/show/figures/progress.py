"""Progress: hypervolume of the front against trials and hours, for every task and chip of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas

from dse.base.records import Array
from dse.base.registry import register
from dse.show.figures import Results
from dse.show.figures.front import numbers
from dse.show.figures.labels import Drawing, colour_of, safe, shortened
from dse.skyline.admissible import fitting, honest
from dse.skyline.pareto import Front, hypervolume, non_dominated

MAX_STEPS = 200
"""Trials at which the front of a curve is looked at; the curve is exact at each of them."""

# Points on a front whose hypervolume is cheap enough to be taken that often: it grows as n log n with up to
# three objectives, as n^2 with four, and steeply beyond.
_CHEAP = {1: 100_000, 2: 20_000, 3: 5_000, 4: 2_000, 5: 400, 6: 60}
_CHEAP_BEYOND = 30
_DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
_NAME_CHARACTERS = 32


@dataclass(frozen=True)
class Curve:
    """How the front of one task on one chip grew; every array (step,), in the order of finishing.

    task, hardware: "" where the table does not say.
    trials: finished trials of the study, failed ones included.
    hours: spent until then, NaN where unknown.
    hypervolume: in [0, 1], 1 for a design that is best in every objective.
    """

    task: str
    hardware: str
    trials: Array
    hours: Array
    hypervolume: Array


@register("figures", "progress")
@dataclass(frozen=True)
class ProgressFigure:
    """Hypervolume of the front over the number of trials, in order of their numbers."""

    def gather(self, results: Results) -> tuple[Curve, ...]:
        finished = [int(trial) for trial in sorted(results.trials["trial"])]
        return gather_progress(results.points(), dict(results.objectives), finished)

    def draw(self, record: tuple[Curve, ...]) -> Drawing:
        """Draw hypervolume in steps against trials and, where they are known, against hours.

        Colours tell tasks apart and dashes chips, or colours the chips of a single task. A trace's `meta`
        names its task and chip.
        """
        import plotly.graph_objects as go
        from plotly.subplots import make_subplots

        timed = any(np.isfinite(curve.hours).any() for curve in record)
        axes = [("trials", "finished trials"), *([("hours", "hours")] if timed else [])]
        figure = make_subplots(rows=1, cols=len(axes), shared_yaxes=True, horizontal_spacing=0.06)
        tasks = list(dict.fromkeys(curve.task for curve in record))
        chips = list(dict.fromkeys(curve.hardware for curve in record))
        for curve in record:
            task, chip = tasks.index(curve.task), chips.index(curve.hardware)
            several = len(tasks) > 1
            colour = colour_of(task if several else chip)
            name = _name(curve.task if several else "", curve.hardware if len(chips) > 1 else "")
            for panel, (axis, words) in enumerate(axes, 1):
                figure.add_trace(
                    go.Scatter(
                        x=getattr(curve, axis).tolist(),
                        y=curve.hypervolume.tolist(),
                        mode="lines" if len(curve.trials) > 1 else "markers",
                        line={
                            "shape": "hv",
                            "color": colour,
                            "width": 2,
                            "dash": _DASHES[chip % len(_DASHES)] if several else "solid",
                        },
                        name=name,
                        legendgroup=name,
                        showlegend=panel == 1 and len(record) > 1,
                        meta={"task": curve.task, "hardware": curve.hardware},
                        customdata=curve.trials.tolist(),
                        hovertemplate=_hover(axis),
                    ),
                    row=1,
                    col=panel,
                )
                figure.update_xaxes(title_text=words, rangemode="tozero", row=1, col=panel)
        figure.update_yaxes(nticks=6, tickformat=".3~g")
        figure.update_yaxes(title_text="hypervolume (1 = ideal)", row=1, col=1)
        figure.update_layout(
            legend={"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"},
            margin={"l": 56, "r": 8, "t": 32, "b": 40},
        )
        return figure


def gather_progress(
    points: pandas.DataFrame,
    objectives: Mapping[str, str],
    finished: Sequence[int],
    hours: Sequence[float] | None = None,
) -> tuple[Curve, ...]:
    """Gather how the front's hypervolume grew, trial by trial; no curve where a front is too large for that.

    Each objective is normalised over the range of all points of the task and chip, so that the last value is
    the hypervolume that the page states of them without budgets. Points that have seen the labels, or do not
    fit their chip where others do, are on no front; objectives that tell no point apart add no dimension.
    A trial's points are those that the table has now, its later repeats included.

    Args:
        points: one row per design point, with a column `trial`.
        objectives: column -> 'max' or 'min'; those that the table lacks are left out.
        finished: trial numbers in the order of finishing; points of other trials only widen the ranges.
        hours: time spent until each had finished; None: unknown.
    """
    spent = np.full(len(finished), np.nan) if hours is None else np.asarray(hours, np.float64)
    known = {name: way for name, way in objectives.items() if np.isfinite(numbers(points, name)).any()}
    curves: list[Curve] = []
    if not known:
        return ()
    for (task, hardware), group in _groups(points):
        costs, place = _normalised(group, known, finished)
        if not costs.size or not (n_steps := _affordable(costs)):
            continue
        places, values = _growth(costs, place, n_steps)
        if places[-1] < len(finished) - 1:  # the last trials changed nothing
            places, values = np.append(places, len(finished) - 1), np.append(values, values[-1])
        curves.append(Curve(task, hardware, places + 1, spent[places], values))
    return tuple(curves)


def _hover(axis: str) -> str:
    at = "%{x} trials" if axis == "trials" else "%{x:.3g} h, %{customdata} trials"
    return f"%{{y:.3f}} after {at}<extra>%{{fullData.name}}</extra>"


def _groups(points: pandas.DataFrame) -> list[tuple[tuple[str, str], pandas.DataFrame]]:
    """Return the points of each (task, chip), in the order of the table; "" where it does not say."""
    by = [name for name in ("task", "hardware") if name in points.columns]
    if not by:
        return [(("", ""), points)]
    groups = []
    for values, group in points.groupby(by, sort=False, dropna=False, observed=True):
        names = dict(zip(by, values, strict=True))
        groups.append(((_text(names.get("task")), _text(names.get("hardware"))), group.drop(columns=by)))
    return groups


def _text(value: object) -> str:
    return "" if value is None or value != value else str(value)


def _normalised(
    group: pandas.DataFrame, objectives: Mapping[str, str], finished: Sequence[int]
) -> tuple[Array, Array]:
    """Return costs in [0, 1] of the points that can be on a front, and which finished trial each is of.

    Returns:
        (point, objective), (point,)
    """
    group = group[honest(group)]
    usable = np.asarray(fitting(group))
    columns = []
    for name, way in objectives.items():
        values = numbers(group, name)
        known = np.isfinite(values)
        usable = usable & known
        if known.any() and (low := values[known].min()) < (high := values[known].max()):
            columns.append((high - values if way == "max" else values - low) / (high - low))
    costs = np.column_stack(columns) if columns else np.empty((len(group), 0))
    place = _places(np.asarray(group["trial"], np.int64), np.asarray(finished, np.int64))
    usable &= place >= 0
    return costs[usable], place[usable]


def _places(trials: Array, finished: Array) -> Array:
    """Return where each trial stands among the finished ones, -1 where it is not among them."""
    if not len(finished):
        return np.full(len(trials), -1)
    order = np.argsort(finished, kind="stable")
    places = order[np.searchsorted(finished[order], trials).clip(max=len(finished) - 1)]
    return np.where(finished[places] == trials, places, -1)


def _affordable(costs: Array) -> int:
    """Return at how many trials the hypervolume can be taken, judged by the last front; 0: not even once."""
    front = np.unique(costs[non_dominated(costs)], axis=0)
    cheap = _CHEAP.get(costs.shape[1], _CHEAP_BEYOND)
    return int(MAX_STEPS * min(1.0, (cheap / len(front)) ** 2))


def _growth(costs: Array, place: Array, n_steps: int) -> tuple[Array, Array]:
    """Return the places at which the front had changed, among so many looked at, and its hypervolume."""
    held = np.unique(place)
    # The last place is always among them, so that the curve ends at what the whole front attains.
    looked = held[np.unique(np.linspace(len(held) - 1, 0, min(n_steps, len(held))).round().astype(int))]
    order = np.argsort(place, kind="stable")
    ends = np.searchsorted(place[order], looked, side="right")
    corner = np.ones(costs.shape[1])
    front, distinct = Front(costs.shape[1]), costs[:0]
    places, values = [], []
    for at, block in zip(looked, np.split(costs[order], ends[:-1]), strict=True):
        new = np.unique(block, axis=0)
        if not front.add(new, np.arange(len(new))).any():
            continue
        grown = np.unique(front.points, axis=0)
        if not np.array_equal(grown, distinct):
            distinct = grown
            places.append(at)
            values.append(hypervolume(distinct, corner))
    return np.array(places, np.int64), np.array(values)


def _name(task: str, hardware: str) -> str:
    return safe(shortened(" · ".join(part for part in (task, hardware) if part), _NAME_CHARACTERS))
