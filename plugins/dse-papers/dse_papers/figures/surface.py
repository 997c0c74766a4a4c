"""The decision surface: what phi and theta trade, for one trained design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.base.records import Array
from dse.base.registry import fixed, register
from dse.show.figures import Results, recorded, trial_key
from dse.show.figures.labels import axis_title

if TYPE_CHECKING:
    import plotly.graph_objects

QUANTITIES = ("accuracy", "accuracy_strict", "decision_latency_ms", "undecided", "ties")


@dataclass(frozen=True)
class SurfaceMap:
    """One quantity of a decision surface.

    values: (phi, theta).
    best: the (phi, theta) values of the fastest setting among those of the highest accuracy (t_p).
    """

    quantity: str
    phi: Array
    theta: Array
    values: Array
    best: tuple[float, float]


@register("figures", "surface")
@dataclass(frozen=True)
class SurfaceFigure:
    """Accuracy or latency of a trial over the decision parameters phi and theta."""

    quantity: str = fixed("accuracy", doc="what is drawn", choices=QUANTITIES)
    trial: int | None = trial_key()
    repeat: int = fixed(0, doc="run of the trial", low=0)

    def gather(self, results: Results) -> SurfaceMap:
        trial, runs = recorded(results, self.trial, "surface.npz")
        if self.repeat >= len(runs):
            raise ValueError(f"repeat must be below {len(runs)} in trial {trial}, got {self.repeat}")
        return gather_surface(runs[self.repeat], self.quantity)

    def draw(self, record: SurfaceMap) -> plotly.graph_objects.Figure:
        """Draw the quantity over phi and theta; the cross marks the setting that reaches t_p."""
        import plotly.graph_objects as go

        phi, theta = record.best
        figure = go.Figure()
        figure.add_heatmap(
            x=record.theta,
            y=record.phi,
            z=record.values,
            colorscale="Cividis",
            colorbar={"title": {"text": axis_title(record.quantity)}, "x": 1.01, "xanchor": "left"},
            hovertemplate="θ %{x:.3g}, φ %{y:.3g}: %{z:.3g}<extra></extra>",
        )
        figure.add_scatter(
            x=[theta],
            y=[phi],
            mode="markers",
            marker={"symbol": "cross", "size": 12, "color": "#D55E00"},
            name="t_p",
            showlegend=False,
            hovertemplate="t_p: θ %{x:.3g}, φ %{y:.3g}<extra></extra>",
        )
        figure.update_xaxes(title_text="θ: fraction of spikes for a decision")
        return figure.update_yaxes(title_text="φ: output spikes before a decision")


def gather_surface(surface: Mapping[str, Array], quantity: str = "accuracy") -> SurfaceMap:
    """Gather one quantity of the decision surface of a run, and the setting that reaches t_p.

    Args:
        surface: arrays of its surface.npz: phi, theta, and QUANTITIES over both.
        quantity: one of QUANTITIES.

    Raises:
        ValueError: there is no such quantity.
    """
    if quantity not in QUANTITIES:
        raise ValueError(f"quantity must be one of {', '.join(QUANTITIES)}, got '{quantity}'")
    accuracy, phi, theta = surface["accuracy"], surface["phi"], surface["theta"]
    latency = np.where(accuracy == accuracy.max(), surface["decision_latency_ms"], np.inf)
    row, column = np.unravel_index(int(np.argmin(latency)), latency.shape)
    return SurfaceMap(quantity, phi, theta, surface[quantity], (float(phi[row]), float(theta[column])))
