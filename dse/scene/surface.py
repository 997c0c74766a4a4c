"""Texture surfaces: heights on a periodic patch, what a pin feels of them, and friction along the path.

    height    white noise shaped by |H(f)| ~ f'^(-1/2) exp(-log2(f' lambda0)^2 / (2 B^2)),
              f' = hypot(f_x, an f_y), with a share wf of the variance from two crossed gratings;
              or printed pins
    slope     grad(h * K),  K(f) = exp(-2 pi f d) exp(-(2 pi f w_p)^2 / 2)
    friction  a line n(X) of unit variance and correlation length lambda0 / 2

A pin's tip travels T = -l s_E slope, s_E = E_texture / (E_texture + E_tip): soft piles give way instead of
tilting the skin. Skin depth d makes a pin blind below a wavelength of about half a millimetre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats
from dse.scene.scene import Sensor, Texture

N = 512
"""Grid points along a side of the patch."""

STEP_MM = 0.1
PRINTED_HEIGHT_MM = 1.0
_PRINTED_EDGE_MM = 0.1
_WEAVE_SECOND = 0.6
_PHASE_RAD = 0.5  # how far yarns stray, and over which length
_PHASE_MM = 10.0
_LINE_POINTS_PER_LENGTH = 8
_LINE_POINTS = 4096


@dataclass(frozen=True)
class Surface:
    """What the tip meets.

    slope: (N, N, 2) float32, d/dx and d/dy of the felt height at [row y, column x].
    steepest: the largest slope.
    step_mm: distance of grid points; the patch repeats after N of them.
    line: (n,) float64 friction roughness along the path, unit variance; it repeats.
    line_step_mm: distance of its points.
    """

    slope: Floats
    steepest: float
    step_mm: float
    line: Floats
    line_step_mm: float


def surface(texture: Texture, sensor: Sensor, rng: np.random.Generator) -> Surface:
    """Return the surface of a texture as the sensor's pins feel it."""
    if texture.pin_radius_mm is None:
        h, step_mm = rough(texture, rng), STEP_MM
    else:
        h, step_mm = printed(texture.pin_radius_mm)
    line_step_mm = texture.wavelength_mm / 2 / _LINE_POINTS_PER_LENGTH
    slope = slope_of(h, step_mm, sensor.depth_mm, sensor.pin_average_mm)
    steepest = float(np.hypot(slope[..., 0], slope[..., 1]).max())
    return Surface(slope, steepest, step_mm, friction_line(rng), line_step_mm)


def rough(texture: Texture, rng: np.random.Generator) -> Floats:
    """Return heights (N, N) in mm of a random surface with its weave, scaled to its rms height."""
    fx, fy = _frequencies(STEP_MM)
    f = np.hypot(fx, texture.grain * fy)
    f[0, 0] = 1.0
    octaves = np.log2(f * texture.wavelength_mm)
    gain = f**-0.5 * np.exp(-(octaves**2) / (2 * texture.bandwidth_oct**2))
    gain[0, 0] = 0.0
    h = _unit(_filtered(rng.standard_normal((N, N)), gain))
    if texture.weave_share > 0 and texture.weave_period_mm is not None:
        woven = _unit(_weave(texture.weave_period_mm, np.deg2rad(texture.weave_angle_deg), rng))
        h = np.sqrt(1 - texture.weave_share) * h + np.sqrt(texture.weave_share) * woven
    return np.asarray(_unit(h) * texture.rms_um * 1e-3)


def printed(radius_mm: float) -> tuple[Floats, float]:
    """Return heights (N, N) in mm of cylinders with gaps as wide as their radius, and the grid's step in mm.

    The patch holds a whole number of pitches 3 R, so that it repeats without a seam. R = 0 is flat.
    """
    if radius_mm == 0:
        return np.zeros((N, N)), STEP_MM
    pitch = 3 * radius_mm
    step_mm = max(1, round(N * STEP_MM / pitch)) * pitch / N
    x = (np.arange(N) * step_mm) % pitch - pitch / 2
    r = np.hypot(x[None, :], x[:, None])
    return PRINTED_HEIGHT_MM / (1 + np.exp((r - radius_mm) / (_PRINTED_EDGE_MM / 4))), step_mm


def slope_of(h: Floats, step_mm: float, depth_mm: float, average_mm: float) -> Floats:
    """Return grad(h * K), (N, N, 2) float32: [..., 0] along x, [..., 1] along y."""
    fx, fy = _frequencies(step_mm)
    f = np.hypot(fx, fy)
    spectrum = np.fft.rfft2(h) * np.exp(-2 * np.pi * f * depth_mm - (2 * np.pi * f * average_mm) ** 2 / 2)
    parts = [np.fft.irfft2(2j * np.pi * axis * spectrum, s=h.shape) for axis in (fx, fy)]
    return np.ascontiguousarray(np.stack(parts, axis=-1), dtype=np.float32)


def friction_line(rng: np.random.Generator) -> Floats:
    """Return a periodic line of unit variance whose correlation falls to 1/e over 8 of its points."""
    f = np.fft.rfftfreq(_LINE_POINTS)
    # A Gaussian autocorrelation exp(-(x / length)^2) is white noise filtered by exp(-(pi f length)^2 / 2).
    gain = np.exp(-((np.pi * f * _LINE_POINTS_PER_LENGTH) ** 2) / 2)
    gain[0] = 0.0
    return _unit(np.fft.irfft(np.fft.rfft(rng.standard_normal(_LINE_POINTS)) * gain, n=_LINE_POINTS))


def _weave(period_mm: float, angle: float, rng: np.random.Generator) -> Floats:
    """Return two crossed gratings whose waves fit the patch, their phases straying slowly."""
    side = N * STEP_MM
    y, x = np.mgrid[:N, :N] / N
    woven = np.zeros((N, N))
    fx, fy = _frequencies(STEP_MM)
    slow = np.exp(-((np.pi * np.hypot(fx, fy) * _PHASE_MM) ** 2) / 2)
    slow[0, 0] = 0.0
    for turn, amplitude in ((0.0, 1.0), (np.pi / 2, _WEAVE_SECOND)):
        kx = round(side / period_mm * np.cos(angle + turn))
        ky = round(side / period_mm * np.sin(angle + turn))
        phase = _PHASE_RAD * _unit(_filtered(rng.standard_normal((N, N)), slow))
        woven += amplitude * np.cos(2 * np.pi * (kx * x + ky * y) + phase)
    return woven


def _frequencies(step_mm: float) -> tuple[Floats, Floats]:
    return np.fft.rfftfreq(N, step_mm)[None, :], np.fft.fftfreq(N, step_mm)[:, None]


def _filtered(noise: Floats, gain: Floats) -> Floats:
    return np.asarray(np.fft.irfft2(np.fft.rfft2(noise) * gain, s=noise.shape))


def _unit(x: Floats) -> Floats:
    """Return x without its mean, scaled to variance 1; what does not vary stays 0."""
    x = x - x.mean()
    spread = x.std()
    return np.asarray(x / spread if spread > 0 else x)
