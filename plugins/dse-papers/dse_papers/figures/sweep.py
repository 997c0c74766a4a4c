"""What a parameter does: columns over it, such as accuracy and transferred information over T_w.

Sources: Rasouli et al., an extreme learning machine for texture recognition, Figs. 12 and 15; Brayshaw et
al., temporal and spatio-temporal domains, Fig. 5a (REFERENCES.md).
"""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.base.records import Array, Floats
from dse.base.registry import fixed, register
from dse.show.figures import Results, full_read_outs, hardware_key, on_one_chip, with_value
from dse.show.figures.front import interval, numbers
from dse.show.figures.labels import OKABE_ITO_LIGHT, axis_title, colour_of, interval_bars, safe, short

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

_DASHES = ("solid", "dash", "dot", "dashdot")
_SYMBOLS = ("circle", "x", "square", "triangle-up")
_PANEL_PX, _NAME_PX, _MARGIN_PX = 180, 21, 100


@dataclass(frozen=True)
class Line:
    """The best design at every value of the parameter, for one family and task (and value of `by`).

    x: (k,) values of the parameter, rising. trial: (k,) the design of each.
    values: column -> (k,), NaN where there is none.
    low, high: column -> (k,) distance from the value to the ends of its interval.
    """

    name: str
    x: Array
    trial: Array
    values: Mapping[str, Array]
    low: Mapping[str, Array]
    high: Mapping[str, Array]


@dataclass(frozen=True)
class Sweep:
    """Columns over a parameter. n_left_out: rows without a number of the parameter or of the first column."""

    x: str
    columns: tuple[str, ...]
    lines: tuple[Line, ...]
    n_left_out: int


@register("figures", "sweep")
@dataclass(frozen=True)
class SweepFigure:
    """Columns over a parameter, a panel each: the design best in the first column at each of its values."""

    x: str = fixed(
        doc="column of numbers, such as model.window_ms; with * all columns like it, as in model.*.window_ms"
    )
    columns: tuple[str, ...] = fixed(("accuracy",), doc="columns of numbers, a panel each")
    family: str = fixed("", doc="family of classifiers (default: a line for each)")
    task: str = fixed("", doc="what is predicted (default: a line for each)")
    by: str = fixed("", doc="another column whose values have a line each")
    hardware: str = hardware_key()

    def gather(self, results: Results) -> Sweep:
        points = full_read_outs(on_one_chip(results.points(), self.hardware))
        for column, name in (("family", self.family), ("task", self.task)):
            points = with_value(points, column, name)
        x, columns = self.x, self.columns
        if not columns or len({x, *columns}) <= len(columns):
            text = f"columns must be one or more, none twice and none the x '{x}'"
            raise ValueError(f"{text}, got {list(columns)}")
        if "*" in x:
            points = points.assign(**{x: _merged(points, x)})
        by = [self.by] if self.by else []
        if unknown := [name for name in (x, *columns, *by) if name not in points.columns]:
            raise ValueError(f"columns must be in the table, got {unknown}")
        known = np.isfinite(numbers(points, x)) & np.isfinite(numbers(points, columns[0]))
        rows = points[known].assign(_x=numbers(points, x)[known], _first=-numbers(points, columns[0])[known])
        if rows.empty:
            raise ValueError(f"a row must have numbers of {x} and {columns[0]}, got none")
        groups = [name for name in ("family", "task") if name in rows and rows[name].nunique() > 1] + by
        lines = tuple(
            _line(_name(name, self.by), of_line, columns)
            for name, of_line in (rows.groupby(groups) if groups else [((), rows)])
        )
        return Sweep(x, tuple(columns), lines, int((~known).sum()))

    def draw(self, record: Sweep) -> plotly.graph_objects.Figure:
        """Draw the columns below each other over the parameter, a line per family and task."""
        from plotly.subplots import make_subplots

        n = len(record.columns)
        figure = make_subplots(rows=n, cols=1, shared_xaxes=True, vertical_spacing=0.08 / n)
        for row, column in enumerate(record.columns, 1):
            for index, line in enumerate(record.lines):
                colour = colour_of(index)
                style = index // len(OKABE_ITO_LIGHT) % len(_DASHES)
                figure.add_scatter(
                    x=line.x,
                    y=line.values[column],
                    error_y=interval_bars(line.low[column], line.high[column], width=3),
                    mode="lines+markers",
                    name=safe(line.name),
                    legendgroup=str(index),
                    showlegend=row == 1 and len(record.lines) > 1,
                    line={"color": colour, "width": 1.5, "dash": _DASHES[style]},
                    marker={"symbol": _SYMBOLS[style], "size": 6},
                    customdata=line.trial,
                    hovertemplate="%{x:.4g}: %{y:.4g}, trial %{customdata}<extra></extra>",
                    row=row,
                    col=1,
                )
            figure.update_yaxes(title_text=axis_title(column), row=row, col=1)
        figure.update_xaxes(title_text=axis_title(record.x), row=n, col=1)
        figure.update_layout(height=max(_PANEL_PX * max(2, n), _NAME_PX * len(record.lines)) + _MARGIN_PX)
        return figure


def _merged(points: pandas.DataFrame, pattern: str) -> Floats:
    """Return the number that each row has in one of the columns of a pattern, NaN where it has none."""
    alike = fnmatch.filter(map(str, points.columns), pattern)
    values = np.column_stack([np.full(len(points), np.nan), *(numbers(points, name) for name in alike)])
    known = np.isfinite(values)
    if (known.sum(axis=1) > 1).any():
        raise ValueError(f"a row must have a number in one of {', '.join(alike)}, got several")
    return np.where(known.any(axis=1), np.nansum(values, axis=1), np.nan)


def _name(values: Sequence[object], by: str) -> str:
    """Return the name of a line: its values in words; that of `by`, the last, with its column."""
    words = [short(value) for value in values]
    return " ".join([*words[:-1], f"{by} {words[-1]}"] if by else words)


def _line(name: str, rows: pandas.DataFrame, columns: Sequence[str]) -> Line:
    best = rows.sort_values(["_x", "_first", "trial"], kind="stable").drop_duplicates("_x")
    ends = {column: interval(best, column) for column in columns}
    return Line(
        name=name,
        x=best["_x"].to_numpy(np.float64),
        trial=best["trial"].to_numpy(np.int64),
        values={column: numbers(best, column) for column in columns},
        low={column: low for column, (low, _) in ends.items()},
        high={column: high for column, (_, high) in ends.items()},
    )
