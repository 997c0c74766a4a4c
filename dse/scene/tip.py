"""The tip: where its pins rest, and the filter of skin and gel between the texture and a pin.

    u_i(t) = -g_i s(t) e_x + f_i(t) + u_rad,     df_i/dt = 2 pi f_s (q_i T(X(t) + x_0 + x_i, y_0 + y_i) - f_i)
    u_rad  = 0.03 m delta_F (t / T) x_i exp(-(r_i / a)^2)     (the skin spreads as the force drifts)

Every pin reads the same field at X + x_i, so pin j behind pin i by dx sees the same vibration dx / v later:
the delay between pins carries velocity, the waveform carries texture.
"""

from __future__ import annotations

import functools

import numpy as np

from dse.base.records import Floats
from dse.scene.scene import Sensor

SPREAD = 0.03


@functools.lru_cache(maxsize=8)
def pins_mm(sensor: Sensor) -> Floats:
    """Return the rest positions (pin, 2) float64 in mm around the axis of the dome; read-only."""
    pitch = sensor.pin_pitch_mm
    if sensor.layout == "grid":
        line = (np.arange(sensor.n_across) - (sensor.n_across - 1) / 2) * pitch
        y, x = np.meshgrid(line, line, indexing="ij")
        pins = np.stack([x.ravel(), y.ravel()], axis=1)
    else:
        rings = [np.zeros((1, 2))]
        for ring in range(1, sensor.n_across + 1):
            angle = 2 * np.pi * np.arange(6 * ring) / (6 * ring)
            rings.append(ring * pitch * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        pins = np.concatenate(rings)
    pins.flags.writeable = False
    return pins


def image_px(sensor: Sensor, at_mm: Floats) -> Floats:
    """Return where points (..., 2) of the tip lie in the image: pixels from the top left of the frame."""
    r2 = (at_mm**2).sum(axis=-1, keepdims=True)
    middle = np.array(sensor.frame_px) / 2
    return np.asarray(middle + sensor.image_scale_px_mm * at_mm * (1 + sensor.lens_per_mm2 * r2))


def skin_filter(corner_hz: float, step_s: float) -> tuple[float, float, float]:
    """Return (e, c0, c1) of f[k+1] = e f[k] + c0 T[k] + c1 T[k+1], exact for a T that is linear between."""
    angle = 2 * np.pi * corner_hz * step_s
    e = float(np.exp(-angle))
    mean = -float(np.expm1(-angle)) / angle
    return e, mean - e, 1 - mean


def lines(slope: Floats, grid_mm: float, y_mm: Floats, scale: Floats) -> Floats:
    """Return what pins read along the motion, for their rows stay the same: (pin, points, 2) float32.

    slope: (points, points, 2) float32 of the surface. y_mm, scale: (pin,) row on the patch and factor of each
    pin.
    """
    place = y_mm / grid_mm
    low = np.floor(place)
    part = (place - low).astype(np.float32)[:, None, None]
    row = low.astype(np.int64)
    here, there = (slope.take(row + k, axis=0, mode="wrap") for k in (0, 1))
    return np.asarray(scale.astype(np.float32)[:, None, None] * (here + part * (there - here)))
