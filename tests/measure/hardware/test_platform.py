"""Platforms with published power, and the power of other hardware, by hand."""

import numpy as np
import pytest

from dse.measure.hardware.cost import cost
from dse.measure.hardware.profile import load
from tests.measure.hardware.loads import network

NETWORK = network((4, 3), [[90, 20], [0, 0]], [[600], [0]], n_steps=[500, 0], step_ms=2.0)


@pytest.mark.parametrize(
    ("name", "idle_w", "running_w"),
    [("cpu_threadripper_2920x", 56, 56.005), ("gpu_rtx_a4500", 28, 46.39), ("loihi2_board", 0.5, 2.25)],
)
def test_a_platform_draws_what_is_printed_for_as_long_as_the_touch_lasts(name, idle_w, running_w):
    found = cost(load(name), NETWORK)
    assert found.power_idle_w.value == idle_w and found.idle_mw == idle_w * 1e3
    assert found.power_w.value[0] == pytest.approx(running_w) and np.isnan(found.power_w.value[1])
    for energy in (found.energy_uj, found.energy_throttled_uj):
        assert energy.value.tolist() == pytest.approx([running_w * 1e6, 0.0])  # for a second, and for none
    assert found.hardware_latency_ms.tolist() == pytest.approx([1000.0, 0.0])
    assert found.fits and len(found.assumptions) == 2


def test_running_power_is_energy_over_computing_time():
    found = cost(load("loihi1_silicon"), NETWORK)
    watts = found.energy_uj.value[0] / (found.hardware_latency_ms[0] * 1e3)
    assert found.power_w.value[0] == pytest.approx(watts)
    assert found.power_w.low[0] < watts < found.power_w.high[0]
    assert found.power_idle_w.value == pytest.approx(found.idle_mw * 1e-3)


def test_a_processor_runs_at_one_power():
    profile = load("mcu_m33")
    found = cost(profile, NETWORK)
    cycle = profile.cycle_nj
    # nJ x MHz = mW
    assert [x[0] for x in found.power_w] == pytest.approx(
        [x * 0.16 for x in (cycle.value, cycle.low, cycle.high)]
    )


def test_what_nobody_published_has_no_value():
    scenario = cost(load("loihi2_scenario"), NETWORK)
    assert np.isnan(scenario.power_w.value).all() and scenario.power_idle_w.value == 0.257
    assert 0.232 < scenario.power_w.low[0] < scenario.power_w.high[0]
    unknown = cost(load("odin"), NETWORK)
    assert np.isnan(unknown.power_idle_w.value) and unknown.power_idle_w.low == 0
