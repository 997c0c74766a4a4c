"""Energy by counting operations: what the literature quotes where no chip is named.

    E = mac M + addition A          M multiply-accumulates, A additions per inference

Computing alone: moving data costs more than that, and static power, cores and time are left out. It compares
classifiers of all families by one rule, and with published figures by the same rule, and nothing else.

Source: syops-counter and SpikingJelly, which count so (REFERENCES.md).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dse.hardware.profile import End, OperationProfile

__all__ = ["OperationProfile", "energy_uj"]

_ENDS: tuple[End, ...] = ("value", "low", "high")


def energy_uj(
    profile: OperationProfile, macs: ArrayLike, additions: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the energy per inference in uJ and the low and high end of its range, each (...).

    Args:
        profile: energy per operation.
        macs: (...) multiply-accumulates per inference.
        additions: (...) additions per inference.

    Raises:
        ValueError: counts that are negative or not finite.
    """
    counts = {"macs": np.asarray(macs, np.float64), "additions": np.asarray(additions, np.float64)}
    for name, values in counts.items():
        if not (np.isfinite(values) & (values >= 0)).all():
            raise ValueError(f"{name} must be finite and >= 0, got {values}")
    value, low, high = (
        np.asarray(
            1e-6
            * (
                getattr(profile.mac_pj, end) * counts["macs"]
                + getattr(profile.addition_pj, end) * counts["additions"]
            )
        )
        for end in _ENDS
    )
    return value, low, high
