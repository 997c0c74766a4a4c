"""Every definition on numpy and on torch: the same numbers, and gradients that are finite."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from dse.base import registry
from dse.engine.neurons import LayerSpec, parameters_of, population_of
from dse.engine.neurons.calculus import NumpyCalculus
from dse.engine.neurons.surrogate import exponential

N_NEURONS, N_SAMPLES, N_STEPS = 5, 3, 40
LAYER = LayerSpec(n_neurons=N_NEURONS, is_output=False, steps_per_sample=1, step_ms=2.0)


def adaptive():
    """Return the module of a user's neuron without registering it for good."""
    path = Path(__file__).parent.parent.parent / "plugins" / "adaptive.py"
    spec = importlib.util.spec_from_file_location("adaptive_for_calculi", path)
    assert spec and spec.loader
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    register, registry.register = registry.register, lambda section, name: lambda cls: cls
    try:
        spec.loader.exec_module(module)
    finally:
        registry.register = register
    return module


NEURONS = {name: cls() for name, cls in registry.known("neurons").items()}
NEURONS["adaptive, of a user"] = adaptive().Adaptive()


def drives(neuron):
    """Return (step, sample, neuron) input that makes neurons spike."""
    population = neuron.population(LAYER, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    return rng.normal(1.5, 4.0, (N_STEPS, N_SAMPLES, N_NEURONS)) * np.asarray(population.to_threshold)


@pytest.mark.parametrize("neuron", NEURONS.values(), ids=NEURONS)
def test_torch_gives_the_numbers_of_numpy_and_finite_gradients(torch, neuron):
    from dse.engine.autograd import TorchCalculus, on_torch

    population = neuron.population(LAYER, np.random.default_rng(0))
    surrogate = exponential(population.to_threshold, 0.03, 3.0)
    on_numpy, calculus = NumpyCalculus("ideal"), TorchCalculus("ideal", surrogate)
    tensors = on_torch(population, calculus)
    drive = torch.tensor(drives(neuron), requires_grad=True)
    shape = (N_SAMPLES, N_NEURONS)
    state, state_torch = population.initial_state(shape, on_numpy), tensors.initial_state(shape, calculus)
    total, n_spikes = torch.zeros(()), 0
    for z, z_torch in zip(drives(neuron), drive, strict=True):
        step, step_torch = population.step(state, z, on_numpy), tensors.step(state_torch, z_torch, calculus)
        np.testing.assert_allclose(step_torch.potential.detach(), step.potential, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(step_torch.spikes.detach(), step.spikes)
        state, state_torch = step.state, step_torch.state
        total, n_spikes = total + step_torch.spikes.sum(), n_spikes + int(step.spikes.sum())
    assert n_spikes > 10
    (gradient,) = torch.autograd.grad(total, drive)
    assert torch.isfinite(gradient).all() and (gradient[:-1] != 0).any(dim=(0, 1)).all()


@pytest.mark.parametrize("huge", [1e30, -1e30, 1e300])
@pytest.mark.parametrize("neuron", NEURONS.values(), ids=NEURONS)
def test_a_huge_input_leaves_no_state_undefined(neuron, huge):
    population = neuron.population(LAYER, np.random.default_rng(0))
    calculus = NumpyCalculus("ideal")
    state = population.initial_state((N_NEURONS,), calculus)
    for z in (huge, 0.0, -huge, 1.0):
        step = population.step(state, np.full(N_NEURONS, z), calculus)
        state = step.state
        assert not any(np.isnan(x).any() for x in (*state, step.potential, step.spikes))


@pytest.mark.parametrize("name", registry.known("neurons"))
def test_parameters_survive_by_name(name):
    population = NEURONS[name].population(LAYER, np.random.default_rng(0))
    parameters = parameters_of(population)
    again = population_of(name, parameters)
    assert {k: x.tolist() for k, x in parameters_of(again).items()} == {
        k: x.tolist() for k, x in parameters.items()
    }
    with pytest.raises(
        ValueError, match=rf"a layer of neuron '{name}' must have the parameters .*, got none"
    ):
        population_of(name, {})
    with pytest.raises(ValueError, match=r"neuron 'sigma_delta' is unknown, known are cuba_lif"):
        population_of("sigma_delta", parameters)
