"""Precision: accuracy over bits per weight, memory and energy, a line for every share of weights removed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.figures import Results, hardware_key, on_one_chip, trial_key, trial_of
from dse.figures.front import interval, numbers
from dse.figures.labels import OKABE_ITO_LIGHT, axis_title
from dse.records import Array
from dse.registry import param, register

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

BITS, PRUNED = "weight_bits", "pruned_after"
COSTS = (BITS, "memory_bytes", "energy_uj")


@dataclass(frozen=True)
class Precision:
    """One trained design at several precisions; NaN where it was not evaluated.

    weight_bits: (k,) rising. pruned: (p,) rising shares removed after training.
    accuracy, accuracy_se: (p, k).
    costs: column -> (p, k), the bits themselves first; what no row has is not among them.
    """

    weight_bits: Array
    pruned: Array
    accuracy: Array
    accuracy_se: Array
    costs: Mapping[str, Array]


@register("figures", "precision")
@dataclass(frozen=True)
class PrecisionFigure:
    """Accuracy and cost of a trial with fewer bits per weight and pruned weights."""

    trial: int | None = trial_key()
    task: str = param("", doc="head of a joint network (default: the first)", axis=False)
    hardware: str = hardware_key()

    def gather(self, results: Results) -> Precision:
        points = results.points()
        rows = points[points["trial"] == trial_of(results, self.trial)]
        if "task" in rows and len(rows):
            rows = rows[rows["task"] == (self.task or rows["task"].iloc[0])]
        return gather_precision(on_one_chip(rows, self.hardware))

    def draw(self, record: Precision) -> plotly.graph_objects.Figure:
        return draw_precision(record)


def gather_precision(points: pandas.DataFrame) -> Precision:
    """Gather the accuracy and cost of one design at the end of the window, at every precision.

    Args:
        points: rows of one trial, task and hardware profile; earlier answers among them are left out.

    Raises:
        ValueError: a column is missing, no row answers at the end, or the rows are of several designs.
    """
    for name in (BITS, PRUNED, "accuracy"):
        if name not in points.columns:
            raise ValueError(f"points must have a column {name}, got a table without it")
    early = np.isfinite(numbers(points, "phi")) | np.isfinite(numbers(points, "read_out_ms"))
    rows = points[~early & np.isfinite(numbers(points, BITS))]
    if rows.empty:
        raise ValueError("points must hold at least one decision at the end of the window, got none")
    for name in ("trial", "task", "hardware"):
        names = list(rows[name].unique()) if name in rows.columns else []
        if len(names) > 1:
            raise ValueError(f"points must have one {name}, got {', '.join(map(str, names))}")
    bits, column = np.unique(numbers(rows, BITS), return_inverse=True)
    pruned, line = np.unique(numbers(rows, PRUNED), return_inverse=True)

    def table(values: Array) -> Array:
        out = np.full((len(pruned), len(bits)), np.nan)
        out[line, column] = values
        return out

    costs = {name: table(numbers(rows, name)) for name in COSTS}
    return Precision(
        bits.astype(np.int64),
        pruned,
        table(numbers(rows, "accuracy")),
        table(interval(rows, "accuracy")[0]),
        {name: values for name, values in costs.items() if np.isfinite(values).any()},
    )


def draw_precision(precision: Precision) -> plotly.graph_objects.Figure:
    """Draw accuracy with one standard error over bits, memory and energy, a panel each."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=1, cols=len(precision.costs), shared_yaxes=True)
    for panel, (cost, values) in enumerate(precision.costs.items(), 1):
        for index, share in enumerate(precision.pruned):
            known = np.isfinite(values[index]) & np.isfinite(precision.accuracy[index])
            name = f"{share:.0%} removed" if share else "all weights"
            figure.add_trace(
                go.Scatter(
                    x=values[index][known],
                    y=precision.accuracy[index][known],
                    error_y={"array": precision.accuracy_se[index][known], "thickness": 1},
                    mode="lines+markers",
                    name=name,
                    legendgroup=name,
                    showlegend=panel == 1,
                    line={"color": OKABE_ITO_LIGHT[index % len(OKABE_ITO_LIGHT)], "width": 1.5},
                    customdata=precision.weight_bits[known],
                    hovertemplate=f"{name}, %{{customdata}} bits: %{{y:.3f}} at %{{x:.4g}}<extra></extra>",
                ),
                row=1,
                col=panel,
            )
        figure.update_xaxes(
            title_text="bits per weight" if cost == BITS else axis_title(cost), row=1, col=panel
        )
    figure.update_yaxes(title_text=axis_title("accuracy"), row=1, col=1)
    return figure
