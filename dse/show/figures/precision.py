"""Precision: accuracy over bits per weight, memory and energy, a line for every share of weights removed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.base.registry import fixed, register
from dse.show.figures import (
    NothingRecorded,
    Results,
    hardware_key,
    of_task,
    on_one_chip,
    trial_key,
    trial_of,
)
from dse.show.figures.front import interval, numbers
from dse.show.figures.labels import Drawing, axis_title, colour_of

BITS, PRUNED = "weight_bits", "pruned_after"
COSTS = (BITS, "memory_bytes", "energy_uj")


@dataclass(frozen=True)
class Precision:
    """One trained design at several precisions; NaN where it was not evaluated.

    weight_bits: (k,) rising. pruned: (p,) rising shares removed after training.
    accuracy, accuracy_se: (p, k).
    costs: column -> (p, k), the bits themselves first; absent columns are omitted.
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
    task: str = fixed("", doc="head of a joint network (default: the first)")
    hardware: str = hardware_key()
    costs: tuple[str, ...] = fixed(COSTS, doc="columns with a panel each")

    def gather(self, results: Results) -> Precision:
        points = results.points()
        points = points[points["trial"] == trial_of(results, self.trial)]
        points = on_one_chip(of_task(points, self.task), self.hardware)
        for name in (BITS, PRUNED, "accuracy"):
            if name not in points.columns:
                raise NothingRecorded(f"points must have a column {name}, got a table without it")
        early = np.isfinite(numbers(points, "phi")) | np.isfinite(numbers(points, "read_out_ms"))
        rows = points[~early & np.isfinite(numbers(points, BITS))]
        if rows.empty:
            raise NothingRecorded("points must hold at least one decision at the end of the window, got none")
        bits, column = np.unique(numbers(rows, BITS), return_inverse=True)
        pruned, line = np.unique(numbers(rows, PRUNED), return_inverse=True)

        def table(values: Array) -> Array:
            out = np.full((len(pruned), len(bits)), np.nan)
            out[line, column] = values
            return out

        costs = {name: table(numbers(rows, name)) for name in self.costs}
        return Precision(
            bits.astype(np.int64),
            pruned,
            table(numbers(rows, "accuracy")),
            table(interval(rows, "accuracy")[0]),
            {name: values for name, values in costs.items() if np.isfinite(values).any()},
        )

    def draw(self, record: Precision) -> Drawing:
        """Draw accuracy with one standard error over each cost, a panel each."""
        from plotly.subplots import make_subplots

        figure = make_subplots(rows=1, cols=len(record.costs), shared_yaxes=True)
        for panel, (cost, values) in enumerate(record.costs.items(), 1):
            for index, share in enumerate(record.pruned):
                known = np.isfinite(values[index]) & np.isfinite(record.accuracy[index])
                name = f"{share:.0%} removed" if share else "all weights"
                figure.add_scatter(
                    x=values[index][known],
                    y=record.accuracy[index][known],
                    error_y={"array": record.accuracy_se[index][known], "thickness": 1},
                    mode="lines+markers",
                    name=name,
                    legendgroup=name,
                    showlegend=panel == 1,
                    line={"color": colour_of(index), "width": 1.5},
                    customdata=record.weight_bits[known],
                    hovertemplate=f"{name}, %{{customdata}} bits: %{{y:.3f}} at %{{x:.4g}}<extra></extra>",
                    row=1,
                    col=panel,
                )
            title = "bits per weight" if cost == BITS else axis_title(cost)
            figure.update_xaxes(title_text=title, row=1, col=panel)
        figure.update_yaxes(title_text=axis_title("accuracy"), row=1, col=1)
        return figure
