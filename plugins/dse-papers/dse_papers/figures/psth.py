"""Peristimulus time histogram: how often all channels spike, over the time since the start of a recording.

Source: Brayshaw et al., temporal and spatio-temporal domains, Figs. 1c and 3 (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.base.records import Array, Dataset
from dse.base.registry import fixed, register
from dse.show.figures import Results, trial_key, trial_of
from dse.show.figures.labels import OKABE_ITO_LIGHT
from dse_papers.figures.panels import chosen_classes, class_panels, task_labels

if TYPE_CHECKING:
    import plotly.graph_objects


@dataclass(frozen=True)
class Psth:
    """Spikes of all channels together, mean over the recordings of a class.

    edges_ms: (bin + 1,) borders of the windows of time.
    rate_hz: (class, bin) spikes per second.
    n_trials: (class,) recordings behind each mean.
    """

    classes: tuple[str, ...]
    edges_ms: Array
    rate_hz: Array
    n_trials: Array


@register("figures", "psth")
@dataclass(frozen=True)
class PsthFigure:
    """Spike rate of all input channels over time, mean over the recordings of each class."""

    trial: int | None = trial_key()
    bin_ms: float = fixed(10.0, doc="width of a window of time", unit="ms", low=0, low_open=True)
    classes: tuple[str, ...] = fixed((), doc="classes that have a panel (default: all)")
    task: str = fixed("", doc="head of a joint target (default: the first)")

    def gather(self, results: Results) -> Psth:
        dataset = results.dataset(trial_of(results, self.trial))
        return gather_psth(dataset, self.bin_ms, self.classes, self.task)

    def draw(self, record: Psth) -> plotly.graph_objects.Figure:
        """Draw a histogram over time per class, all on one scale."""
        titles = [f"{name} (n = {n})" for name, n in zip(record.classes, record.n_trials, strict=True)]
        figure, places = class_panels(
            titles, "time (ms)", "spike rate of all channels (spikes/s)", float(record.rate_hz.max())
        )
        for (row, column), rate_hz in zip(places, record.rate_hz, strict=True):
            figure.add_scatter(
                x=record.edges_ms,
                y=np.append(rate_hz, rate_hz[-1:]),
                mode="lines",
                line={"shape": "hv", "width": 0.8, "color": OKABE_ITO_LIGHT[0]},
                fill="tozeroy",
                fillcolor=OKABE_ITO_LIGHT[0],
                hovertemplate="from %{x:.4g} ms: %{y:.4g} spikes/s<extra></extra>",
                row=row,
                col=column,
            )
        figure.update_xaxes(range=[0, float(record.edges_ms[-1])])
        return figure


def gather_psth(dataset: Dataset, bin_ms: float = 10.0, classes: Sequence[str] = (), task: str = "") -> Psth:
    """Gather the spike rate over time of every class, over the evaluated windows of all parts of the split.

    Args:
        dataset: spikes and windows.
        bin_ms: width of a window of time, rounded to steps, at least one; the last may be shorter.
        classes: names; empty: all.
        task: head of a joint target; '': the first.

    Raises:
        ValueError: no such class or task, or a class without a recording.
    """
    labels, names = task_labels(dataset, task)
    chosen = chosen_classes(names, classes)
    step_ms, spikes = dataset.spikes.step_ms, dataset.spikes
    width = max(1, round(bin_ms / step_ms))
    edges = np.append(np.arange(0, dataset.n_steps, width), dataset.n_steps)
    samples = np.concatenate([dataset.train, dataset.validation, dataset.test]).astype(np.int64)
    total = np.zeros((len(names), len(edges) - 1))
    for sample in samples.tolist():
        first = sample * spikes.n_steps + int(dataset.start[sample])
        total[labels[sample]] += np.diff(spikes.row_offsets[first + edges])
    n_trials = np.bincount(labels[samples], minlength=len(names))
    for k in chosen:
        if not n_trials[k]:
            raise ValueError(f"class '{names[k]}' must have at least one recording, got none")
    seconds = np.diff(edges) * step_ms / 1000
    return Psth(
        classes=tuple(names[k] for k in chosen),
        edges_ms=edges * step_ms,
        rate_hz=total[chosen] / n_trials[chosen, None] / seconds,
        n_trials=n_trials[chosen],
    )
