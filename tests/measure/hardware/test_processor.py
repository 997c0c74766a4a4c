import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from dse.measure.hardware.cost import cost
from dse.measure.hardware.profile import load, read
from tests.measure.hardware.loads import network, operations

M4, M33, M7 = PARTS = tuple(load(name) for name in ("mcu_m4", "mcu_m33", "mcu_m7"))
EACH = pytest.mark.parametrize("profile", PARTS, ids=lambda profile: profile.name)


@pytest.mark.parametrize(
    ("profile", "energy_uj", "latency_ms", "mac_nj", "mac_cycles", "clock_mhz"),
    [
        (M4, 323.0, 7.57, 1.22, 3.44, 120),
        (M33, 119.1, 4.82, 0.45, 2.92, 160),
        (M7, 266.5, 1.82, 1.01, 1.93, 280),
    ],
    ids=lambda x: getattr(x, "name", None),
)
def test_the_published_autoencoder(profile, energy_uj, latency_ms, mac_nj, mac_cycles, clock_mhz):
    sizes = [640, *[128] * 4, 8, *[128] * 4, 640]
    macs = sum(a * b for a, b in pairwise(sizes))
    assert macs == 264_192
    found = cost(profile, operations(macs, n_weights=macs))
    # MLPerf Tiny v1.0, and what is printed per multiply-accumulate, to its last digit.
    assert found.energy_uj.value == pytest.approx(energy_uj, rel=1e-4)
    assert found.hardware_latency_ms == pytest.approx(latency_ms, rel=1e-4)
    assert found.energy_uj.value * 1e3 / macs == pytest.approx(mac_nj, abs=0.005)
    assert found.step_time_us.value * clock_mhz / macs == pytest.approx(mac_cycles, abs=0.005)
    # Spread over software: 1.5 in energy, 1.25 in time; the same part takes 443.2 uJ and 8.61 ms with other.
    assert found.energy_uj.high == pytest.approx(1.5 * energy_uj, rel=1e-3)
    assert found.energy_uj.low == pytest.approx(energy_uj / 1.5, rel=1e-3)
    assert found.step_time_us.high == pytest.approx(1.25e3 * latency_ms, rel=1e-3)
    assert found.fits and found.n_cores.value == 1


def test_other_software_on_the_same_part_lies_within_the_range():
    found = cost(M4, operations(264_192))
    assert found.energy_uj.low < 443.2 < found.energy_uj.high
    assert found.step_time_us.low < 8.61e3 < found.step_time_us.high


def cycles_of(profile, **work):
    """Return the cycles of some work: keyword arguments without `_cycles`."""
    figures = profile.at("value")
    return figures["wait_factor"] * sum(figures[f"{name}_cycles"] * n for name, n in work.items())


# 24-50-7 in 100 steps with 46, 100 and 10 spikes, updates of all neurons in all steps. 46 x 50 + 100 x 7 =
# 3000 weights; rows of 50 weights have a loop, rows of 7 have none.
BY_HAND = {
    "step": 100,
    "layer": 200,
    "neuron": 5700,
    "update": 5000,
    "output": 700,
    "spike": 146,
    "output_spike": 10,
    "row": 46,
    "synapse": 3000,
}


# Energy of a cycle, time to wake up, sleep, clock, and cycles of a multiply-accumulate in float.
FIGURES = pytest.mark.parametrize(
    ("profile", "cycle_nj", "wake_us", "sleep_mw", "clock_mhz", "mac_cycles"),
    [
        (M4, 0.35557, 5.0, 0.010, 120, 9.0),
        (M33, 0.15443, 20.5, 0.0295, 160, 9.0),
        (M7, 0.52296, 20.0, 0.106, 280, 5.0),
    ],
    ids=lambda x: getattr(x, "name", None),
)


@FIGURES
def test_a_spiking_network_by_hand(profile, cycle_nj, wake_us, sleep_mw, clock_mhz, mac_cycles):
    found = cost(profile, network((24, 50, 7), [46, 100, 10]))
    cycles = cycles_of(profile, **BY_HAND)
    assert profile is not M4 or cycles == pytest.approx(275067.6)
    energy_uj, busy_ms = cycles * cycle_nj * 1e-3, cycles / clock_mhz * 1e-3
    assert found.energy_uj.value == pytest.approx(energy_uj)
    assert found.hardware_latency_ms == pytest.approx(busy_ms)
    assert found.step_time_us.value == pytest.approx(busy_ms * 10)
    assert sum(found.breakdown.values()) == pytest.approx(energy_uj)
    # Asleep until the next step of 1 ms, which it wakes for at running power.
    idle_mw = sleep_mw + cycle_nj * clock_mhz * wake_us / 1e3
    assert found.idle_mw == pytest.approx(idle_mw)
    assert found.energy_throttled_uj.value == pytest.approx(energy_uj + idle_mw * (100 - busy_ms))
    assert "the processor wakes once per step" in found.assumptions


@FIGURES
def test_a_classifier_measured_in_float_by_hand(profile, cycle_nj, wake_us, sleep_mw, clock_mhz, mac_cycles):
    # 5000 float multiply-accumulates and 200 spikes that are counted, of 300 ms of input.
    found = cost(profile, operations(5000, 200, n_weights=5000, duration_ms=300.0, number_bits=32))
    addition = cycles_of(profile, synapse=1)
    cycles = 5000 * mac_cycles + 200 * addition
    assert found.energy_uj.value == pytest.approx(cycles * cycle_nj * 1e-3)
    busy_ms = cycles / clock_mhz * 1e-3
    assert found.hardware_latency_ms == pytest.approx(busy_ms)
    asleep_uj = sleep_mw * (300 - busy_ms)
    assert found.energy_throttled_uj.value == pytest.approx(found.energy_uj.value + asleep_uj)
    assert "the processor sleeps until all input has arrived" in found.assumptions


PROGRAM = {"tally_start": 1.0, "tally_step": 100.0, "tally_spike": 200.0, "neighbour": 5000.0, "sample": 50.0}


@EACH
def test_a_program_that_counts_spikes_by_hand(profile):
    # 100 steps of 3 ms; what is known of the program counts, not the multiply-accumulates.
    load = dataclasses.replace(operations(5000, 200, duration_ms=300.0), program=_each(PROGRAM))
    found = cost(profile, load)
    cycles = cycles_of(profile, **PROGRAM)
    assert found.hardware_latency_ms * profile.cycles_per_ms == pytest.approx(cycles)
    assert found.energy_uj.value == pytest.approx(cycles * profile.cycle_nj.value * 1e-3)
    counting = cycles_of(profile, tally_start=1, tally_step=100, tally_spike=200)
    assert found.breakdown["addition"] == pytest.approx(counting * cycle_uj(profile))
    waking = profile.cycle_nj.value * profile.clock_mhz.value * profile.wake_us.value * 1e-3 / 3.0
    assert found.idle_mw == pytest.approx(profile.sleep_uw.value * 1e-3 + waking)
    assert "the processor wakes once per step" in found.assumptions


def test_a_profile_without_cycles_of_programs_prices_multiply_accumulates():
    text = "".join(line for line in M4.text.splitlines(True) if not line.startswith(("sample", "tally")))
    older = read(text.replace("name: mcu_m4", "name: older"), "older.yaml")
    assert older.sample_cycles is None and "sample_cycles" not in older.ends
    plain = operations(5000, 200, duration_ms=300.0)
    known = dataclasses.replace(plain, program=_each(PROGRAM))
    assert cost(older, known).energy_uj.value == cost(older, plain).energy_uj.value
    assert cost(M4, known).energy_uj.value != cost(M4, plain).energy_uj.value
    spiking = network((24, 50, 7), [46, 100, 10])
    assert cost(older, spiking).energy_uj == cost(M4, spiking).energy_uj


def _each(work):
    return {kind: np.asarray(n) for kind, n in work.items()}


def cycle_uj(profile):
    """Return the energy of a cycle of the program."""
    return profile.wait_factor.value * profile.cycle_nj.value * 1e-3


def test_state_updates_of_operations_cost_what_those_of_hidden_neurons_do():
    found = cost(M4, operations(0, 3000, 5700))
    each = M4.neuron_cycles.value + M4.update_cycles.value
    assert found.breakdown["neuron_update"] == pytest.approx(5700 * each * cycle_uj(M4))
    assert found.breakdown["addition"] == pytest.approx(3000 * M4.synapse_cycles.value * cycle_uj(M4))


def test_neurons_at_rest_are_looked_at_and_not_updated():
    every = network((24, 50, 7), [46, 100, 10])
    counted = dataclasses.replace(every, updates=np.array([3000.0, 100.0]))
    saved = cost(M4, every).energy_uj.value - cost(M4, counted).energy_uj.value
    assert saved == pytest.approx(cycles_of(M4, update=2000, output=600) * M4.cycle_nj.value * 1e-3)


def test_a_layer_at_rest_is_passed_over():
    seldom = dataclasses.replace(network((24, 50, 7), [46, 100, 10]), updates=np.array([800.0, 30.0]))
    # Without a count, a layer is awake in as many steps as it has updates: all 100, and 30.
    saved = cost(M4, seldom).energy_uj.value
    saved -= cost(M4, dataclasses.replace(seldom, awake=np.array([60.0, 20.0]))).energy_uj.value
    assert saved == pytest.approx(cycles_of(M4, neuron=40 * 50 + 10 * 7) * M4.cycle_nj.value * 1e-3)


def test_delayed_copies_of_the_inputs_are_looked_through():
    plain = network((120, 50, 7), [46, 100, 10])
    # 3 copies of 40 channels: two words each in every step, but for the undelayed copy.
    more = cost(M4, dataclasses.replace(plain, copies=3)).energy_uj.value - cost(M4, plain).energy_uj.value
    assert more == pytest.approx(cycles_of(M4, copy=400) * M4.cycle_nj.value * 1e-3)


def test_recurrent_spikes_reach_two_layers():
    forward = cost(M4, network((24, 50, 7), [46, 100, 10]))
    back = cost(M4, network((24, 50, 7), [46, 100, 10], recurrent=(True, True)))
    more = cycles_of(M4, synapse=100 * 50 + 10 * 7, row=100, recurrent=110)
    assert back.energy_uj.value - forward.energy_uj.value == pytest.approx(more * M4.cycle_nj.value * 1e-3)


def test_each_matrix_is_packed_where_it_needs_few_bits():
    back = network((24, 50, 7), [46, 100, 10], recurrent=(True, False))
    # Recurrent weights that need 4 bits, beside forward ones of 8; rows of packed weights have a loop.
    few = cost(M4, dataclasses.replace(back, needed_bits=(8, 4, 3)))
    more = cycles_of(M4, packed=100 * 57, row=100) - cycles_of(M4, synapse=100 * 57)
    saved = few.energy_uj.value - cost(M4, back).energy_uj.value
    assert saved == pytest.approx(more * M4.cycle_nj.value * 1e-3)
    assert cost(M4, dataclasses.replace(back, needed_bits=(8, 5, 6))).energy_uj == cost(M4, back).energy_uj


def test_weights_that_are_zero_are_skipped_where_lists_are_smaller():
    sizes, spikes = (24, 50, 7), [46, 100, 10]
    few = network(sizes, spikes, synapses=(10.0, 1.5, 0.0), stored=(240, 75))
    # 240 weights with columns and 25 places of rows are 530 bytes, all 1200 are 1200; 252 and 350: lists.
    found = cost(M4, few)
    expected = cycles_of(M4, list=460 + 150, row=146, spike=146, output_spike=10)
    assert found.breakdown["synaptic_event"] == pytest.approx(expected * M4.cycle_nj.value * 1e-3)
    packed = cost(M4, dataclasses.replace(network(sizes, spikes), weight_bits=4))
    expected = cycles_of(M4, packed=3000, row=146, spike=146, output_spike=10)
    assert packed.breakdown["synaptic_event"] == pytest.approx(expected * M4.cycle_nj.value * 1e-3)
    # 1650 and 502 bytes: all are stored, and all are events.
    many = network(sizes, spikes, synapses=(30.0, 5.0, 0.0), stored=(800, 200))
    assert cost(M4, many).energy_uj.value == cost(M4, network(sizes, spikes)).energy_uj.value


def test_weights_that_do_not_fit_in_flash():
    fits = cost(M4, network((2048, 1000, 48), [0, 0, 0]))
    assert fits.fits and fits.misfits == ()  # 2 096 000 of 2 097 152 bytes
    found = cost(M4, network((2048, 1000, 50), [0, 0, 0]))
    assert not found.fits
    (misfit,) = found.misfits
    assert misfit.rule == "flash_kib"
    assert misfit.text == "weights of 2098000 bytes, 2097152 bytes of flash"
    assert misfit.change == "at most 2097152 weights instead of 2098000"
    lists = network((3000, 3000, 10), [0, 0, 0], synapses=(300.0, 5.0, 0.0), stored=(900_000, 15_000))
    assert "at most 699050 weights instead of 915000" in str(cost(M4, lists).misfits[0])


@pytest.mark.parametrize(
    ("n_weights", "bits", "change"),
    [
        (524_288, 32, None),
        (524_289, 32, "weights of 16 bits instead of 32"),
        (1_048_577, 32, "weights of 8 bits instead of 32"),
        (2_097_153, 32, "at most 524288 weights instead of 2097153"),
        (2_097_152, 5, None),
        (2_097_153, 5, "at most 2097152 weights instead of 2097153"),
        (1_048_577, 9, "weights of 8 bits instead of 9"),
    ],
)
def test_the_smallest_change_that_fits_in_flash(n_weights, bits, change):
    found = cost(M4, operations(1, n_weights=n_weights, number_bits=bits))
    assert [misfit.change for misfit in found.misfits] == ([change] if change else [])


@pytest.mark.parametrize(("bits", "most"), [(8, 2_097_152), (32, 524_288), (64, 262_144)])
def test_numbers_of_a_classifier_of_counts_take_what_its_c_takes(bits, most):
    fits, over = (
        dataclasses.replace(operations(1, n_weights=n, number_bits=32), stored_bits=bits)
        for n in (most, most + 1)
    )
    assert cost(M4, fits).fits
    assert cost(M4, over).misfits[0].change == f"at most {most} weights instead of {most + 1}"


def test_of_design_points_together_the_largest_must_fit():
    found = cost(M4, operations([1, 1], [0, 0], [0, 0], [10, 3e6], [0, 0]))
    assert not found.fits and found.energy_uj.value.shape == (2,)


def test_states_that_do_not_fit_in_working_memory():
    # 81 920 neurons of two states of 4 bytes fill 640 KiB.
    assert cost(M4, network((1, 81_920), [0, 0])).fits
    (misfit,) = cost(M4, network((1, 81_921), [0, 0])).misfits
    assert misfit.rule == "sram_kib"
    assert misfit.text == "states of 655368 bytes, 655360 bytes of working memory"
    assert misfit.change == "at most 81920 neurons instead of 81921"


@pytest.mark.parametrize(
    ("n_neurons", "change"),
    [
        (2482, None),  # 2 states and 64 slots of 4 bytes: 264 bytes a neuron
        (2483, "delays of 5 bits instead of 6"),
        (4819, "delays of 4 bits instead of 6"),
        (40_961, "no individual delays of synapses"),
        (81_921, "at most 2482 neurons instead of 81921"),
    ],
)
def test_delays_take_working_memory(n_neurons, change):
    found = cost(M4, network((1, n_neurons), [0, 0], delay_bits=6))
    assert [misfit.change for misfit in found.misfits] == ([change] if change else [])


def test_delays_take_flash():
    assert cost(M4, network((1000, 1048), [0, 0], delay_bits=4)).fits
    assert "at most 1048576 weights" in str(cost(M4, network((1000, 1049), [0, 0], delay_bits=4)).misfits[0])


def test_a_step_longer_than_its_period_is_slow_and_fits():
    # 1e6 x 50 events in 10 steps of 1 us: it never sleeps.
    found = cost(M4, network((24, 50, 7), [1e6, 0, 0], n_steps=10, step_ms=1e-3))
    assert found.step_time_us.value > 1.0 and found.fits
    assert found.energy_throttled_uj.value == found.energy_uj.value


@EACH
def test_a_processor_that_cannot_sleep_runs(profile):
    # Steps of 1 us are shorter than waking up: it idles at running power, no more.
    found = cost(profile, network((2, 1), [0, 0], step_ms=1e-3))
    assert found.idle_mw == pytest.approx(profile.cycle_nj.value * profile.clock_mhz.value)
