"""Parallel coordinates: every design is a line across several columns, the front in colour."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

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
_ABSENT = -0.1  # where lines pass an axis that they have no value on
_STEPS = 5  # between ticks of an axis of numbers, about
_INK, _PAPER = "#1B1E22", "rgba(255,255,255,0.8)"


@dataclass(frozen=True)
class Parallel:
    """Design points along several axes.

    columns: the axes, left to right.
    categories: for each axis the words that its values count from 0, None where it is of numbers.
    values: (point, column) float64; NaN where a design does not have the parameter.
    on_front: (point,) whether no other point of the same task and chip is better in all objectives.
    n_incomplete: rows that miss a measured number on one of the axes, and have no line.
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
        columns = self.columns or (*(name for name in map(str, frame.columns) if "." in name), *objectives)
        if len(columns) < 2 or len(set(columns)) < len(columns):
            raise ValueError(f"columns must be at least two distinct columns, got {list(columns)}")
        if unknown := [name for name in columns if name not in frame.columns]:
            raise ValueError(f"columns must be in the table, got {unknown}")
        by = [name for name in ("task", "hardware") if name in frame.columns]
        on_front = front_mask(frame, objectives.items(), group_numbers(frame, by), admissible(frame))
        axes = [_axis(frame, column) for column in columns]
        values = np.column_stack([axis for axis, _ in axes])
        is_measured = np.array(["." not in column for column in columns])  # not of some families alone
        complete = np.flatnonzero((np.isfinite(values) | ~is_measured).all(axis=1))
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

    def draw(self, record: Parallel) -> plotly.graph_objects.Figure:
        """Draw the lines, the front in colour on top; a column over two decades is in logarithms."""
        import plotly.graph_objects as go

        axes = [
            _scaled(words, record.values[:, index]) for index, words in enumerate(record.categories)
        ]  # plotly's own parallel coordinates are pixels, in a PDF too
        shares = np.column_stack([axis.shares for axis in axes])
        figure = go.Figure()
        for is_front, name in ((False, "others"), (True, "front")):
            lines = shares[record.on_front == is_front]
            gap = np.full((len(lines), 1), np.nan)
            places = np.broadcast_to([*range(len(axes)), np.nan], (len(lines), len(axes) + 1))
            figure.add_scatter(
                x=places.ravel(),
                y=np.hstack([lines, gap]).ravel(),
                mode="lines",
                name=name,
                line={"color": OKABE_ITO_LIGHT[0] if is_front else _DIM, "width": 1.2 if is_front else 0.6},
                hoverinfo="skip",
            )
        for place, axis in enumerate(axes):
            figure.add_shape(type="line", x0=place, x1=place, y0=0, y1=1, line={"color": _INK, "width": 1})
            for at, text in axis.ticks:
                figure.add_annotation(
                    x=place,
                    y=at,
                    text=text,
                    showarrow=False,
                    xanchor="left",
                    xshift=3,
                    bgcolor=_PAPER,
                    borderpad=1,
                )
        figure.update_layout(
            xaxis={
                "tickvals": list(range(len(axes))),
                "ticktext": [axis_title(_clipped(name)) for name in record.columns],
                "side": "top",
                "tickangle": -25,
                "range": [-0.1, len(axes) - 0.6],
                "showgrid": False,
                "showline": False,
                "ticks": "",
            },
            yaxis={"visible": False, "range": [_ABSENT - 0.04, 1.04]},
            legend={"y": -0.02, "yanchor": "top"},
            margin={"l": 16, "r": 48, "t": 24, "b": 32},
        )
        return figure


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


class _Scaled(NamedTuple):
    """Values of an axis as shares of its length, and its ticks: share and text."""

    shares: Array
    ticks: list[tuple[float, str]]


def _scaled(words: tuple[str, ...] | None, values: Array) -> _Scaled:
    if words is not None:
        last = len(words) - 1
        every = -(-len(words) // _MAX_TICKS) or 1
        shares = values / last if last > 0 else np.full(len(values), 0.5)
        places = [(k / last if last > 0 else 0.5, words[k]) for k in range(0, len(words), every)]
        return _Scaled(shares, [(at, html.escape(_clipped(word), quote=False)) for at, word in places])
    known = values[np.isfinite(values)]
    if not len(known):
        return _Scaled(np.full(len(values), _ABSENT), [(_ABSENT, "–")] if len(values) else [])
    low, high = float(known.min()), float(known.max())
    if low == high:
        shares, ticks = np.where(values == low, 0.5, np.nan), [(0.5, short(low))]
    elif low > 0 and high / low > _SPANS_DECADES:
        foot, top = math.log10(low), math.log10(high)
        shares = (np.log10(values) - foot) / (top - foot)
        powers = range(math.ceil(foot), math.floor(top) + 1)
        ticks = [((power - foot) / (top - foot), short(10.0**power)) for power in powers]
    else:
        shares = (values - low) / (high - low)
        rough = (high - low) / _STEPS
        unit = 10.0 ** math.floor(math.log10(rough))
        step = next(n * unit for n in (1, 2, 5, 10) if n * unit >= rough * 0.999)
        rounds = [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
        ticks = [((at - low) / (high - low), short(round(at, 12))) for at in rounds]
    if len(known) < len(values):
        ticks.append((_ABSENT, "–"))
    return _Scaled(np.where(np.isnan(shares), _ABSENT, shares), ticks)


def _clipped(text: str) -> str:
    return text if len(text) <= _LABEL_CHARACTERS else f"{text[: _LABEL_CHARACTERS - 1]}…"
