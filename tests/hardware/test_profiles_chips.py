"""What every profile of the package must do, whatever its kind."""

from typing import get_args

import numpy as np
import pytest

from dse.hardware.cost import NotApplicable, cost, drawn
from dse.hardware.profile import Evidence, kinds, load, names
from dse.records import Operations, Workload

EACH = pytest.mark.parametrize("name", names())
NETWORK = Workload(
    (16, 20, 7),
    (True, False),
    np.array([100.0, 100.0, 0.0]),
    np.array([[40.0, 90.0, 9.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    np.array([[800.0, 300.0], [0.0, 0.0], [0.0, 0.0]]),
    1.0,
    weight_bits=4,
)
CLASSIFIER = Operations(
    macs=np.array([1000.0, 0.0]),
    additions=np.array([50.0, 0.0]),
    updates=np.array([10.0, 0.0]),
    n_weights=np.array([1000.0, 0.0]),
    duration_ms=np.array([100.0, 0.0]),
    number_bits=8,
)
LOADS = pytest.mark.parametrize("given", [NETWORK, CLASSIFIER], ids=["network", "classifier"])


def test_the_chips_are_there():
    chips = "loihi1_silicon loihi1_davies loihi2_scenario xylo_imu truenorth spinnaker2 odin reckon"
    others = "mcu_m4 mcu_m33 mcu_m7 asic45_memory op_4.6_0.9 loihi1_kerasspiking"
    assert {*chips.split(), *others.split()} <= set(names())


@EACH
def test_numbers_have_a_range_and_a_pedigree(name):
    profile = load(name)
    assert profile.name == name and profile.doc and type(profile) in kinds().values()
    assert profile.numbers()
    for key, what in profile.numbers().items():
        number = getattr(profile, key)
        assert 0 <= number.low <= number.value <= number.high, key
        assert number.evidence in get_args(Evidence) and number.source and number.unit == what.unit, key
        suffix = key.rsplit("_", 1)[-1]
        units = {"pj": "pJ", "nj": "nJ", "ns": "ns", "us": "us", "mw": "mW", "uw": "uW", "mhz": "MHz"}
        assert number.unit == units.get(suffix, number.unit), key


@EACH
@LOADS
def test_the_interval_contains_the_value(name, given):
    profile = load(name)
    try:
        found = cost(profile, given)
    except NotApplicable as reason:
        assert str(reason).startswith(name) and "\n" not in str(reason)
        return
    for low, value, high in (
        (found.energy_uj.low, found.energy_uj.value, found.energy_uj.high),
        (found.energy_throttled_uj.low, found.energy_throttled_uj.value, found.energy_throttled_uj.high),
        (found.static_uj.low, found.static_uj.value, found.static_uj.high),
        (found.static_throttled_uj.low, found.static_throttled_uj.value, found.static_throttled_uj.high),
        (found.step_time_us.low, found.step_time_us.value, found.step_time_us.high),
        *([[x[:1] for x in (found.power_w.low, found.power_w.value, found.power_w.high)]] * found.timed),
    ):
        assert np.isnan(value).all() if profile.interval_only else (low <= value).all()
        assert (low <= high).all() and not (value > high).any()
    assert np.shape(found.pipeline_ms) == np.shape(found.energy_uj.high)
    assert found.energy_uj.high[0] > 0
    assert (found.energy_uj.low[-1], found.energy_throttled_uj.high[-1]) == (0, 0)  # nothing in no time
    for misfit in found.misfits:
        assert misfit.rule and misfit.text and misfit.change, misfit


@EACH
@LOADS
def test_draws_stay_in_the_interval(name, given):
    profile = load(name)
    try:
        found = cost(profile, given)
    except NotApplicable:
        with pytest.raises(NotApplicable):
            drawn(profile, given, profile.drawn(3, np.random.default_rng(1)))
        return
    draws = drawn(profile, given, profile.drawn(20, np.random.default_rng(1)))
    assert (draws.energy_uj >= found.energy_uj.low * (1 - 1e-9)).all()
    assert (draws.energy_uj <= found.energy_uj.high * (1 + 1e-9)).all()


@EACH
def test_a_network_runs_everywhere(name):
    assert cost(load(name), NETWORK).energy_uj.high[0] > 0
