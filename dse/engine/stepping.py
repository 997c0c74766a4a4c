"""A stack of layers that runs step by step from rest, with the spikes of `dse.engine.network.answer`.

A step's work grows with its input spikes and with the neurons. A layer sees the spikes of the one before a
step later, and its own ones too; nothing from before the first step is seen. One with delays sums anew what
arrives in a step, from the spikes that its longest delay reaches back to.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from dse.base.records import Array, Ints
from dse.engine import layers
from dse.engine.definition import DefinedLayer, delayed_sum, in_type, rows_sum
from dse.engine.events import ONCE, Rows, pooled
from dse.engine.forward import Prepared
from dse.engine.layers import CompiledLayer
from dse.engine.layout import LANES, aligned
from dse.engine.neurons.calculus import NumpyCalculus

_NONE = np.zeros(0, np.int32)


class RunningLayer(Protocol):
    """A layer between two steps.

    fired: numbers of the neurons that fired in the last step, rising; several times where they did.
    """

    fired: Ints

    def step(self, index: Ints) -> None:
        """Advance by one step, given the numbers of the inputs that spike, int32, rising."""


def running(layer: Prepared) -> RunningLayer:
    """Return a layer at rest."""
    if isinstance(layer, CompiledLayer):
        return _Compiled(layer)
    assert isinstance(layer, DefinedLayer)  # there is no other kind
    return _Defined(layer)


class _Past:
    """The input spikes of a layer, as far back as its longest delay."""

    def __init__(self, delay: Array, n_inputs: int) -> None:
        self._n_inputs = n_inputs
        self._steps: deque[Ints] = deque(maxlen=1 + int(delay.max(initial=0)))

    def with_step(self, index: Ints) -> Rows:
        """Take over the spikes of a step; return those of all."""
        self._steps.append(index.copy())
        offsets = np.cumsum([0, *(len(x) for x in self._steps)])
        return Rows(offsets, np.concatenate(self._steps), 1, len(self._steps), self._n_inputs)


class _Compiled:
    """A layer that the kernels run."""

    def __init__(self, layer: CompiledLayer) -> None:
        self._layer = ready = layer.layer
        self._pool = layer.pool
        n = ready.n_columns
        self._offsets = np.zeros(2, np.int64)
        self._z = aligned(n, ready.back_u.dtype)
        self._fired = np.zeros(n // LANES, np.uint16)
        self._peak = np.zeros(LANES, ready.keep_u.dtype)
        self._u, self._v = aligned(n, ready.keep_u.dtype), aligned(n, ready.keep_u.dtype)
        self._sent = np.zeros(n, np.int32)
        self._past = _Past(ready.delay, ready.n_inputs) if ready.delay.size else None
        self.fired: Ints = self._sent[:0]

    def step(self, index: Ints) -> None:
        times = ONCE
        if self._pool is not None:
            of_pools = pooled(Rows(np.array([0, len(index)]), index, 1, 1, self._pool.size), self._pool)
            index, times = of_pools.index, of_pools.times
        self._offsets[1] = len(index)
        if self._past is not None:
            rows = self._past.with_step(index)
            self._z[:] = layers.arriving(self._layer, rows.offsets, rows.index)
        n_sent = layers.step(
            self._layer,
            self._offsets,
            index,
            times,
            self._z,
            self._fired,
            self._peak,
            self._u,
            self._v,
            self._sent,
            len(self.fired),
        )
        self.fired = self._sent[:n_sent]


class _Defined:
    """A layer that the definition of its neurons runs."""

    def __init__(self, layer: DefinedLayer) -> None:
        self._calculus = NumpyCalculus(layer.arithmetic)
        self._real = np.dtype(np.float32 if layer.arithmetic == "float32" else np.float64)
        self._weight = layer.weights.feed_forward.astype(self._real)
        self._delay = layer.weights.delay
        self._past = _Past(self._delay, len(self._weight))
        self._ring = layer.weights.recurrent.astype(self._real)
        self._population: Any = in_type(layer.weights.population, self._real)
        self._state = self._population.initial_state((1, layer.n_neurons), self._calculus)
        self._spikes = np.zeros((1, layer.n_neurons), self._real)
        self.fired: Ints = _NONE

    def step(self, index: Ints) -> None:
        z = delayed_sum(self._past.with_step(index), slice(0, 1), self._weight, self._delay)[:, -1]
        if self._ring.size:
            z = z + rows_sum(self._spikes, self._ring)
        self._state, _, self._spikes = self._population.step(self._state, z, self._calculus)
        counts = self._spikes[0].astype(np.uint8)
        neurons = np.flatnonzero(counts)
        self.fired = np.repeat(neurons, counts[neurons]).astype(np.int32)


class RunningStack:
    """A stack of layers from rest on, with delayed copies of its inputs.

    Args:
        stack: layers, input side first; their weights are shared by all that run.
        n_channels: input channels, delayed copies not counted.
        delays: of the copies, in network steps.
        steps_per_sample: network steps per input step; spikes arrive in the first.
    """

    def __init__(
        self, stack: Sequence[Prepared], n_channels: int, delays: tuple[int, ...], steps_per_sample: int
    ) -> None:
        self._layers = [running(layer) for layer in stack]
        self._n_channels, self._delays, self._per_sample = n_channels, delays, steps_per_sample
        self._past: deque[Ints] = deque(maxlen=max(delays) // steps_per_sample + 1)
        self._step = 0

    @property
    def fired(self) -> tuple[Ints, ...]:
        """Per layer, the neurons that fired in the last step; they are overwritten by the next step."""
        return tuple(layer.fired for layer in self._layers)

    @property
    def output(self) -> Ints:
        """The outputs that spike in the step to come: those that fired in the last one."""
        return self._layers[-1].fired

    def step(self, channels: Ints) -> None:
        """Advance by one network step.

        Args:
            channels: int32 input channels that spike, rising; read in the first network step of each input
                step, and held until the last delayed copy has arrived.
        """
        if self._step % self._per_sample == 0:
            self._past.append(channels)
        index = self._arriving()
        # From the last layer back: each reads what the one before fired in the step before.
        for layer, before in zip(self._layers[:0:-1], self._layers[-2::-1], strict=True):
            layer.step(before.fired)
        self._layers[0].step(index)
        self._step += 1

    def _arriving(self) -> Ints:
        """Return the inputs of the first layer that spike: copy k of channel c is k n_channels + c."""
        if self._delays == (0,):
            return self._past[-1] if self._step % self._per_sample == 0 else _NONE
        present, copies = self._step // self._per_sample, []
        for k, delay in enumerate(self._delays):
            sent, within = divmod(self._step - delay, self._per_sample)
            if within == 0 and sent >= 0:
                copies.append(self._past[sent - present - 1] + np.int32(k * self._n_channels))
        return np.concatenate(copies) if copies else _NONE
