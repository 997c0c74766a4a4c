"""Inference time per class: when the winning output neuron spikes first.

Source: threshold encoding for texture recognition, Fig. 3 (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse import store
from dse.base.records import Floats, Ints
from dse.base.registry import register
from dse.measure.objectives.first_spike import by_class, first_spike_ms
from dse.show.figures import NothingRecorded, Results, recorded, trial_key
from dse.show.figures.labels import OKABE_ITO_LIGHT, Drawing, drawn, interval_bars, rows_layout, safe

_BAR_PX, _MARGIN_PX, _LEAST = 20, 100, 10


@dataclass(frozen=True)
class FirstSpikes:
    """Time from the start of the window to the first output spike of the winning neuron, by class.

    median_ms, least_ms, most_ms: (class,) over the samples of a class; NaN where all are silent.
    n_timed, n: (class,) samples with an output spike, and all.
    on_test: whether the samples are those of the test set.
    """

    classes: tuple[str, ...]
    median_ms: Floats
    least_ms: Floats
    most_ms: Floats
    n_timed: Ints
    n: Ints
    on_test: bool


@register("figures", "first_spike")
@dataclass(frozen=True)
class FirstSpikeFigure:
    """Inference time of a spiking trial per class: first output spike of the winning neuron, all runs."""

    trial: int | None = trial_key()

    def gather(self, results: Results) -> FirstSpikes:
        trial, validated = recorded(results, self.trial, "response.npz", "output")
        tested = results.arrays(trial, "response_test.npz")
        runs = tested or validated
        responses = [store.response_of(run) for run in runs]
        classes = tuple(results.classes(trial))
        if responses[0].output.shape[2] != len(classes):
            raise ValueError(f"trial {trial} must have one output per class, got several heads")
        times_ms = np.concatenate([first_spike_ms(response) for response in responses])
        target = np.concatenate([run["target"] for run in runs])
        timed = np.isfinite(times_ms)
        if not timed.any():
            raise NothingRecorded(f"trial {trial} must have an output spike, got none")
        n = len(classes)
        least_ms, most_ms = np.full(n, np.inf), np.full(n, -np.inf)
        np.minimum.at(least_ms, target[timed], times_ms[timed])
        np.maximum.at(most_ms, target[timed], times_ms[timed])
        n_timed = np.bincount(target[timed], minlength=n)
        return FirstSpikes(
            classes=classes,
            median_ms=by_class(times_ms, target, n),
            least_ms=np.where(n_timed > 0, least_ms, np.nan),
            most_ms=np.where(n_timed > 0, most_ms, np.nan),
            n_timed=n_timed,
            n=np.bincount(target, minlength=n),
            on_test=bool(tested),
        )

    def draw(self, record: FirstSpikes) -> Drawing:
        """Draw a bar per class, its median, with a line from its least to its largest time."""
        names = [safe(name) for name in record.classes]
        hover = [
            f"{name}: median of {timed} of {n} samples"
            for name, timed, n in zip(names, record.n_timed.tolist(), record.n.tolist(), strict=True)
        ]
        bars = {
            "type": "bar",
            "orientation": "h",
            "y": list(range(len(names))),
            "x": record.median_ms,
            "marker": {"color": OKABE_ITO_LIGHT[0]},
            "error_x": interval_bars(
                record.median_ms - record.least_ms,
                record.most_ms - record.median_ms,
                width=3,
                color=OKABE_ITO_LIGHT[1],
            ),
            "customdata": hover,
            "hovertemplate": "%{customdata}, %{x:.4g} ms<extra></extra>",
        }
        of_set = "test" if record.on_test else "validation"
        title = f"first output spike (ms), {of_set} set"
        layout = rows_layout(title, record.classes, _BAR_PX, _MARGIN_PX, _LEAST)
        layout["xaxis"] |= {"rangemode": "tozero"}
        return drawn([bars], layout)
