"""One trial of a scene: what varies from trial to trial, drawn from seeds that belong to that trial alone."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from dse.base import seeds
from dse.base.records import Floats
from dse.scene.contact import Contact, contact
from dse.scene.friction import Friction, travel
from dse.scene.scene import Scene, Sensor, Texture
from dse.scene.surface import Surface, surface
from dse.scene.tip import pins_mm

_SLIP_NORMALS = 1024


@dataclass(frozen=True)
class Trial:
    """Everything that was drawn for one trial, and what follows from it before time begins.

    pins_mm: (pin, 2) rest positions, rotated as mounted.
    offset_px: mounting error of the image.
    start_mm: where on the texture the tip stands.
    tilt_mm: travel of a pin's tip per unit of slope, l s_E.
    drift: relative change of the force over the record.
    onset_s, gain, ripple, ripple_hz, ripple_phase: of the speed.
    key: 64 bits from which the start phases of the pixels follow.
    """

    surface: Surface
    contact: Contact
    friction: Friction
    pins_mm: Floats
    offset_px: Floats
    start_mm: Floats
    force_n: float
    drift: float
    tilt_mm: float
    onset_s: float
    gain: float
    ripple: float
    ripple_hz: float
    ripple_phase: float
    normals: Floats
    key: int


def trial(scene: Scene, k: int) -> Trial:
    """Return trial k, the same whatever else the scene holds and in whichever order trials are asked for.

    Raises:
        IndexError: there is no such trial.
    """
    texture_index, _, force_index, _ = scene.cell(k)
    texture, variation, sensor = scene.textures[texture_index], scene.variation, scene.sensor
    rng = generator(scene, k, "trial")
    normal = rng.standard_normal(8)
    x0, y0, hz, phase = rng.uniform(-1, 1, 4)
    force = mean_force(scene, k)
    if force > 0 and force_index < len(scene.forces_n):
        bound = variation.force_bound_n
        force = max(0.0, force + float(np.clip(normal[0] * variation.force_n, -bound, bound)))
    friction = float(np.exp(normal[1] * variation.friction))
    tip_mpa = sensor.modulus_mpa * float(np.exp(normal[2] * variation.modulus))
    angle = np.deg2rad(normal[3] * variation.mounting_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    pins = pins_mm(sensor) @ turn.T
    low, high = variation.ripple_hz
    mounting = rng.standard_normal(2) * variation.mounting_px
    return Trial(
        surface=_surface(scene.seed, texture, sensor),
        contact=contact(sensor, pins, force, tip_mpa, texture.modulus_mpa),
        friction=Friction(
            texture.mu_static * friction, texture.mu_kinetic * friction, texture.stribeck_mm_s,
            texture.slip_jitter, texture.friction_roughness, sensor.stiffness_n_mm, sensor.incipient_slip,
        ),
        pins_mm=pins,
        offset_px=mounting,
        start_mm=np.array([x0 * variation.start_x_mm, y0 * variation.start_y_mm]),
        force_n=force,
        drift=float(normal[4] * variation.force_drift),
        tilt_mm=sensor.lever_mm * texture.modulus_mpa / (texture.modulus_mpa + tip_mpa),
        onset_s=1e-3 * (variation.onset_ms + abs(float(normal[5])) * variation.onset_sd_ms),
        gain=float(np.exp(normal[6] * variation.speed_gain)),
        ripple=variation.ripple * abs(float(normal[7])),
        ripple_hz=low + (high - low) * (hz + 1) / 2,
        ripple_phase=np.pi * phase,
        normals=rng.standard_normal(_SLIP_NORMALS),
        key=int(rng.integers(2**63)),
    )  # fmt: skip


def mean_force(scene: Scene, k: int) -> float:
    """Return the force of trial k in N, before its deviation; a randomised force has none."""
    force = scene.cell(k)[2]
    if scene.randomised_force_n is None or force < len(scene.forces_n):
        return scene.forces_n[force]
    return float(generator(scene, k, "force").uniform(*scene.randomised_force_n))


def generator(scene: Scene, k: int, purpose: str) -> np.random.Generator:
    """Return the random generator of one purpose of trial k."""
    texture, motion, force, repetition = scene.cell(k)
    cell = {
        "texture": scene.textures[texture].name,
        "motion": scene.motions[motion].label,
        "force_n": scene.forces_n[force] if force < len(scene.forces_n) else "randomised",
    }
    return seeds.generator(scene.seed, cell, purpose, repetition)


def speed(scene: Scene, k: int, drawn: Trial, t_s: Floats) -> Floats:
    """Return the speed of the tip in mm/s at times (n,) of the record; 0 outside the profile."""
    motion = scene.motions[scene.cell(k)[1]]
    t = t_s - drawn.onset_s
    inside = (t >= 0) & (t <= motion.duration_s)
    v = np.zeros(len(t_s))
    v[inside] = motion.speed(t[inside])
    ripple = 1 + drawn.ripple * np.sin(2 * np.pi * drawn.ripple_hz * t_s + drawn.ripple_phase)
    return np.asarray(np.maximum(0.0, drawn.gain * v * ripple))


def path(scene: Scene, k: int, drawn: Trial, step_s: float) -> tuple[Floats, Floats]:
    """Return the skin's deflection s and slip distance X in mm, (n + 1,), at steps that cover the record."""
    n = int(np.ceil(scene.duration_ms / 1000 / step_s - 1e-9))
    if drawn.contact.radius_mm == 0 or scene.motions[scene.cell(k)[1]].peak_mm_s == 0:
        return np.zeros(n + 1), np.zeros(n + 1)
    middle = (np.arange(n) + 0.5) * step_s
    v = speed(scene, k, drawn, middle)
    if not v.any():
        return np.zeros(n + 1), np.zeros(n + 1)
    force = drawn.force_n * (1 + drawn.drift * middle / (scene.duration_ms / 1000))
    line = drawn.surface
    s, x = travel(drawn.friction, v, force, step_s, line.line, line.line_step_mm, drawn.normals)
    return s, x


@functools.lru_cache(maxsize=64)
def _surface(seed: int, texture: Texture, sensor: Sensor) -> Surface:
    return surface(texture, sensor, seeds.generator(seed, {"texture": texture.name}, "surface"))
