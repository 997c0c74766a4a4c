"""One window of a stream: the spikes of its steps in, the answer out in the step in which it falls."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from dse.deploy.classifier import BundleError, Classifier, Input
from dse.deploy.decide import decided
from dse.deploy.form import Rule, rule_of
from dse.engine.stepping import RunningStack
from dse.measure.heads import head_slices
from dse.models.snn.respond import layers_of
from dse.records import Answers, Dataset, Ints, Network, Response, Spikes

_NONE = np.zeros(0, np.int64)


class Answer(NamedTuple):
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


class Window(Protocol):
    """A window without an answer so far."""

    def step(self, channels: Ints, t_us: Ints | None) -> Answer | None:
        """Take the spikes of the next input step; return the answer if it falls in it.

        Args:
            channels: int32 channels that spike, rising; with times, in their order.
            t_us: int32 times of the spikes since the start of the step; None: a spike has that of the step.
        """
        ...


def opener_of(bundle: Classifier, taken: Input) -> Callable[[], Window]:
    """Return what opens windows: a network that runs step by step, or a classifier that needs whole windows.

    Args:
        bundle: as read.
        taken: the recordings that it takes.

    Raises:
        BundleError: it refuses such windows.
    """
    network = bundle.fitted
    if not isinstance(network, Network):
        return Whole(bundle, taken).open
    layers, per_sample = layers_of(network), network.steps_per_sample  # all windows share the weights
    step_ms = taken.step_ms / per_sample
    rule = rule_of(bundle, taken.n_steps * per_sample, network.sizes[-1], step_ms)

    def opened() -> Running:
        stack = RunningStack(layers, network.n_channels, network.delays, per_sample)
        return Running(rule, stack, network.sizes[-1], per_sample, step_ms)

    return opened


def shares(counts: Sequence[int]) -> tuple[float, float]:
    """Return the share of the largest count, and by how much it exceeds that of the second; 0 without any."""
    total = sum(counts)
    if not total:
        return 0.0, 0.0
    *_, second, first = 0, *sorted(counts)
    return first / total, (first - second) / total


class Running:
    """A window of a network: its states, and its output spikes.

    Args:
        rule: of the decision.
        stack: the network at rest.
        n_outputs: output neurons.
        per_sample: network steps per input step.
        step_ms: duration of a network step.
    """

    def __init__(
        self, rule: Rule, stack: RunningStack, n_outputs: int, per_sample: int, step_ms: float
    ) -> None:
        self._rule, self._stack, self._per_sample, self._step_ms = rule, stack, per_sample, step_ms
        self._counts = [0] * n_outputs
        self._step = 0

    def step(self, channels: Ints, _: Ints | None) -> Answer | None:
        """Take the spikes of the next input step; return the answer if it falls in it (`Window`)."""
        for _part in range(self._per_sample):
            output = set(self._stack.output.tolist())
            for neuron in output:
                self._counts[neuron] += 1
            if (answer := self._answer(bool(output))) is not None:
                return answer
            self._step += 1
            self._stack.step(channels)
        return None

    def _answer(self, has_changed: bool) -> Answer | None:
        """Return the answer if it falls in this network step; has_changed: whether an output has spiked."""
        rule, is_last = self._rule, self._step == self._rule.last
        if not is_last and (rule.least_total is None or not has_changed):
            return None
        parts = [self._counts[first : first + n] for first, n in rule.parts]
        decides = rule.is_met(parts[0])
        if not (decides or is_last):
            return None
        confidence, margin = (min(x) for x in zip(*map(shares, parts), strict=True))
        time_ms = (self._step + 1) * self._step_ms
        return Answer(rule.label(parts), time_ms, decides, confidence, margin)


class Whole:
    """A classifier that is shown a window when it is over, or when as much of it is there as it reads."""

    def __init__(self, bundle: Classifier, taken: Input) -> None:
        self._bundle, self._taken = bundle, taken
        settings = bundle.sections.preprocessing
        self._has_times = settings is not None and settings.every_event and bundle.sections.encoder is None
        self.n_needed = taken.n_steps
        try:
            data, response = self._responded([], [])
        except ValueError as error:
            raise BundleError(str(error)) from None
        if isinstance(response, Answers):
            time_ms = decided(bundle, data, response)[1][0]
            self.n_needed = min(self.n_needed, math.ceil(time_ms / taken.step_ms - 1e-9))

    def open(self) -> Collected:
        """Return a window at its first step."""
        return Collected(self)

    def answer(self, channels: list[Ints], t_us: list[Ints | None]) -> Answer:
        """Return the answer to the spikes of a window's first steps; the others are taken for empty."""
        data, response = self._responded(channels, t_us)
        label, time_ms, reached = decided(self._bundle, data, response)
        confidence, margin = None, None
        if isinstance(response, Response):
            n, heads = round(float(time_ms[0]) / response.step_ms), self._bundle.heads
            parts = dict(zip((head.name for head in heads), head_slices(data), strict=False))
            counts = response.output[0, :n, parts.get(self._bundle.head, slice(None))].sum(axis=0)
            confidence, margin = shares(counts.tolist())
        return Answer(int(label[0]), float(time_ms[0]), bool(reached[0]), confidence, margin)

    def _responded(self, channels: list[Ints], t_us: list[Ints | None]) -> tuple[Dataset, Response | Answers]:
        """Return a window as the only sample of a data set, and what the family answers to it.

        Families do not read positions in an answer.
        """
        bundle, n_steps, step_ms = self._bundle, self._taken.n_steps, self._taken.step_ms
        n_channels, counts = bundle.fitted.n_channels, np.zeros(n_steps, np.int64)
        counts[: len(channels)] = [len(x) for x in channels]
        times = None
        if self._has_times:
            since = [round(i * step_ms * 1000) + x for i, x in enumerate(t_us) if x is not None]
            times = np.concatenate([*since, np.zeros(0, np.int32)]).astype(np.int32)
        channel = np.concatenate([*channels, np.zeros(0, np.int32)]).astype(np.int32)
        offsets, zero = np.concatenate([[0], np.cumsum(counts)]), np.zeros(1, np.int32)
        data = Dataset(
            spikes=Spikes(offsets, channel, n_steps, n_channels, step_ms, times), target=np.full(1, -1),
            classes=bundle.classes, start=zero, start_low=zero, start_high=zero, n_steps=n_steps, train=_NONE,
            validation=_NONE, test=np.zeros(1, np.int64), positions=np.zeros((n_channels, 3), np.int32),
            heads=bundle.heads,
        )  # fmt: skip
        return data, bundle.sections.model.respond(bundle.fitted, data, data.test)


class Collected:
    """The steps of a window so far."""

    def __init__(self, classifier: Whole) -> None:
        self._classifier = classifier
        self._channels: list[Ints] = []
        self._t_us: list[Ints | None] = []

    def step(self, channels: Ints, t_us: Ints | None) -> Answer | None:
        """Take the spikes of the next input step; return the answer if it falls in it (`Window`)."""
        self._channels.append(channels)
        self._t_us.append(t_us)
        if len(self._channels) < self._classifier.n_needed:
            return None
        return self._classifier.answer(self._channels, self._t_us)
