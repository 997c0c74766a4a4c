"""One recording as a spiking network answered it: output spikes, running confidence, spikes of each layer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse import store
from dse.base.records import Array
from dse.base.registry import fixed, register
from dse.measure.decision import decide
from dse.show.figures import Results, recorded, trial_key
from dse.show.figures.labels import LEGEND, OKABE_ITO_LIGHT, Drawing, drawn, safe, shortened

TRUE, LEADING, DECISION = OKABE_ITO_LIGHT[0], OKABE_ITO_LIGHT[2], OKABE_ITO_LIGHT[1]
QUIET = "rgba(127, 135, 145, 0.8)"
_LONGEST_NAME = 12  # letters of a class beside the axis; hovering shows all of them
_MOST_NAMES = 12  # beside the axis


@dataclass(frozen=True)
class Recording:
    """What a network did on one recording; what happens in step t is known at (t + 1) step_ms.

    classes: names of the outputs. true: the class that was meant, None where that is unknown.
    spikes: (k, 2) step and class of every output spike, in order of steps.
    confidence: (T,) share of the output spikes so far that the leading class has; NaN before the first.
    leading: (T,) class with most output spikes so far, the lowest on ties.
    layers: (T, layer) spikes of each layer and step, the input first.
    phi, theta: the decision rule; None where the answer comes at the end of the recording.
    answer, decision_ms: the class that is answered, and when; decided: whether theta was reached.
    """

    classes: tuple[str, ...]
    true: int | None
    step_ms: float
    spikes: Array
    confidence: Array
    leading: Array
    layers: Array
    phi: float | None
    theta: float | None
    answer: int
    decision_ms: float
    decided: bool

    @property
    def time_ms(self) -> Array:
        """Ends of the steps, (T,)."""
        return (np.arange(len(self.confidence)) + 1) * self.step_ms


@register("figures", "recording")
@dataclass(frozen=True)
class RecordingFigure:
    """Activity of a network on one recording: output spikes, confidence, spikes of each layer."""

    trial: int | None = trial_key()
    sample: int = fixed(0, doc="place among the validation recordings", low=0)
    phi: float | None = fixed(None, doc="output spikes before a decision (default: decide at the end)", low=0)
    theta: float = fixed(0.5, doc="confidence to reach, where phi is given", low=0, high=1)

    def gather(self, results: Results) -> Recording:
        trial, runs = recorded(results, self.trial, "response.npz", "output")
        response = store.response_of(runs[0])
        if self.sample >= len(response.output):
            raise ValueError(f"sample must be below {len(response.output)}, got {self.sample}")
        setting = None if self.phi is None else (self.phi, self.theta)
        answered, true = response.output[self.sample], int(runs[0]["target"][self.sample])
        spikes = response.spikes[self.sample]
        return gather_recording(answered, spikes, response.step_ms, results.classes(trial), true, setting)

    def draw(self, record: Recording) -> Drawing:
        """Draw output spikes by class, the confidence of the leading class, and spikes of each layer.

        A line named 'decision' marks when the answer comes, one named 'theta' what confidence it takes.
        """
        names = [shortened(name, _LONGEST_NAME) for name in record.classes]
        every = -(-len(names) // _MOST_NAMES)  # names of many classes would cover each other
        n_layers, peaks = record.layers.shape[1], record.layers.max(axis=0)
        layers = ["input", *(f"layer {layer}" for layer in range(1, n_layers - 1)), "output"][-n_layers:]
        theta = record.theta
        decision = {"xref": "x", "yref": "paper", "x0": record.decision_ms, "x1": record.decision_ms}
        shapes: list[dict[str, Any]] = [
            {"name": "decision", **decision, "y0": 0, "y1": 1}
            | {"line": {"color": DECISION, "width": 1.5, "dash": "solid" if record.decided else "dot"}}
        ]
        notes: list[dict[str, Any]] = []
        if theta is not None:
            share = {"xref": "paper", "yref": "y2", "x0": 0, "x1": 1, "y0": theta, "y1": theta}
            line = {"color": DECISION, "width": 1, "dash": "dash"}
            shapes.append({"name": "theta", **share, "line": line})
            place = {"x": 1, "xref": "paper", "xanchor": "left", "y": theta, "yref": "y2"}
            font = {"size": 10, "color": DECISION}
            notes.append({"name": "theta", "text": "θ", **place, "showarrow": False, "font": font})
        # Laid out at once: changing a figure takes longer than drawing one, and a panel has half a dozen.
        layout = {
            "height": 320,
            "margin": {"l": 64, "r": 16, "t": 28, "b": 40},
            "legend": {**LEGEND, "font": {"size": 10}},
            "shapes": [{"type": "line", **shape} for shape in shapes],
            "annotations": notes,
            "xaxis": {
                "title": {"text": "time (ms)"},
                "range": [0, float(record.time_ms[-1])],
                "anchor": "y3",
            },
            "yaxis": {
                "domain": [0.56, 1.0],
                "range": [len(names) - 0.4, -0.6],
                "tickvals": list(range(0, len(names), every)),
                "ticktext": [safe(name) for name in names[::every]],
                "showgrid": False,
            },
            "yaxis2": {
                "domain": [0.3, 0.5],
                "range": [0, 1.05],
                "tickvals": [0, 0.5, 1],
                "title": {"text": "share"},
            },
            "yaxis3": {
                "domain": [0.0, 0.24],
                "tickvals": list(range(n_layers)),
                "ticktext": [f"{name} ≤ {peak}" for name, peak in zip(layers, peaks, strict=True)],
                "autorange": "reversed",
                "showgrid": False,
            },
        }
        return drawn([*_rasters(record), _confidence(record), _layers(record)], layout)


def gather_recording(
    output: Array,
    layers: Array,
    step_ms: float,
    classes: Sequence[str],
    true: int | None = None,
    setting: tuple[float, float] | None = None,
) -> Recording:
    """Gather what a network did on one recording.

    Args:
        output: (T, class) uint8 output spikes.
        layers: (T, layer) spikes of each layer and step, the input first.
        step_ms: duration of a step.
        classes: names of the outputs.
        true: the class that was meant, None where that is unknown.
        setting: phi and theta (`dse.measure.decision`); None: the answer comes at the end.
    """
    output, layers = np.asarray(output), np.asarray(layers)
    if output.ndim != 2 or output.shape[1] != len(classes) or not output.size:
        raise ValueError(f"output must be (T, {len(classes)}) as classes, got {output.shape}")
    if layers.ndim != 2 or len(layers) != len(output):
        raise ValueError(f"layers must be ({len(output)}, layer) as output, got {layers.shape}")
    if true is not None and not 0 <= true < len(classes):
        raise ValueError(f"true must be in 0..{len(classes) - 1}, got {true}")
    counts = output.cumsum(axis=0, dtype=np.int64)
    total = counts.sum(axis=1)
    answer, step, decided = int(counts[-1].argmax()), len(output) - 1, False
    if setting is not None:
        decisions = decide(output[None], *setting)
        answer, step, decided = int(decisions.label[0]), int(decisions.step[0]), bool(decisions.decided[0])
    return Recording(
        classes=tuple(classes),
        true=true,
        step_ms=float(step_ms),
        spikes=np.argwhere(output),
        confidence=np.where(total > 0, counts.max(axis=1) / np.maximum(total, 1), np.nan),
        leading=counts.argmax(axis=1),
        layers=layers,
        phi=None if setting is None else float(setting[0]),
        theta=None if setting is None else float(setting[1]),
        answer=answer,
        decision_ms=(step + 1) * float(step_ms),
        decided=decided,
    )


def _rasters(recording: Recording) -> list[dict[str, Any]]:
    """Return the output spikes, those of the true class in a colour of their own."""
    names = [safe(name) for name in recording.classes]
    steps, spiking = recording.spikes.T
    if recording.true is None:
        kinds = [("output spike", np.ones(len(spiking), bool), QUIET)]
    else:
        meant = spiking == recording.true
        kinds = [("true class", meant, TRUE), ("another", ~meant, QUIET)]
    size = min(max(3.0, 90.0 / len(names)), 10.0)
    return [
        {
            "type": "scatter",
            "x": recording.time_ms[steps[chosen]].astype(np.float32),
            "y": spiking[chosen].astype(np.int32),
            "text": [names[k] for k in spiking[chosen]],
            "mode": "markers",
            "marker": {"symbol": "line-ns-open", "size": size, "color": colour},
            "name": kind,
            "hovertemplate": "%{text}, %{x:.4g} ms<extra></extra>",
        }
        for kind, chosen, colour in kinds
    ]


def _confidence(recording: Recording) -> dict[str, Any]:
    names = [safe(name) for name in recording.classes]
    return {
        "type": "scatter",
        "x0": recording.step_ms,
        "dx": recording.step_ms,
        "y": [None if np.isnan(x) else round(x, 3) for x in recording.confidence.tolist()],
        "yaxis": "y2",
        "text": [names[k] for k in recording.leading],
        "mode": "lines",
        "line": {"color": LEADING, "width": 1.5, "shape": "hv"},
        "showlegend": False,
        "name": "confidence",
        "hovertemplate": "%{text} leads with %{y:.2f}, %{x:.4g} ms<extra></extra>",
    }


def _layers(recording: Recording) -> dict[str, Any]:
    """Return spikes per layer and step, each by its layer's busiest step: inputs outnumber the others."""
    counts = recording.layers.T
    peaks = np.maximum(counts.max(axis=1, keepdims=True), 1)
    return {
        "type": "heatmap",
        "x0": recording.step_ms / 2,
        "dx": recording.step_ms,
        "y": list(range(len(counts))),
        "z": np.rint(100 * counts / peaks).astype(np.uint8),
        "yaxis": "y3",
        "customdata": counts.astype(np.min_scalar_type(int(peaks.max()))),
        "colorscale": [[0, "rgba(127, 135, 145, 0)"], [1, TRUE]],
        "zmin": 0,
        "zmax": 100,
        "showscale": False,
        "hovertemplate": "%{customdata} spikes, %{x:.4g} ms<extra></extra>",
        "name": "layers",
    }
