"""Recognition over time: accuracy after every input length, and where t_c lies."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.figures import Results, mean_of
from dse.figures.labels import OKABE_ITO_LIGHT, axis_title, short
from dse.measure import decision
from dse.records import Array
from dse.registry import register

if TYPE_CHECKING:
    import plotly.graph_objects

_DASHES = ("solid", "dash", "dot", "dashdot")  # beyond the palette's colours, the line tells curves apart


@dataclass(frozen=True)
class Recognition:
    """One curve: a trial, or a family.

    time_ms, accuracy: (k,) by rising input length.
    t_c_ms: shortest input length within 10 % of the peak; NaN where no accuracy is known.
    accuracy_at_t_c: its accuracy.
    """

    name: str
    time_ms: Array
    accuracy: Array
    t_c_ms: float
    accuracy_at_t_c: float


@register("figures", "recognition")
@dataclass(frozen=True)
class RecognitionFigure:
    """Accuracy over input length, one curve for the most accurate trial of each family and task."""

    def gather(self, results: Results) -> tuple[Recognition, ...]:
        trials = results.trials[results.trials["status"] == "finished"]
        best = trials.sort_values("accuracy", ascending=False, kind="stable").drop_duplicates(
            ["task", "family"]
        )
        n_tasks = best["task"].nunique()
        read_outs = {}
        for trial, task, family in zip(best["trial"], best["task"], best["family"], strict=True):
            runs = results.arrays(int(trial), f"read_out_{task}.npz")  # of a head of a joint network
            runs = runs or results.arrays(int(trial), "read_out.npz")
            if runs:
                name = f"{family} {task}" if n_tasks > 1 else str(family)
                read_outs[name] = mean_of(runs, "decision_latency_ms"), mean_of(runs, "accuracy")
        if not read_outs:
            raise ValueError("a finished trial must have recorded a read_out.npz, got none")
        return gather_recognition(read_outs)

    def draw(self, record: tuple[Recognition, ...]) -> plotly.graph_objects.Figure:
        return draw_recognition(record)


def gather_recognition(read_outs: Mapping[str, tuple[Array, Array]]) -> tuple[Recognition, ...]:
    """Gather curves of recognition in the order given.

    Args:
        read_outs: name -> input lengths in ms and accuracy after each, (k,) both, as in read_out.npz.

    Raises:
        ValueError: a curve without input lengths, or not one accuracy for each.
    """
    curves = []
    for name, columns in read_outs.items():
        time_ms, accuracy = (np.asarray(column, np.float64) for column in columns)
        if time_ms.shape != accuracy.shape or time_ms.size == 0:
            raise ValueError(
                f"'{name}' must have one or more input lengths and an accuracy for each, "
                f"got {time_ms.size} and {accuracy.size}"
            )
        order = np.argsort(time_ms, kind="stable")
        time_ms, accuracy = time_ms[order], accuracy[order]
        t_c_ms = decision.t_c(time_ms, accuracy)
        reached = accuracy[time_ms == t_c_ms]
        at = float(reached[0]) if len(reached) else float("nan")
        curves.append(Recognition(name, time_ms, accuracy, t_c_ms, at))
    return tuple(curves)


def draw_recognition(curves: tuple[Recognition, ...]) -> plotly.graph_objects.Figure:
    """Draw accuracy over input length, one line per curve; a ring marks its t_c."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for i, curve in enumerate(curves):
        name = html.escape(curve.name, quote=False)
        colour = OKABE_ITO_LIGHT[i % len(OKABE_ITO_LIGHT)]
        dash = _DASHES[i // len(OKABE_ITO_LIGHT) % len(_DASHES)]
        figure.add_trace(
            go.Scatter(
                x=curve.time_ms,
                y=curve.accuracy,
                mode="lines" if len(curve.time_ms) > 1 else "markers",
                line={"color": colour, "dash": dash},
                name=name,
                legendgroup=str(i),
                hovertemplate=f"{name}: %{{y:.3f}} after %{{x:.4g}} ms<extra></extra>",
            )
        )
        if np.isfinite(curve.t_c_ms):
            figure.add_trace(
                go.Scatter(
                    x=[curve.t_c_ms],
                    y=[curve.accuracy_at_t_c],
                    mode="markers",
                    marker={"symbol": "circle-open", "size": 11, "color": colour, "line": {"width": 2}},
                    name=f"t_c of {name}",
                    legendgroup=str(i),
                    showlegend=False,
                    hovertemplate=f"{name}: t_c {short(curve.t_c_ms)} ms, %{{y:.3f}}<extra></extra>",
                )
            )
    figure.update_layout(
        xaxis={"title": {"text": "input length (ms)"}, "rangemode": "tozero"},
        yaxis={"title": {"text": axis_title("accuracy")}, "range": [0, 1.02]},
    )
    return figure
