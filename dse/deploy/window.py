"""One window of a stream: the spikes of its steps in, the answer out in the step in which it falls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dse.deploy.classifier import BundleError, Classifier, Input
from dse.deploy.decide import decided
from dse.engine.stepping import RunningStack
from dse.measure.heads import head_answers, head_slices, joint_label
from dse.models.snn.respond import layers_of
from dse.records import Answers, Dataset, Ints, Network, Response, Spikes

_NONE = np.zeros(0, np.int64)


class Verdict(NamedTuple):
    """An answer to a window.

    label: class, as of `dse.deploy.reference.decided`. time_ms: since the window's first step.
    decided: whether theta was reached.
    confidence, margin: as in `dse.deploy.stream.Decision`.
    """

    label: int
    time_ms: float
    decided: bool
    confidence: float | None
    margin: float | None


def opener_of(bundle: Classifier, recordings: Input) -> Stepwise | Whole:
    """Return what opens windows: a network that runs step by step, or a classifier that needs whole windows.

    Args:
        bundle: as read.
        recordings: what it takes.

    Raises:
        BundleError: it refuses such windows.
    """
    network = bundle.fitted
    if isinstance(network, Network):
        return Stepwise(bundle, network, recordings)
    return Whole(bundle, recordings)


def _data(bundle: Classifier, spikes: Spikes) -> Dataset:
    """Return one window as the only sample of a data set; families do not read positions in an answer."""
    zero = np.zeros(1, np.int32)
    return Dataset(
        spikes=spikes, target=np.full(1, -1), classes=bundle.classes, start=zero, start_low=zero,
        start_high=zero, n_steps=spikes.n_steps, train=_NONE, validation=_NONE, test=np.zeros(1, np.int64),
        positions=np.zeros((spikes.n_channels, 3), np.int32), heads=bundle.heads,
    )  # fmt: skip


def _parts(bundle: Classifier, data: Dataset) -> dict[str, slice]:
    """Return the outputs of each head of a bundle by its name."""
    return dict(zip((head.name for head in bundle.heads), head_slices(data), strict=False))


def shares(counts: Sequence[int]) -> tuple[float, float]:
    """Return the share of the largest count, and by how much it exceeds that of the second; 0 without any."""
    total = sum(counts)
    if not total:
        return 0.0, 0.0
    *_, second, first = 0, *sorted(counts)
    return first / total, (first - second) / total


class Stepwise:
    """A network; all windows share its weights."""

    def __init__(self, bundle: Classifier, network: Network, recordings: Input) -> None:
        self._network, self._layers = network, layers_of(network)
        self.per_sample = network.steps_per_sample
        self.n_outputs = network.sizes[-1]
        self._step_ms = recordings.step_ms / self.per_sample
        spikes = Spikes(np.zeros(2, np.int64), _NONE, 1, network.n_channels, recordings.step_ms)
        self._data = _data(bundle, spikes)
        parts = _parts(bundle, self._data)
        self._part = parts.get(bundle.head, slice(None))
        self._parts = list(parts.values()) if not bundle.head else []
        self._heads = bundle.heads
        self._phi, self._theta = bundle.phi, bundle.theta
        self._n_steps = recordings.n_steps * self.per_sample
        if self._phi is None and bundle.read_out_ms is not None:
            self._n_steps = min(self._n_steps, max(1, round(bundle.read_out_ms / self._step_ms)))

    def open(self) -> Running:
        """Return a window at its first step."""
        network = self._network
        stack = RunningStack(self._layers, network.n_channels, network.delays, self.per_sample)
        return Running(self, stack)

    def verdict(self, counts: list[int], n_steps: int, has_changed: bool) -> Verdict | None:
        """Return the answer after so many network steps, if it falls in the last of them.

        The rule is that of dse.measure.decision.

        Args:
            counts: (output,) spikes so far.
            n_steps: network steps so far, > 0.
            has_changed: whether the last step added any.
        """
        is_last = n_steps == self._n_steps
        if not (has_changed or is_last):
            return None
        part = counts[self._part]
        confidence, margin = shares(part)
        decides = self._phi is None
        if self._phi is not None and self._theta is not None:
            decides = sum(part) > self._phi and confidence >= self._theta
            if not (decides or is_last):
                return None
        elif not is_last:
            return None
        if self._parts and self._phi is None:
            label = int(joint_label(head_answers(self._data, np.array([counts])), self._heads)[0])
            confidence, margin = (min(x) for x in zip(*(shares(counts[p]) for p in self._parts), strict=True))
        else:
            label = part.index(max(part))
        return Verdict(label, n_steps * self._step_ms, decides, confidence, margin)


class Running:
    """A window of a network without an answer so far: its states, and its output spikes."""

    def __init__(self, classifier: Stepwise, stack: RunningStack) -> None:
        self._classifier, self._stack = classifier, stack
        self._counts = [0] * classifier.n_outputs
        self._n_steps = 0

    def step(self, channels: Ints, _: Ints | None) -> Verdict | None:
        """Take the next input step: int32 channels that spike, rising; return the answer if there is one."""
        for _part in range(self._classifier.per_sample):
            self._n_steps += 1
            output = set(self._stack.output.tolist())
            for neuron in output:
                self._counts[neuron] += 1
            verdict = self._classifier.verdict(self._counts, self._n_steps, bool(output))
            if verdict is not None:
                return verdict
            self._stack.step(channels)
        return None


class Whole:
    """A classifier that is shown a window when it is over, or when as much of it is there as it reads."""

    def __init__(self, bundle: Classifier, recordings: Input) -> None:
        self._bundle, self._recordings = bundle, recordings
        settings = bundle.sections.preprocessing
        self._has_times = settings is not None and settings.every_event and bundle.sections.encoder is None
        self.n_needed = recordings.n_steps
        try:
            response = self._respond([], [])
        except ValueError as error:
            raise BundleError(str(error)) from None
        if isinstance(response, Answers):
            time_ms = decided(bundle, self._shown([], []), response)[1][0]
            self.n_needed = min(self.n_needed, math.ceil(time_ms / recordings.step_ms - 1e-9))

    def open(self) -> Collected:
        """Return a window at its first step."""
        return Collected(self)

    def verdict(self, channels: list[Ints], t_us: list[Ints | None]) -> Verdict:
        """Return the answer to the spikes of a window's first steps; the others are taken for empty."""
        response = self._respond(channels, t_us)
        label, time_ms, reached = decided(self._bundle, self._shown(channels, t_us), response)
        confidence, margin = None, None
        if isinstance(response, Response):
            n = round(float(time_ms[0]) / response.step_ms)
            parts = _parts(self._bundle, self._shown([], []))
            counts = response.output[0, :n, parts.get(self._bundle.head, slice(None))].sum(axis=0)
            confidence, margin = shares(counts.tolist())
        return Verdict(int(label[0]), float(time_ms[0]), bool(reached[0]), confidence, margin)

    def _respond(self, channels: list[Ints], t_us: list[Ints | None]) -> Response | Answers:
        data = self._shown(channels, t_us)
        return self._bundle.sections.model.respond(self._bundle.fitted, data, data.test)

    def _shown(self, channels: list[Ints], t_us: list[Ints | None]) -> Dataset:
        n_steps, step_ms = self._recordings.n_steps, self._recordings.step_ms
        counts = np.zeros(n_steps, np.int64)
        counts[: len(channels)] = [len(x) for x in channels]
        times = None
        if self._has_times:
            since = [round(i * step_ms * 1000) + x for i, x in enumerate(t_us) if x is not None]
            times = np.concatenate([*since, np.zeros(0, np.int32)]).astype(np.int32)
        spikes = Spikes(
            np.concatenate([[0], np.cumsum(counts)]),
            np.concatenate([*channels, np.zeros(0, np.int32)]).astype(np.int32),
            n_steps,
            self._bundle.fitted.n_channels,
            step_ms,
            times,
        )
        return _data(self._bundle, spikes)


class Collected:
    """The steps of a window so far."""

    def __init__(self, classifier: Whole) -> None:
        self._classifier = classifier
        self._channels: list[Ints] = []
        self._t_us: list[Ints | None] = []

    def step(self, channels: Ints, t_us: Ints | None) -> Verdict | None:
        """Take the spikes of the next input step; return the answer if it falls in it.

        Args:
            channels: int32 channels, rising; with times, in their order.
            t_us: int32 times of the spikes since the start of the step; None: a spike has that of the step.
        """
        self._channels.append(channels)
        self._t_us.append(t_us)
        if len(self._channels) < self._classifier.n_needed:
            return None
        return self._classifier.verdict(self._channels, self._t_us)
