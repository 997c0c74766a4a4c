"""Layers run by the definition of their neurons, on numpy: what answers where there is no kernel.

Sums of weights run over the spikes of each row in their order, so that a sample answers the same alone and in
any batch.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from dse.base.records import Arithmetic, Array, Floats, Ints
from dse.engine.batch import chunk_samples
from dse.engine.events import Rows
from dse.engine.layers import Forward, Weights, check_inputs
from dse.engine.neurons import Population
from dse.engine.neurons.calculus import NumpyCalculus
from dse.engine.neurons.fixed_point import STATE_SCALE

P = TypeVar("P", bound=Population[Any])


@dataclass(frozen=True)
class DefinedLayer:
    """A layer and the arithmetic in which the definition of its neurons runs."""

    weights: Weights
    arithmetic: Arithmetic

    @property
    def n_neurons(self) -> int:
        return self.weights.n_neurons

    def forward(self, rows: Rows, *, keep_voltage: bool = False, count: bool = False) -> Forward:
        """Run the layer from rest over a batch; arguments as in `dse.engine.layers.CompiledLayer.forward`."""
        check_inputs(rows, self.weights.feed_forward.shape[0])
        n, t, h = rows.n_samples, rows.n_steps, self.n_neurons
        fired = np.zeros((n, t, h), np.uint8)
        voltage = np.zeros((n, t, h) if keep_voltage else (0, 0, 0))
        updates = np.zeros((n, t) if count else (0, 0), np.int32)
        peak = 0.0
        size = chunk_samples(n, t)
        for first in range(0, n, size):
            part = slice(first, min(first + size, n))
            run = self._run(rows, part)
            fired[part] = run.fired
            if keep_voltage:
                voltage[part] = run.potential
            if count:
                updates[part] = run.updates
                peak = max(peak, run.peak)
        counts = fired.reshape(n * t, h)
        row, neuron = np.nonzero(counts)
        index = np.repeat(neuron, counts[row, neuron]).astype(np.int32)
        offsets = np.concatenate([[0], np.cumsum(counts.sum(axis=1, dtype=np.int64))])
        return Forward(voltage, Rows(offsets, index, n, t, h), updates, peak)

    def _run(self, rows: Rows, samples: slice) -> _Run:
        calculus = NumpyCalculus(self.arithmetic)
        real = np.dtype(np.float32 if self.arithmetic == "float32" else np.float64)
        population = in_type(self.weights.population, real)
        drive = delayed_sum(rows, samples, self.weights.feed_forward.astype(real), self.weights.delay)
        n, t, h = drive.shape
        ring = self.weights.recurrent.astype(real)
        state = population.initial_state((n, h), calculus)
        spikes = np.zeros((n, h), real)
        # The state at rest does not count as the start of an update.
        rest = population.step(state, np.zeros((n, h), real), calculus).potential
        awake: Callable[[Any], Any] = getattr(population, "awake", lambda state: False)
        run = _Run(np.zeros((n, t, h), np.uint8), np.zeros((n, t, h), real), np.zeros((n, t), np.int32))
        scale = STATE_SCALE if self.arithmetic == "integer" else 1
        for step in range(t):
            z = drive[:, step] + rows_sum(spikes, ring) if ring.size else drive[:, step]
            state, potential, spikes = population.step(state, z, calculus)
            run.fired[:, step] = spikes
            run.potential[:, step] = potential
            run.updates[:, step] = ((potential != rest) | (z != 0) | awake(state)).sum(axis=1)
            highest = [np.abs(x).max(initial=0) / scale for x in state]
            run.peak = max(run.peak, float(np.abs(potential).max(initial=0)), *map(float, highest))
        return run


@dataclass
class _Run:
    """What some samples gave: (sample, step, neuron) spikes and potential, (sample, step) updates."""

    fired: Ints
    potential: Floats
    updates: Array
    peak: float = 0.0


def weighted(rows: Rows, samples: slice, feed_forward: Floats) -> Floats:
    """Return the weighted input spikes of some samples, (sample, step, neuron)."""
    from scipy.sparse import csr_array

    low, high = samples.start * rows.n_steps, samples.stop * rows.n_steps
    offsets = rows.offsets[low : high + 1]
    part = slice(offsets[0], offsets[-1])
    index, once = rows.index[part], np.ones(offsets[-1] - offsets[0], feed_forward.dtype)
    times = rows.times[part].astype(once.dtype) if rows.times.size else once
    matrix = csr_array((times, index, offsets - offsets[0]), shape=(high - low, rows.n_inputs))
    summed: Floats = matrix @ feed_forward
    return summed.reshape(samples.stop - samples.start, rows.n_steps, -1)


def delayed_sum(rows: Rows, samples: slice, feed_forward: Floats, delay: Array) -> Floats:
    """Return the weighted input spikes of some samples as they arrive, (sample, step, neuron).

    The definition of dse.engine.delays; what would arrive after the window is lost.
    """
    if not delay.size:
        return weighted(rows, samples, feed_forward)
    total = np.zeros((samples.stop - samples.start, rows.n_steps, feed_forward.shape[1]), feed_forward.dtype)
    for steps in np.unique(delay).tolist():
        part = weighted(rows, samples, np.where(delay == steps, feed_forward, 0))
        total[:, steps:] += part[:, : max(0, rows.n_steps - steps)]
    return total


def rows_sum(spikes: Floats, matrix: Floats) -> Floats:
    """Return spikes (sample, neuron) times a matrix; each row is summed in the order of its spikes."""
    from scipy.sparse import csr_array

    summed: Floats = csr_array(spikes) @ matrix
    return summed


def in_type(population: P, real: np.dtype[Any]) -> P:
    """Return a population with its real parameters in one type."""
    changes = {
        field.name: np.asarray(value, real)
        for field in dataclasses.fields(population)  # type: ignore[arg-type]
        if isinstance(value := getattr(population, field.name), np.ndarray) and value.dtype.kind == "f"
    }
    return dataclasses.replace(population, **changes)  # type: ignore[type-var]
