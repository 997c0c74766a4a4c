"""The contract of a neuron."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dse.base.records import Arithmetic
from dse.engine.neurons import LayerSpec, Neuron, Population, parameters_of
from dse.engine.neurons.calculus import NumpyCalculus
from dse.testing.expect import expect, expect_component, pure, same

_LAYER = LayerSpec(n_neurons=4, is_output=False, steps_per_sample=1, step_ms=5.0)


def check_neuron(neuron: Neuron) -> None:
    """Check a neuron: parameters by seed, a resting state, a step that is pure and treats samples alike.

    Raises:
        AssertionError: what it violates.
    """
    name = expect_component(neuron)
    cls = neuron.Populations
    expect(
        dataclasses.is_dataclass(cls) and cls.__dataclass_params__.frozen,  # type: ignore[attr-defined]
        f"{name}.Populations must be a frozen dataclass",
    )
    expect(neuron.arithmetics, f"{name}.arithmetics must name one or more")
    population = pure(f"{name}.population", lambda seed: _population(neuron, seed), 3)
    expect(isinstance(population, cls), f"{name}.population must return one of its Populations")
    parameters = parameters_of(population)
    for key, values in parameters.items():
        expect(
            values.shape in ((), (_LAYER.n_neurons,)) and values.dtype.kind in "biuf",
            f"{name}: parameter {key} must be a number, or one per neuron, got shape {values.shape}",
        )
    for key, (low, high) in neuron.limits.items():
        values = parameters[key]
        expect(low <= values.min() and values.max() <= high, f"{name}: {key} must be in [{low:g}, {high:g}]")
    expect((np.asarray(population.to_threshold) > 0).all(), f"{name}.to_threshold must be > 0")
    for arithmetic in neuron.arithmetics:
        _check_steps(name, neuron, arithmetic)


def _population(neuron: Neuron, seed: int) -> Population[Any]:
    return neuron.population(_LAYER, np.random.default_rng(seed))


def _check_steps(name: str, neuron: Neuron, arithmetic: Arithmetic) -> None:
    population = _population(neuron, 3)
    calculus = NumpyCalculus(arithmetic)
    shape = (2, 3, _LAYER.n_neurons)
    weak = np.random.default_rng(4).normal(0, 1, (60, *shape)) * np.asarray(population.to_threshold)
    if arithmetic == "integer":
        weak = np.rint(weak)
    drives = weak.astype(calculus.dtype)
    state, spikes = population.initial_state(shape, calculus), []
    alone = population.initial_state(shape[2:], calculus)
    for t, drive in enumerate(drives):
        step = pure(f"a step of {name}", population.step, state, drive, calculus)
        expect(
            step.spikes.shape == shape and step.potential.shape == shape,
            f"a step of {name} must keep the shape {shape}, got {step.spikes.shape}",
        )
        numbers = range(neuron.most_spikes + 1)
        expect(np.isin(step.spikes, numbers).all(), f"spikes of {name} must be 0 or {neuron.most_spikes}")
        expect(
            np.isfinite(np.asarray(step.potential, float)).all(),
            f"potentials of {name} must be finite, step {t}",
        )
        one = population.step(alone, drive[1, 2], calculus)
        expect(
            same(np.asarray(one.spikes), np.asarray(step.spikes[1, 2])),
            f"{name} must treat a sample alone as among others",
        )
        state, alone = step.state, one.state
        spikes.append(step.spikes)
    expect(np.sum(spikes) > 0, f"{name} must spike under a drive of the size of its threshold")
