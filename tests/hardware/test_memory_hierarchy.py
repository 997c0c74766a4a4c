import dataclasses

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from dse.config.faults import ConfigError
from dse.hardware.cost import cost, drawn
from dse.hardware.kinds.memory_hierarchy import MemoryHierarchy, as_lists
from dse.hardware.profile import load
from tests.hardware.loads import network, operations

PROFILE = load("asic45_memory")
MEMORY = ("weight_memory", "state_memory")


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


def test_memory_dominates():
    for each in (
        network((24, 50, 7), [46, 100, 10]),
        network((1600, 450, 11), [3190, 896, 0]),
        operations(264_192, n_weights=264_192),
        operations(5000, 200, n_weights=5000, number_bits=32),
    ):
        found = picojoules(cost(PROFILE, each))
        memory = sum(found.get(cause, 0.0) for cause in MEMORY)
        assert memory > 0.8 * sum(found.values())


@pytest.mark.parametrize(
    ("n_bytes", "access_pj"),
    [
        (0, 10),
        (8192, 10),
        (8193, 20),
        (32_768, 20),
        (32_769, 100),
        (1_048_576, 100),
        (1_048_577, 1300),
    ],
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


@given(
    st.tuples(*[st.integers(1, 500)] * 3),
    st.tuples(st.floats(0, 1), st.floats(0, 1)),
    st.integers(1, 16),
)
def test_lists_are_stored_where_they_take_less(sizes, shares, bits):
    dense = network(sizes, [0, 0, 0])
    stored = tuple(int(share * n) for share, n in zip(shares, dense.dense, strict=True))
    pruned = dataclasses.replace(dense, synapses=(0.0, 0.0, 0.0), stored=stored)
    as_list, as_matrix = sum(stored) * (bits + 16), sum(dense.dense) * bits
    assert as_lists(pruned, bits) == (as_list < as_matrix)
    assert not as_lists(dense, bits)


def test_nothing_costs_nothing():
    for each in (
        operations(0),
        network((24, 50, 7), [0, 0, 0], n_steps=0),
        network((24, 50, 7), [0, 0, 0], [0, 0]),
        network((24, 50, 7), [0, 0, 0], [0, 0], synapses=(0.0, 0.0, 0.0), stored=(0, 0)),
    ):
        found = cost(PROFILE, each)
        assert found.energy_uj.value == found.energy_uj.high == found.energy_throttled_uj.high == 0


def test_leading_axes_are_design_points_in_the_memory_of_the_largest():
    found = cost(PROFILE, operations([1, 2], [0, 0], [0, 0], [10, 9000], [0, 0]))
    assert found.breakdown["weight_memory"] * 1e6 == pytest.approx([5, 10])
    rng = np.random.default_rng(0)
    spikes, n_steps = rng.uniform(0, 5000, (3, 2, 3)), rng.uniform(1, 200, (3, 2))
    together = cost(PROFILE, network((24, 50, 7), spikes, None, n_steps))
    for at in np.ndindex(3, 2):
        alone = cost(PROFILE, network((24, 50, 7), spikes[at], None, n_steps[at]))
        assert together.energy_uj.value[at] == pytest.approx(float(alone.energy_uj.value))


def test_draws_stay_within_the_range():
    figures = PROFILE.drawn(200, np.random.default_rng(0))
    for each in (operations(5000, 200, 30, 5000), network((24, 50, 7), [46, 100, 10])):
        energy_uj, found = drawn(PROFILE, each, figures).energy_uj, cost(PROFILE, each)
        assert energy_uj.shape == (200,) and np.ptp(energy_uj) > 0
        assert (energy_uj >= found.energy_uj.low).all() and (energy_uj <= found.energy_uj.high).all()


def ordered(before, after):
    assert after.energy_uj.low <= after.energy_uj.value <= after.energy_uj.high
    for dearer, cheaper in zip(after.energy_uj, before.energy_uj, strict=True):
        assert dearer >= cheaper * (1 - 1e-12)
    assert sum(after.breakdown.values()) == pytest.approx(float(after.energy_uj.value))


@given(
    st.tuples(*[st.integers(1, 3000)] * 3),
    st.tuples(st.booleans(), st.booleans()),
    st.tuples(*[st.floats(0, 1e5)] * 3),
    st.integers(0, 2),
    st.floats(0, 1e5),
    st.integers(0, 500),
)
def test_more_spikes_steps_and_neurons_never_cost_less(sizes, recurrent, spikes, layer, more, wider):
    before = cost(PROFILE, network(sizes, spikes, recurrent=recurrent))
    spikes, sizes = np.array(spikes), list(sizes)
    spikes[layer] += more
    sizes[layer] += wider
    ordered(before, cost(PROFILE, network(sizes, spikes, n_steps=101.0, recurrent=recurrent)))


@given(
    st.lists(st.floats(0, 1e7), min_size=4, max_size=4),
    st.lists(st.floats(0, 1e7), min_size=4, max_size=4),
    st.sampled_from([4, 8, 32]),
)
def test_more_operations_and_weights_never_cost_less(counts, more, bits):
    before = cost(PROFILE, operations(*counts, number_bits=bits))
    ordered(before, cost(PROFILE, operations(*np.add(counts, more), number_bits=bits)))


def test_every_number_says_what_it_is():
    assert isinstance(PROFILE, MemoryHierarchy)
    evidence = {name: getattr(PROFILE, name).evidence for name in PROFILE.numbers()}
    assert evidence.pop("fetched_per_used") == "assumption"
    assert set(evidence.values()) == {"second-hand"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["dram_pj"].update(unit="nJ"), "dram_pj.unit must be 'pJ', got 'nJ'"),
        (lambda d: d["fetched_per_used"].update(low=3), "fetched_per_used must be 0 <= low <= value"),
        (lambda d: d.pop("update_pj"), "update_pj is required"),
    ],
)
def test_a_wrong_number_is_named(tmp_path, change, message):
    data = yaml.safe_load(PROFILE.text) | {"name": "mine"}
    change(data)
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(data, sort_keys=False))
    with pytest.raises(ConfigError, match=message):
        load(file)
