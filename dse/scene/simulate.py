"""A trial of a scene, by the fast method.

1. stick, slip and travel of the skin: one degree of freedom, the whole record at once (friction.travel);
2. at marks, every texture step and wherever the skin turns: the texture filter of the pins in contact, and
   from it every pin's place in the image (movement);
3. a look (camera.look) at each pin that has moved by more than `skip_px` since its last look, once in a
   camera step, and at each pin that has turned, where it turned: between two looks a pin moves straight;
4. background events (background).

Cost follows moving pins and events. While nothing slides nothing is computed but the background.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from dse.base import seeds
from dse.base.records import Block, Floats, Ints
from dse.scene import background, camera, movement
from dse.scene.scene import Scene, Sensor
from dse.scene.tip import SPREAD, image_px, lines, pins_mm, skin_filter
from dse.scene.trial import Trial, path, speed, trial

VERSION = 1
"""Raised when the same scene gives other events than before."""

# A pin at rest is looked at again after so many camera steps; no event is older than that when it is sent.
_OLDEST = 16
_REACH_PX = 4.0  # step of the distance at rest below which pins are neighbours: neighbours are kept by it
_LEAST_THRESHOLD = 0.02  # of a pixel, whatever its mismatch: a level must be somewhere else than the next
_MEV_S = 4.0  # room for events, in millions per second; a trial that needs more is simulated again with more


@dataclass(frozen=True)
class Paths:
    """Where everything was in one trial, at n times a fixed step apart.

    t_s: (n,) from 0.
    px: (n, pin, 2) image centres of the pins, x and y in pixels of the frame.
    s_mm, x_mm, v_mm_s: (n,) deflection of the skin, slip distance, speed of the tip.
    radius_px, edge_px: of a pin's image.
    """

    t_s: Floats
    px: Floats
    s_mm: Floats
    x_mm: Floats
    v_mm_s: Floats
    radius_px: float
    edge_px: float


@dataclass(frozen=True)
class Flags:
    """What a user should know of a trial beside its events.

    contact_saturated: the force would spread the contact beyond the rim.
    refractory_drops: events not sent because their pixel was refractory.
    lost_looks: looks at pins that had left the frame and its margin.
    looks: looks at pins in all, the work of the camera.
    """

    contact_saturated: bool
    refractory_drops: int
    lost_looks: int
    looks: int


def events(scene: Scene, k: int) -> Block:
    """Return the events of trial k, background included, sorted by time, row, column and polarity."""
    return simulated(scene, k)[0]


def simulated(scene: Scene, k: int) -> tuple[Block, Flags]:
    """Return the events of trial k (see `events`), and what went on beside them."""
    drawn, noise = trial(scene, k), background.events(scene, k)
    s, x = path(scene, k, drawn, scene.method.friction_step_ms / 1000)
    sent: Ints = np.zeros(0, np.int64)
    tally: Ints = np.zeros(4, np.int64)
    if not _rests(scene, drawn, s, x):
        capacity = int(_MEV_S * 1e3 * scene.duration_ms) + 1024
        sent, tally = _sent(scene, drawn, s, x, capacity)
        if tally[camera.EVENTS] > capacity:
            sent, tally = _sent(scene, drawn, s, x, int(tally[camera.EVENTS]))
    n, dropped, lost, looks = tally.tolist()
    block = camera.in_order(sent[:n], noise, scene.sensor.frame_px)
    return block, Flags(drawn.contact.saturated, dropped, lost, looks)


def pin_paths(scene: Scene, k: int, step_ms: float) -> Paths:
    """Return where the pins of trial k are at 0, step_ms, 2 step_ms, ...; friction and skin at that step."""
    drawn, step_s = trial(scene, k), step_ms / 1000
    s, x = path(scene, k, drawn, step_s)
    tip = _tip(scene, drawn)
    drift = np.arange(len(s)) * step_s / (scene.duration_ms / 1000)
    rest = image_px(scene.sensor, drawn.pins_mm) + drawn.offset_px
    px = np.repeat(rest[None], len(s), axis=0)
    moved = np.empty((len(s), len(tip.pin), 2))
    constants = np.array(skin_filter(scene.sensor.corner_hz, step_s))
    movement.paths(tip, movement.at_rest(len(tip.pin)), s, x, drift, constants, moved)
    px[:, tip.pin] = moved + 0.5  # from pixel centres at whole numbers to the corner of the frame
    t_s = np.arange(len(s)) * step_s
    v = speed(scene, k, drawn, t_s)
    return Paths(
        t_s=t_s,
        px=px,
        s_mm=s,
        x_mm=x,
        v_mm_s=v,
        radius_px=_radius_px(scene),
        edge_px=scene.sensor.edge_px,
    )


def _radius_px(scene: Scene) -> float:
    return scene.sensor.pin_radius_mm * scene.sensor.image_scale_px_mm


def thresholds_and_gains(scene: Scene) -> tuple[Floats, Floats]:
    """Return thresholds off, on of every pixel, (height, width, 2) float32, and e^-off, e^on."""
    return _drawn_thresholds(scene.seed, scene.sensor.frame_px, scene.camera.threshold, scene.camera.mismatch)


@functools.lru_cache(maxsize=4)
def _drawn_thresholds(
    seed: int, frame_px: tuple[int, int], threshold: float, mismatch: float
) -> tuple[Floats, Floats]:
    rng = seeds.generator(seed, {}, "camera")
    spread = np.exp(mismatch * rng.standard_normal((frame_px[1], frame_px[0], 2)))
    theta = np.maximum(_LEAST_THRESHOLD, threshold * spread).astype(np.float32)
    return theta, np.exp(theta * np.array([-1.0, 1.0], np.float32))


def _sent(scene: Scene, drawn: Trial, s: Floats, x: Floats, capacity: int) -> tuple[Ints, Ints]:
    """Return what the camera sends (`camera.View.sent`) as the skin moves by s and x, and its counters."""
    method, sensor = scene.method, scene.sensor
    tip = _tip(scene, drawn)
    view = camera.view(
        *thresholds_and_gains(scene), drawn.key, scene.camera.refractory_us,
        camera.light_of(_radius_px(scene), sensor.edge_px, scene.camera.contrast),
        image_px(sensor, drawn.pins_mm) + drawn.offset_px - 0.5,
        _neighbours(sensor, _reach_px(sensor, drawn, tip, float(s.max()))), capacity,
    )  # fmt: skip
    n_texture = round(method.texture_step_ms / method.friction_step_ms)
    skin = _skin(sensor.corner_hz, method.friction_step_ms / 1000, n_texture)
    steps = movement.Steps(
        friction_us=1000 * method.friction_step_ms,
        n_camera=round(method.camera_step_ms / method.friction_step_ms),
        oldest_us=_OLDEST * (1000 * method.camera_step_ms),
        skip_px=method.skip_px,
        turn_px=method.turn_px,
        duration_us=1000 * scene.duration_ms,
    )
    pins, marks = movement.at_rest(len(tip.pin)), movement.marks(s, n_texture)
    movement.walk(tip, pins, s, x, marks, skin, view, steps)
    return view.sent, view.tally


def _rests(scene: Scene, drawn: Trial, s: Floats, x: Floats) -> bool:
    """Return whether no pin moves by more than the camera's skip distance."""
    # The force's drift spreads the pins by at most its share of r exp(-(r / a)^2): 0.43 a.
    spread_mm = SPREAD * abs(drawn.drift) * drawn.contact.radius_mm / math.sqrt(2 * math.e)
    spread_px = spread_mm * scene.sensor.image_scale_px_mm
    return not (s.any() or x.any()) and bool(spread_px <= scene.method.skip_px)


def _tip(scene: Scene, drawn: Trial) -> movement.Tip:
    """Return the pins that may move."""
    contact, sensor = drawn.contact, scene.sensor
    reads = np.flatnonzero(contact.pressure > 0)
    order = np.concatenate([reads, np.flatnonzero((contact.shear > 0) & (contact.pressure <= 0))])
    rest = drawn.pins_mm[order]
    r2 = (rest**2).sum(axis=1)
    surface = drawn.surface
    y_mm = rest[: len(reads), 1] + drawn.start_mm[1]
    scale = -drawn.tilt_mm * contact.pressure[reads]
    return movement.Tip(
        pin=order,
        rest_mm=rest,
        shear=contact.shear[order],
        spread=SPREAD * drawn.drift * np.exp(-r2 / max(contact.radius_mm, 1e-9) ** 2),
        n_contact=len(reads),
        start_mm=drawn.start_mm,
        middle_px=np.array(sensor.frame_px) / 2 + drawn.offset_px - 0.5,
        scale=sensor.image_scale_px_mm,
        lens=sensor.lens_per_mm2,
        lines=lines(surface.slope, surface.step_mm, y_mm, scale),
        grid_mm=surface.step_mm,
    )


def _reach_px(sensor: Sensor, drawn: Trial, tip: movement.Tip, s_mm: float) -> float:
    """Return the distance at rest from which the discs of two pins never overlap in a trial.

    The texture moves each by what it reads at most; shear brings them together by no more than s, nor by more
    than their distance times the slope of its weight; the force's drift by a share of their distance.
    """
    read_mm = drawn.tilt_mm * drawn.surface.steepest * drawn.contact.pressure.max(initial=0.0)
    disc_mm = sensor.pin_radius_mm + camera.DISC * sensor.edge_px / sensor.image_scale_px_mm
    near_mm = (2 * disc_mm + 2 * read_mm) / (1 - min(0.9, SPREAD * abs(drawn.drift)))
    width_mm = sensor.rim_mm - drawn.contact.radius_mm
    reach_mm = near_mm + s_mm
    if s_mm < width_mm:
        reach_mm = min(reach_mm, near_mm / (1 - s_mm / width_mm))
    furthest = np.hypot(*tip.rest_mm.T).max(initial=0.0) + read_mm + s_mm
    bend = 1 + 3 * sensor.lens_per_mm2 * furthest**2
    return float(np.ceil(bend * reach_mm * sensor.image_scale_px_mm / _REACH_PX) * _REACH_PX)


@functools.lru_cache(maxsize=64)
def _neighbours(sensor: Sensor, reach_px: float) -> tuple[Ints, Ints]:
    """Return where each pin's neighbours begin, (pin + 1,), and which they are: those nearer at rest."""
    at = image_px(sensor, pins_mm(sensor))
    near = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)) < reach_px
    np.fill_diagonal(near, False)
    return np.concatenate([[0], np.cumsum(near.sum(axis=1))]), np.ascontiguousarray(np.nonzero(near)[1])


@functools.lru_cache(maxsize=8)
def _skin(corner_hz: float, step_s: float, n: int) -> Floats:
    """Return the texture filter's constants for 0 .. n steps, (n + 1, 3)."""
    return np.array([(1.0, 0.0, 0.0)] + [skin_filter(corner_hz, m * step_s) for m in range(1, n + 1)])
