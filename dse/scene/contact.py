"""Where the dome touches: the Hertz contact, and how much each pin reads of the texture and of the shear.

1 / E* = 1 / E_tip + 1 / E_texture
a   = (3 F R / (4 E*))^(1/3), at most the rim b
q_i = sqrt(1 - (r_i / a)^2) inside a, else 0                                     (pressure: reads the texture)
g_i = 1 inside a, (b - r_i) / (b - a) between a and the rim, 0 beyond            (shear)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats
from dse.scene.scene import Sensor


@dataclass(frozen=True)
class Contact:
    """Contact of one trial.

    radius_mm: a; 0 without force.
    pressure, shear: q and g, (pin,) float64 in [0, 1].
    saturated: the force would spread the contact beyond the rim.
    """

    radius_mm: float
    pressure: Floats
    shear: Floats
    saturated: bool


def contact(sensor: Sensor, pins_mm: Floats, force_n: float, tip_mpa: float, texture_mpa: float) -> Contact:
    """Return the contact of a dome pressed by a force, or none, onto a flat texture (Hertz).

    pins_mm: (pin, 2) rest positions.
    """
    r = np.hypot(pins_mm[:, 0], pins_mm[:, 1])
    if force_n <= 0:
        return Contact(0.0, np.zeros(len(r)), np.zeros(len(r)), False)
    modulus = 1 / (1 / tip_mpa + 1 / texture_mpa)
    free = (3 * force_n * sensor.dome_radius_mm / (4 * modulus)) ** (1 / 3)
    b, a = sensor.rim_mm, min(free, sensor.rim_mm)
    pressure = np.sqrt(np.clip(1 - (r / a) ** 2, 0, None))
    between = np.clip((b - r) / (b - a), 0, 1) if b > a else (r <= a).astype(np.float64)
    return Contact(a, pressure, np.where(r <= a, 1.0, between), free > b)
