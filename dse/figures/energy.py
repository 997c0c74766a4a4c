"""Accuracy against energy while one parameter moves, such as the gain that sets the spike rate."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.figures import Results, full_read_outs, hardware_key, of_task, on_one_chip
from dse.figures.front import axis_type, interval, numbers
from dse.figures.labels import OKABE_ITO_LIGHT, axis_title, short
from dse.records import Array
from dse.registry import param, register
from dse.skyline.front import front_mask

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects


_APART = 0.06  # of an axis: labels nearer than this in both would overlap


@dataclass(frozen=True)
class Trade:
    """Points of two columns, in the order of the parameter that labels them.

    x, y: the two columns. parameter: the column that labels the points.
    values: (point, 2) float64 of x and y.
    low, high: (point, 2) distance from the value to the ends of its interval, 0 where none is known.
    labels: (point,) the parameter, in words.
    on_front: (point,) whether no other point is better in both columns.
    n_left_out: rows that miss one of the two columns, and are not shown.
    """

    x: str
    y: str
    parameter: str
    values: Array
    low: Array
    high: Array
    labels: tuple[str, ...]
    on_front: Array
    n_left_out: int


@register("figures", "trade")
@dataclass(frozen=True)
class TradeFigure:
    """Trade-off: two columns of the full read-outs, with points labelled by a parameter."""

    parameter: str = param(doc="column that labels the points, such as encoder.gain", axis=False)
    x: str = param("energy_uj", doc="column of the cost", axis=False)
    y: str = param("accuracy", doc="column of the quality", axis=False)
    hardware: str = hardware_key()
    task: str = param("", doc="what is predicted (default: the first task)", axis=False)

    def gather(self, results: Results) -> Trade:
        frame = of_task(full_read_outs(on_one_chip(results.points(), self.hardware)), self.task)
        return gather_energy(frame, self.parameter, self.x, self.y)

    def draw(self, record: Trade) -> plotly.graph_objects.Figure:
        return draw_energy(record)


def gather_energy(
    frame: pandas.DataFrame,
    parameter: str,
    x: str = "energy_uj",
    y: str = "accuracy",
    objectives: Mapping[str, str] | None = None,
) -> Trade:
    """Gather two columns of a table of design points, labelled by a parameter.

    Args:
        frame: one row per design point.
        parameter: column of the parameter, numbers or words.
        x: cost column.
        y: quality column.
        objectives: column -> 'max' or 'min'; absent: x falls and y rises.

    Raises:
        ValueError: a column is not in the table, or has no direction.
    """
    unknown = [column for column in (parameter, x, y) if column not in frame.columns]
    if unknown:
        raise ValueError(f"columns must be in the table, got {unknown}")
    directions = {x: "min", y: "max"} if objectives is None else objectives
    undirected = [column for column in (x, y) if column not in directions]
    if undirected:
        raise ValueError(f"objectives must say 'max' or 'min' for both columns, got none for {undirected}")
    values = np.column_stack([numbers(frame, x), numbers(frame, y)])
    shown = np.isfinite(values).all(axis=1)
    points = frame[shown]
    number = numbers(points, parameter)
    words = np.argsort(points[parameter].astype(str).to_numpy(), kind="stable")
    order = words[np.argsort(number[words], kind="stable")]  # numbers first, words in their own order after
    points = points.iloc[order]
    ends = [interval(points, column) for column in (x, y)]
    return Trade(
        x=x,
        y=y,
        parameter=parameter,
        values=values[shown][order],
        low=np.column_stack([low for low, _ in ends]),
        high=np.column_stack([high for _, high in ends]),
        labels=tuple(short(value) for value in points[parameter].tolist()),
        on_front=front_mask(points, [(x, directions[x]), (y, directions[y])]),
        n_left_out=int((~shown).sum()),
    )


def draw_energy(trade: Trade) -> plotly.graph_objects.Figure:
    """Draw the points; those on the front are strong, joined by a staircase, and have labels and bars.

    The labels of the others show on hovering: dozens of designs would hide the front behind theirs.
    """
    import plotly.graph_objects as go

    figure = go.Figure()
    colour = OKABE_ITO_LIGHT[0]
    scale = axis_type(trade.values[:, 0])
    for best in (False, True):
        rows = np.flatnonzero(trade.on_front == best)
        rows = rows[np.argsort(trade.values[rows, 0], kind="stable")]
        bars = {"type": "data", "symmetric": False, "color": colour, "thickness": 1, "visible": best}
        figure.add_scatter(
            x=trade.values[rows, 0],
            y=trade.values[rows, 1],
            error_x={**bars, "array": trade.high[rows, 0], "arrayminus": trade.low[rows, 0]},
            error_y={**bars, "array": trade.high[rows, 1], "arrayminus": trade.low[rows, 1]},
            cliponaxis=False,
            customdata=[html.escape(trade.labels[row], quote=False) for row in rows],
            text=_written([html.escape(trade.labels[row], quote=False) for row in rows], trade, rows, scale),
            textposition="bottom right",
            mode="lines+markers+text" if best else "markers",
            marker={"color": colour, "size": 9 if best else 6, "opacity": 1.0 if best else 0.4},
            line={"color": colour, "width": 1.5, "shape": "hv"},
            name="front" if best else "dominated",
            hovertemplate=f"{axis_title(trade.parameter)} %{{customdata}}<extra></extra>",
        )
    figure.update_layout(
        xaxis={"title": {"text": axis_title(trade.x)}, "type": scale},
        yaxis={"title": {"text": axis_title(trade.y)}},
    )
    return figure


def _written(labels: list[str], trade: Trade, rows: Array, scale: str) -> list[str]:
    """Return the labels, '' for one that would overlap an earlier one."""
    values = np.column_stack(
        [np.log(trade.values[:, 0]) if scale == "log" else trade.values[:, 0], trade.values[:, 1]]
    )
    span = np.ptp(values, axis=0) if len(values) else np.ones(2)
    places = values[rows] / np.where(span > 0, span, 1.0)
    taken: list[int] = []
    for k in range(len(rows)):
        if all(np.abs(places[k] - places[other]).max() >= _APART for other in taken):
            taken.append(k)
    return [label if k in taken else "" for k, label in enumerate(labels)]
