"""Spike trains before any classifier: intervals between spikes, and how far classes lie apart over time.

Sources: Rasouli et al., an extreme learning machine for texture recognition, Figs. 8, 10 and 13; Rongala et
al., IEEE Trans. Biomed. Circuits Syst. 11, 2017 (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.base.records import Array, Dataset, Floats, Ints
from dse.base.registry import fixed, register
from dse.data.encoders.receptors import FA_FALLING, FA_RISING, KINDS
from dse.show.figures import Results, trial_key, trial_of
from dse.show.figures.labels import OKABE_ITO_LIGHT, safe
from dse_papers.figures.panels import chosen_classes

if TYPE_CHECKING:
    import plotly.graph_objects


# Where there are more classes than colours, they differ in these as well.
_N_COLORS = len(OKABE_ITO_LIGHT)
_DASHES = ("solid", "dash", "dot", "dashdot")
_SYMBOLS = ("circle", "x", "square", "triangle-up")
_HEIGHT_PX, _MARGIN_PX, _NAME_PX = 400, 90, 21


@dataclass(frozen=True)
class Intervals:
    """Intervals between consecutive spikes of a channel, over groups of channels.

    edges_ms: (bin + 1,) borders of the histogram; a bin holds one interval length in steps.
    counts: (group, class, bin) int64 intervals. beyond: (group, class) int64, longer than the last bin.
    mean_ms, sd_ms: (group, sample) mean and standard deviation of a sample's intervals; NaN without one.
    target: (sample,) class of each.
    """

    groups: tuple[str, ...]
    classes: tuple[str, ...]
    edges_ms: Array
    counts: Array
    beyond: Array
    mean_ms: Array
    sd_ms: Array
    target: Array


@dataclass(frozen=True)
class Distances:
    """Mean Euclidean distance between samples' binned patterns, after each time.

    within: (k,) of pairs of one class. between: (k,) of pairs of two. NaN where there is no such pair.
    ratio: (k,) between / within; NaN where within is 0 or NaN.
    """

    time_ms: Array
    within: Array
    between: Array
    ratio: Array


@register("figures", "intervals")
@dataclass(frozen=True)
class IntervalsFigure:
    """Histograms of the intervals between a trial's training spikes, per class and kind of channel."""

    trial: int | None = trial_key()
    bins: int = fixed(40, doc="bins of the histogram", low=1)
    classes: tuple[str, ...] = fixed((), doc="classes that are drawn (default: all)")

    def gather(self, results: Results) -> Intervals:
        trial = trial_of(results, self.trial)
        dataset = results.dataset(trial)
        groups = self.groups(dataset.positions[:, 2], results.sections(trial).get("encoder") or {})
        chosen = chosen_classes(dataset.classes, self.classes)
        number = np.full(len(dataset.classes), -1)
        number[chosen] = np.arange(len(chosen))
        named = tuple(dataset.classes[c] for c in chosen)
        dataset = replace(dataset, classes=named, target=number[dataset.target])
        samples = dataset.train[dataset.target[dataset.train] >= 0]
        return gather_isi(dataset, samples, groups, self.bins)

    @staticmethod
    def groups(planes: Ints, encoder: Mapping[str, Any]) -> dict[str, Ints]:
        """Return the channels of each panel: kinds of receptors by their names, others by their planes.

        Args:
            planes: (channel,) of `Dataset.positions`.
            encoder: section of the trial; empty where spikes were recorded.
        """
        if encoder.get("kind") != "receptors":
            return {f"plane {plane}": np.flatnonzero(planes == plane) for plane in np.unique(planes).tolist()}
        kinds = KINDS if encoder.get("sa", True) else KINDS[1:]
        return {name: np.flatnonzero(planes % len(kinds) == kind) for kind, name in enumerate(kinds)}

    def draw(self, record: Intervals) -> plotly.graph_objects.Figure:
        """Draw the share of every interval length, a panel per group and a line per class."""
        middle = (record.edges_ms[1:] + record.edges_ms[:-1]) / 2
        total = record.counts.sum(axis=2) + record.beyond

        def line(g: int, c: int) -> dict[str, Any]:
            share = record.counts[g, c] / max(1, int(total[g, c]))
            look = {"color": _color(c), "width": 1.5, "dash": _DASHES[c // _N_COLORS % len(_DASHES)]}
            # A gap on the logarithmic axis where the share is 0.
            return {"x": middle, "y": np.where(share > 0, share, np.nan), "mode": "lines", "line": look}

        figure = _panels(record, line, shared_yaxes=True)
        figure.update_xaxes(title={"text": "interval (ms)"})
        # The shortest interval is most of them; the others would lie on the axis.
        figure.update_yaxes(type="log", dtick=1, exponentformat="power")
        return figure.update_yaxes(title={"text": "fraction of intervals"}, col=1)


@register("figures", "intervals_by_sample")
@dataclass(frozen=True)
class SampleIntervalsFigure(IntervalsFigure):
    """Intervals between spikes, one dot per sample: mean and standard deviation."""

    @staticmethod
    def groups(planes: Ints, encoder: Mapping[str, Any]) -> dict[str, Ints]:
        """Return the channels of each panel: those of rising and falling receptors share one."""
        groups = IntervalsFigure.groups(planes, encoder)
        merged: dict[str, Ints] = {}
        for name, channels in groups.items():
            short = "FA" if name in (FA_RISING, FA_FALLING) else name
            merged[short] = np.sort(np.concatenate([merged.get(short, channels[:0]), channels]))
        return merged

    def draw(self, record: Intervals) -> plotly.graph_objects.Figure:
        """Draw every sample by mean and deviation of its intervals, a panel per group, a colour per class."""

        def dots(g: int, c: int) -> dict[str, Any]:
            mine = record.target == c
            look = {"color": _color(c), "size": 5, "symbol": _SYMBOLS[c // _N_COLORS % len(_SYMBOLS)]}
            return {
                "x": record.mean_ms[g, mine],
                "y": record.sd_ms[g, mine],
                "mode": "markers",
                "marker": look,
            }

        figure = _panels(record, dots)
        figure.update_xaxes(title={"text": "mean interval (ms)"})
        return figure.update_yaxes(title={"text": "standard deviation (ms)"}, col=1)


@register("figures", "distances")
@dataclass(frozen=True)
class DistancesFigure:
    """Distance between classes over time, in the spikes that a trial was trained on."""

    trial: int | None = trial_key()
    every_ms: float = fixed(20.0, doc="time between looks", unit="ms", low=0, low_open=True)
    bin_ms: float = fixed(100.0, doc="counting window T_w", unit="ms", low=0, low_open=True)
    bins: int = fixed(10, doc="counting windows n_d of a pattern", low=1)

    def gather(self, results: Results) -> Distances:
        dataset = results.dataset(trial_of(results, self.trial))
        return gather_distances(dataset, dataset.train, self.every_ms, self.bin_ms, self.bins)

    def draw(self, record: Distances) -> plotly.graph_objects.Figure:
        """Draw distances within and between classes over time, and their ratio on an axis of its own."""
        import plotly.graph_objects as go

        figure = go.Figure()
        for k, (name, values) in enumerate(
            (("within a class", record.within), ("between classes", record.between))
        ):
            line = {"color": OKABE_ITO_LIGHT[k]}
            figure.add_scatter(x=record.time_ms, y=values, name=name, mode="lines", line=line)
        figure.add_scatter(
            x=record.time_ms, y=record.ratio, name="between / within", mode="lines", yaxis="y2",
            line={"color": OKABE_ITO_LIGHT[2], "dash": "dot"},
        )  # fmt: skip
        figure.update_layout(
            xaxis={"title": {"text": "time since the start (ms)"}},
            yaxis={"title": {"text": "distance of binned patterns (spikes)"}, "rangemode": "tozero"},
            yaxis2={
                "title": {"text": "ratio"},
                "overlaying": "y",
                "side": "right",
                "showgrid": False,
                "rangemode": "tozero",
                "tickmode": "auto",
            },
            legend={"orientation": "h", "y": 1.08},  # the right side is the second axis's
        )
        return figure


def gather_isi(dataset: Dataset, samples: Array, groups: Mapping[str, Array], n_bins: int = 40) -> Intervals:
    """Gather the intervals of samples' windows; intervals across channels do not count.

    Args:
        dataset: spikes and windows.
        samples: (n,) sample numbers.
        groups: name -> channels, such as those of one plane of `dataset.positions`.
        n_bins: of the histogram, from one step on.

    Raises:
        ValueError: no group, a channel that there is not, or spikes with times of their own.
    """
    n_channels, step_ms = dataset.spikes.n_channels, dataset.spikes.step_ms
    for name, channels in groups.items():
        if not np.isin(channels, np.arange(n_channels)).all():
            raise ValueError(f"channels of group '{name}' must be in 0..{n_channels - 1}, got {channels}")
    if not groups:
        raise ValueError("groups must name at least one group of channels, got none")
    if dataset.spikes.t_us is not None:
        raise ValueError("spikes must be at most one per channel and step, got every event (every_event)")
    shape = len(groups), len(samples)
    mean_ms, sd_ms = np.full(shape, np.nan), np.full(shape, np.nan)
    counts = np.zeros((len(groups), len(dataset.classes), n_bins), np.int64)
    beyond = np.zeros(counts.shape[:2], np.int64)
    for k, (i, step, channel) in enumerate(_windows(dataset, samples)):
        order = np.lexsort((step, channel))
        intervals = np.diff(step[order])
        of = channel[order]
        same = of[1:] == of[:-1]
        intervals, of = intervals[same], of[1:][same]
        for g, channels in enumerate(groups.values()):
            of_group = intervals[np.isin(of, channels)]
            if not of_group.size:
                continue
            mean_ms[g, k] = of_group.mean() * step_ms
            sd_ms[g, k] = of_group.std() * step_ms
            label = dataset.target[i]
            binned = np.bincount(of_group - 1, minlength=n_bins)
            counts[g, label] += binned[:n_bins]
            beyond[g, label] += binned[n_bins:].sum()
    return Intervals(
        tuple(groups), dataset.classes, (np.arange(n_bins + 1) + 0.5) * step_ms,
        counts, beyond, mean_ms, sd_ms, np.asarray(dataset.target[samples]),
    )  # fmt: skip


def gather_distances(
    dataset: Dataset, samples: Array, every_ms: float, bin_ms: float = 100.0, bins: int = 10
) -> Distances:
    """Gather how far classes lie apart over time; work and memory grow with the square of the samples.

    A pattern holds the spikes of every channel in each of the last counting windows, as a time-delayed
    classifier receives them; windows before the start are empty.

    Args:
        dataset: spikes and windows.
        samples: (n,) sample numbers.
        every_ms: time between looks, rounded to steps, at least one; the last is at the end of the window.
        bin_ms: counting window T_w, rounded in the same way.
        bins: counting windows n_d of a pattern.

    Raises:
        ValueError: fewer than two samples.
    """
    if len(samples) < 2:
        raise ValueError(f"samples must be at least 2, got {len(samples)}")
    step_ms = dataset.spikes.step_ms
    every, width = (max(1, round(ms / step_ms)) for ms in (every_ms, bin_ms))
    ends = np.arange(dataset.n_steps, 0, -every)[::-1]
    trains = [(step, channel) for _, step, channel in _windows(dataset, samples)]
    target = dataset.target[samples]
    first, second = np.triu_indices(len(samples), 1)
    same = target[first] == target[second]
    within, between = np.full((2, len(ends)), np.nan)
    squares: dict[int, Array] = {}  # of the counting window that ends at a step, (pair,)
    for k, end in enumerate(ends.tolist()):
        of_pattern = [last for last in range(end, max(0, end - bins * width), -width)]
        squares = {last: square for last, square in squares.items() if last > end - bins * width}
        for last in of_pattern:
            if last not in squares:
                counts = _counts(trains, max(0, last - width), last, dataset.spikes.n_channels)
                squares[last] = _square_distances(counts)[first, second]
        gap = np.sum([squares[last] for last in of_pattern], axis=0) ** 0.5
        within[k] = gap[same].mean() if same.any() else np.nan
        between[k] = gap[~same].mean() if not same.all() else np.nan
    ratio = np.divide(between, within, out=np.full(len(ends), np.nan), where=within > 0)
    return Distances(ends * step_ms, within, between, ratio)


def _counts(trains: Sequence[tuple[Ints, Ints]], begin: int, end: int, n_channels: int) -> Floats:
    """Return spikes of every sample and channel in the steps begin .. end - 1, (sample, channel)."""
    counts = np.zeros((len(trains), n_channels))
    for row, (step, channel) in zip(counts, trains, strict=True):
        low, high = np.searchsorted(step, [begin, end])
        row += np.bincount(channel[low:high], minlength=n_channels)
    return counts


def _square_distances(x: Floats) -> Floats:
    square = (x**2).sum(axis=1)
    return np.asarray(np.maximum(square[:, None] + square - 2 * x @ x.T, 0.0))


def _windows(dataset: Dataset, samples: Array) -> Iterator[tuple[int, Array, Array]]:
    """Yield sample, and step and channel of every spike of its window."""
    spikes = dataset.spikes
    for i in np.asarray(samples, np.int64).tolist():
        first = i * spikes.n_steps + int(dataset.start[i])
        borders = np.asarray(spikes.row_offsets[first : first + dataset.n_steps + 1])
        step = np.repeat(np.arange(dataset.n_steps), np.diff(borders))
        yield i, step, np.asarray(spikes.channel[borders[0] : borders[-1]], np.int64)


def _panels(
    intervals: Intervals, trace: Callable[[int, int], dict[str, Any]], **axes: bool
) -> plotly.graph_objects.Figure:
    """Return a panel per group with a trace per class, high enough for the names of all classes."""
    from plotly.subplots import make_subplots

    names = [[safe(x) for x in several] for several in (intervals.groups, intervals.classes)]
    figure = make_subplots(rows=1, cols=len(names[0]), subplot_titles=names[0], **axes)
    for g in range(len(names[0])):
        for c, name in enumerate(names[1]):
            keys = {"name": name, "legendgroup": str(c), "showlegend": g == 0, **trace(g, c)}
            figure.add_scatter(**keys, row=1, col=g + 1)
    figure.update_annotations(font_size=12)
    return figure.update_layout(height=max(_HEIGHT_PX, _MARGIN_PX + _NAME_PX * len(names[1])))


def _color(c: int) -> str:
    return OKABE_ITO_LIGHT[c % _N_COLORS]
