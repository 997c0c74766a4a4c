"""Recognition over time: accuracy after every input length, and where t_c lies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.base.registry import fixed, register
from dse.measure import decision
from dse.show.figures import NothingRecorded, Results, mean_of, ranked
from dse.show.figures.labels import OKABE_ITO_LIGHT, Drawing, axis_title, colour_of, safe, short

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

    trial: int | None = fixed(None, doc="number of a trial: its curve alone", low=0)

    def gather(self, results: Results) -> tuple[Recognition, ...]:
        curves = tuple(self._curves(results))
        if not curves:
            raise NothingRecorded("a trial must answer after several input lengths, got none")
        return curves

    def _curves(self, results: Results) -> Iterator[Recognition]:
        if self.trial is not None:
            runs = results.arrays(self.trial, "read_out.npz")
            if runs and len(runs[0]["accuracy"]) > 1:
                yield curve(f"trial {self.trial}", *_means(runs))
            return
        best = ranked(results).drop_duplicates(["task", "family"])
        n_tasks = best["task"].nunique()
        for trial, task, family in zip(best["trial"], best["task"], best["family"], strict=True):
            runs = results.arrays(int(trial), f"read_out_{task}.npz")  # of a head of a joint network
            runs = runs or results.arrays(int(trial), "read_out.npz")
            if runs:
                yield curve(f"{family} {task}" if n_tasks > 1 else str(family), *_means(runs))

    def draw(self, record: tuple[Recognition, ...]) -> Drawing:
        """Draw one line per curve; a ring marks its t_c."""
        import plotly.graph_objects as go

        figure = go.Figure()
        for i, one in enumerate(record):
            name = safe(one.name)
            colour = colour_of(i)
            figure.add_scatter(
                x=one.time_ms,
                y=one.accuracy,
                mode="lines" if len(one.time_ms) > 1 else "markers",
                line={"color": colour, "dash": _DASHES[i // len(OKABE_ITO_LIGHT) % len(_DASHES)]},
                name=name,
                legendgroup=str(i),
                hovertemplate=f"{name}: %{{y:.3f}} after %{{x:.4g}} ms<extra></extra>",
            )
            if np.isfinite(one.t_c_ms):
                figure.add_scatter(
                    x=[one.t_c_ms],
                    y=[one.accuracy_at_t_c],
                    mode="markers",
                    marker={"symbol": "circle-open", "size": 11, "color": colour, "line": {"width": 2}},
                    name=f"t_c of {name}",
                    legendgroup=str(i),
                    showlegend=False,
                    hovertemplate=f"{name}: t_c {short(one.t_c_ms)} ms, %{{y:.3f}}<extra></extra>",
                )
        figure.update_layout(
            xaxis={"title": {"text": "input length (ms)"}, "rangemode": "tozero"},
            yaxis={"title": {"text": axis_title("accuracy")}, "range": [0, 1.02]},
            showlegend=len(record) > 1,
        )
        return figure


def _means(runs: list[dict[str, Array]]) -> tuple[Array, Array]:
    return mean_of(runs, "decision_latency_ms"), mean_of(runs, "accuracy")


def curve(name: str, time_ms: Array, accuracy: Array) -> Recognition:
    """Return a curve: input lengths in ms, and the accuracy after each, (k,) both, in any order."""
    time_ms, accuracy = np.asarray(time_ms, np.float64), np.asarray(accuracy, np.float64)
    order = np.argsort(time_ms, kind="stable")
    time_ms, accuracy = time_ms[order], accuracy[order]
    t_c_ms = decision.t_c(time_ms, accuracy)
    reached = accuracy[time_ms == t_c_ms]
    return Recognition(name, time_ms, accuracy, t_c_ms, float(reached[0]) if len(reached) else float("nan"))
