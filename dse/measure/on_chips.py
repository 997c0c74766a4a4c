"""Work of design points -> what it costs on a chip, in columns."""

from __future__ import annotations

import numpy as np

from dse.base.records import Array, Operations, Workload
from dse.measure.hardware.cost import NotApplicable, drawn
from dse.measure.hardware.profile import Figures, Profile
from dse.measure.objectives import Priced, measured
from dse.measure.objectives.on_chip import latency_of

DRAWN = ("energy_uj", "energy_throttled_uj", "hardware_latency_ms", "latency_ms")
"""Columns that depend on a chip's uncertain numbers; `drawn_on` samples them."""


def columns_on(profile: Profile, load: Workload | Operations) -> dict[str, Array]:
    """Return the hardware columns of some work on one profile, in the shape of its counts.

    A chip that cannot run such a classifier has no columns, and counted operations have energies only.
    """
    try:
        priced = Priced.on(profile, load)
    except NotApplicable:
        return {}
    columns = measured("hardware", priced)
    shape = np.shape(columns["energy_uj"])
    return {name: np.broadcast_to(np.asarray(x), shape).copy() for name, x in columns.items()}


def drawn_on(profile: Profile, load: Workload | Operations, figures: Figures) -> dict[str, Array]:
    """Return the columns of `DRAWN` under samples of a chip's uncertain numbers: (sample, ...) each.

    Args:
        profile: the chip.
        load: counts (...).
        figures: `profile.drawn`, the same for all that are to be compared.

    Returns:
        Nothing where the chip cannot run the classifier.
    """
    try:
        costs = drawn(profile, load, figures)
    except NotApplicable:
        return {}
    return {
        "energy_uj": costs.energy_uj,
        "energy_throttled_uj": costs.energy_throttled_uj,
        "hardware_latency_ms": costs.hardware_latency_ms,
        "latency_ms": latency_of(load, costs.step_time_us),
    }
