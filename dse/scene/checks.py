"""What physics and the method's steps say against a scene, before anything is simulated."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dse.scene.scene import Method, Motion, Scene, Sensor, Texture, Variation

Sentence = tuple[str, str]
"""Key that is at fault, and what it must be: `must be >= 2, got 1`."""

_BLIND = 1e-3  # a wave that the skin passes with less than this is not felt
_FINEST_MM = 0.2  # the shortest wave that a surface's grid of 0.1 mm holds


def sensor_faults(sensor: Sensor) -> Iterator[Sentence]:
    """Yield what is wrong with a sensor: pins that overlap, or that the frame cuts off."""
    if sensor.layout == "grid" and sensor.n_across < 1:
        yield "n_across", f"must be >= 1 for a grid, got {sensor.n_across}"
        return
    many = sensor.n_across > (1 if sensor.layout == "grid" else 0)
    if many and sensor.pin_pitch_mm < 2 * sensor.pin_radius_mm:
        diameter = 2 * sensor.pin_radius_mm
        yield (
            "pin_pitch_mm",
            f"must be at least a pin's diameter, {diameter:g} mm, got {sensor.pin_pitch_mm:g}",
        )
    width = 2 * half_width_px(sensor)
    if width > min(sensor.frame_px):
        yield (
            "frame_px",
            f"must contain the image of the pins, {math.ceil(width)} x {math.ceil(width)} px, "
            f"got {sensor.frame_px[0]} x {sensor.frame_px[1]}",
        )


def texture_faults(texture: Texture) -> Iterator[Sentence]:
    """Yield what is wrong with a texture."""
    if not texture.name:
        yield "name", "must not be empty, got ''"
    if texture.mu_kinetic > texture.mu_static:
        yield "mu_kinetic", f"must be at most mu_static, {texture.mu_static:g}, got {texture.mu_kinetic:g}"
    if texture.weave_share > 0 and texture.weave_period_mm is None:
        yield "weave_period_mm", f"must be given with weave_share {texture.weave_share:g}, got null"
    if texture.pin_radius_mm is not None and 0 < texture.pin_radius_mm < _FINEST_MM:
        yield "pin_radius_mm", f"must be 0 (flat) or >= {_FINEST_MM:g}, got {texture.pin_radius_mm:g}"


def variation_faults(variation: Variation) -> Iterator[Sentence]:
    """Yield what is wrong with the variation of trials."""
    low, high = variation.ripple_hz
    if low > high:
        yield "ripple_hz", f"must be in increasing order, got [{low:g}, {high:g}]"


def step_faults(method: Method, sensor: Sensor, motion: Motion) -> Iterator[Sentence]:
    """Yield whether a step is too long for a motion: four or more of them to the shortest wave that is felt.

    A longer one would fold the vibration to a frequency that nothing in the scene has. Steps are refused,
    never shortened in silence: a scene is simulated as its file says.
    """
    longest_ms = (
        1000 * shortest_wavelength_mm(sensor) / 4 / motion.peak_mm_s if motion.peak_mm_s else math.inf
    )
    if method.texture_step_ms > longest_ms:
        yield (
            "texture_step_ms",
            f"must be at most {longest_ms:.3g} ms for the {motion.peak_mm_s:g} mm/s of '{motion.label}', "
            f"got {method.texture_step_ms:g}",
        )


def shortest_wavelength_mm(sensor: Sensor) -> float:
    """Return the shortest wave that a pin feels: K(f) = 1/1000 (surface.slope_of), no finer than the grid.

    With w = 2 pi f it solves d w + (w_p w)^2 / 2 = ln 1000.
    """
    depth, average, target = sensor.depth_mm, sensor.pin_average_mm, -math.log(_BLIND)
    root = depth + math.sqrt(depth**2 + 2 * average**2 * target)
    return max(_FINEST_MM, 2 * math.pi * root / (2 * target))


def half_width_px(sensor: Sensor) -> float:
    """Return how far the image of the resting pins reaches from the centre of the frame, along x or y."""
    reach = sensor.pin_pitch_mm * (sensor.n_across if sensor.layout == "rings" else (sensor.n_across - 1) / 2)
    corner = reach if sensor.layout == "rings" else math.sqrt(2) * reach
    return sensor.image_scale_px_mm * (reach * (1 + sensor.lens_per_mm2 * corner**2) + sensor.pin_radius_mm)


def warnings(scene: Scene) -> list[str]:
    """Return what is legal in a scene but hardly meant."""
    sentences, camera = [], scene.camera
    if camera.threshold >= math.log(camera.contrast):
        sentences.append(
            f"no pixel can send an event: camera.threshold {camera.threshold:g} is at or above "
            f"ln(contrast) = {math.log(camera.contrast):.3g}"
        )
    if scene.variation.onset_ms >= scene.duration_ms:
        sentences.append(
            f"nothing moves: the trial of {scene.duration_ms:g} ms ends before the earliest motion onset, "
            f"variation.onset_ms {scene.variation.onset_ms:g}"
        )
    return sentences
