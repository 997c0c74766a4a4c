"""How the potential of neurons answers to inputs so small that none fires."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from dse.base.records import Floats
from dse.engine.neurons import Population
from dse.engine.neurons.calculus import NumpyCalculus

_IMPULSE = 2.0**-30  # a power of two scales float64 exactly, and so small a drive makes nothing fire
_LONGEST = 2**16
"""Steps after which a potential that still grows is taken to have no limit."""


def response_norm(population: Population[Any], n_neurons: int, n_steps: int) -> Floats:
    """Return the root of the summed squared potential after one unit input spike, (neuron,).

    The response is that to an impulse so small that no neuron fires, against the potential without any.
    """
    calculus = NumpyCalculus("ideal")
    state = population.initial_state((2, n_neurons), calculus)
    drive, total = np.zeros((2, n_neurons)), np.zeros(n_neurons)
    drive[1] = _IMPULSE
    for _ in range(n_steps):
        state, potential, _ = population.step(state, drive, calculus)
        total += ((potential[1] - potential[0]) / _IMPULSE) ** 2
        drive = np.zeros_like(drive)
    return np.asarray(np.sqrt(total))


def constant_response(population: Population[Any], n_neurons: int, n_steps: int) -> Floats:
    """Return the potential after so many steps of a constant input of 1, no neuron firing, (neuron,)."""
    return _per_unit(next(itertools.islice(_potentials(population, n_neurons), n_steps - 1, None)))


def _potentials(population: Population[Any], n_neurons: int) -> Iterator[Floats]:
    """Yield the potential without input and with a small constant one, step after step, (2, neuron)."""
    calculus = NumpyCalculus("ideal")
    state, drive = population.initial_state((2, n_neurons), calculus), np.zeros((2, n_neurons))
    drive[1] = _IMPULSE
    while True:
        state, potential, _ = population.step(state, drive, calculus)
        yield potential


def _per_unit(potential: Floats) -> Floats:
    return np.asarray((potential[1] - potential[0]) / _IMPULSE, np.float64)


def dc_gain(population: Population[Any], n_neurons: int) -> Floats:
    """Return the potential that a constant input of 1 per step ends at, no neuron firing, (neuron,).

    Raises:
        ValueError: it has no limit, or none above rest.
    """
    before: Floats = np.zeros(n_neurons)
    potentials = itertools.islice(_potentials(population, n_neurons), _LONGEST)
    for n_steps, potential in enumerate(potentials, 1):
        if n_steps >= 64 and n_steps.bit_count() == 1:  # 64, 128, 256, ...
            gain = _per_unit(potential)
            if (gain > 0).all() and np.allclose(gain, before, rtol=1e-6, atol=0):
                return gain
            before = gain
    raise ValueError(
        "neurons that are chosen (start contrasts, family kernel_snn) must not have a potential that has no "
        "limit above rest under a constant input, as without a decay"
    )
