"""Sample length: nets trained on samples of each length, beside one net that is read out early.

Source: Brayshaw et al., real-time texture classification, Fig. 4 (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.show.figures import Results, recorded
from dse.show.figures.front import interval, numbers
from dse.show.figures.labels import OKABE_ITO_LIGHT, axis_title

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

LENGTH = "window.n_steps"
QUANTITIES = ("accuracy", "t_p_ms", "t_h_ms")
ON_TEST = {"accuracy": "accuracy_test", "t_p_ms": "t_p_test_ms", "t_h_ms": "t_h_test_ms"}
"""Columns of the same quantities on the test set, at the settings that validation chose."""


@dataclass(frozen=True)
class Lengths:
    """Accuracy and decision times over sample length; NaN where there is none.

    trained_ms: (k,) rising lengths that nets were trained on. trial: (k,) the best net of each.
    trained: quantity -> (k,). low, high: quantity -> (k,) distance to the ends of its range: one standard
        error of the accuracy, the least and the largest of the runs of a time; 0 where none is known.
    early_ms: (m,) rising lengths after which one net was read out. early: quantity -> (m,).
    on_test: whether all are of the test set; they are of the validation set where the study has no other.
    """

    trained_ms: Array
    trial: Array
    trained: Mapping[str, Array]
    low: Mapping[str, Array]
    high: Mapping[str, Array]
    early_ms: Array
    early: Mapping[str, Array]
    on_test: bool


@register("figures", "lengths")
@dataclass(frozen=True)
class LengthsFigure:
    """Accuracy over sample length: the best trial of each length, and the longest one read out early."""

    def gather(self, results: Results) -> Lengths:
        trials = results.trials
        _, runs = recorded(results, longest(trials), "read_out.npz")
        return gather_lengths(trials, runs)

    def draw(self, record: Lengths) -> plotly.graph_objects.Figure:
        """Draw accuracy, t_p and t_h over sample length, a panel each."""
        import plotly.graph_objects as go
        from plotly.subplots import make_subplots

        figure = make_subplots(
            rows=1, cols=len(QUANTITIES), subplot_titles=[axis_title(x) for x in QUANTITIES]
        )
        figure.update_annotations(font_size=12)
        of_set = "test" if record.on_test else "validation"
        sources = (
            (f"trained per length, {of_set} set", record.trained_ms, record.trained, "solid"),
            (f"one network, read out early, {of_set} set", record.early_ms, record.early, "dash"),
        )
        for column, quantity in enumerate(QUANTITIES, 1):
            for index, (name, times, values, dash) in enumerate(sources):
                colour = OKABE_ITO_LIGHT[index]
                low, high = record.low[quantity], record.high[quantity]
                bars = {"array": high, "arrayminus": low, "symmetric": False, "thickness": 1, "width": 3}
                figure.add_trace(
                    go.Scatter(
                        x=times,
                        y=values[quantity],
                        mode="lines+markers",
                        name=name,
                        legendgroup=name,
                        showlegend=column == 1,
                        line={"color": colour, "dash": dash, "width": 1.5},
                        marker={"size": 5},
                        error_y=bars if values is record.trained and (low.any() or high.any()) else None,
                        hovertemplate="%{x:.4g} ms: %{y:.3g}<extra></extra>",
                    ),
                    row=1,
                    col=column,
                )
            figure.update_xaxes(title_text="sample length (ms)", rangemode="tozero", row=1, col=column)
            figure.update_yaxes(rangemode="tozero", row=1, col=column)
            if not np.isfinite(np.concatenate([values[quantity] for _, _, values, _ in sources])).any():
                x = 0.5 * max(record.trained_ms.max(), record.early_ms.max())
                figure.add_annotation(x=x, y=0.5, text="none", showarrow=False, row=1, col=column)
                figure.update_yaxes(range=[0, 1], showticklabels=False, row=1, col=column)
        figure.update_layout(
            height=340,
            margin={"t": 64, "l": 48, "r": 16},
            legend={"orientation": "h", "x": 0, "y": 1.12, "yanchor": "bottom"},
        )
        return figure


def longest(trials: pandas.DataFrame) -> int:
    """Return the trial of the longest samples, the most accurate of several: the net to read out early.

    Raises:
        ValueError: no trial is finished, or the table has no sample length.
    """
    return int(_best(trials)["trial"].iloc[-1])


def gather_lengths(trials: pandas.DataFrame, read_outs: Sequence[Mapping[str, Array]]) -> Lengths:
    """Gather the most accurate trial of every sample length, and the early read-outs of one net.

    The length of a trial is the time of its full read-out.

    Args:
        trials: one row per trial, with the axis `window.n_steps`.
        read_outs: what read_out.npz of each run of one trial holds (that of `longest`); runs are averaged.

    Raises:
        ValueError: no trial is finished, no read-out, or the table has no sample length.
    """
    if not read_outs:
        raise ValueError("read_outs must hold at least one run, got none")
    best = _best(trials)
    on_test = bool(np.isfinite(numbers(best, ON_TEST["t_p_ms"])).any())
    columns = {name: ON_TEST[name] if on_test else name for name in QUANTITIES}
    ranges = {name: _range(best, column) for name, column in columns.items()}
    early_ms = np.asarray(read_outs[0]["decision_latency_ms"], dtype=np.float64)
    nothing = np.full(len(early_ms), np.nan)
    return Lengths(
        trained_ms=numbers(best, "decision_latency_ms"),
        trial=best["trial"].to_numpy(),
        trained={name: numbers(best, column) for name, column in columns.items()},
        low={name: low for name, (low, _) in ranges.items()},
        high={name: high for name, (_, high) in ranges.items()},
        early_ms=early_ms,
        early={
            name: np.mean([np.asarray(run.get(column, nothing), np.float64) for run in read_outs], axis=0)
            for name, column in columns.items()
        },
        on_test=on_test,
    )


def _range(best: pandas.DataFrame, column: str) -> tuple[Array, Array]:
    """Return how far the range of a column over the runs reaches below and above its mean, else its error."""
    value, least, most = (numbers(best, f"{column}{end}") for end in ("", "_min", "_max"))
    below, above = interval(best, column)
    return (
        np.where(np.isfinite(least), value - least, below),
        np.where(np.isfinite(most), most - value, above),
    )


def _best(trials: pandas.DataFrame) -> pandas.DataFrame:
    """Return the most accurate finished trial of every length, shortest first; the first of equal ones."""
    if LENGTH not in trials.columns:
        raise ValueError(f"trials must differ in {LENGTH}, got a table without it")
    finished = trials[np.isfinite(numbers(trials, "accuracy"))]
    if finished.empty:
        raise ValueError("trials must hold at least one finished trial, got none")
    ordered = finished.sort_values(
        [LENGTH, "accuracy", "trial"], ascending=[True, False, True], kind="stable"
    )
    first: pandas.DataFrame = ordered.drop_duplicates(LENGTH)
    return first
