"""What a scene is: a sensor, textures, motions, forces, and how trials of one cell differ.

Frozen records only; their fields are the keys of a scene file. Numbers that are assumed rather than known
say so in their doc: [S] seen in a source, [M] from memory, [A] assumed or tuned (scene/__init__ lists the
sources).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from dse.base.records import Floats
from dse.base.registry import fixed, param


@dataclass(frozen=True)
class Sensor:
    """A soft tip with pins on the inside of its skin, and the part of the image that its camera reads out."""

    layout: str = fixed(doc="arrangement of the pins at rest", choices=("rings", "grid"))
    n_across: int = fixed(
        doc="rings: number of rings around the central pin (ring k holds 6 k pins); grid: pins per side",
        low=0,
    )
    pin_pitch_mm: float = param(
        doc="distance between rings, or between neighbouring pins", unit="mm", low=0, low_open=True
    )
    image_scale_px_mm: float = param(doc="image scale [A]", unit="px/mm", low=0, low_open=True)
    frame_px: tuple[int, int] = param(doc="width and height of the frame [S]", unit="px", low=1)
    pin_radius_mm: float = param(doc="radius of a pin's image [A]", unit="mm", low=0, low_open=True)
    edge_px: float = param(0.45, doc="logistic scale of a pin's edge [A]", unit="px", low=0.05)
    dome_radius_mm: float = param(20.0, doc="radius of the dome [M]", unit="mm", low=0, low_open=True)
    modulus_mpa: float = param(
        0.06, doc="effective modulus of skin and gel [A]", unit="MPa", low=0, low_open=True
    )
    rim_mm: float = param(
        18.0, doc="radius at which the skin is clamped [A]", unit="mm", low=0, low_open=True
    )
    stiffness_n_mm: float = param(0.9, doc="tangential stiffness [A]", unit="N/mm", low=0, low_open=True)
    incipient_slip: bool = param(
        False,
        doc="the rim of the contact slips before its middle does, so that the texture is felt meanwhile",
    )
    lever_mm: float = param(4.0, doc="travel of a pin's tip per slope of the skin [A]", unit="mm", low=0)
    depth_mm: float = param(0.30, doc="effective depth from skin to pin [A]", unit="mm", low=0)
    pin_average_mm: float = param(0.2, doc="Gaussian width over which a pin averages [A]", unit="mm", low=0)
    corner_hz: float = param(100.0, doc="corner of skin and gel, first order [A]", unit="Hz", low=0.1)
    lens_per_mm2: float = param(0.0, doc="radial lens term kappa of r (1 + kappa r^2)", unit="1/mm2", low=0)


@dataclass(frozen=True)
class Camera:
    """Pixels that send an event when the logarithm of their light has changed by a threshold."""

    contrast: float = param(5.0, doc="ratio of the light of white and of black [A]", low=1, low_open=True)
    threshold: float = param(0.30, doc="change of log light per event, usually 0.2 to 0.3 [S]", low=0.02)
    mismatch: float = param(
        0.12, doc="log-normal spread of the threshold over pixels and polarities [A]", low=0, high=1
    )
    refractory_us: float = param(100.0, doc="dead time of a pixel after an event [A]", unit="us", low=0)
    noise_hz: float = param(0.1, doc="rate of background events of a pixel [A]", unit="Hz", low=0)
    noise_rms: float = param(
        0.0, doc="rms noise of log light; matters if it is close to the threshold", low=0
    )
    bandwidth_hz: float = param(
        3000.0, doc="bandwidth of the noise of log light [A]", unit="Hz", low=0, low_open=True
    )
    readout_mev_s: float = param(
        165.0, doc="largest event rate of the readout [M]", unit="million events/s", low=0, low_open=True
    )


@dataclass(frozen=True)
class Texture:
    """A surface: heights, softness and friction against the tip. All numbers of the shipped ones are [A]."""

    name: str = fixed(doc="class name")
    rms_um: float = param(doc="rms height", unit="um", low=0)
    wavelength_mm: float = param(doc="wavelength lambda0 of the random part", unit="mm", low=0, low_open=True)
    bandwidth_oct: float = param(doc="width B of its spectrum", unit="octaves", low=0, low_open=True)
    modulus_mpa: float = param(doc="modulus", unit="MPa", low=0, low_open=True)
    mu_static: float = param(doc="static friction", low=0)
    mu_kinetic: float = param(doc="kinetic friction, at most the static", low=0)
    stribeck_mm_s: float = param(doc="speed v_s over which static friction fades", unit="mm/s", low=0.01)
    slip_jitter: float = param(doc="log spread of the slip threshold", low=0)
    friction_roughness: float = param(doc="rms relative friction roughness eta along the path", low=0)
    grain: float = param(1.0, doc="anisotropy an of f' = hypot(fx, an fy); above 1: grain along y", low=0.01)
    weave_share: float = param(0.0, doc="share wf of the variance that is woven", low=0, high=1)
    weave_period_mm: float | None = param(None, doc="period of the weave", unit="mm", low=0.2)
    weave_angle_deg: float = param(0.0, doc="angle alpha of the first grating", unit="deg")
    pin_radius_mm: float | None = param(
        None,
        doc="radius of printed pins 1 mm high, gap as wide, in place of a random surface",
        unit="mm",
        low=0,
    )


class Motion(Protocol):
    """A velocity profile: a component of section `scene.motions`."""

    @property
    def label(self) -> str:
        """Class name: the given one, else made of kind and numbers."""

    @property
    def peak_mm_s(self) -> float:
        """Highest speed."""

    @property
    def duration_s(self) -> float:
        """Time after which the tip stands still; t counts from motion onset."""

    def speed(self, t_s: Floats) -> Floats:
        """Return the speed in mm/s at times (n,) within [0, duration_s]; callers set it to 0 outside."""


@dataclass(frozen=True)
class Variation:
    """How trials of one cell differ: standard deviations unless said otherwise, all [A]."""

    force_n: float = param(0.20, doc="of the force", unit="N", low=0)
    force_bound_n: float = param(0.5, doc="largest deviation of the force [S]", unit="N", low=0)
    force_drift: float = param(0.06, doc="of the relative drift of the force over the trial", low=0)
    start_x_mm: float = param(5.0, doc="half range of the start position along the motion", unit="mm", low=0)
    start_y_mm: float = param(2.5, doc="half range of the start position across the motion", unit="mm", low=0)
    mounting_px: float = param(0.4, doc="of the position of the image, in x and y", unit="px", low=0)
    mounting_deg: float = param(1.0, doc="of the rotation of the image", unit="deg", low=0)
    speed_gain: float = param(0.02, doc="of the log of the gain of the speed", low=0)
    ripple: float = param(0.05, doc="of the relative speed ripple", low=0)
    ripple_hz: tuple[float, float] = param(
        (8.0, 22.0), doc="range of the frequency of the speed ripple", unit="Hz", low=0
    )
    onset_ms: float = param(30.0, doc="earliest motion onset in the trial", unit="ms", low=0)
    onset_sd_ms: float = param(
        8.0, doc="of the delay of the motion onset; its magnitude is added", unit="ms", low=0
    )
    friction: float = param(0.05, doc="of the log of the factor on friction", low=0)
    modulus: float = param(0.08, doc="of the log of the factor on the modulus of the tip", low=0)


@dataclass(frozen=True)
class Method:
    """Steps of the fast method: speed against error (benchmarks/scene.py prints both)."""

    friction_step_ms: float = param(0.1, doc="time step of friction and motion", unit="ms", low=0.01, high=1)
    texture_step_ms: float = param(
        0.5, doc="time step of the texture filter of the skin", unit="ms", low=0.01, high=2
    )
    camera_step_ms: float = param(
        2.0, doc="time step at which the image of a moving pin is updated", unit="ms", low=0.01, high=4
    )
    skip_px: float = param(
        0.1, doc="the image of a pin that moved less than this is not updated", unit="px", low=0, high=1
    )
    turn_px: float = param(
        0.02,
        doc="the image of a pin that reversed after moving further than this is also updated at the reversal",
        unit="px",
        low=0,
        high=1,
    )

    def __post_init__(self) -> None:
        for fine, coarse in (("friction", "texture"), ("texture", "camera")):
            ratio = getattr(self, f"{coarse}_step_ms") / getattr(self, f"{fine}_step_ms")
            if ratio < 1 - 1e-9 or abs(ratio - round(ratio)) > 1e-6:
                raise ValueError(
                    f"{coarse}_step_ms must be a multiple of {fine}_step_ms, "
                    f"{getattr(self, f'{fine}_step_ms'):g} ms, got {getattr(self, f'{coarse}_step_ms'):g}"
                )


@dataclass(frozen=True)
class Scene:
    """Trials of every texture, motion and force.

    Trial k = ((texture * n_motions + motion) * n_forces + force) * trials + repetition. A range of randomised
    forces is the last force: each of its trials draws its own. What happens in a trial follows from the
    scene's seed and from the names of its own texture and motion, its force and its repetition: never from
    what else is in the scene.
    """

    name: str
    seed: int
    sensor: Sensor
    camera: Camera
    textures: tuple[Texture, ...]
    motions: tuple[Motion, ...]
    forces_n: tuple[float, ...]
    trials: int
    duration_ms: float
    variation: Variation
    method: Method
    randomised_force_n: tuple[float, float] | None = None

    @property
    def n_forces(self) -> int:
        return len(self.forces_n) + (self.randomised_force_n is not None)

    @property
    def n_trials(self) -> int:
        return len(self.textures) * len(self.motions) * self.n_forces * self.trials

    def cell(self, k: int) -> tuple[int, int, int, int]:
        """Return texture, motion, force and repetition of trial k.

        Raises:
            IndexError: there is no such trial.
        """
        if not 0 <= k < self.n_trials:
            raise IndexError(f"trial must be in [0, {self.n_trials}), got {k}")
        k, repetition = divmod(k, self.trials)
        k, force = divmod(k, self.n_forces)
        texture, motion = divmod(k, len(self.motions))
        return texture, motion, force, repetition
