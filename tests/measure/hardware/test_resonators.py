"""Resonators on every kind of hardware: four multiplications by two factors each, or a reason why not."""

from dataclasses import replace

import pytest

from dse.base.records import Workload
from dse.measure.hardware.cost import NotApplicable, cost
from dse.measure.hardware.profile import load, names
from dse.measure.hardware.workload import read_inference
from tests.measure.hardware.loads import PLAIN

# 24 inputs, 50 neurons of which 20 resonate, 7 outputs; 100 steps, 400 + 70 updates.
MIXED = replace(PLAIN, resonators=(20, 0))
FIXED = {
    *("loihi1_silicon", "loihi1_davies", "loihi1_kerasspiking", "xylo_imu"),
    *("odin", "reckon", "truenorth", "ice40_up5k", "ecp5_12f"),
}


@pytest.mark.parametrize("name", names())
def test_chips_run_them_or_say_why_not(name):
    if name in FIXED:
        why = f"{name} cannot run resonators: its neurons cannot be programmed"
        with pytest.raises(NotApplicable, match=why):
            cost(load(name), MIXED)
        return
    low, high = (cost(load(name), x).energy_uj.high for x in (PLAIN, MIXED))
    assert low <= high or name.endswith("_gcc")  # in the code of gcc, a leak takes longer than a rotation


def more(name):
    """Return by how many pJ each cause is dearer with resonators, on average between the ends."""
    profile = load(name)
    costs = [cost(replace(profile, interval_only=False), x) for x in (PLAIN, MIXED)]
    plain, mixed = ({cause: float(x) * 1e6 for cause, x in one.breakdown.items()} for one in costs)
    return {cause: mixed[cause] - plain[cause] for cause in mixed if mixed[cause] != plain[cause]}, costs[1]


def test_loihi_2_has_their_updates_twice():
    dearer, mixed = more("loihi2_scenario")
    # Of 400 updates of the layer 20 in 50 count twice: 160 more of 11.83 pJ.
    assert dearer == pytest.approx({"neuron_update": 160 * 11.83})
    assert any("an update of a resonator counts twice" in text for text in mixed.assumptions)


def test_a_processor_runs_other_code_for_them():
    dearer, _ = more("mcu_m4")
    # All 400 updates of the layer, 20 in 50 of them theirs, decide which of the two a neuron is.
    profile = load("mcu_m4")
    beyond = profile.mixed_cycles.value - profile.update_cycles.value
    assert dearer == pytest.approx({"neuron_update": 400 * beyond * profile.cycle_nj.value * 1e3})


def test_software_on_spinnaker_has_their_updates_twice():
    dearer, _ = more("spinnaker2")
    assert dearer == pytest.approx({"neuron_update": 20 * 100 * 2190.0})


def test_memory_has_their_factors():
    dearer, _ = more("asic45_memory")
    # 160 more updates of 6.4 pJ; each reads two factors of 16 bits, at 10 pJ x 2 x 16 / 64 each.
    assert dearer == pytest.approx({"neuron_update": 160 * 6.4, "state_memory": 160 * 2 * 5.0})
    # 2 x 1000 states of 4 bytes lie in 8 KiB; with 2 x 993 factors of 2 bytes it takes 32 KiB.
    whole = replace(PLAIN, sizes=(24, 993, 7))
    loads = (whole, replace(whole, resonators=(993, 0)))
    state = [float(cost(load("asic45_memory"), x).breakdown["state_memory"]) for x in loads]
    assert state[1] > 1.9 * state[0]


def test_their_factors_take_flash():
    chip = load("mcu_m4")
    full = replace(PLAIN, sizes=(2 * 2**20 // 50 - 7, 50, 7))  # 2 MiB but for less than 50 bytes
    assert cost(chip, full).fits
    misfits = cost(chip, replace(full, resonators=(50, 0))).misfits
    assert [misfit.rule for misfit in misfits] == ["flash_kib"]
    assert "beside 200 of neurons' factors" in misfits[0].text


def test_a_workload_file_states_them():
    text = "{layers: [24, 50, 7], n_steps: 100, spikes: [0.46, 1, 0.1], updates: [4, 0.7], resonators: %s}"
    inference = read_inference(text % "[20, 0]", "net.yaml")
    assert isinstance(inference.load, Workload) and inference.load.resonators == (20, 0)
    assert read_inference(text % "[0, 0]", "net.yaml").load.resonators is None
    with pytest.raises(Exception, match=r"net.yaml:1: resonators\[0\] must be in \[0, 50\], got 60"):
        read_inference(text % "[60, 0]", "net.yaml")
