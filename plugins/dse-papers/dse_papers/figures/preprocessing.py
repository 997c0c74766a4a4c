"""Input rasters: events of a recording as the camera sends them, cropped, pooled, and cut to the window.

Source: Brayshaw et al., texture and velocity, Figs. 4 and 6 (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dse.base.records import Floats, Ints
from dse.base.registry import fixed, register
from dse.data.preprocessing.stages import Stages
from dse.show.figures import Results, trial_key, trial_of
from dse.show.figures.labels import OKABE_ITO_LIGHT, safe

if TYPE_CHECKING:
    import plotly.graph_objects

_CELLS = (300, 200)  # of a raster over time and over addresses, at most
_LEFT_OUT = "rgba(230, 159, 0, 0.25)"
_SCALE = [[0.0, "white"], [1e-6, "#9CC4E0"], [0.5, OKABE_ITO_LIGHT[0]], [1.0, "#0B2540"]]


@dataclass(frozen=True)
class Raster:
    """Events or spikes of one recording, counted in cells of time and address.

    title: what it shows. address: what an address is.
    counts: (row, column) int64 in cells of equal size; the last row and column may be smaller.
    cell_ms, cell_addresses: width and height of a cell.
    end_ms, n_addresses: ends of the axes.
    window_ms: begin and end of what a classifier receives; None where nothing is left out.
    """

    title: str
    address: str
    counts: Ints
    cell_ms: float
    cell_addresses: int
    end_ms: float
    n_addresses: int
    window_ms: tuple[float, float] | None


@register("figures", "preprocessing")
@dataclass(frozen=True)
class PreprocessingFigure:
    """Rasters of one event recording: as recorded, cropped, pooled, and cut to the window."""

    trial: int | None = trial_key()
    sample: int = fixed(0, doc="number of the recording in the data", low=0)

    def gather(self, results: Results) -> tuple[Raster, ...]:
        return gather_stages(results.stages(trial_of(results, self.trial), self.sample))

    def draw(self, record: tuple[Raster, ...]) -> plotly.graph_objects.Figure:
        return draw_rasters(record)


@register("figures", "inputs")
@dataclass(frozen=True)
class InputsFigure:
    """Pooled rasters of several event recordings; what is outside the window is shaded."""

    samples: tuple[int, ...] = fixed(doc="numbers of the recordings in the data, such as [0, 12]")
    trial: int | None = trial_key()

    def gather(self, results: Results) -> tuple[Raster, ...]:
        if not self.samples:
            raise ValueError("samples must name at least one recording, got none")
        trial = trial_of(results, self.trial)
        return tuple(gather_pooled(results.stages(trial, sample)) for sample in self.samples)

    def draw(self, record: tuple[Raster, ...]) -> plotly.graph_objects.Figure:
        return draw_rasters(record)


def gather_stages(stages: Stages) -> tuple[Raster, ...]:
    """Gather the rasters of one recording: all events, those in the crop, all spikes, those in the window.

    A step that leaves out nothing has no raster of its own; the title of the one before says so.
    """
    events, (width, height) = stages.events, stages.frame
    left, top, columns, rows = stages.crop
    x, y = events.x.astype(np.int64) - left, events.y.astype(np.int64) - top
    kept = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    end_us = int(events.t_us[-1]) + 1 if len(events.t_us) else stages.end_us
    is_whole = stages.crop == (0, 0, width, height)
    pooled = gather_pooled(stages)
    t_us = _spike_us(stages)
    inside = (t_us >= stages.begin_us) & (t_us < stages.end_us)
    window = f"window of {(stages.end_us - stages.begin_us) / 1000:g} ms"
    is_window = pooled.window_ms is None
    raw = _raster(
        f"as recorded, {width} × {height} pixels{', not cropped' * is_whole}", "pixel",
        events.t_us, events.y.astype(np.int64) * width + events.x, end_us, width * height,
    )  # fmt: skip
    cropped = _raster(
        f"cropped to {columns} × {rows} pixels", "pixel",
        events.t_us[kept], (y * columns + x)[kept], end_us, columns * rows,
    )  # fmt: skip
    pooled = replace(pooled, title=f"pooled to {stages.n_channels} channels{f', {window}' * is_window}")
    cut = _raster(
        window, "channel", t_us[inside] - stages.begin_us, stages.channels[inside],
        stages.end_us - stages.begin_us, stages.n_channels, stages.bin_us,
    )  # fmt: skip
    return raw, *(() if is_whole else (cropped,)), pooled, *(() if is_window else (cut,))


def gather_pooled(stages: Stages) -> Raster:
    """Gather the pooled raster of a whole recording, and which part of it is the window."""
    end_us = max(len(stages.counts) * stages.bin_us, stages.end_us)
    raster = _raster(
        stages.name, "channel", _spike_us(stages), stages.channels, end_us, stages.n_channels, stages.bin_us
    )
    is_whole = stages.begin_us <= 0 and stages.end_us >= end_us
    return raster if is_whole else replace(raster, window_ms=(stages.begin_us / 1000, stages.end_us / 1000))


def _spike_us(stages: Stages) -> Ints:
    """Return the start of the bin of every pooled spike, (n,)."""
    return np.repeat(np.arange(len(stages.counts)) * stages.bin_us, stages.counts)


def _raster(
    title: str,
    address: str,
    t_us: Ints,
    addresses: Ints,
    end_us: int,
    n_addresses: int,
    unit_us: int = 1,
) -> Raster:
    """Return events counted in as many cells as there is room for, each of whole units and addresses."""
    cell_us = -(-end_us // (_CELLS[0] * unit_us)) * unit_us
    cell_addresses = -(-n_addresses // _CELLS[1])
    shape = -(-n_addresses // cell_addresses), -(-end_us // cell_us)
    place = addresses // cell_addresses * shape[1] + t_us // cell_us
    counts = np.bincount(place, minlength=shape[0] * shape[1]).reshape(shape)
    return Raster(
        title=title,
        address=address,
        counts=counts,
        cell_ms=cell_us / 1000,
        cell_addresses=cell_addresses,
        end_ms=end_us / 1000,
        n_addresses=n_addresses,
        window_ms=None,
    )


def draw_rasters(rasters: Sequence[Raster]) -> plotly.graph_objects.Figure:
    """Draw rasters two by two: darker cells have more events; what is outside the window is shaded."""
    from plotly.subplots import make_subplots

    n_columns = min(2, len(rasters))
    n_rows = -(-len(rasters) // n_columns)
    titles = [safe(raster.title) for raster in rasters]
    figure = make_subplots(
        rows=n_rows,
        cols=n_columns,
        subplot_titles=titles,
        horizontal_spacing=0.14 if n_columns > 1 else 0,
        vertical_spacing=0.36 / n_rows,
    )
    for k, raster in enumerate(rasters):
        row, column = k // n_columns + 1, k % n_columns + 1
        figure.add_heatmap(
            x0=raster.cell_ms / 2,
            dx=raster.cell_ms,
            y0=(raster.cell_addresses - 1) / 2,
            dy=raster.cell_addresses,
            z=_shades(raster.counts),
            customdata=raster.counts,
            zmin=0,
            zmax=1,
            colorscale=_SCALE,
            showscale=False,
            hovertemplate=f"%{{customdata}} at %{{x:.4g}} ms, {raster.address} %{{y:.0f}}<extra></extra>",
            row=row,
            col=column,
        )
        for begin_ms, end_ms in _left_out(raster):
            figure.add_vrect(
                x0=begin_ms, x1=end_ms, fillcolor=_LEFT_OUT, line_width=0, layer="above", row=row, col=column
            )
        figure.update_xaxes(
            title_text="time (ms)", range=[0, raster.end_ms], showgrid=False, row=row, col=column
        )
        figure.update_yaxes(
            title_text=raster.address,
            range=[-0.5, raster.n_addresses - 0.5],
            showgrid=False,
            nticks=5,
            row=row,
            col=column,
        )
    figure.update_annotations(font_size=12)
    figure.update_layout(height=80 + 240 * n_rows, margin={"t": 32})
    return figure


def _shades(counts: Ints) -> Floats:
    """Return 0 for an empty cell and up to 1 for the 99th percentile of the others, by the logarithm."""
    busy = counts[counts > 0]
    most = float(np.percentile(busy, 99)) if busy.size else 1.0
    return np.asarray(np.round(np.minimum(np.log1p(counts) / np.log1p(most), 1.0), 3))


def _left_out(raster: Raster) -> list[tuple[float, float]]:
    """Return the spans of time outside the window."""
    if raster.window_ms is None:
        return []
    begin_ms, end_ms = raster.window_ms
    spans = [(0.0, begin_ms), (end_ms, raster.end_ms)]
    return [(begin, end) for begin, end in spans if end > begin]
