"""The decision surface: what phi and theta trade, for one trained design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.figures.labels import axis_title
from dse.records import Array, Surface

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


def gather_surface(surface: Surface, quantity: str = "accuracy") -> SurfaceMap:
    """Gather one quantity of a decision surface, and the setting that reaches t_p.

    Raises:
        ValueError: the surface has no such quantity.
    """
    if quantity not in QUANTITIES:
        raise ValueError(f"quantity must be one of {', '.join(QUANTITIES)}, got '{quantity}'")
    latency = np.where(surface.accuracy == surface.accuracy.max(), surface.decision_latency_ms, np.inf)
    row, column = np.unravel_index(int(np.argmin(latency)), latency.shape)
    return SurfaceMap(
        quantity=quantity,
        phi=surface.phi,
        theta=surface.theta,
        values=np.asarray(getattr(surface, quantity)),
        best=(float(surface.phi[row]), float(surface.theta[column])),
    )


def draw_surface(surface: SurfaceMap) -> plotly.graph_objects.Figure:
    """Draw one quantity over phi and theta; the cross marks the setting that reaches t_p."""
    import plotly.graph_objects as go

    title = axis_title(surface.quantity)
    figure = go.Figure(
        go.Heatmap(
            x=surface.theta,
            y=surface.phi,
            z=surface.values,
            colorscale="Cividis",
            colorbar={"title": {"text": title}},
            hovertemplate="θ %{x:.3g}, φ %{y:.3g}: %{z:.3g}<extra></extra>",
        )
    )
    figure.add_trace(
        go.Scatter(
            x=[surface.best[1]],
            y=[surface.best[0]],
            mode="markers",
            marker={"symbol": "cross", "size": 12, "color": "#D55E00"},
            name="t_p",
            hovertemplate="t_p: θ %{x:.3g}, φ %{y:.3g}<extra></extra>",
        )
    )
    figure.update_layout(
        xaxis={"title": {"text": "θ: share of spikes that decides"}},
        yaxis={"title": {"text": "φ: spikes before any decision"}},
    )
    return figure
