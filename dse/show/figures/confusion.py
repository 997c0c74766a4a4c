"""The confusion matrix: true classes against predicted ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.show.figures import Results, recorded, trial_key
from dse.show.figures.labels import Drawing, drawn, safe


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
        counts = np.sum([run["validation"] for run in runs], axis=0)
        classes = tuple(results.classes(trial))
        if counts.shape != 2 * (len(classes),) or (counts < 0).any():
            raise ValueError(
                f"trial {trial} must have counts >= 0 of {len(classes)} classes, got {counts.tolist()}"
            )
        total = counts.sum(axis=1, keepdims=True)
        rates = np.divide(counts, total, out=np.zeros(counts.shape), where=total > 0)
        return Confusion(counts.astype(np.int64), rates, classes)

    def draw(self, record: Confusion) -> Drawing:
        """Draw shades by rate and counts as text, the first class on top."""
        # Places, not names, are the coordinates: two classes may bear the same name.
        places = list(range(len(record.classes)))
        names = [safe(name) for name in record.classes]
        heat = {
            "type": "heatmap",
            "x": places,
            "y": places,
            "z": record.rates,
            "text": record.counts,
            "texttemplate": "%{text}",
            "hovertemplate": "rate %{z:.3f}, count %{text}<extra></extra>",
            "colorscale": "Cividis",
            "zmin": 0,
            "zmax": 1,
            "colorbar": {"title": {"text": "rate"}},
        }
        ticks = {"tickvals": places, "ticktext": names}
        layout = {
            "xaxis": {"title": {"text": "predicted"}, **ticks},
            "yaxis": {"title": {"text": "true"}, "autorange": "reversed", **ticks},
        }
        return drawn([heat], layout)
