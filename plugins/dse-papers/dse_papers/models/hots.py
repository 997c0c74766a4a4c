"""HOTS: a hierarchy of time surfaces whose prototypes are counted; the nearest labelled histogram answers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, NamedTuple

import numpy as np

from dse.base.records import Answers, Array, Dataset, Outcome, Parameters
from dse.base.registry import fixed, param, register
from dse.models.training import Generators, Training
from dse_papers.models.prototypes import clustered, drawn_surfaces, learnt_online
from dse_papers.models.time_surfaces import Field, Memory, Prepared, Stream, neighbours, prepared

_FARTHEST, _MOST_PLACES = 2**20, 2**26


@register("models", "hots")
@dataclass(frozen=True)
class HOTS:
    """Time surfaces of events, in 1 to 3 layers (equations: dse_papers.models.time_surfaces).

    Layer l has radius K_rad^(l-1) rad_1, f = K_f^(l-1) f_1 prototypes and time constant K_tau^(l-1) tau_1;
    radius and f are rounded, halves upwards, and at least 1. Fewer prototypes are learnt where fewer surfaces
    differ. A sample's histogram counts the prototypes of the last layer over its events so far; the nearest
    signature (Euclidean; the first of equally near ones) gives the class. Prototypes are learnt once, on the
    whole training windows, and signatures for every input length. With `preprocessing.every_event` every
    event has its own time; otherwise spikes are events of the time of their step, rounded to microseconds,
    and those of one step come in the order of their channels.

    Cost: W_t is the numbers of all prototypes and of the signatures. An event costs, per layer,
    f + 1 multiply-accumulates for each number of its surface (distances, and the decay), and 1 addition for
    its count; an answer costs one multiply-accumulate per number of the signatures, and f more to normalise.
    With the filter, every input event costs an addition per place within its radius. `training` is not used.

    Sources: Lagorce et al. 2017; Brayshaw et al., temporal and spatio-temporal domains, Eqs. (2)-(4).
    """

    takes_events: ClassVar[bool] = True
    no_c: ClassVar[str] = (
        "family hots takes an exponential of every neighbour of every event, and the nearest of its "
        "prototypes by such numbers: the last bits of exponentials differ between C libraries, and C is "
        "written without one"
    )

    layers: int = param(1, low=1, high=3, doc="layers of prototypes")
    radius: int = param(2, low=1, unit="places", doc="radius rad_1 of the time surfaces of the first layer")
    radius_factor: float = param(
        2.0, low=0, low_open=True, doc="K_rad: radius of a layer divided by that of the layer before"
    )
    radius_max: int = param(10, low=1, unit="places", doc="largest radius of any layer")
    prototypes: int = param(16, low=1, doc="number f_1 of prototypes of the first layer")
    prototypes_factor: float = param(
        2.0,
        low=0,
        low_open=True,
        doc="K_f: number of prototypes of a layer divided by that of the layer before",
    )
    tau_ms: float = param(
        100.0, low=0, low_open=True, unit="ms", doc="time constant tau_1 of the first layer"
    )
    tau_factor: float = param(
        2.0, low=0, low_open=True, doc="K_tau: time constant of a layer divided by that of the layer before"
    )
    clustering: str = param(
        "kmeans",
        choices=("kmeans", "online"),
        doc="how prototypes are learnt: k-means on sampled surfaces, or the published online rule on every "
        "event",
    )
    surfaces: int = param(
        10_000, low=1, doc="number of training surfaces sampled for k-means; the online rule starts from them"
    )
    normalised: bool = param(True, doc="divide histograms by their sums")
    signatures: str = param(
        "class",
        choices=("class", "sample"),
        doc="labelled histograms to compare with: the mean of each class, or that of each training sample",
    )
    filter_radius: int | None = param(
        None,
        low=1,
        unit="places",
        doc="eps: an event needs neighbours within this distance (default: no filter)",
    )
    filter_neighbours: int = param(
        10, low=1, doc="sam: number of earlier events required within filter_radius"
    )
    filter_ms: float = param(
        100.0,
        low=0,
        low_open=True,
        unit="ms",
        doc="how much earlier those events may be; not stated in the sources",
    )
    read_outs: int = fixed(
        20, low=1, high=50, doc="largest number of input lengths with a prediction, evenly spaced"
    )

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        """Learn prototypes and signatures from `dataset.train`; answer on validation and, if any, on test.

        Raises:
            ValueError: there is no training sample.
        """
        if not dataset.train.size:
            raise ValueError("training needs at least one training sample, got none")
        began = time.perf_counter()
        inputs = _Inputs(dataset, _places(dataset.positions), self._near())
        samples = dataset.train
        planes = [_small(inputs.events(i)[1].plane) for i in samples]
        prototypes: list[Array] = []
        for layer in range(self.layers):
            recordings = [partial(inputs.in_planes, i, p) for i, p in zip(samples, planes, strict=True)]
            field = self._field(layer, inputs.places, prototypes)
            learnt = self._learnt(layer, recordings, [len(p) for p in planes], field, rngs)
            prototypes.append(learnt.astype(np.float32))
            memory, lookup = Memory(field), prepared(prototypes[-1])
            planes = [_small(_assigned(memory, recording(), lookup)) for recording in recordings]
        lengths, f = read_out_steps(dataset.n_steps, self.read_outs), len(prototypes[-1])
        counts = np.stack(
            [histograms(inputs.events(i)[0], p, lengths, f) for i, p in zip(samples, planes, strict=True)]
        )
        signature, label = self._signatures(counts, dataset.target[samples])
        arrays = {f"prototypes_{layer + 1}": x for layer, x in enumerate(prototypes)}
        arrays |= {"signatures": signature, "signature_class": label, "positions": dataset.positions}
        fitted = Parameters(arrays, dataset.spikes.n_channels)
        seconds = time.perf_counter() - began
        n_input = sum(int(np.ptp(inputs.rows(i))) for i in samples)
        health = {
            "hots_prototypes": sum(map(len, prototypes)),
            "hots_unused_prototypes": int((counts[:, -1].sum(axis=0) == 0).sum()),
            "hots_events_kept": sum(map(len, planes)) / n_input if n_input else 1.0,
        }
        validation = self.respond(fitted, dataset, dataset.validation)
        test = self.respond(fitted, dataset, dataset.test) if dataset.test.size else None
        return Outcome(fitted, validation, test, {}, health, seconds)

    def respond(self, fitted: Parameters, dataset: Dataset, samples: Array) -> Answers:
        """Return the answers to some samples, in one pass over their events.

        Raises:
            ValueError: the data set has other channels or other input lengths than the one trained on.
        """
        n_channels, arrays = dataset.spikes.n_channels, fitted.arrays
        if n_channels != fitted.n_channels:
            raise ValueError(f"samples must have {fitted.n_channels} channels, got {n_channels}")
        lengths = read_out_steps(dataset.n_steps, self.read_outs)
        if len(lengths) != len(arrays["signatures"]):
            raise ValueError(
                f"windows must have {len(arrays['signatures'])} input lengths, got {len(lengths)}"
            )
        inputs = _Inputs(dataset, _places(arrays["positions"]), self._near())
        prototypes: list[Array] = []
        layers = []
        for layer in range(self.layers):
            memory = Memory(self._field(layer, inputs.places, prototypes))
            prototypes.append(arrays[f"prototypes_{layer + 1}"])
            layers.append((memory, prepared(prototypes[-1])))
        shape = len(samples), len(lengths)
        counts = np.zeros((*shape, len(prototypes[-1])), dtype=np.int32)
        input_spikes = np.zeros(shape, dtype=np.int64)
        for row, i in enumerate(samples):
            step, events = inputs.events(i)
            for memory, learnt in layers:
                events = events._replace(plane=_assigned(memory, events, learnt))
            counts[row] = histograms(step, events.plane, lengths, counts.shape[2])
            rows = inputs.rows(i)
            input_spikes[row] = rows[lengths] - rows[0]
        features = self._features(counts)
        label = np.empty(shape, dtype=np.int64)
        for k, signature in enumerate(arrays["signatures"]):
            label[:, k] = arrays["signature_class"][_nearest_rows(features[:, k], signature)]

        n_events = counts.sum(axis=2, dtype=np.int64).mean(axis=0) if len(samples) else np.zeros(shape[1])
        n_input = input_spikes.mean(axis=0) if len(samples) else np.zeros(shape[1])
        per_event = sum(x.size + x.shape[1] for x in prototypes)
        per_answer = arrays["signatures"][0].size + (counts.shape[2] if self.normalised else 0)
        stored = sum(x.size for x in prototypes) + arrays["signatures"][0].size
        return Answers(
            label=label,
            time_ms=lengths * dataset.spikes.step_ms,
            n_weights=np.full(len(lengths), stored, dtype=np.int64),
            macs=n_events * per_event + per_answer,
            additions=n_events + n_input * self._filter_places(),
            input_spikes=input_spikes,
        )

    def check_fitted(self, fitted: Parameters, n_outputs: int) -> None:
        """Check the arrays, which are read from disk.

        Raises:
            ValueError: shapes or numbers disagree with the settings.
        """
        arrays = fitted.arrays
        positions = arrays["positions"]
        if positions.shape != (fitted.n_channels, 3) or positions.dtype.kind != "i":
            raise ValueError(
                f"array 'positions' must be ({fitted.n_channels}, 3) integers, got {positions.shape} of "
                f"{positions.dtype}"
            )
        if np.abs(positions.astype(np.float64)).max() > _FARTHEST:
            raise ValueError(f"array 'positions' must be within {_FARTHEST} of 0")
        places = _places(positions)
        if places.width * places.height * places.n_planes > _MOST_PLACES:
            raise ValueError(f"array 'positions' must span at most {_MOST_PLACES} places")
        before: list[Array] = []
        for layer in range(self.layers):
            name = f"prototypes_{layer + 1}"
            n, size = len(arrays[name]), self._field(layer, places, before).size
            if arrays[name].shape != (n, size) or arrays[name].dtype.kind != "f" or not n:
                raise ValueError(f"array '{name}' must be (prototypes, {size}), got {arrays[name].shape}")
            before.append(arrays[name])
        signatures, n = arrays["signatures"].shape, len(before[-1])
        if signatures[2:] != (n,) or arrays["signature_class"].shape != signatures[1:2]:
            text = f"array 'signatures' must be (length, signature, {n}), with a class each"
            raise ValueError(f"{text}, got {signatures}")

    def _learnt(
        self,
        layer: int,
        recordings: Sequence[Callable[[], Stream]],
        n_events: Sequence[int],
        field: Field,
        rngs: Generators,
    ) -> Array:
        n = _rounded(self.prototypes * self.prototypes_factor**layer)
        surface_rngs = rngs("drawn surfaces", layer)
        drawn = drawn_surfaces(recordings, n_events, field, self.surfaces, 2 * n, surface_rngs)
        rng = rngs("prototypes", layer)
        if self.clustering == "online":
            return learnt_online(recordings, drawn, field, n, rng)
        return clustered(drawn, n, rng)

    def _field(self, layer: int, places: _Places, before: Sequence[Array]) -> Field:
        radius = min(self.radius_max, _rounded(self.radius * self.radius_factor**layer))
        n_planes = len(before[-1]) if before else places.n_planes
        return Field(
            places.width, places.height, n_planes, radius, 1000 * self.tau_ms * self.tau_factor**layer
        )

    def _near(self) -> _Near | None:
        if self.filter_radius is None:
            return None
        return _Near(self.filter_radius, self.filter_neighbours, round(1000 * self.filter_ms))

    def _filter_places(self) -> int:
        """Return how many places lie within the filter's radius."""
        if self.filter_radius is None:
            return 0
        along = np.arange(-self.filter_radius, self.filter_radius + 1)
        return int((along[:, None] ** 2 + along**2 <= self.filter_radius**2).sum())

    def _features(self, counts: Array) -> Array:
        """Return histograms as they are compared, float32; one without events stays 0."""
        shares = counts.astype(np.float32)
        return shares / np.maximum(shares.sum(axis=-1, keepdims=True), 1) if self.normalised else shares

    def _signatures(self, counts: Array, target: Array) -> tuple[Array, Array]:
        """Return labelled histograms, (length, signature, prototype) float32, and their classes."""
        features = self._features(counts).transpose(1, 0, 2)
        if self.signatures == "sample":
            return np.ascontiguousarray(features), target
        present = np.unique(target)
        means = [features[:, target == c].mean(axis=1, dtype=np.float64) for c in present]
        return np.stack(means, axis=1).astype(np.float32), present


def read_out_steps(n_steps: int, most: int) -> Array:
    """Return the input lengths that are answered, in steps, rising to the whole: all, or `most` even ones."""
    n = min(most, n_steps)
    return -(-np.arange(1, n + 1) * n_steps // n)


def histograms(step: Array, label: Array, lengths: Array, n: int) -> Array:
    """Return how often each of n labels came within each input length, (length, label) int32.

    Args:
        step: (event,) steps from 0, below the last length.
        label: (event,) numbers from 0 to n - 1.
        lengths: (length,) steps, rising; an event counts where its step is below the length.
        n: labels.
    """
    first = np.searchsorted(lengths, step, side="right")
    counts = np.bincount(first * n + label, minlength=len(lengths) * n).reshape(len(lengths), n)
    return counts.cumsum(axis=0, dtype=np.int32)


class _Near(NamedTuple):
    """The noise filter: an event needs n earlier ones within the radius and the span."""

    radius: int
    n: int
    span_us: int


class _Places(NamedTuple):
    """x, y and plane of every channel, (n_channels,) int32 from 0, and how many of each there are."""

    x: Array
    y: Array
    plane: Array
    width: int
    height: int
    n_planes: int


def _places(positions: Array) -> _Places:
    """Return positions from the first column and row that hold a channel; planes are numbered anew."""
    x, y, name = positions.T.astype(np.int32)
    names, plane = np.unique(name, return_inverse=True)
    x, y, plane = x - x.min(), y - y.min(), plane.astype(np.int32)
    return _Places(x, y, plane, int(x.max()) + 1, int(y.max()) + 1, len(names))


@dataclass(frozen=True)
class _Inputs:
    """The events of a data set's evaluated windows, in the order of the spikes (`records.Spikes`)."""

    dataset: Dataset
    places: _Places
    near: _Near | None
    _passed: dict[int, Array] = field(default_factory=dict)  # sample -> bits of its events

    def events(self, i: int) -> tuple[Array, Stream]:
        """Return the events of sample i that pass the filter, and their steps within the window."""
        rows = self.rows(i)
        step = np.repeat(np.arange(len(rows) - 1), np.diff(rows))
        channel = self.dataset.spikes.channel[rows[0] : rows[-1]]
        x, y, plane, *_ = self.places
        events = Stream(self._times_us(i, step), x[channel], y[channel], plane[channel])
        if self.near is None:
            return step, events
        if i not in self._passed:
            n_near = neighbours(events, self.near.radius, self.near.span_us)
            self._passed[i] = np.packbits(n_near >= self.near.n)
        passed = np.unpackbits(self._passed[i], count=len(step)).view(np.bool_)
        return step[passed], Stream(*(a[passed] for a in events))

    def in_planes(self, i: int, plane: Array) -> Stream:
        """Return the events of sample i that pass the filter, in the planes of a deeper layer."""
        return self.events(i)[1]._replace(plane=plane)

    def rows(self, i: int) -> Array:
        """Return where the spikes of every step of sample i's window begin, and where the last ones end."""
        spikes = self.dataset.spikes
        first = int(i) * spikes.n_steps + int(self.dataset.start[i])
        return spikes.row_offsets[first : first + self.dataset.n_steps + 1]

    def _times_us(self, i: int, step: Array) -> Array:
        """Return the times of sample i's spikes since the start of its window, int64."""
        spikes, step_us = self.dataset.spikes, 1000 * self.dataset.spikes.step_ms
        if spikes.t_us is None:
            return np.rint(step * step_us).astype(np.int64)
        rows = self.rows(i)
        t_us = spikes.t_us[rows[0] : rows[-1]].astype(np.int64)
        return np.asarray(t_us - round(int(self.dataset.start[i]) * step_us))


def _small(planes: Array) -> Array:
    """Return planes in the smallest type that holds them: those of all training events are in memory."""
    return planes.astype(np.min_scalar_type(int(planes.max(initial=0))))


def _assigned(memory: Memory, events: Stream, prototypes: Prepared) -> Array:
    memory.forget()
    return memory.assign(events, prototypes)


def _nearest_rows(features: Array, signatures: Array) -> Array:
    """Return the number of the nearest signature of every row; the lowest of equally near ones."""
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(features, signatures, "sqeuclidean").argmin(axis=1))


def _rounded(number: float) -> int:
    """Return a number rounded, halves upwards, and at least 1."""
    return max(1, math.floor(number + 0.5))
