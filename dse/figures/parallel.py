"""Parallel coordinates: every design is a line across several columns, the front in colour."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.figures import Results, hardware_key, on_one_chip
from dse.figures.front import numbers
from dse.figures.labels import OKABE_ITO_LIGHT, axis_title, short
from dse.records import Array
from dse.registry import param, register
from dse.skyline.admissible import admissible
from dse.skyline.front import front_mask
from dse.skyline.table import group_numbers

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

MAX_LINES = 3000
"""Lines that a figure holds: the front, and beyond it an even sample of the other designs."""

_DIM = "#B4BBC3"
_SPANS_DECADES = 100.0
_MAX_TICKS = 12
_LABEL_CHARACTERS = 24
_CHARACTER_PX = 7  # about as wide as one is drawn


@dataclass(frozen=True)
class Parallel:
    """Design points along several axes.

    columns: the axes, left to right.
    categories: for each axis the words that its values count from 0, None where it is of numbers.
    values: (point, column) float64.
    on_front: (point,) whether no other point of the same task and chip is better in all objectives.
    n_incomplete: rows that miss a number on one of the axes, and have no line.
    n_left_out: complete rows left out of the sample.
    """

    columns: tuple[str, ...]
    categories: tuple[tuple[str, ...] | None, ...]
    values: Array
    on_front: Array
    n_incomplete: int
    n_left_out: int


@register("figures", "parallel")
@dataclass(frozen=True)
class ParallelFigure:
    """Parallel coordinates: design points as lines over several columns, with the front highlighted."""

    columns: tuple[str, ...] = param(
        (),
        doc="columns, left to right (default: the axes of the search space and the objectives)",
        axis=False,
    )
    hardware: str = hardware_key()

    def gather(self, results: Results) -> Parallel:
        frame = on_one_chip(results.points(), self.hardware)
        objectives = {name: way for name, way in results.objectives if name in frame}
        axes = [name for name in map(str, frame.columns) if "." in name]
        return gather_parallel(frame, self.columns or (*axes, *objectives), objectives)

    def draw(self, record: Parallel) -> plotly.graph_objects.Figure:
        return draw_parallel(record)


def gather_parallel(
    frame: pandas.DataFrame, columns: Sequence[str], objectives: Mapping[str, str]
) -> Parallel:
    """Gather design points along several columns, at most `MAX_LINES` beside those on the front.

    Args:
        frame: one row per design point.
        columns: any of the table's, at least two. What is no number is a category, and so is its absence.
        objectives: column -> 'max' or 'min'; the front is over all of them, whatever is shown.

    Raises:
        ValueError: fewer than two columns, one twice or not in the table, or objectives as of `front_mask`.
    """
    if len(columns) < 2 or len(set(columns)) < len(columns):
        raise ValueError(f"columns must be at least two distinct columns, got {list(columns)}")
    if unknown := [name for name in columns if name not in frame.columns]:
        raise ValueError(f"columns must be in the table, got {unknown}")
    on_front = _fronts(frame, objectives)
    axes = [_axis(frame, column) for column in columns]
    values = np.column_stack([axis for axis, _ in axes])
    complete = np.flatnonzero(np.isfinite(values).all(axis=1))
    best, rest = complete[on_front[complete]], complete[~on_front[complete]]
    room = min(len(rest), max(0, MAX_LINES - len(best)))
    sample = rest[np.linspace(0, len(rest) - 1, room).round().astype(int)]
    shown = np.sort(np.concatenate([best, sample]))
    return Parallel(
        tuple(columns),
        tuple(words for _, words in axes),
        values[shown],
        on_front[shown],
        len(frame) - len(complete),
        len(complete) - len(shown),
    )


def draw_parallel(parallel: Parallel) -> plotly.graph_objects.Figure:
    """Draw the lines, the front in colour above the others; a column over two decades is in logarithms."""
    import plotly.graph_objects as go

    dimensions = [
        _dimension(column, words, parallel.values[:, index])
        for index, (column, words) in enumerate(zip(parallel.columns, parallel.categories, strict=True))
    ]
    figure = go.Figure(
        go.Parcoords(
            dimensions=dimensions,
            line={
                "color": parallel.on_front.astype(int).tolist(),  # higher numbers are drawn above lower ones
                "colorscale": [[0, _DIM], [1, OKABE_ITO_LIGHT[0]]],
                "cmin": 0,
                "cmax": 1,
            },
            labelside="top",
        )
    )
    # Plotly gives these axes no room of their own: words stand left of them, titles above.
    first = parallel.categories[0] if parallel.categories[0] is not None else ()
    longest = max((len(_clipped(word)) for word in first), default=0)
    left = max(longest + 2, len(_clipped(parallel.columns[0])) // 2) * _CHARACTER_PX
    right = len(_clipped(parallel.columns[-1])) // 2 * _CHARACTER_PX
    figure.update_layout(margin={"l": max(56, left), "r": max(48, right), "t": 48, "b": 24})
    return figure


def _fronts(frame: pandas.DataFrame, objectives: Mapping[str, str]) -> Array:
    """Return which rows are on the front of their task and chip, among those that a skyline compares."""
    by = [name for name in ("task", "hardware") if name in frame.columns]
    return front_mask(frame, objectives.items(), group_numbers(frame, by), admissible(frame))


def _axis(frame: pandas.DataFrame, column: str) -> tuple[Array, tuple[str, ...] | None]:
    """Return a column as numbers, and the words that these count where it has any."""
    import pandas

    present = frame[column].notna()
    values = numbers(frame, column)
    is_number = not np.isnan(values[np.asarray(present)]).any()
    if is_number and not pandas.api.types.is_bool_dtype(frame[column][present]):
        return values, None
    words = frame[column].astype(object).where(present, "–").map(_word)
    places, named = pandas.factorize(words)
    return np.asarray(places, np.float64), tuple(map(str, named))


def _word(value: object) -> str:
    return ("yes" if value else "no") if isinstance(value, bool | np.bool_) else str(value)


def _dimension(column: str, words: tuple[str, ...] | None, values: Array) -> dict[str, Any]:
    label = axis_title(_clipped(column))
    if words is not None:
        places = list(range(0, len(words), -(-len(words) // _MAX_TICKS) or 1))
        margin = 0.5 if len(words) < 2 else 0.0
        return {
            "label": label,
            "values": values.tolist(),
            "tickvals": places,
            "ticktext": [_clipped(words[place]) for place in places],  # plotly takes these as they are
            "range": [-margin, max(len(words) - 1, 0) + margin],
        }
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    if low > 0 and high / low > _SPANS_DECADES:
        powers = range(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)
        return {
            "label": label,
            "values": np.log10(values).tolist(),
            "tickvals": list(powers),
            "ticktext": [short(10.0**power) for power in powers],
            "range": [math.log10(low), math.log10(high)],
        }
    # Plotly draws an axis of one value as a bare line: give it a range to lie in.
    margin = 0.5 * (abs(low) or 1.0) if low == high else 0.0
    ends = [low - margin, high + margin]
    return {"label": label, "values": values.tolist(), "range": ends, "tickformat": ".3~r"}


def _clipped(text: str) -> str:
    return text if len(text) <= _LABEL_CHARACTERS else f"{text[: _LABEL_CHARACTERS - 1]}…"
