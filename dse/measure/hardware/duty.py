"""Time until an answer, and mean power and battery life of a device that answers on a schedule."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dse.base.records import Floats
from dse.config.settings import Schedule

_MS_PER_HOUR = 3.6e6
_ROUNDING = 1e-12


def mean_power_mw(
    schedule: Schedule, energy_uj: ArrayLike, contact_ms: ArrayLike, idle_mw: ArrayLike
) -> Floats:
    """Return the mean power in mW of one inference per contact.

        P = r (E + (a - t) P_idle) + (1 - r a) P_between        r contacts per time

    The device is on for a = max(t, awake_ms), and asleep in between. Without awake_ms it idles in between,
    and a = t. What is continuous takes E / t. Arguments are broadcast; an energy or a power that is unknown
    (NaN) leaves the result unknown.

    Args:
        schedule: r, awake_ms, and P_between where that is not P_idle.
        energy_uj: E of an inference, static energy included (`Cost.energy_throttled_uj`).
        contact_ms: t that an inference takes: its window, or its computing time where that is longer.
        idle_mw: P_idle, power while nothing is to be done.

    Example:
        >>> float(mean_power_mw(Schedule(contacts_per_hour=36), 2e5, 5e4, 5.0))  # 2 mW, and 5 for half of it
        4.5
    """
    energy, contact, idle = (np.asarray(x, np.float64) for x in (energy_uj, contact_ms, idle_mw))
    rate = np.asarray(schedule.contacts_per_hour or 0.0)
    named = {"contacts_per_hour": rate, "energy_uj": energy, "contact_ms": contact, "idle_mw": idle}
    for name, values in named.items():
        if (values < 0).any() or np.isinf(values).any():
            raise ValueError(f"{name} must be finite and >= 0, got {values}")
    if np.isnan(rate):
        raise ValueError(f"contacts_per_hour must be a number, got {rate}")
    per_ms = contacts_per_ms(schedule, contact)
    if schedule.continuous:
        return np.broadcast_arrays(per_ms * energy, idle)[0].copy()
    awake = np.maximum(contact, schedule.awake_ms or 0.0)
    busy = rate * awake / _MS_PER_HOUR
    if (busy > 1 + _ROUNDING).any():
        most = _MS_PER_HOUR / np.nanmax(awake)
        raise ValueError(
            f"contacts must not overlap: {most:.6g} of {np.nanmax(awake):.6g} ms each fit into an hour, "
            f"got {rate:.6g}"
        )
    between = idle if schedule.awake_ms is None else schedule.asleep_uw * 1e-3
    waiting = np.where(awake > contact, (awake - contact) * idle, 0.0)
    return np.asarray(per_ms * (energy + waiting) + np.maximum(1 - busy, 0.0) * between)


def contacts_per_ms(schedule: Schedule, contact_ms: Floats) -> Floats:
    """Return the rate of inferences of `contact_ms` each: power in mW per uJ of an inference."""
    if schedule.contacts_per_hour is None:
        return 1.0 / contact_ms
    return np.full_like(contact_ms, schedule.contacts_per_hour / _MS_PER_HOUR)


def on_schedule(
    schedule: Schedule, energy_uj: Floats, contact_ms: Floats, idle_mw: ArrayLike
) -> dict[str, Floats]:
    """Return columns of design points on a schedule (`mean_power_mw`); NaN where contacts would overlap.

    Args:
        schedule: how often, and of what battery.
        energy_uj: of each point.
        contact_ms: of each point.
        idle_mw: NaN or 0 where it is unknown.
    """
    idle = np.asarray(idle_mw, np.float64)
    awake = np.fmax(contact_ms, schedule.awake_ms or 0.0)
    is_apart = (schedule.contacts_per_hour or 0.0) * awake <= _MS_PER_HOUR
    contact = np.where(is_apart, contact_ms, np.nan)
    power = mean_power_mw(schedule, energy_uj, contact, np.where(idle > 0, idle, np.nan))
    columns = {"power_mw": power, "energy_per_hour_mj": power * 3600.0}
    if schedule.battery_mwh is not None:
        columns["battery_days"] = battery_h(schedule.battery_mwh, power) / 24.0
    return columns


def battery_h(battery_mwh: ArrayLike, power_mw: ArrayLike) -> Floats:
    """Return how many hours a battery lasts at a mean power; infinite where nothing is drawn."""
    battery, power = np.asarray(battery_mwh, np.float64), np.asarray(power_mw, np.float64)
    if not (np.isfinite(battery) & (battery >= 0)).all() or (power < 0).any():
        raise ValueError(f"battery_mwh and power_mw must be >= 0, got {battery} and {power}")
    battery, power = np.broadcast_arrays(battery, power)
    lasts = np.full(power.shape, np.inf)
    np.divide(battery, power, out=lasts, where=power != 0)
    return lasts


def latency_ms(decision_ms: ArrayLike, step_ms: float, step_time_us: ArrayLike) -> Floats:
    """Time from the first touch until the hardware has computed the decision.

    The hardware starts a step when its input is complete and the step before is done. With n steps
    of period p that each take c to compute, the last one is done at p + (n - 1) max(p, c) + c.

    Args:
        decision_ms: decision time on the sensor's clock, n p, any shape.
        step_ms: period p of a step.
        step_time_us: computing time c of a step, broadcast against decision_ms.
    """
    compute_ms = np.asarray(step_time_us, dtype=np.float64) / 1e3
    steps_before = np.asarray(decision_ms, dtype=np.float64) / step_ms - 1
    return np.asarray(step_ms + steps_before * np.maximum(step_ms, compute_ms) + compute_ms)
