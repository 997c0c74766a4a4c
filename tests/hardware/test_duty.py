import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.hardware.duty import battery_h, mean_power_mw


def test_an_hour_added_up():
    # 36 contacts of 100 s and 200 mJ each take all of an hour: 7.2 J per 3600 s are 2 mW.
    assert mean_power_mw(36, 2e5, 1e5, 5.0) == pytest.approx(2.0)
    # Half as many: 1 mW, and 5 mW for the other half of the hour.
    assert mean_power_mw(18, 2e5, 1e5, 5.0) == pytest.approx(1.0 + 2.5)
    assert battery_h(35, 3.5) == pytest.approx(10.0)


def test_without_contacts_it_idles():
    assert mean_power_mw(0, 1e6, 100.0, 0.25) == 0.25
    assert mean_power_mw(0, 1e6, 0.0, 0.0) == 0.0
    assert battery_h(100.0, 0.0) == np.inf
    assert battery_h(0.0, 1.0) == 0.0
    assert battery_h(0.0, 0.0) == np.inf


def test_contacts_must_not_overlap():
    assert mean_power_mw(3600, 0.0, 1000.0, 7.0) == 0.0  # side by side
    message = "contacts must not overlap: 3600 of 1000 ms each fit into an hour, got 3601"
    with pytest.raises(ValueError, match=message):
        mean_power_mw(3601, 0.0, [10.0, 1000.0], 7.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1, 1, 1, 1), "contacts_per_hour must be finite and >= 0"),
        ((np.inf, 1, 0, 1), "contacts_per_hour must be finite and >= 0"),
        ((np.nan, 1, 1, 1), "contacts_per_hour must be a number"),
        ((1, -1, 1, 1), "energy_uj must be finite and >= 0"),
        ((1, 1, -1, 1), "contact_ms must be finite and >= 0"),
        ((1, 1, 1, -1), "idle_mw must be finite and >= 0"),
    ],
)
def test_what_cannot_be(arguments, message):
    with pytest.raises(ValueError, match=message):
        mean_power_mw(*arguments)


@pytest.mark.parametrize("arguments", [(-1, 1), (np.nan, 1), (1, -1)])
def test_no_such_battery(arguments):
    with pytest.raises(ValueError, match="battery_mwh and power_mw must be >= 0"):
        battery_h(*arguments)


def test_what_is_unknown_stays_unknown():
    power = mean_power_mw(10, [np.nan, 1e3], [np.nan, 10.0], 1.0)
    assert np.isnan(power).tolist() == [True, False]
    assert np.isnan(battery_h(10, power)).tolist() == [True, False]


@given(st.floats(0, 100), st.floats(0, 1e6), st.floats(0, 36_000), st.floats(0, 100))
def test_power_lies_between_idling_and_computing(rate, energy_uj, contact_ms, idle_mw):
    busy = rate * contact_ms / 3.6e6
    computing = rate * energy_uj / 3.6e6
    found = mean_power_mw(rate, energy_uj, contact_ms, idle_mw)
    assert found == pytest.approx(computing + (1 - busy) * idle_mw)
    assert computing <= found * (1 + 1e-12)
    assert found <= (computing + idle_mw) * (1 + 1e-12)
