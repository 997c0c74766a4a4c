"""The definition of the CUBA-LIF neuron against golden vectors and by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.engine.neurons import cuba_lif, fixed_point
from dse.engine.neurons.calculus import NumpyCalculus
from dse.engine.neurons.surrogate import exponential
from tests.golden import cases


@pytest.mark.parametrize("case", cases())
def test_states_spikes_and_gradients_are_golden(case):
    given_params = case.settings["params"]
    population = cuba_lif.rounded(
        given_params["current_decay"], given_params["voltage_decay"], given_params["threshold"]
    )
    surrogate = exponential(population.to_threshold, given_params["tau_grad"], given_params["scale_grad"])
    shifts = case.settings["delay_shift"]
    spikes = case.given("x").astype(np.float64)
    inputs, used, voltages = [], [], []
    for layer in range(1, case.n_layers + 1):
        weight = case.given(f"w{layer}")
        weight = (fixed_point.quantise(weight) if case.mode == "quant" else weight).astype(np.float64)
        if case.mode == "quant":
            np.testing.assert_array_equal(64 * weight, case.expected(f"w{layer}_int"))
        current, voltage, fired = cuba_lif.run(
            spikes @ weight.T, population, "integer" if case.integer else "ideal"
        )
        np.testing.assert_array_equal(current, case.state("cur", layer))
        np.testing.assert_array_equal(voltage, case.state("vol", layer))
        np.testing.assert_array_equal(fired, case.expected(f"spk{layer}"))
        inputs.append(spikes)
        used.append(weight)
        voltages.append(voltage)
        spikes = (cuba_lif.shift(fired) if shifts else fired).astype(np.float64)
    np.testing.assert_array_equal(spikes, case.expected("out"))

    labels, n_steps = case.given("labels"), spikes.shape[1]
    target = np.full(spikes.shape[::2], case.settings["false_rate"])
    target[np.arange(len(labels)), labels] = case.settings["true_rate"]
    error = spikes.mean(axis=1) - target
    assert (error**2).sum() == pytest.approx(float(case.expected("loss")), rel=1e-6, abs=1e-12)
    grad = np.repeat((2 / n_steps * error)[:, None], n_steps, axis=1)
    for layer in range(case.n_layers, 0, -1):
        if shifts:
            grad = np.concatenate([grad[:, 1:], np.zeros_like(grad[:, :1])], axis=1)
        grad = cuba_lif.backward(grad, surrogate(voltages[layer - 1] - population.to_threshold), population)
        by_weight = np.einsum("nto,ntc->oc", grad, inputs[layer - 1])
        if case.mode == "quant":
            by_weight = by_weight * fixed_point.quantise_passes(case.given(f"w{layer}"))
        golden = case.expected(f"grad_w{layer}")
        np.testing.assert_allclose(by_weight, golden, rtol=0, atol=1e-5 * max(np.abs(golden).max(), 1e-30))
        grad = grad @ used[layer - 1]


def test_equality_with_the_threshold_does_not_fire():
    population = cuba_lif.rounded(0.0, 1.0, 1.25)
    _, voltage, fired = cuba_lif.run(np.array([[[1.25, 1.25 + 1 / 4096]]]), population, "integer")
    np.testing.assert_array_equal(voltage[0, 0], [1.25, 1.25 + 1 / 4096])
    np.testing.assert_array_equal(fired[0, 0], [False, True])


def test_integer_leak_truncates_towards_zero_on_both_sides():
    x = np.array([5, -5, 4096, -4096, 0])
    leaked = cuba_lif.leak(x, np.int32(1024), NumpyCalculus("integer"))
    np.testing.assert_array_equal(leaked, [3, -3, 3072, -3072, 0])


def test_a_spike_resets_the_potential_and_not_the_current():
    population = cuba_lif.rounded(0.5, 0.0, 1.0)
    current, voltage, fired = cuba_lif.run(np.array([[[2.0], [0.0], [0.0]]]), population, "ideal")
    np.testing.assert_array_equal(current[0, :, 0], [2.0, 1.0, 0.5])
    np.testing.assert_array_equal(voltage[0, :, 0], [2.0, 1.0, 1.5])
    np.testing.assert_array_equal(fired[0, :, 0], [True, False, True])


@pytest.mark.parametrize("bad", [(-0.1, 0.0, 1.0), (0.0, 1.1, 1.0), (0.0, 0.0, 0.001)])
def test_parameters_out_of_range_are_refused(bad):
    with pytest.raises(ValueError, match=r"must be"):
        cuba_lif.rounded(*bad)


@given(st.lists(st.floats(-6, 6, width=32), min_size=1, max_size=20))
def test_quantised_weights_lie_on_the_8_bit_grid_and_stay_put(values):
    rounded = fixed_point.quantise(np.array(values))
    integers = 64 * rounded
    assert np.all(integers % 2 == 0) and integers.min() >= -256 and integers.max() <= 254
    np.testing.assert_array_equal(fixed_point.quantise(rounded), rounded)
    inside = np.abs(values) < 3.9
    assert np.all(np.abs(rounded - np.array(values))[inside] <= 1 / 64 + 1e-6)
