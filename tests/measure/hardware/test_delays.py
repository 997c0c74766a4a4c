"""Networks with a delay per synapse: which chips hold them, and what that costs."""

from dataclasses import replace

import pytest

from dse.measure.hardware.cost import cost
from dse.measure.hardware.profile import load, names
from tests.measure.hardware.loads import PLAIN

LATE = replace(PLAIN, delay_bits=6)


@pytest.mark.parametrize("name", ["loihi1_silicon", "loihi1_davies", "loihi2_scenario"])
def test_loihi_holds_six_bits_of_them(name):
    assert cost(load(name), LATE).fits
    assert cost(load(name), LATE).energy_uj.high == cost(load(name), PLAIN).energy_uj.high
    assert not cost(load(name), replace(PLAIN, delay_bits=7)).fits


@pytest.mark.parametrize("name", [n for n in names() if not type(load(n)).delays_synapses])
def test_chips_without_them_say_so(name):
    held = cost(load(name), LATE)
    assert not held.fits
    assert any("6 bits of delay per synapse" in str(misfit) for misfit in held.misfits)


def test_memory_is_counted():
    assert (PLAIN.number_bits, LATE.number_bits) == (8, 14)
    plain, late = (cost(load("asic45_memory"), x) for x in (PLAIN, LATE))
    assert late.energy_uj.high > plain.energy_uj.high
    misfits = cost(load("mcu_m4"), replace(LATE, sizes=(24, 3000, 7))).misfits  # 66 states of 32 bits each
    assert any("delays of 5 bits instead of 6" in str(misfit) for misfit in misfits)


def test_layers_without_them_store_none():
    wide = replace(LATE, sizes=(2000, 50, 7), delayed=(False, True))
    assert wide.number_bits == 8 + 6 * 350 / 100350
    plain, late, everywhere = (
        [cost(load(name), x) for name in ("loihi1_silicon", "asic45_memory", "mcu_m4")]
        for x in (replace(wide, delay_bits=0, delayed=None), wide, replace(wide, delayed=None))
    )
    assert plain[0].n_cores.high == late[0].n_cores.high < everywhere[0].n_cores.high
    energies = [float(x[1].energy_uj.low) for x in (plain, late, everywhere)]
    assert energies[0] < energies[1] < energies[2]
    # A byte beside each weight is more than the flash holds: 2 MiB.
    most = replace(wide, sizes=(30000, 50, 7))
    assert cost(load("mcu_m4"), most).fits and not cost(load("mcu_m4"), replace(most, delayed=None)).fits


def test_a_processor_adds_late_weights_one_by_one():
    chip = load("mcu_m4")
    plain, late = (float(cost(chip, x).hardware_latency_ms) for x in (PLAIN, LATE))
    more = (46 * 50 + 100 * 7) * (chip.delayed_cycles.value - chip.synapse_cycles.value)
    more += (100 * 50 + 70 * 7) * chip.held_cycles.value + 100 * chip.row_cycles.value
    assert late - plain == pytest.approx(more / chip.cycles_per_ms)
    first = float(cost(chip, replace(LATE, delayed=(True, False))).hardware_latency_ms)
    fewer = 100 * 7 * (chip.delayed_cycles.value - chip.synapse_cycles.value)
    fewer += 70 * 7 * chip.held_cycles.value + 100 * chip.row_cycles.value
    assert late - first == pytest.approx(fewer / chip.cycles_per_ms)
