"""One trial of a scene: its pins and events in the image at a moment, and its course over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.base.records import Array, Block
from dse.show.figures.labels import OKABE_ITO_LIGHT, Drawing, drawn, safe

if TYPE_CHECKING:
    from dse.scene.simulate import Paths

ON, OFF, SHEAR, SPEED = OKABE_ITO_LIGHT[:4]
PIN = "rgba(127, 135, 145, 0.45)"
OUTLINE = np.stack([f(np.linspace(0, 2 * np.pi, 17)) for f in (np.cos, np.sin)], axis=1)
"""A pin's disc of radius 1 as a closed line, (17, 2)."""

_PLACES = 260_000  # pin positions that a page carries, over all moments
_FEWEST_MOMENTS, _MOST_MOMENTS = 50, 800
_RECENT_MS = 5.0


@dataclass(frozen=True)
class TrialView:
    """One trial, thinned to what a page can carry.

    name: what the trial is, in words.
    frame_px: width and height of the image.
    radius_px: of a pin's image.
    t_s: (n,) moments, evenly spaced from 0.
    px: (n, pin, 2) centres of the pins; pins are in the order of their place along the motion, x.
    v_mm_s, s_mm: (n,) speed of the tip and shear of the skin.
    on_kev_s, off_kev_s: (n - 1,) thousand events per second between a moment and the next.
    raster: (pin, n - 1) int32 events between two moments, each counted for the pin nearest at the first.
    events: every `one_in`-th event, x and y as pixel addresses.
    n_events: events of the whole trial.
    recent_ms: how long an event is seen after it was sent.
    """

    name: str
    frame_px: tuple[int, int]
    radius_px: float
    t_s: Array
    px: Array
    v_mm_s: Array
    s_mm: Array
    on_kev_s: Array
    off_kev_s: Array
    raster: Array
    events: Block
    n_events: int
    one_in: int
    recent_ms: float

    @property
    def step_ms(self) -> float:
        """Time between two moments."""
        return float(1000 * self.t_s[1])

    @property
    def busiest(self) -> int:
        """The moment after the interval with the most events."""
        return int(np.argmax(self.on_kev_s + self.off_kev_s)) + 1


def gather_trial(
    block: Block, paths: Paths, frame_px: tuple[int, int], name: str, most_events: int = 60_000
) -> TrialView:
    """Gather what a figure of a trial shows.

    Moments are every m-th of the paths, so that a page carries at most `_PLACES` pin positions; events after
    the last moment are counted in `n_events` only.

    Args:
        block: the trial's events, sorted by time.
        paths: where its pins were, at the step of the physics.
        frame_px: width and height of the image.
        name: what the trial is, in words.
        most_events: events that are kept to be drawn one by one.

    Raises:
        ValueError: the paths have fewer than two times.
    """
    n, n_pins = paths.px.shape[:2]
    if n < 2:
        raise ValueError(f"paths must have at least two times, got {n}")
    n_moments = min(_MOST_MOMENTS, max(_FEWEST_MOMENTS, _PLACES // max(n_pins, 1)))
    every = slice(None, None, -(-(n - 1) // n_moments))
    order = np.lexsort((paths.px[0, :, 1], paths.px[0, :, 0]))
    t_s, px = paths.t_s[every], paths.px[every][:, order]
    borders = np.searchsorted(block.t_us, np.rint(1e6 * t_s))
    n_shown, one_in = borders[-1], -(-len(block.t_us) // most_events) or 1
    on = np.searchsorted(np.flatnonzero(block.polarity[:n_shown] == 1), borders)
    kev_s = np.diff([on, borders - on], axis=1) / np.diff(t_s) / 1000
    return TrialView(
        name=name,
        frame_px=(int(frame_px[0]), int(frame_px[1])),
        radius_px=float(paths.radius_px),
        t_s=t_s,
        px=px,
        v_mm_s=paths.v_mm_s[every],
        s_mm=paths.s_mm[every],
        on_kev_s=kev_s[0],
        off_kev_s=kev_s[1],
        raster=_raster(block, borders, px),
        events=Block(*(x[:n_shown:one_in] for x in (block.t_us, block.x, block.y, block.polarity))),
        n_events=len(block.t_us),
        one_in=one_in,
        recent_ms=max(_RECENT_MS, float(1000 * t_s[1])),
    )


def _raster(block: Block, borders: Array, px: Array) -> Array:
    """Return events per pin and interval (pin, interval): interval i holds borders[i]:borders[i + 1]."""
    from scipy.spatial import KDTree

    counts = np.zeros((px.shape[1], len(px) - 1), np.int32)
    for i in range(len(px) - 1) if px.shape[1] else ():
        part = slice(borders[i], borders[i + 1])
        centres = np.stack([block.x[part], block.y[part]], axis=1) + 0.5
        if len(centres):
            counts[:, i] = np.bincount(KDTree(px[i]).query(centres)[1], minlength=len(counts))
    return counts


def draw_pins(view: TrialView, moment: int, exaggeration: float = 1.0) -> Drawing:
    """Draw the image at a moment: pins as discs, lines from their places at rest, the last events as dots.

    Args:
        view: the trial.
        moment: index into `view.t_s`.
        exaggeration: factor on what the pins have moved since the first moment; events stay at their pixels.
    """
    rest, moved = view.px[0], view.px[0] + exaggeration * (view.px[moment] - view.px[0])
    discs = moved[:, None] + view.radius_px * OUTLINE
    traces = []
    for points, style in (
        (discs, {"fill": "toself", "fillcolor": PIN, "line": {"width": 0}, "name": "pin"}),
        (np.stack([rest, moved], axis=1), {"line": {"width": 1, "color": PIN}, "name": "moved from rest"}),
    ):
        x, y = _strokes(points)
        traces.append({"x": x, "y": y, "mode": "lines", "hoverinfo": "skip", **style})
    now_us = 1e6 * view.t_s[moment]
    seen = (view.events.t_us <= now_us) & (view.events.t_us > now_us - 1000 * view.recent_ms)
    for polarity, name, colour in ((0, "OFF event", OFF), (1, "ON event", ON)):
        mine = seen & (view.events.polarity == polarity)
        traces.append(
            {
                "x": view.events.x[mine] + 0.5,
                "y": view.events.y[mine] + 0.5,
                "mode": "markers",
                "marker": {"color": colour, "size": 4},
                "name": name,
                "hovertemplate": f"{name} at %{{x}}, %{{y}} px<extra></extra>",
            }
        )
    width, height = view.frame_px
    shape = {"scaleanchor": "x", "constrain": "domain"}
    layout = {
        "xaxis": {"title": {"text": "x (px)"}, "range": [0, width], "constrain": "domain"},
        "yaxis": {"title": {"text": "y (px)"}, "range": [height, 0], **shape},
        "legend": {"orientation": "h", "itemsizing": "constant"},
    }
    return drawn(traces, layout)


def draw_course(view: TrialView) -> Drawing:
    """Draw a trial over time: events per pin, their rate, the speed of the tip and the shear of the skin."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=4, shared_xaxes=True, vertical_spacing=0.03, row_heights=[0.46, 0.18, 0.18, 0.18]
    )
    middle_s = (view.t_s[1:] + view.t_s[:-1]) / 2
    busy = view.raster[view.raster > 0]
    figure.add_trace(
        go.Heatmap(
            x=middle_s,
            z=view.raster.astype(
                np.min_scalar_type(int(view.raster.max(initial=0)))
            ),  # a quarter of the page
            colorscale="Cividis",
            zmin=0,
            zmax=float(np.percentile(busy, 99)) if len(busy) else 1.0,
            colorbar={
                "title": {"text": f"events in {view.step_ms:.3g} ms", "side": "right"},
                "thickness": 8,
                "len": 0.5,
                "x": 1.01,
                "y": 1.02,
                "yanchor": "top",
            },
            hovertemplate="%{x:.4f} s, pin %{y}: %{z} events<extra></extra>",
            name="events of a pin",
        ),
        row=1,
        col=1,
    )
    # The rates of ON and OFF nearly agree: the line below is wider, so that both are seen.
    lines: tuple[tuple[int, str, Array, Array, str, float, str], ...] = (
        (2, "OFF events", middle_s, view.off_kev_s, OFF, 2.6, "kev/s"),
        (2, "ON events", middle_s, view.on_kev_s, ON, 1.0, "kev/s"),
        (3, "speed", view.t_s, view.v_mm_s, SPEED, 1.4, "mm/s"),
        (4, "shear", view.t_s, view.s_mm, SHEAR, 1.4, "mm"),
    )
    for row, name, x, y, colour, wide, unit in lines:
        trace: dict[str, Any] = {"x": x, "y": y, "name": name, "line": {"color": colour, "width": wide}}
        hover = f"{name}: %{{y:.4g}} {unit} at %{{x:.4f}} s<extra></extra>"
        figure.add_trace(go.Scatter(mode="lines", hovertemplate=hover, **trace), row=row, col=1)
    titles = ("pin, along x", "kev/s", "v (mm/s)", "s (mm)")
    for row, title in enumerate(titles, start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    for row in (2, 3, 4):
        figure.update_yaxes(rangemode="tozero", row=row, col=1)
    figure.update_xaxes(range=[0, float(view.t_s[-1])])
    figure.update_xaxes(title_text="time (s)", row=4, col=1)
    figure.update_layout(showlegend=False, title={"text": safe(view.name)})
    return figure


def _strokes(points: Array) -> tuple[Array, Array]:
    """Return x and y of lines (line, point, 2) drawn in one stroke each: a gap (NaN) ends every line."""
    gap = np.full((len(points), 1, 2), np.nan)
    x, y = np.concatenate([points, gap], axis=1).reshape(-1, 2).T
    return x, y
