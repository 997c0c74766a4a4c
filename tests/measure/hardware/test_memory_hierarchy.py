import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.measure.hardware.cost import cost
from dse.measure.hardware.kinds.memory_hierarchy import as_lists
from dse.measure.hardware.profile import load
from tests.measure.hardware.loads import network, operations

PROFILE = load("asic45_memory")


def picojoules(found):
    return {cause: float(x) * 1e6 for cause, x in found.breakdown.items() if x}


def test_a_spiking_network_by_hand():
    # 24-50-7: 1550 weights of 1 byte and 57 x 2 states of 4 bytes, each in 8 KiB of 10 pJ per 64 bits.
    # 46 x 50 + 100 x 7 = 3000 events: 0.03 pJ, a quarter of an access for the weight, two for the state.
    # 57 x 100 updates: 6.4 pJ, four accesses for two states.
    found = cost(PROFILE, network((24, 50, 7), [46, 100, 10]))
    assert picojoules(found) == pytest.approx(
        {
            "addition": 3000 * 0.03,
            "neuron_update": 5700 * 6.4,
            "weight_memory": 3000 * 2.5,
            "state_memory": 3000 * 20 + 5700 * 40,
        }
    )
    assert found.energy_uj.value == pytest.approx(0.33207)
    # Low: all that a word holds is used, 8 weights or 2 states. High: every value is an access.
    assert found.energy_uj.low == pytest.approx((3000 * (0.03 + 1.25 + 10) + 5700 * (0.46 + 20)) * 1e-6)
    assert found.energy_uj.high == pytest.approx((3000 * (0.1 + 10 + 20) + 5700 * (9.2 + 40)) * 1e-6)
    assert not found.timed and found.fits and found.n_cores.value == 0
    assert found.hardware_latency_ms == found.idle_mw == found.static_throttled_uj.value == 0


def test_an_integer_network_without_spikes_by_hand():
    # 264192 weights of 1 byte: 1 MiB of 100 pJ, a quarter of an access each, and 0.23 pJ.
    found = cost(PROFILE, operations(264_192, n_weights=264_192))
    assert picojoules(found) == pytest.approx({"mac": 264_192 * 0.23, "weight_memory": 264_192 * 25})
    assert found.energy_uj.value == pytest.approx(6.66556416)


def test_a_classifier_measured_in_float_by_hand():
    # 5000 numbers of 4 bytes: 32 KiB of 20 pJ, one access each, and 4.6 pJ; 200 spikes counted: 0.03 pJ, and
    # a counter read and written in 8 KiB.
    found = cost(PROFILE, operations(5000, 200, n_weights=5000, number_bits=32))
    assert picojoules(found) == pytest.approx(
        {"mac": 23_000, "weight_memory": 100_000, "addition": 6, "state_memory": 200 * 20}
    )


def test_of_what_has_state_updates_additions_are_of_weights():
    one = cost(PROFILE, operations(0, 3000, 5700, n_weights=1550))
    other = cost(PROFILE, network((24, 50, 7), [46, 100, 10]))
    assert picojoules(one) == pytest.approx(picojoules(other))


@pytest.mark.parametrize(
    ("n_bytes", "access_pj"),
    [(0, 10), (8192, 10), (8193, 20), (32_768, 20), (32_769, 100), (1_048_576, 100), (1_048_577, 1300)],
)
def test_the_smallest_memory_that_holds_all(n_bytes, access_pj):
    found = cost(PROFILE, operations(1, n_weights=n_bytes))
    assert picojoules(found)["weight_memory"] == pytest.approx(access_pj / 4)
    # 4 bits each: twice as many in the same memory, for half of the energy.
    half = cost(PROFILE, operations(1, n_weights=2 * n_bytes, number_bits=4))
    assert picojoules(half)["weight_memory"] == pytest.approx(access_pj / 8)


def test_states_have_a_memory_of_their_own():
    # 1024 neurons of 8 bytes fill 8 KiB; one more needs 32 KiB of 20 pJ.
    small = cost(PROFILE, network((1, 1024), [0, 0], [10.0]))
    large = cost(PROFILE, network((1, 1025), [0, 0], [10.0]))
    assert picojoules(small)["state_memory"] == pytest.approx(10 * 4 * 10)
    assert picojoules(large)["state_memory"] == pytest.approx(10 * 4 * 20)


def test_quiet_neurons_are_left_alone():
    found = cost(PROFILE, network((24, 50, 7), [46, 100, 10], [1000, 60]))
    assert picojoules(found)["neuron_update"] == pytest.approx(1060 * 6.4)


def test_delays_are_fetched_with_the_weight_and_need_states():
    # 14 bits are 28 / 64 of an access; 57 neurons x (2 + 64) states of 4 bytes need 32 KiB of 20 pJ.
    found = cost(PROFILE, network((24, 50, 7), [46, 100, 10], delay_bits=6))
    assert picojoules(found) == pytest.approx(
        {
            "addition": 90,
            "neuron_update": 5700 * 6.4,
            "weight_memory": 3000 * 10 * 28 / 64,
            "state_memory": 3000 * 40 + 5700 * 80,
        }
    )


def test_weights_that_are_zero_are_skipped_where_lists_are_smaller():
    sizes, spikes = (24, 50, 7), [46, 100, 10]
    few = network(sizes, spikes, synapses=(10.0, 1.5, 0.0), stored=(240, 75))
    assert as_lists(few, 8)
    # 8 bits and an index of 16: 48 / 64 of an access.
    found = picojoules(cost(PROFILE, few))
    assert found["addition"] == pytest.approx(610 * 0.03)
    assert found["weight_memory"] == pytest.approx(610 * 7.5)
    many = network(sizes, spikes, synapses=(30.0, 5.0, 0.0), stored=(800, 200))
    assert not as_lists(many, 8)
    assert picojoules(cost(PROFILE, many)) == picojoules(cost(PROFILE, network(sizes, spikes)))


@given(st.tuples(*[st.integers(1, 500)] * 3), st.tuples(st.floats(0, 1), st.floats(0, 1)), st.integers(1, 16))
def test_lists_are_stored_where_they_take_less(sizes, shares, bits):
    dense = network(sizes, [0, 0, 0])
    stored = tuple(int(share * n) for share, n in zip(shares, dense.dense, strict=True))
    pruned = dataclasses.replace(dense, synapses=(0.0, 0.0, 0.0), stored=stored)
    as_list, as_matrix = sum(stored) * (bits + 16), sum(dense.dense) * bits
    assert as_lists(pruned, bits) == (as_list < as_matrix)
    assert not as_lists(dense, bits)


def test_design_points_together_lie_in_the_memory_of_the_largest():
    found = cost(PROFILE, operations([1, 2], [0, 0], [0, 0], [10, 9000], [0, 0]))
    assert found.breakdown["weight_memory"] * 1e6 == pytest.approx([5, 10])
