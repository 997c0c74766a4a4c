"""The front: which design points nothing beats, over any two or three columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas

from dse.base import registry
from dse.base.records import Array
from dse.base.registry import fixed, register
from dse.show.figures import Results, full_read_outs, hardware_key, on_one_chip, with_value
from dse.show.figures.labels import (
    Drawing,
    axis_title,
    colour_of,
    drawn,
    interval_bars,
    safe,
    short,
    shortened,
)
from dse.skyline.admissible import admissible
from dse.skyline.front import front_mask

HOVER_CHARACTERS = 60
_CROWD = 200  # points: more are drawn at half the size
_BARS = 20  # intervals on a front: more would hide its points
_SIZES = {2: (5, 9), 3: (2, 4)}  # dominated, on the front; in space points are drawn larger than their size
_CAMERA = {"eye": {"x": 1.5, "y": 1.5, "z": 0.85}, "center": {"x": 0, "y": 0, "z": -0.15}}
_APART = 0.06  # of an axis: labels nearer than this in both would overlap


@dataclass(frozen=True)
class Front:
    """Design points in the plane or space of two or three columns.

    columns: the columns shown, x first. directions: 'max' or 'min' of each.
    values: (point, column) float64.
    low, high: (point, column) distance from the value to the ends of its interval, 0 where none is known.
    on_front: (point,) whether no other point of the same group is better, over the columns shown.
    group: (point,) index into `groups`: fronts are never computed across groups (tasks).
    hover: (point,) the design in words, HTML-escaped.
    labels: (point,) what stands beside a point of the front, HTML-escaped; '' for nothing.
    n_left_out: rows that miss one of the columns and are not shown.
    """

    columns: tuple[str, ...]
    directions: tuple[str, ...]
    values: Array
    low: Array
    high: Array
    on_front: Array
    group: Array
    groups: tuple[str, ...]
    hover: tuple[str, ...]
    labels: tuple[str, ...]
    n_left_out: int


def numbers(frame: pandas.DataFrame, column: str) -> Array:
    """Return a column as float64, NaN where it holds no number or does not exist."""
    if column not in frame.columns:
        return np.full(len(frame), np.nan)
    return np.asarray(pandas.to_numeric(frame[column], errors="coerce"), dtype=np.float64)


def interval(frame: pandas.DataFrame, column: str) -> tuple[Array, Array]:
    """Return how far a column's interval reaches below and above its value, 0 where none is known.

    `<column>_se` is one standard error on both sides; `<column>_low` and `<column>_high` are its ends.
    """
    error = numbers(frame, f"{column}_se")
    value = numbers(frame, column)
    low, high = numbers(frame, f"{column}_low"), numbers(frame, f"{column}_high")
    below = np.where(np.isfinite(error), error, value - low)
    above = np.where(np.isfinite(error), error, high - value)
    return np.nan_to_num(np.maximum(below, 0.0)), np.nan_to_num(np.maximum(above, 0.0))


def spans_decades(values: Array) -> bool:
    """Return whether numbers are positive and span more than two decades, so that an axis is logarithmic."""
    known = values[np.isfinite(values)]
    return bool(len(known) and known.min() > 0 and known.max() / known.min() > 100)


def design_columns(frame: pandas.DataFrame) -> list[str]:
    """Return the columns that say what a design is: trial, parameters, settings, hardware."""
    about = ("trial", "hardware", "phi", "theta", "weight_bits", "pruned_after")
    named = [column for column in about if column in frame.columns]
    return named[:1] + [column for column in map(str, frame.columns) if "." in column] + named[1:]


@register("figures", "front")
@dataclass(frozen=True)
class FrontFigure:
    """Design points over two or three columns, with the front of each task."""

    columns: tuple[str, ...] = fixed(
        (),
        doc="two or three columns, x first (default: energy, else the second objective, and the first one)",
    )
    hardware: str = hardware_key()
    task: str = fixed("", doc="what is predicted (default: every task, each with its own front)")
    full: bool = fixed(False, doc="one point per design: its answer at the end of the window")
    labels: str = fixed("", doc="column written beside the front, such as encoder.gain")

    def gather(self, results: Results) -> Front:
        ways: Mapping[str, str] = {
            **{name: column.direction for name, column in registry.columns().items()},
            **dict(results.objectives),
        }
        first = [name for name, _ in results.objectives]
        costs = ["energy_uj"] if "energy_uj" in first[1:] else first[1:2]
        columns = self.columns or (*costs, *first[:1])
        if len(columns) not in (2, 3):
            raise ValueError(f"columns must be two or three, got {len(columns)}")
        frame = with_value(on_one_chip(results.points(), self.hardware), "task", self.task)
        frame = full_read_outs(frame) if self.full else frame
        held = frame[admissible(frame)]
        if held.empty and len(frame):
            raise ValueError("some design must fit the chip; choose another with the key hardware")
        named = [*columns, *([self.labels] if self.labels else [])]
        if unknown := [column for column in named if column not in held.columns]:
            raise ValueError(f"columns must be in the table, got {unknown}")
        if undirected := [column for column in columns if column not in ways]:
            raise ValueError(f"columns must have a direction, 'max' or 'min', got none for {undirected}")
        values = np.column_stack([numbers(held, column) for column in columns])
        shown = np.isfinite(values).all(axis=1)
        points = held[shown]
        names = points["task"].astype(str).tolist() if "task" in points else [""] * len(points)
        groups = tuple(dict.fromkeys(names)) or ("",)
        group = np.array([groups.index(name) for name in names], int)
        ends = [interval(points, column) for column in columns]
        words = points[self.labels].tolist() if self.labels else [""] * len(points)
        return Front(
            columns=tuple(columns),
            directions=tuple(ways[column] for column in columns),
            values=values[shown],
            low=np.column_stack([low for low, _ in ends]),
            high=np.column_stack([high for _, high in ends]),
            on_front=front_mask(points, [(column, ways[column]) for column in columns], group),
            group=group,
            groups=groups,
            hover=_hover(points, columns),
            labels=tuple(map(_safe, words)),
            n_left_out=int((~shown).sum()),
        )

    def draw(self, record: Front) -> Drawing:
        """Draw dominated points dim; in the plane the front is a staircase, with its intervals as bars.

        The staircase is what the front attains: a slanted line would claim designs that do not exist.
        """
        flat = len(record.columns) == 2
        logs = [spans_decades(record.values[:, k]) for k in range(len(record.columns))]
        traces = []
        for index, name in enumerate(record.groups):
            colour = colour_of(index)
            for best in (False, True):
                rows = np.flatnonzero((record.group == index) & (record.on_front == best))
                rows = rows[np.argsort(record.values[rows, 0], kind="stable")]
                crowded = flat and len(record.values) > _CROWD
                dim = min(0.4, (0.25 if flat else 0.4) * float(np.sqrt(1000 / max(len(rows), 1))))
                trace: dict[str, Any] = {
                    "type": "scatter" if flat else "scatter3d",
                    **{
                        axis: record.values[rows, k] for axis, k in zip("xyz", range(len(logs)), strict=False)
                    },
                    "showlegend": best or len(record.groups) == 1,
                    "name": safe(f"{name} {'front' if best else 'dominated'}".strip()),
                    "mode": "lines+markers" if best and flat else "markers",
                    "marker": {
                        "color": colour,
                        "size": _SIZES[len(logs)][best] / (2 if crowded else 1),
                        "opacity": 1.0 if best else dim,
                    },
                    "hovertext": [record.hover[row] for row in rows],
                    "hovertemplate": "%{hovertext}<extra></extra>",
                }
                if best:
                    trace |= {f"error_{axis}": bars for axis, bars in _bars(record, rows, colour).items()}
                    if any(record.labels):
                        trace |= {"text": _written(record, rows, logs), "textposition": "bottom right"}
                        trace |= {"mode": f"{trace['mode']}+text"} | ({"cliponaxis": False} if flat else {})
                if flat:
                    shape = "hv" if record.directions[0] == "min" else "vh"
                    trace["line"] = {"color": colour, "width": 1.5, "shape": shape}
                traces.append(trace)
        titles = {
            f"{axis}axis": {"title": {"text": axis_title(column)}, "type": "log" if log else "linear"}
            for axis, column, log in zip("xyz", record.columns, logs, strict=False)
        }
        space = {
            "scene": {**titles, "camera": _CAMERA},
            "legend": {"x": 0, "y": 1, "itemsizing": "constant"},
            "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
            "height": 560,
        }
        return drawn(traces, {**(titles if flat else space), "hoverlabel": {"align": "left"}})


def _bars(front: Front, rows: Array, colour: str) -> dict[str, dict[str, Any]]:
    """Return the intervals of every n-th point of a front."""
    shown = np.arange(len(rows)) % -(-len(rows) // _BARS) == 0 if len(rows) else np.zeros(0, bool)
    return {
        axis: interval_bars(
            *(np.where(shown, end[rows, k], np.nan) for end in (front.low, front.high)),
            color=colour,
            thickness=0.75,
            width=2,
        )
        for k, axis in enumerate("xyz"[: len(front.columns)])
        if front.high[rows, k].any() or front.low[rows, k].any()
    }


def _written(front: Front, rows: Array, logs: Sequence[bool]) -> list[str]:
    """Return the labels of points, '' for one that would overlap an earlier one."""
    values = np.column_stack(
        [np.log(front.values[:, k]) if log else front.values[:, k] for k, log in enumerate(logs)]
    )
    places = values[rows] / np.maximum(np.ptp(values, axis=0), 1e-300)
    taken: list[int] = []
    for k in range(len(rows)):
        if all(np.abs(places[k] - places[other]).max() >= _APART for other in taken):
            taken.append(k)
    return [front.labels[row] if k in taken else "" for k, row in enumerate(rows)]


def _hover(frame: pandas.DataFrame, columns: Sequence[str]) -> tuple[str, ...]:
    named = [*design_columns(frame), *columns]
    titles = [axis_title(column) for column in named]
    rows = zip(*(frame[column].tolist() for column in named), strict=True)
    return tuple(
        "<br>".join(f"{title} {_safe(value)}" for title, value in zip(titles, row, strict=True))
        for row in rows
    )


def _safe(value: object) -> str:
    return safe(shortened(short(value), HOVER_CHARACTERS))
