"""The confusion matrix: true classes against predicted ones."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.figures import Results, recorded, trial_key
from dse.records import Array
from dse.registry import register

if TYPE_CHECKING:
    import plotly.graph_objects


@dataclass(frozen=True)
class Confusion:
    """Counts and rates of a confusion matrix; rows are true classes, columns predicted ones.

    counts: (class, class) int64.
    rates: (class, class) float64, each row sums to 1; a class without samples has a row of 0.
    """

    counts: Array
    rates: Array
    classes: tuple[str, ...]


@register("figures", "confusion")
@dataclass(frozen=True)
class ConfusionFigure:
    """Confusion matrix of a trial on the validation samples, summed over its runs."""

    trial: int | None = trial_key()

    def gather(self, results: Results) -> Confusion:
        trial, runs = recorded(results, self.trial, "confusion.npz")
        counts = [run["validation"] for run in runs]
        return gather_confusion(np.sum(counts, axis=0), results.classes(trial))

    def draw(self, record: Confusion) -> plotly.graph_objects.Figure:
        return draw_confusion(record)


def gather_confusion(counts: Array, classes: Sequence[str]) -> Confusion:
    """Gather a confusion matrix with its rates per true class.

    Raises:
        ValueError: the matrix is not square, holds a negative count, or differs from `classes` in size.
    """
    counts = np.asarray(counts)
    if counts.shape != (len(classes), len(classes)):
        raise ValueError(f"counts must be ({len(classes)}, {len(classes)}) as classes, got {counts.shape}")
    if (counts < 0).any():
        raise ValueError(f"counts must be >= 0, got {counts.min()}")
    total = counts.sum(axis=1, keepdims=True)
    rates = np.divide(counts, total, out=np.zeros(counts.shape), where=total > 0)
    return Confusion(counts.astype(np.int64), rates, tuple(classes))


def draw_confusion(confusion: Confusion) -> plotly.graph_objects.Figure:
    """Draw a confusion matrix: shade by rate, counts as text, the first class on top."""
    import plotly.graph_objects as go

    names = [html.escape(name, quote=False) for name in confusion.classes]
    # Places, not names, are the coordinates: two classes may bear the same name.
    places = list(range(len(names)))
    figure = go.Figure(
        go.Heatmap(
            x=places,
            y=places,
            z=confusion.rates,
            text=confusion.counts,
            texttemplate="%{text}",
            hovertemplate="rate %{z:.3f}, count %{text}<extra></extra>",
            colorscale="Cividis",
            zmin=0,
            zmax=1,
            colorbar={"title": {"text": "rate"}},
        )
    )
    ticks = {"tickvals": places, "ticktext": names}
    figure.update_layout(
        xaxis={"title": {"text": "predicted"}, **ticks},
        yaxis={"title": {"text": "true"}, "autorange": "reversed", **ticks},
    )
    return figure
