"""The decision surface: what phi and theta trade, for one trained design; accuracy and time side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.figures import Results, recorded, trial_key
from dse.figures.labels import axis_title
from dse.records import Array, DecisionSurface
from dse.registry import param, register

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

    quantity: str = param("accuracy", doc="what is drawn", choices=QUANTITIES, axis=False)
    trial: int | None = trial_key()
    repeat: int = param(0, doc="run of the trial", low=0, axis=False)

    def gather(self, results: Results) -> SurfaceMap:
        trial, runs = recorded(results, self.trial, "surface.npz")
        if self.repeat >= len(runs):
            raise ValueError(f"repeat must be below {len(runs)} in trial {trial}, got {self.repeat}")
        return gather_surface(stored_surface(runs[self.repeat]), self.quantity)

    def draw(self, record: SurfaceMap) -> plotly.graph_objects.Figure:
        return draw_surface(record)


def stored_surface(arrays: Mapping[str, Array]) -> DecisionSurface:
    """Return the decision surface of a run, of whose surface.npz these are the arrays."""
    return DecisionSurface(**{name: arrays[name] for name in ("phi", "theta", *QUANTITIES)}, work=np.empty(0))


def gather_surface(surface: DecisionSurface, quantity: str = "accuracy") -> SurfaceMap:
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
    return draw_surfaces([surface])


def draw_surfaces(surfaces: Sequence[SurfaceMap]) -> plotly.graph_objects.Figure:
    """Draw quantities side by side over phi and theta; a cross marks the setting that reaches t_p."""
    from plotly.subplots import make_subplots

    n = len(surfaces)
    figure = make_subplots(rows=1, cols=n, horizontal_spacing=0.25 / n, shared_yaxes=True)
    for column, surface in enumerate(surfaces, 1):
        right = figure.get_subplot(1, column).xaxis.domain[1]
        for trace in _traces(surface, bar_x=right + 0.01):
            figure.add_trace(trace, row=1, col=column)
        figure.update_xaxes(title_text="θ: fraction of spikes for a decision", row=1, col=column)
    figure.update_yaxes(title_text="φ: output spikes before a decision", row=1, col=1)
    return figure


def _traces(surface: SurfaceMap, bar_x: float) -> tuple[Any, Any]:
    import plotly.graph_objects as go

    heat = go.Heatmap(
        x=surface.theta,
        y=surface.phi,
        z=surface.values,
        colorscale="Cividis",
        colorbar={"title": {"text": axis_title(surface.quantity)}, "x": bar_x, "xanchor": "left"},
        hovertemplate="θ %{x:.3g}, φ %{y:.3g}: %{z:.3g}<extra></extra>",
    )
    mark = go.Scatter(
        x=[surface.best[1]],
        y=[surface.best[0]],
        mode="markers",
        marker={"symbol": "cross", "size": 12, "color": "#D55E00"},
        name="t_p",
        showlegend=False,
        hovertemplate="t_p: θ %{x:.3g}, φ %{y:.3g}<extra></extra>",
    )
    return heat, mark
