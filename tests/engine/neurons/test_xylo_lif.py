"""Neurons of Xylo: hand-computed cases, the record of its simulator, and what bounds the states."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.engine.neurons import LayerSpec
from dse.engine.neurons.calculus import NumpyCalculus
from dse.engine.neurons.xylo_lif import HIGHEST, LOWEST, Population, XyloLif

GOLDEN = json.loads((Path(__file__).parents[2] / "golden" / "xylo.json").read_text())
INTEGER = NumpyCalculus("integer")


def one(current_shift, voltage_shift, threshold, weight_shift=0, most_spikes=1):
    return Population(
        np.array([current_shift]), np.array([voltage_shift]), threshold, weight_shift, most_spikes
    )


def run(population, z):
    """Return i, potential before reset and spikes after each step; z in 8-bit weight steps."""
    state, seen = population.initial_state((1,), INTEGER), []
    for drive in z:
        state, potential, spikes = population.step(state, np.array([drive / 32]), INTEGER)
        seen.append((int(state.i[0]), round(float(potential[0]) * population.per_weight), int(spikes[0])))
    return seen


def test_a_spike_decays_before_it_reaches_the_potential():
    # i: 100 -> 50 -> 25 -> 25 - 12 = 13; v: 50; 50 - 12 + 25 = 63 fires, 3 is left; 3 - 1 (least) + 13 = 15.
    assert run(one(1, 2, 60), [100, 0, 0]) == [(50, 50, 0), (25, 63, 1), (13, 15, 0)]


def test_shifts_of_negative_states_round_down_and_every_state_ends_at_0():
    # -25 >> 1 = -13 leaves -12; -3 >> 1 = -2 leaves -1; -1 >> 1 = -1 leaves 0.
    assert [i for i, _, _ in run(one(1, 2, 60), [-100, 0, 0, 0, 0, 0, 0])] == [-50, -25, -12, -6, -3, -1, 0]
    # 15 bits shift any positive state to 0: it loses 1 a step.
    assert [v for _, v, _ in run(one(1, 15, 60), [2, 0, 0, 0])] == [1, 0, 0, 0]


def test_equality_fires_and_what_is_left_of_an_output_fires_again():
    assert run(one(1, 15, 60), [120, -60, 0]) == [(60, 60, 1), (0, 0, 0), (0, 0, 0)]
    # 63 fires and leaves 33, less 1, which fires and leaves 2.
    assert run(one(1, 15, 30), [126, -63, 0]) == [(63, 63, 1), (0, 32, 1), (0, 1, 0)]


def test_a_hidden_neuron_spikes_as_often_as_it_reaches_its_threshold():
    # 124 >> 1: 62 reaches 20 three times and leaves 2; 2 - 1 + 31 reaches it once.
    assert run(one(1, 15, 20, most_spikes=31), [124, 0]) == [(62, 62, 3), (31, 32, 1)]
    assert [s for _, _, s in run(one(1, 15, 1, most_spikes=31), [126, 0])] == [31, 31]


def test_states_saturate_at_16_bits():
    assert run(one(15, 0, HIGHEST), [127 * 256, 127 * 256])[-1][0] == HIGHEST - 1
    assert run(one(15, 15, HIGHEST), [-128 * 256] * 3)[-1][:2] == (LOWEST + 1, LOWEST)


@pytest.mark.parametrize("case", GOLDEN, ids=range(len(GOLDEN)))
def test_it_is_the_vendors_simulator(case):
    spikes = np.array(case["spikes"])
    before = np.concatenate([np.zeros((1, spikes.shape[1])), spikes[:-1]])
    drives = {
        "": np.array(case["input"]) @ case["weights_in"] + before @ case["weights_rec"],
        "output_": before @ case["weights_out"],
    }
    assert spikes.any() and np.any(case["output_spikes"])
    for layer, drive in drives.items():
        population = Population(
            np.array(case[f"{layer}current_shift"]),
            np.array(case[f"{layer}voltage_shift"]),
            case[f"{layer}threshold"],
            case[f"{layer}weight_shift"],
            1 if layer else 31,
        )
        state = population.initial_state((drive.shape[1],), INTEGER)
        for t, z in enumerate(drive):
            state, _, fired = population.step(state, z / 32, INTEGER)
            assert fired.tolist() == case[f"{layer}spikes"][t]
            assert state.i.tolist() == [row[t] for row in case[f"{layer}state_i"]]
            assert state.v.tolist() == [row[t] for row in case[f"{layer}state_v"]]


@given(threshold=st.floats(1 / 8, 32))
def test_states_have_room_for_32_thresholds(threshold):
    layer = LayerSpec(n_neurons=1, is_output=False, steps_per_sample=1, step_ms=1.0)
    population = XyloLif(threshold=threshold).population(layer, np.random.default_rng(0))
    assert 2**9 - 1 < population.threshold <= 2**10
    assert population.to_threshold == pytest.approx(threshold, rel=2**-9)
    assert LOWEST <= -128 << population.weight_shift
    assert population.most_spikes == 31


def test_an_output_spikes_once_in_a_step():
    layer = LayerSpec(n_neurons=2, is_output=True, steps_per_sample=1, step_ms=1.0)
    population = XyloLif(threshold=4.0).population(layer, np.random.default_rng(0))
    assert (population.threshold, population.weight_shift, population.most_spikes) == (1024, 3, 1)
    assert population.current_shift.tolist() == [3, 3]


def test_neurons_differ_between_two_bounds():
    layer = LayerSpec(n_neurons=200, is_output=False, steps_per_sample=1, step_ms=1.0)
    population = XyloLif(voltage_shift=(2, 4)).population(layer, np.random.default_rng(0))
    assert set(population.voltage_shift.tolist()) == {2, 3, 4}


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"current_shift": (3, 1)}, r"current_shift must have bounds in increasing order, got \[3, 1\]"),
        ({"voltage_shift": (1, 2, 3)}, "voltage_shift must be one shift or two bounds, got 3 numbers"),
    ],
)
def test_wrong_bounds_are_refused(keys, message):
    with pytest.raises(ValueError, match=message):
        XyloLif(**keys)
