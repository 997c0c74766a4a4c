"""Class histograms of HOTS: how often each prototype of the last layer was nearest, for every class.

Source: Brayshaw et al., temporal and spatio-temporal domains, Fig. 4b (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse import store
from dse.base.records import Array, Parameters
from dse.base.registry import fixed, register
from dse.show.figures import Results, recorded, trial_key
from dse.show.figures.labels import OKABE_ITO_LIGHT
from dse_papers.figures.panels import MOST_COLUMNS, chosen_classes, class_panels

if TYPE_CHECKING:
    import plotly.graph_objects


@dataclass(frozen=True)
class Histograms:
    """Labelled histograms of one trained HOTS over whole windows, mean over those of a class.

    activity: (class, prototype) counts, or fractions where the study divides histograms by their sums.
    normalised: whether they are fractions.
    """

    classes: tuple[str, ...]
    activity: Array
    normalised: bool


@register("figures", "histograms")
@dataclass(frozen=True)
class HistogramsFigure:
    """Class histograms of a HOTS trial: activity of each prototype of the last layer, a panel per class."""

    trial: int | None = trial_key()
    repeat: int = fixed(0, doc="run of the trial: each has prototypes of its own", low=0)
    classes: tuple[str, ...] = fixed((), doc="classes that have a panel (default: all)")
    per_row: int = fixed(MOST_COLUMNS, doc="panels in a row, at most", low=1)

    def gather(self, results: Results) -> Histograms:
        trial, runs = recorded(results, self.trial, "weights.npz", "own/signatures")
        if self.repeat >= len(runs):
            raise ValueError(
                f"repeat must be below {len(runs)}, the runs of trial {trial}, got {self.repeat}"
            )
        fitted = store.fitted_of(runs[self.repeat])
        assert isinstance(fitted, Parameters)
        return gather_histograms(fitted.arrays, results.classes(trial), self.classes)

    def draw(self, record: Histograms) -> plotly.graph_objects.Figure:
        return draw_histograms(record, self.per_row)


def gather_histograms(
    weights: Mapping[str, Array], names: Sequence[str], classes: Sequence[str] = ()
) -> Histograms:
    """Gather the histograms of whole windows.

    Args:
        weights: what a HOTS has learnt: signatures (length, signature, prototype), the whole window last, and
            signature_class (signature,).
        names: of the classes.
        classes: names of those to show; empty: all.

    Raises:
        ValueError: no such class, or one without a labelled histogram.
    """
    signatures, label = weights["signatures"][-1].astype(np.float64), weights["signature_class"]
    chosen = chosen_classes(names, classes)
    for k in chosen:
        if not (label == k).any():
            raise ValueError(f"class '{names[k]}' must have a labelled histogram, got none")
    sums = signatures.sum(axis=1)
    return Histograms(
        classes=tuple(names[k] for k in chosen),
        activity=np.stack([signatures[label == k].mean(axis=0) for k in chosen]),
        normalised=bool(np.all(np.isclose(sums, 1, atol=1e-4) | (sums == 0))),
    )


def draw_histograms(histograms: Histograms, n_columns: int = MOST_COLUMNS) -> plotly.graph_objects.Figure:
    """Draw a bar per prototype, a panel per class, all on one scale; at most `n_columns` panels in a row."""
    title = "fraction of events" if histograms.normalised else "events per recording"
    top = float(histograms.activity.max())
    x_title = "prototype of the last layer"
    figure, places = class_panels(histograms.classes, x_title, title, top, n_columns)
    for (row, column), activity in zip(places, histograms.activity, strict=True):
        figure.add_bar(
            x=np.arange(len(activity)),
            y=activity,
            marker={"color": OKABE_ITO_LIGHT[0], "line": {"width": 0}},
            hovertemplate=f"prototype %{{x}}: %{{y:.3g}} {title}<extra></extra>",
            row=row,
            col=column,
        )
    figure.update_layout(bargap=0.15)
    return figure
