"""Learning curves: loss, training accuracy and gradient over the epochs, one line per repeat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.show.figures import NothingRecorded, Results, recorded, trial_key
from dse.show.figures.labels import LEGEND, Drawing, colour_of, drawn

CURVES = {"loss": "loss", "accuracy_train": "training<br>accuracy", "gradient_norm": "gradient"}
"""Curves of a history that are drawn where it holds them, and what their axes say."""

_MOST_EPOCHS = 120  # points of a line: more are finer than a pixel or two
_GAP = 0.06  # between panels, of the height
_AXES: Mapping[str, Any] = {
    "accuracy_train": {"range": [0, 1.02], "tickvals": [0, 0.5, 1]},
    "gradient_norm": {"type": "log", "dtick": 1, "exponentformat": "power"},
}


@dataclass(frozen=True)
class Learning:
    """curves: name of a curve -> one (epoch,) array per repeat, empty where that repeat has none."""

    curves: Mapping[str, tuple[Array, ...]]


@register("figures", "learning")
@dataclass(frozen=True)
class LearningFigure:
    """Loss, accuracy and gradient norm of a trial over the epochs, one line per run."""

    trial: int | None = trial_key()

    def gather(self, results: Results) -> Learning:
        trial, runs = recorded(results, self.trial, "history.npz", "loss" if self.trial is None else "")
        known = [
            {name: np.asarray(x, np.float64) for name, x in history.items() if np.ndim(x) == 1}
            for history in runs
        ]
        curves = {
            name: tuple(history.get(name, np.zeros(0)) for history in known)
            for name in CURVES
            if any(len(history.get(name, ())) > 1 for history in known)
        }
        if not curves:  # a fit in closed form has no epochs
            raise NothingRecorded(
                f"trial {trial} must have two epochs of one of {', '.join(CURVES)}, got none"
            )
        return Learning(curves)

    def draw(self, record: Learning) -> Drawing:
        """Draw each curve over the epochs in a panel of its own; a gradient spans decades."""
        n = len(record.curves)
        layout: dict[str, Any] = {
            "height": 280,
            "margin": {"l": 56, "r": 12, "t": 28, "b": 40},
            "legend": {**LEGEND, "font": {"size": 10}},
            "xaxis": {"title": {"text": "epoch"}, "anchor": f"y{n}" if n > 1 else "y"},
        }
        traces = []
        for panel, (name, repeats) in enumerate(record.curves.items()):
            axis = f"y{panel + 1}" if panel else "y"
            top = 1 - panel / n
            layout[axis.replace("y", "yaxis")] = {
                "title": {"text": CURVES[name]},
                "domain": [top - 1 / n + (_GAP if panel < n - 1 else 0), top],
                **_AXES.get(name, {"rangemode": "tozero", "nticks": 4}),
            }
            for repeat, values in enumerate(repeats):
                run, every = f"repeat {repeat}", -(-len(values) // _MOST_EPOCHS) or 1
                traces.append(
                    {
                        "type": "scatter",
                        "x": np.arange(1, len(values) + 1, dtype=np.int32)[::every],
                        "y": values.astype(np.float32)[::every],
                        "yaxis": axis,
                        "mode": "lines",
                        "line": {"color": colour_of(repeat), "width": 1.2},
                        "name": run,
                        "legendgroup": run,
                        "showlegend": panel == 0 and len(repeats) > 1,
                        "hovertemplate": f"{run}, epoch %{{x}}: %{{y:.3g}}<extra></extra>",
                    }
                )
        return drawn(traces, layout)
