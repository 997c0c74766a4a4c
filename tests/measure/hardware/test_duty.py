import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.config.settings import Schedule
from dse.measure.hardware.duty import battery_h, on_schedule
from dse.measure.hardware.duty import mean_power_mw as on


def mean_power_mw(rate, *rest):
    return on(Schedule(contacts_per_hour=rate), *rest)


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


def test_between_contacts_it_sleeps():
    # 36 contacts of 20 s: on for 50 s each, half of the hour; 30 s of these idle, and it sleeps in between.
    schedule = Schedule(contacts_per_hour=36, awake_ms=5e4, asleep_uw=100)
    assert on(schedule, 2e5, 2e4, 5.0) == pytest.approx(2.0 + 36 * 3e4 * 5.0 / 3.6e6 + 0.05)
    assert on(schedule, 2e5, 6e4, np.nan) == pytest.approx(2.0 + 0.4 * 0.1)  # never idles
    with pytest.raises(ValueError, match="contacts must not overlap: 72 of 50000 ms"):
        on(Schedule(contacts_per_hour=73, awake_ms=5e4), 2e5, 2e4, 5.0)


def test_what_is_continuous_never_idles():
    for idle_mw in 7.0, np.nan:
        assert on(Schedule(continuous=True), [100.0, 300.0], [50.0, 100.0], idle_mw).tolist() == [2.0, 3.0]


def test_columns_of_points_on_a_schedule():
    schedule = Schedule(contacts_per_hour=3600, battery_mwh=48)
    columns = on_schedule(schedule, np.array([500.0, 500.0]), np.array([500.0, 2000.0]), 3.0)
    assert columns["power_mw"][0] == pytest.approx(0.5 + 1.5)
    assert columns["energy_per_hour_mj"][0] == pytest.approx(7200)
    assert columns["battery_days"][0] == pytest.approx(1.0)
    assert all(np.isnan(x[1]) for x in columns.values())  # they overlap
    assert np.isnan(on_schedule(schedule, np.array([500.0]), np.array([500.0]), 0.0)["power_mw"][0])
