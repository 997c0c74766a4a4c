"""Battery life of a device that is touched now and then."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dse.records import Floats

_MS_PER_HOUR = 3.6e6
_ROUNDING = 1e-12


def mean_power_mw(
    contacts_per_hour: ArrayLike, energy_uj: ArrayLike, contact_ms: ArrayLike, idle_mw: ArrayLike
) -> Floats:
    """Return the mean power in mW of one inference per contact, with idling in between.

        P = r E + (1 - r t) P_idle          r contacts per time

    Arguments are broadcast; an energy or a power that is unknown (NaN) leaves the result unknown.

    Args:
        contacts_per_hour: r.
        energy_uj: E of an inference, static energy included (`Cost.energy_throttled_uj`).
        contact_ms: t that an inference takes: its window, or its computing time where that is longer.
        idle_mw: P_idle, power while nothing is to be done.

    Raises:
        ValueError: an argument is negative, contacts are not a finite number, or they overlap.
    """
    rate, energy, contact, idle = (
        np.asarray(x, np.float64) for x in (contacts_per_hour, energy_uj, contact_ms, idle_mw)
    )
    named = {"contacts_per_hour": rate, "energy_uj": energy, "contact_ms": contact, "idle_mw": idle}
    for name, values in named.items():
        if (values < 0).any() or np.isinf(values).any():
            raise ValueError(f"{name} must be finite and >= 0, got {values}")
    if np.isnan(rate).any():
        raise ValueError(f"contacts_per_hour must be a number, got {rate}")
    busy = rate * contact / _MS_PER_HOUR
    if (busy > 1 + _ROUNDING).any():
        most = _MS_PER_HOUR / np.nanmax(contact)
        raise ValueError(
            f"contacts must not overlap: {most:.6g} of {np.nanmax(contact):.6g} ms each fit into an hour, "
            f"got {rate.max():.6g}"
        )
    # uJ per hour are 1e-3 mJ per 3600 s.
    return np.asarray(rate * energy * 1e-3 / 3600 + np.maximum(1 - busy, 0.0) * idle)


def battery_h(battery_mwh: ArrayLike, power_mw: ArrayLike) -> Floats:
    """Return how many hours a battery lasts at a mean power; infinite where nothing is drawn.

    Raises:
        ValueError: a battery or a power is negative.
    """
    battery, power = np.asarray(battery_mwh, np.float64), np.asarray(power_mw, np.float64)
    if not (np.isfinite(battery) & (battery >= 0)).all() or (power < 0).any():
        raise ValueError(f"battery_mwh and power_mw must be >= 0, got {battery} and {power}")
    battery, power = np.broadcast_arrays(battery, power)
    lasts = np.full(power.shape, np.inf)
    np.divide(battery, power, out=lasts, where=power != 0)
    return lasts
