"""The grid of a search: what two of its axes reach together, averaged over all the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.base.records import Array
from dse.base.registry import fixed, register
from dse.show.figures import Results, of_task
from dse.show.figures.front import numbers
from dse.show.figures.labels import axis_title, safe, short

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

MAX_VALUES = 20
"""Distinct numbers of an axis that have a row or column each; more are binned."""

_BINS = 12
_SPANS_DECADES = 100.0
_PRINTED = (10, 12)  # rows and columns of cells that are still large enough for their value
_MAX_TICKS = 12
_LABEL_CHARACTERS = 18
_TITLE_CHARACTERS = 40


@dataclass(frozen=True)
class Grid:
    """A column of a table over two others.

    x, y, value: the columns.
    x_labels, y_labels: what a column and a row of cells are, in words: a value, or the ends of a bin.
    mean: (y, x) mean over the rows of a cell, NaN where there are none.
    n: (y, x) rows of a cell.
    n_left_out: rows that miss one of the three.
    """

    x: str
    y: str
    value: str
    x_labels: tuple[str, ...]
    y_labels: tuple[str, ...]
    mean: Array
    n: Array
    n_left_out: int


@register("figures", "grid")
@dataclass(frozen=True)
class GridFigure:
    """Heat map: mean of a column over the trials at each pair of values of two axes."""

    x: str = fixed(doc="column of the horizontal axis, such as model.hidden")
    y: str = fixed(doc="column of the vertical axis")
    value: str = fixed("accuracy", doc="column of numbers")
    task: str = fixed("", doc="what is predicted (default: the first task)")

    def gather(self, results: Results) -> Grid:
        trials = of_task(results.trials, self.task)
        return gather_grid(trials, self.x, self.y, self.value)

    def draw(self, record: Grid) -> plotly.graph_objects.Figure:
        """Draw the means as a heat map; cells without a row stay blank, and values stand where they fit."""
        import plotly.graph_objects as go

        printed = len(record.y_labels) <= _PRINTED[0] and len(record.x_labels) <= _PRINTED[1]
        x_words, y_words = ([_safe(text) for text in texts] for texts in (record.x_labels, record.y_labels))
        hover = [
            [[int(n), x, y] for n, x in zip(line, x_words, strict=True)]
            for line, y in zip(record.n, y_words, strict=True)
        ]
        figure = go.Figure(
            go.Heatmap(
                x=list(range(len(x_words))),
                y=list(range(len(y_words))),
                z=[[None if np.isnan(mean) else float(mean) for mean in line] for line in record.mean],
                text=[
                    ["" if np.isnan(mean) else short(float(mean)) for mean in line] for line in record.mean
                ],
                texttemplate="%{text}" if printed else None,
                customdata=hover,
                colorscale="Cividis",
                colorbar={
                    "title": {"text": f"mean {_title(record.value)}", "side": "right"},
                    "thickness": 12,
                },
                xgap=1,
                ygap=1,
                hoverongaps=False,
                hovertemplate=(
                    f"{_template(record.x)} %{{customdata[1]}}<br>"
                    f"{_template(record.y)} %{{customdata[2]}}<br>"
                    f"mean {_template(record.value)} %{{text}} of %{{customdata[0]}}<extra></extra>"
                ),
            )
        )
        for axis, column, words in (("xaxis", record.x, x_words), ("yaxis", record.y, y_words)):
            places = list(range(0, len(words), -(-len(words) // _MAX_TICKS) or 1))
            figure.layout[axis] = {
                "title": {"text": _title(column), "standoff": 4},
                "automargin": True,
                "tickvals": places,
                "ticktext": [words[place] for place in places],
                "showgrid": False,
                "zeroline": False,
            }
        figure.update_layout(margin={"l": 56, "r": 8, "t": 8, "b": 40})
        return figure


def gather_grid(frame: pandas.DataFrame, x: str, y: str, value: str = "accuracy") -> Grid:
    """Gather the mean of a column over each two values of two axes, over whatever else differs.

    Args:
        frame: a row per trial, or per design point; of one task, and one chip where `value` depends on it.
        x: column of numbers or of words. Numbers rise, words keep the order of the table; more than
            `MAX_VALUES` numbers are binned, in equal steps, or equal ratios where they span two decades.
        y: another one.
        value: column of numbers.

    Raises:
        ValueError: a column is not in the table, or two are the same.
    """
    if unknown := [name for name in (x, y, value) if name not in frame.columns]:
        raise ValueError(f"columns must be in the table, got {unknown}")
    if len({x, y, value}) < 3:
        raise ValueError(f"x, y and value must be three columns, got '{x}', '{y}' and '{value}'")
    values = numbers(frame, value)
    usable = np.isfinite(values)
    for name in (x, y):
        usable &= np.asarray(frame[name].notna()) & ~np.isinf(numbers(frame, name))
    rows = frame[usable]
    x_labels, column = _places(rows, x)
    y_labels, row = _places(rows, y)
    shape = (len(y_labels), len(x_labels))
    total, n = np.zeros(shape), np.zeros(shape, np.int64)
    np.add.at(total, (row, column), values[usable])
    np.add.at(n, (row, column), 1)
    mean = np.divide(total, n, out=np.full(shape, np.nan), where=n > 0)
    return Grid(x, y, value, x_labels, y_labels, mean, n, int((~usable).sum()))


def _places(rows: pandas.DataFrame, column: str) -> tuple[tuple[str, ...], Array]:
    """Return what the cells along an axis are, and which one each row is in."""
    import pandas

    if not len(rows):
        return (), np.empty(0, np.int64)
    values = numbers(rows, column)
    if np.isnan(values).any() or pandas.api.types.is_bool_dtype(rows[column]):
        words = rows[column].astype(str)
        places, named = pandas.factorize(words)
        return tuple(map(str, named)), np.asarray(places)
    distinct, places = np.unique(values, return_inverse=True)
    if len(distinct) <= MAX_VALUES:
        return tuple(_exact(x) for x in distinct.tolist()), places
    low, high = distinct[0], distinct[-1]
    log = low > 0 and high / low > _SPANS_DECADES
    edges = np.geomspace(low, high, _BINS + 1) if log else np.linspace(low, high, _BINS + 1)
    labels = tuple(
        f"{short(a)}–{short(b)}" for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    )
    return labels, np.searchsorted(edges[1:-1], values, side="right")


def _exact(value: float) -> str:
    """Return a setting as people write it: it is not measured, so that no digit is dropped."""
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def _safe(text: str) -> str:
    return safe(_clipped(text, _LABEL_CHARACTERS))


def _clipped(text: str, n: int) -> str:
    return text if len(text) <= n else f"{text[: n - 1]}…"


def _title(column: str) -> str:
    return axis_title(_clipped(column, _TITLE_CHARACTERS))


def _template(column: str) -> str:
    """Return a column's words, to be read as they are within a plotly template."""
    return _title(column).replace("%{", "% {")
