"""One window of a stream: the spikes of its steps in, the decision out in the step in which it falls."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dse.base.records import Answers, Dataset, Ints, Network, Response, Spikes
from dse.deploy.classifier import BundleError, Classifier, Input
from dse.deploy.form import rule_of
from dse.deploy.reference import decided, windows_of
from dse.engine.stepping import RunningStack
from dse.measure.heads import head_slices
from dse.models.snn.respond import layers_of


class Decision(NamedTuple):
    """The answer to one window.

    window: its number, from 0. begin_ms: its first step, by the time of the stream.
    answer: the class; None: a combination of the heads' answers that no training recording had.
    time_ms: from the beginning of the window to the answer.
    confidence: share of the output spikes that are of the class; 0 without spikes, None of a classifier
        without output spikes. margin: the same, minus the share of the class that is second.
        Of a joint net that answers with all heads together: the lowest over its heads.
    decided: whether theta was reached; true where the answer comes at a fixed time.
    """

    window: int
    begin_ms: float
    answer: str | None
    time_ms: float
    confidence: float | None
    margin: float | None
    decided: bool


Window = Callable[[Ints, Ints | None], Decision | None]
"""Takes the spikes of the next input step; returns the decision if it falls in it.

The spikes are int32 channels, rising; or, with int32 times since the start of the step, in their order.
"""


def opener_of(bundle: Classifier, taken: Input) -> Callable[[int, float], Window]:
    """Return what opens a window by its number and its beginning in ms.

    A network runs step by step; any other classifier is shown what it reads of a window once it is there.
    """
    return (_of_network if isinstance(bundle.fitted, Network) else _of_whole_windows)(bundle, taken)


def _of_network(bundle: Classifier, taken: Input) -> Callable[[int, float], Window]:
    network = bundle.fitted
    assert isinstance(network, Network)
    layers, per_sample, n_outputs = layers_of(network), network.steps_per_sample, network.sizes[-1]
    step_ms = taken.step_ms / per_sample  # of a network step
    rule = rule_of(bundle, taken.n_steps * per_sample, n_outputs, step_ms)

    def opened(number: int, begin_ms: float) -> Window:
        stack = RunningStack(layers, network.n_channels, network.delays, per_sample)  # they share the weights
        counts, step = [0] * n_outputs, 0

        def taking(channels: Ints, _: Ints | None) -> Decision | None:
            nonlocal step
            for _part in range(per_sample):
                spiking = set(stack.output.tolist())
                for neuron in spiking:
                    counts[neuron] += 1
                is_last = step == rule.last
                if is_last or (spiking and rule.least_total is not None):
                    parts = [counts[first : first + n] for first, n in rule.parts]
                    is_met = rule.is_met(parts[0])
                    if is_met or is_last:
                        answer, time_ms = bundle.named(rule.label(parts)), (step + 1) * step_ms
                        share, margin = (min(x) for x in zip(*map(shares, parts), strict=True))
                        return Decision(number, begin_ms, answer, time_ms, share, margin, is_met)
                step += 1
                stack.step(channels)
            return None

        return taking

    return opened


def shares(counts: Sequence[int]) -> tuple[float, float]:
    """Return the share of the largest count, and by how much it exceeds that of the second; 0 without any."""
    total = sum(counts)
    if not total:
        return 0.0, 0.0
    *_, second, first = 0, *sorted(counts)
    return first / total, (first - second) / total


def _of_whole_windows(bundle: Classifier, taken: Input) -> Callable[[int, float], Window]:
    settings = bundle.sections.preprocessing
    has_times = settings is not None and settings.every_event and bundle.sections.encoder is None
    n_channels, n_steps, step_us = bundle.fitted.n_channels, taken.n_steps, taken.step_ms * 1000

    def responded(steps: Sequence[tuple[Ints, Ints | None]]) -> tuple[Dataset, Response | Answers]:
        """Return the first steps of a window as data, and what is answered to it with the others empty."""
        none, counts, times = np.zeros(0, np.int32), np.zeros(n_steps, np.int64), None
        counts[: len(steps)] = [len(channels) for channels, _ in steps]
        if has_times:
            since = [round(i * step_us) + t_us for i, (_, t_us) in enumerate(steps) if t_us is not None]
            times = np.concatenate([*since, none]).astype(np.int32)
        channel = np.concatenate([*(channels for channels, _ in steps), none]).astype(np.int32)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        spikes = Spikes(offsets, channel, n_steps, n_channels, taken.step_ms, times)
        data = windows_of(spikes, bundle.classes, bundle.heads)
        return data, bundle.sections.model.respond(bundle.fitted, data, data.test)

    n_needed = n_steps
    try:
        data, response = responded([])
    except ValueError as error:
        raise BundleError(str(error)) from None
    if isinstance(response, Answers):
        answers_ms = decided(bundle, data, response)[1][0]
        n_needed = min(n_needed, math.ceil(answers_ms / taken.step_ms - 1e-9))

    def opened(number: int, begin_ms: float) -> Window:
        steps: list[tuple[Ints, Ints | None]] = []

        def taking(channels: Ints, t_us: Ints | None) -> Decision | None:
            steps.append((channels, t_us))
            if len(steps) < n_needed:
                return None
            data, response = responded(steps)
            [label], [time_ms], [reached] = decided(bundle, data, response)
            sure: tuple[float | None, float | None] = (None, None)
            if isinstance(response, Response):
                n = round(float(time_ms) / response.step_ms)
                parts = dict(zip((head.name for head in bundle.heads), head_slices(data), strict=False))
                output = response.output[0, :n, parts.get(bundle.head, slice(None))]
                sure = shares(output.sum(axis=0).tolist())
            return Decision(number, begin_ms, bundle.named(label), float(time_ms), *sure, bool(reached))

        return taking

    return opened
