"""A small scene for tests: few pins on one texture; nothing varies and no pixel is noisy unless asked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dse.scene.scene import Camera, Method, Scene, Sensor, Texture, Variation

SENSOR = Sensor("rings", 2, 1.35, 10.4, (88, 88), 0.40)
"""19 pins, 14 px apart."""

CAMERA = Camera(noise_hz=0.0)

DENIM = Texture(
    "denim", 55, 1.0, 0.4, 1.0, 0.40, 0.36, 2.5, 0.25, 0.045,
    weave_share=0.6, weave_period_mm=1.05, weave_angle_deg=55,
)  # fmt: skip

FOAM = Texture("foam", 90, 1.6, 0.5, 0.05, 0.79, 0.72, 4.0, 0.25, 0.045)

NONE = Variation(**{name: 0.0 for name in Variation.__dataclass_fields__ if name != "ripple_hz"})

SMOOTH = replace(DENIM, name="smooth", rms_um=0.0, slip_jitter=0.0, friction_roughness=0.0)
"""Friction alone."""


@dataclass(frozen=True)
class Steady:
    """A tip that moves at one speed, at once."""

    v_mm_s: float
    duration_s: float = 10.0

    @property
    def label(self) -> str:
        return f"steady {self.v_mm_s:g}"

    @property
    def peak_mm_s(self) -> float:
        return self.v_mm_s

    def speed(self, t_s: np.ndarray) -> np.ndarray:
        return np.full(len(t_s), self.v_mm_s)


EXACT = Method(friction_step_ms=0.1, texture_step_ms=0.1, camera_step_ms=0.1, skip_px=0.0)
"""Steps of the reference: what is left is the closed form of the camera."""


def scene(texture=DENIM, v_mm_s=28.0, force_n=1.5, **other):
    """Return a scene of one cell, 300 ms; further fields of Scene by name."""
    fields = {
        "name": "small", "seed": 1, "sensor": SENSOR, "camera": CAMERA, "textures": (texture,),
        "motions": (Steady(v_mm_s),), "forces_n": (force_n,), "trials": 1, "duration_ms": 300.0,
        "variation": NONE, "method": Method(),
    }  # fmt: skip
    return Scene(**(fields | other))


def pooled(found, frame_px, bin_ms, duration_ms):
    """Return events in pools of 4 x 4 pixels and bins, (bin * row * column,)."""
    width, height = frame_px[0] // 4, frame_px[1] // 4
    n = np.zeros((round(duration_ms / bin_ms), height, width))
    inside = (found.x // 4 < width) & (found.y // 4 < height)
    at = found.t_us // round(1000 * bin_ms), found.y // 4, found.x // 4
    np.add.at(n, tuple(a[inside] for a in at), 1)
    return n.ravel()


def likeness(a, b, scene, bin_ms=10.0):
    """Return the correlation of pooled counts."""
    x, y = (pooled(found, scene.sensor.frame_px, bin_ms, scene.duration_ms) for found in (a, b))
    return float(np.corrcoef(x, y)[0, 1])
