import dataclasses
from functools import partial

import pytest

from dse.measure.hardware.cost import cost
from dse.measure.hardware.profile import load
from tests.measure.hardware import loads

network, silent = partial(loads.network, n_steps=1.0), partial(loads.silent, n_steps=1.0)

XYLO = load("xylo_imu")


def cycles(load):
    """Cycles per inference: the time at 50 MHz."""
    return float(cost(XYLO, load).hardware_latency_ms) * 50e3


def rules(load):
    return {misfit.rule: misfit.change for misfit in cost(XYLO, load).misfits}


def test_the_example_of_the_reference():
    # 16-50-7, 2 % of inputs and 10 % of hidden neurons spike in a step:
    # 16 (1 + 3.5 x 0.02 x 50) = 72; 50 (22 + 3 x 0.1) = 1115; 50 x 0.1 (1 + 8 x 7) = 285; 12 x 7 = 84.
    found = cost(XYLO, network((16, 50, 7), [0.32, 5, 0]))
    assert found.hardware_latency_ms * 50e3 == pytest.approx(72 + 1115 + 285 + 84)
    assert found.step_time_us.value == pytest.approx(31.12)  # 1556 cycles of 20 ns
    # 1556 cycles x 20 ns x 13 uW = 404.56 pJ; static 188 + 333 uW for 31.12 us, or for the step of 1 ms.
    assert found.dynamic_uj == pytest.approx(404.56e-6)
    assert found.static_uj.value == pytest.approx(521e-6 * 31.12)
    assert found.static_throttled_uj.value == pytest.approx(0.521)
    assert {cause: float(x) for cause, x in found.breakdown.items()} == pytest.approx(
        {
            "input": 72 * 260e-9,
            "neuron": 1100 * 260e-9,
            "spike": 15 * 260e-9,
            "synapse": 0.0,
            "output": (285 + 84) * 260e-9,
        }
    )
    assert (found.n_cores.value, found.fits, found.idle_mw) == (1, True, pytest.approx(0.521))
    # Everything spikes: 16 (1 + 175) + 50 x 25 + 50 x 57 + 84 = 7000 cycles, x 1.2 per ms = 8.4 MHz.
    assert XYLO.worst_clock_mhz(network((16, 50, 7), [0, 0, 0])) == pytest.approx(8.4)


def test_between_steps_the_inputs_may_be_off():
    found = cost(XYLO, silent((16, 50, 7)))  # 16 + 1100 + 84 = 1200 cycles = 24 us
    # Low: 0.7 x (188 + 333) uW and 9.1 uW for 24 us, then the core alone, 131.6 uW, for 976 us.
    assert found.energy_throttled_uj.low == pytest.approx((364.7 + 9.1) * 24e-6 + 131.6 * 976e-6)
    # High: 1.3 x 521 uW for 1 ms, and 193 uW for 24 us.
    assert found.energy_throttled_uj.high == pytest.approx(677.3e-3 + 193 * 24e-6)


def test_recurrence_costs_every_hidden_neuron_of_every_spike():
    # 7 x 50 cycles more for each of 5 spikes.
    feedforward, recurrent = (
        cycles(network((16, 50, 7), [0.32, 5, 0], recurrent=(back, False))) for back in (False, True)
    )
    assert recurrent - feedforward == pytest.approx(7 * 50 * 5)


def test_hidden_layers_share_the_hidden_neurons():
    # 16-30-20-7, 4 spikes each: 16 + 3.5 x 4 x 30, 22 x 50, 3 x 8, 7 x 20 x 4, 4 (1 + 56), 84.
    found = cycles(network((16, 30, 20, 7), [4, 4, 4, 4]))
    assert found == pytest.approx(16 + 420 + 1100 + 24 + 560 + 228 + 84)


def test_zeros_between_hidden_neurons_cost_nothing():
    dense = network((16, 50, 7), [10, 8, 0], recurrent=(True, False))
    half = dataclasses.replace(dense, synapses=(50, 28.5, 0))  # of 57 synapses of a hidden spike
    assert cycles(dense) - cycles(half) == pytest.approx(7 * 25 * 8)


def test_one_neuron_and_no_steps():
    # 1-1-1: 1 + 22 + 12 cycles a step; an input spike 3.5; a hidden spike 3 + 1 + 8.
    assert cycles(silent((1, 1, 1))) == pytest.approx(35)
    assert cycles(network((1, 1, 1), [1, 1, 1])) == pytest.approx(35 + 3.5 + 12)
    nothing = cost(XYLO, silent((16, 50, 7), n_steps=0.0))
    assert nothing.energy_uj.value == nothing.energy_throttled_uj.value == nothing.hardware_latency_ms == 0


@pytest.mark.parametrize(
    ("rule", "broken", "least", "change"),
    [
        ("inputs", (17, 50, 7), (16, 50, 7), "16 inputs"),
        ("outputs", (16, 50, 17), (16, 50, 16), "16 outputs"),
        ("hidden_neurons", (8, 1, 248, 248, 7), (8, 1, 248, 247, 7), "496 hidden neurons"),
        ("neurons_with_input", (16, 129, 7, 7), (16, 128, 7, 7), "128 neurons in the first layer"),
        ("neurons_with_output", (16, 7, 129, 7), (16, 7, 128, 7), "128 neurons in the last hidden layer"),
        ("layers", (16, 7), (16, 1, 7), "a hidden layer"),
        ("fan_out", (16, 1, 513, 1, 7), (16, 1, 512, 1, 7), "512 hidden neurons per spike"),
        # 129 weights per neuron of the second layer: 247 x 129 = 31863, 246 x 129 = 31734.
        (
            "hidden_weights",
            (16, 128, 247, 1, 7),
            (16, 128, 246, 1, 7),
            "31744 weights between hidden neurons",
        ),
    ],
)
def test_the_change_that_is_named_is_the_smallest(rule, broken, least, change):
    assert rules(silent(broken))[rule] == change
    assert rule not in rules(silent(least))


def test_what_is_no_size_can_be_changed_too():
    assert rules(silent((16, 50, 7), weight_bits=9)) == {"weight_bits": "8 bits per weight"}
    assert rules(silent((16, 50, 7), delay_bits=3)) == {"delays": "synapses without individual delays"}
    back = silent((16, 50, 7), recurrent=(True, True))
    assert rules(back) == {"recurrent_outputs": "an output layer without recurrence"}
    assert rules(silent((16, 50, 7), recurrent=(True, False))) == {}


def test_pruning_makes_hidden_weights_fit():
    dense = silent((16, 128, 250, 1, 7))
    assert "hidden_weights" in rules(dense)
    stored = (*dense.dense[:1], dense.dense[1] // 2, *dense.dense[2:])
    assert "hidden_weights" not in rules(dataclasses.replace(dense, stored=stored))


def test_a_step_that_is_too_short_for_the_clock():
    # Everything spikes in 16-128-16, recurrent: 16 (1 + 448) + 128 x 25 + 7 x 128 x 128 + 128 x 129 + 192
    # = 141776 cycles, x 1.2 = 170131.2: 250 MHz are enough for steps of 0.6805248 ms and longer.
    made = {"recurrent": (True, False), "sizes": (16, 128, 16)}
    assert rules(silent(step_ms=0.5, **made)) == {"maximum_clock_mhz": "steps of 0.681 ms"}
    assert rules(silent(step_ms=0.681, **made)) == {}
    assert "maximum_clock_mhz" in rules(silent(step_ms=0.680, **made))
