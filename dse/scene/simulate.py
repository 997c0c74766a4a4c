"""A trial of a scene, by the fast method: an event list or a pooled raster, whichever is asked for.

1. stick, slip and travel of the skin: one degree of freedom, the whole record at once (friction.travel);
2. at marks, every texture step and wherever the skin turns: the texture filter of the pins in contact, and
   from it every pin's place in the image;
3. a look (camera.look) at each pin that has moved by more than `skip_px` since its last look, once in a
   camera step, and at each pin that has turned, where it turned: between two looks a pin moves straight;
4. background events.

Cost follows moving pins and events. While nothing slides nothing is computed but the background.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dse import seeds
from dse.native.compiled import compiled
from dse.preprocessing import Pooling, without_quiet
from dse.preprocessing.kernels import flush
from dse.records import Array, Block
from dse.scene import camera
from dse.scene.camera import EVENTS, N_TALLY, OVERFLOW, Sink
from dse.scene.scene import Scene, Sensor
from dse.scene.tip import SPREAD, image_px, lines, pins_mm, skin_filter
from dse.scene.trial import Trial, generator, path, speed, trial

VERSION = 1
"""Raised when the same scene gives other events than before."""

# A pin at rest is looked at again after so many camera steps; no event is older than that when it is sent.
_OLDEST = 16
_REACH_PX = 4.0  # step of the distance at rest below which pins are neighbours: neighbours are kept by it
_SETTLED_MM = 1e-6
_STILL_PX2 = 1e-12
_LEAST_THRESHOLD = 0.02  # of a pixel, whatever its mismatch: a level must be somewhere else than the next
_RADIX_BITS = 11
_RADIX = 1 << _RADIX_BITS
_24_BITS = np.uint64(0xFFFFFF)
_MEV_S = 4.0  # room for events, in millions per second; a trial that needs more is simulated again with more


@dataclass(frozen=True)
class Paths:
    """Where everything was in one trial, at n times a fixed step apart.

    t_s: (n,) from 0.
    px: (n, pin, 2) image centres of the pins, x and y in pixels of the frame.
    s_mm, x_mm, v_mm_s: (n,) deflection of the skin, slip distance, speed of the tip.
    radius_px, edge_px: of a pin's image.
    """

    t_s: Array
    px: Array
    s_mm: Array
    x_mm: Array
    v_mm_s: Array
    radius_px: float
    edge_px: float


@dataclass(frozen=True)
class Flags:
    """What a user should know of a trial beside its events.

    contact_saturated: the force would spread the contact beyond the rim.
    refractory_drops: events not sent because their pixel rested.
    lost_looks: looks at pins that had left the frame and its margin.
    looks: looks at pins in all, the work of the camera.
    """

    contact_saturated: bool
    refractory_drops: int
    lost_looks: int
    looks: int


class _Tip(NamedTuple):
    """The moving pins of a trial: those of the contact first.

    pin: (pin,) which pins of the sensor they are.
    rest_mm: (pin, 2). shear: (pin,). spread: (pin,) share of rest_mm by which the force's drift has
    moved a pin at the end. n_contact: pins that read the texture. start_mm: (2,).
    middle_px: (2,) where the axis of the dome is, pixel centres at whole numbers. scale: px/mm. lens: 1/mm2.
    lines, grid_mm: (pin of the contact, column, 2) float32 what each reads along the motion, mm; distance of
        columns.
    """

    pin: Array
    rest_mm: Array
    shear: Array
    spread: Array
    n_contact: int
    start_mm: Array
    middle_px: Array
    scale: float
    lens: float
    lines: Array
    grid_mm: float


class _Work(NamedTuple):
    """Work space of a trial: rows are moving pins, but for at_px, which holds all of the sensor."""

    f: Array
    before: Array
    now: Array
    place_px: Array
    seen_px: Array
    seen_d2: Array
    looked_us: Array
    at_px: Array
    near_px: Array
    ramp: Array


class _Steps(NamedTuple):
    """The method as the kernel reads it: times in us, the camera's step in friction steps."""

    friction_us: float
    n_camera: int
    camera_us: float
    skip_px: float
    turn_px: float
    duration_us: float


class _Events(NamedTuple):
    """A Block as a kernel takes it."""

    t_us: Array
    x: Array
    y: Array
    polarity: Array


class _Raster(NamedTuple):
    """Arrays of a raster: spikes per bin, their channels, and how many events make one."""

    counts: Array
    channels: Array
    needed: int


def events(scene: Scene, k: int) -> Block:
    """Return the events of trial k, background included, sorted by time, row, column and polarity."""
    return simulated(scene, k)[0]


def simulated(scene: Scene, k: int) -> tuple[Block, Flags]:
    """Return the events of trial k (see `events`), and what went on beside them."""
    drawn, background = trial(scene, k), noise(scene, k)
    capacity = int(_MEV_S * 1e3 * scene.duration_ms) + 1024
    while True:
        sink = _list_sink(capacity)
        tally = _run(
            scene, k, drawn, sink, background, _Raster(np.zeros(0, np.int64), np.zeros(0, np.int32), 1)
        )
        if not tally[OVERFLOW]:
            break
        capacity = int(tally[EVENTS]) + 1
    n = int(tally[EVENTS])
    parts = (background.t_us, background.x, background.y, background.polarity)
    t_us, x, y, polarity = (
        np.concatenate([seen[:n], other.astype(seen.dtype)])
        for seen, other in zip(sink[:4], parts, strict=True)
    )
    order = _in_order(t_us, y, x, polarity)
    block = Block(t_us[order].astype(np.int64), x[order], y[order], polarity[order])
    return block, Flags(
        drawn.contact.saturated, int(tally[camera.DROPPED]), int(tally[camera.LOST]), int(tally[camera.LOOKS])
    )


def raster(scene: Scene, k: int, pooling: Pooling, n_bins: int) -> tuple[Array, Array]:
    """Return the pooled raster of trial k: spikes per bin (n_bins,) int64, and their channels int32 in order.

    It equals `preprocessing.pool` of `events(scene, k)` bit for bit, without a list in between.
    """
    drawn, background = trial(scene, k), noise(scene, k)
    capacity = int(_MEV_S * 1e3 * scene.duration_ms / 4) + 2 * pooling.n_channels
    while True:
        sink = _raster_sink(scene, pooling, n_bins)
        counts, channels = np.zeros(n_bins, np.int64), np.empty(capacity, np.int32)
        tally = _run(scene, k, drawn, sink, background, _Raster(counts, channels, pooling.needed))
        if not tally[OVERFLOW]:
            break
        capacity *= 2
    return without_quiet(counts, channels[: counts.sum()].copy(), pooling)


def pin_paths(scene: Scene, k: int, step_ms: float) -> Paths:
    """Return where the pins of trial k are at 0, step_ms, 2 step_ms, ...; friction and skin at that step."""
    drawn, step_s = trial(scene, k), step_ms / 1000
    s, x = path(scene, k, drawn, step_s)
    tip = _tip(scene, drawn)
    drift = np.arange(len(s)) * step_s / (scene.duration_ms / 1000)
    rest = image_px(scene.sensor, drawn.pins_mm) + drawn.offset_px
    px = np.repeat(rest[None], len(s), axis=0)
    moved = np.empty((len(s), len(tip.pin), 2))
    work = [np.zeros((len(tip.pin), 2)) for _ in range(4)]
    _paths(tip, s, x, drift, *skin_filter(scene.sensor.corner_hz, step_s), *work, moved)
    px[:, tip.pin] = moved + 0.5  # from pixel centres at whole numbers to the corner of the frame
    t_s = np.arange(len(s)) * step_s
    v = speed(scene, k, drawn, t_s)
    return Paths(t_s, px, s, x, v, _radius_px(scene), scene.sensor.edge_px)


def thresholds(scene: Scene) -> Array:
    """Return the contrast thresholds (height, width, 2) float32 of the camera's pixels: OFF, ON."""
    return _camera(scene)[0]


def start_levels(scene: Scene, k: int) -> Array:
    """Return the phase (height, width) in (-1, 1) of each pixel's level at the start of trial k."""
    width, height = scene.sensor.frame_px
    return np.asarray(camera.start_phases(trial(scene, k).key, height, width))


def noise(scene: Scene, k: int) -> Block:
    """Return the background events of trial k: uniform in place and time, sorted by time.

    Their rate is noise_hz and, where noise of log light comes near the threshold, the rate at which it
    crosses it (Rice: bandwidth exp(-theta^2 / (2 rms^2))); a pixel cannot send more often than it rests, nor
    the frame more than the readout passes. Background events leave the levels of pixels as they are.
    """
    width, height = scene.sensor.frame_px
    key = int(generator(scene, k, "background").integers(2**63))
    per_us = background_hz(scene) * width * height * 1e-6
    return Block(*_poisson(key, per_us, round(scene.duration_ms * 1000), width, height))


def background_hz(scene: Scene) -> float:
    """Return the rate of background events of a pixel."""
    seen = scene.camera
    rate = seen.noise_hz
    if seen.noise_rms > 0:
        rate += seen.bandwidth_hz * float(np.exp(-((seen.threshold / seen.noise_rms) ** 2) / 2))
    if seen.refractory_us > 0:
        rate = min(rate, 1e6 / seen.refractory_us)
    width, height = scene.sensor.frame_px
    return min(rate, seen.readout_mev_s * 1e6 / (width * height))


def _radius_px(scene: Scene) -> float:
    return scene.sensor.pin_radius_mm * scene.sensor.image_scale_px_mm


def _camera(scene: Scene) -> tuple[Array, Array]:
    return _pixels(scene.seed, scene.sensor.frame_px, scene.camera.threshold, scene.camera.mismatch)


@functools.lru_cache(maxsize=4)
def _pixels(seed: int, frame_px: tuple[int, int], threshold: float, mismatch: float) -> tuple[Array, Array]:
    """Return thresholds off, on of every pixel, (height, width, 2) float32, and e^-off, e^on."""
    rng = seeds.generator(seed, {}, "camera")
    spread = np.exp(mismatch * rng.standard_normal((frame_px[1], frame_px[0], 2)))
    theta = np.maximum(_LEAST_THRESHOLD, threshold * spread).astype(np.float32)
    return theta, np.exp(theta * np.array([-1.0, 1.0], np.float32))


def _tip(scene: Scene, drawn: Trial) -> _Tip:
    """Return the pins that may move."""
    contact, sensor = drawn.contact, scene.sensor
    reads = np.flatnonzero(contact.pressure > 0)
    order = np.concatenate([reads, np.flatnonzero((contact.shear > 0) & (contact.pressure <= 0))])
    rest = drawn.pins_mm[order]
    r2 = (rest**2).sum(axis=1)
    spread = SPREAD * drawn.drift * np.exp(-r2 / max(contact.radius_mm, 1e-9) ** 2)
    surface = drawn.surface
    felt = np.empty((len(reads), surface.slope.shape[1], 2), np.float32)
    y_mm = rest[: len(reads), 1] + drawn.start_mm[1]
    scale = -drawn.tilt_mm * contact.pressure[reads]
    lines(surface.slope, surface.step_mm, y_mm, scale, len(reads), felt)
    return _Tip(
        order, rest, contact.shear[order], spread, len(reads), drawn.start_mm,
        np.array(sensor.frame_px) / 2 + drawn.offset_px - 0.5, sensor.image_scale_px_mm, sensor.lens_per_mm2,
        felt, surface.step_mm,
    )  # fmt: skip


def _run(
    scene: Scene, k: int, drawn: Trial, sink: Sink, background: Block, raster: _Raster
) -> Array:  # fmt: skip
    """Simulate a trial into a sink; return the camera's counters."""
    method, sensor = scene.method, scene.sensor
    tally = np.zeros(N_TALLY, np.int64)
    seen = _Events(background.t_us, background.x, background.y, background.polarity)
    friction_s = method.friction_step_ms / 1000
    s, x = path(scene, k, drawn, friction_s)
    # The force's drift spreads the pins by at most its share of r exp(-(r / a)^2): 0.43 a.
    spread_mm = SPREAD * abs(drawn.drift) * drawn.contact.radius_mm / np.sqrt(2 * np.e)
    if not (s.any() or x.any()) and spread_mm * sensor.image_scale_px_mm <= method.skip_px:
        _flushed(sink, seen, raster, tally, 0, 0, 0, np.inf)
        return tally
    tip = _tip(scene, drawn)
    n_texture = round(method.texture_step_ms / method.friction_step_ms)
    skin = _skin(sensor.corner_hz, friction_s, n_texture)
    first, neighbours = _neighbours(sensor, _reach_px(sensor, drawn, tip, float(s.max())))
    f, before, now, place_px, seen_px = np.zeros((5, len(tip.pin), 2))
    seen_d2, looked_us = np.zeros((2, len(tip.pin)))
    at_px = image_px(sensor, drawn.pins_mm) + drawn.offset_px - 0.5
    near_px = np.zeros((int(np.diff(first).max(initial=0)) + 1, 2))
    work = _Work(f, before, now, place_px, seen_px, seen_d2, looked_us, at_px, near_px, camera.ramp())
    steps = _Steps(
        1000 * method.friction_step_ms, round(method.camera_step_ms / method.friction_step_ms),
        1000 * method.camera_step_ms, method.skip_px, method.turn_px, 1000 * scene.duration_ms,
    )  # fmt: skip
    _trial(
        tip, work, s, x, _marks(s, n_texture), skin,
        camera.state(*_camera(scene), drawn.key, scene.camera.refractory_us),
        camera.light_of(_radius_px(scene), sensor.edge_px, scene.camera.contrast), sink, tally, first,
        neighbours, steps, seen, raster,
    )  # fmt: skip
    return tally


def _reach_px(sensor: Sensor, drawn: Trial, tip: _Tip, s_mm: float) -> float:
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
def _neighbours(sensor: Sensor, reach_px: float) -> tuple[Array, Array]:
    """Return where each pin's neighbours begin, (pin + 1,), and which they are: those nearer at rest."""
    at = image_px(sensor, pins_mm(sensor))
    near = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)) < reach_px
    np.fill_diagonal(near, False)
    return np.concatenate([[0], np.cumsum(near.sum(axis=1))]), np.ascontiguousarray(np.nonzero(near)[1])


@functools.lru_cache(maxsize=8)
def _skin(corner_hz: float, step_s: float, n: int) -> Array:
    """Return the texture filter's constants for 0 .. n steps, (n + 1, 3)."""
    return np.array([(1.0, 0.0, 0.0)] + [skin_filter(corner_hz, m * step_s) for m in range(1, n + 1)])


def _list_sink(capacity: int) -> Sink:
    none = np.zeros(0, np.int32)
    return Sink(
        np.empty(capacity, np.int32), np.empty(capacity, np.int32), np.empty(capacity, np.int32),
        np.empty(capacity, np.uint8), np.zeros((1, 0), np.uint64), np.zeros((1, 0), np.uint8),
        none, none, none, none, 0, 0, 1, -1, 0, 0, 1, 0,
    )  # fmt: skip


def _raster_sink(scene: Scene, pooling: Pooling, n_bins: int) -> Sink:
    none = np.zeros(0, np.int32)
    held_us = (_OLDEST + 1) * scene.method.camera_step_ms * 1000
    slots = 1 << (int(np.ceil(held_us / pooling.bin_us)) + 1).bit_length()
    n_counts = pooling.n_channels if pooling.needed > 1 else 0
    return Sink(
        none, none, none, np.zeros(0, np.uint8),
        np.zeros((slots, (pooling.n_channels + 63) // 64), np.uint64), np.zeros((slots, n_counts), np.uint8),
        pooling.first_x, pooling.n_x, pooling.first_y, pooling.n_y, pooling.width, pooling.height,
        pooling.poles, pooling.only, pooling.start_us, pooling.end_us, pooling.bin_us, n_bins,
    )  # fmt: skip


@compiled()
def _marks(s, n_texture):  # type: ignore[no-untyped-def]
    """Return the friction steps at which pins are placed, (mark, 2), and whether the skin turns there.

    They are every `n_texture`-th step, the last, and where s turns.
    """
    found = np.empty((len(s), 2), np.int64)
    n, last = 0, len(s) - 1
    for k in range(1, len(s)):
        turns = k < last and (s[k] - s[k - 1]) * (s[k + 1] - s[k]) < 0
        if k % n_texture == 0 or k == last or turns:
            found[n, 0], found[n, 1] = k, turns
            n += 1
    return found[:n]


@compiled(_nrt=False)
def _place(tip, i, s, f, drift, out):  # type: ignore[no-untyped-def]
    """Write the image centre of moving pin i to row i of out; f (pin, 2) is the filtered texture, mm."""
    x = tip.rest_mm[i, 0] * (1 + tip.spread[i] * drift) - tip.shear[i] * s + f[i, 0]
    y = tip.rest_mm[i, 1] * (1 + tip.spread[i] * drift) + f[i, 1]
    bend = tip.scale * (1 + tip.lens * (x * x + y * y))
    out[i, 0] = tip.middle_px[0] + bend * x
    out[i, 1] = tip.middle_px[1] + bend * y


@compiled(_nrt=False)
def _read(tip, x, target):  # type: ignore[no-untyped-def]
    """Write q_i T of every pin of the contact at slip distance x to target (pin, 2)."""
    points = tip.lines.shape[1]
    for i in range(tip.n_contact):
        place = (x + tip.start_mm[0] + tip.rest_mm[i, 0]) / tip.grid_mm
        low = np.floor(place)
        part = place - low
        a = int(low) & (points - 1)
        b = (a + 1) & (points - 1)
        for axis in range(2):
            here = tip.lines[i, a, axis]
            target[i, axis] = here + part * (tip.lines[i, b, axis] - here)


@compiled(_nrt=False)
def _advance(tip, moved, x, e, c0, c1, before, now, f):  # type: ignore[no-untyped-def]
    """Advance the texture filter by a step; return how far it is from rest, mm.

    Args:
        tip: the pins.
        moved: whether the slip distance changed.
        x: slip distance at the end of the step.
        e: filter constant (tip.skin_filter).
        c0: filter constant.
        c1: filter constant.
        before: (pin, 2) what the pins read at the beginning; becomes what they read at the end.
        now: (pin, 2) work space.
        f: (pin, 2) filtered, updated.
    """
    if moved:
        _read(tip, x, now)
    rest = 0.0
    for i in range(tip.n_contact):
        for axis in range(2):
            end = now[i, axis] if moved else before[i, axis]
            f[i, axis] = e * f[i, axis] + c0 * before[i, axis] + c1 * end
            rest = max(rest, abs(end - f[i, axis]))
            before[i, axis] = end
    return rest


@compiled(_nrt=False)
def _paths(tip, s, x, drift, e, c0, c1, before, now, f, at_px, out):  # type: ignore[no-untyped-def]
    """Write the image centres (step, pin, 2) of the moving pins; the other arrays are work space."""
    _read(tip, x[0], f)
    _read(tip, x[0], before)
    for k in range(len(s)):
        if k:
            _advance(tip, x[k] != x[k - 1], x[k], e, c0, c1, before, now, f)
        for i in range(len(tip.rest_mm)):
            _place(tip, i, s[k], f, drift[k], at_px)
            out[k, i, 0] = at_px[i, 0]
            out[k, i, 1] = at_px[i, 1]


@compiled(_nrt=False)
def _trial(  # type: ignore[no-untyped-def]
    tip, work, s, x, marks, skin, pixels, light, sink, tally, first, neighbours, method, background, raster,
):  # fmt: skip
    """Simulate a trial; see the module's docstring for the order of things.

    Args:
        tip: moving pins.
        work: work space; its at_px holds the centres of all pins at t = 0.
        s: (n + 1,) deflection of the skin.
        x: (n + 1,) slip distance.
        marks: see `_marks`.
        skin: (steps + 1, 3) constants of the texture filter for so many friction steps.
        pixels: state of the camera.
        light: image of a pin.
        sink: where events go.
        tally: counters.
        first: (pin + 1,) where each pin's neighbours begin.
        neighbours: pins that may come near.
        method: steps and distances.
        background: background events, sorted by time; used by a raster.
        raster: its arrays.
    """
    f, before, now, at_px, place_px, seen_px = (
        work.f, work.before, work.now, work.at_px, work.place_px, work.seen_px
    )  # fmt: skip
    n = len(tip.rest_mm)
    _read(tip, x[0], f)
    _read(tip, x[0], before)
    fastest_drift = 0.0
    for i in range(n):
        _place(tip, i, 0.0, f, 0.0, seen_px)
        at_px[tip.pin[i], 0], at_px[tip.pin[i], 1] = seen_px[i, 0], seen_px[i, 1]
        r = np.sqrt(tip.rest_mm[i, 0] ** 2 + tip.rest_mm[i, 1] ** 2)
        fastest_drift = max(fastest_drift, tip.scale * abs(tip.spread[i]) * r / method.duration_us)
    settled, awake, moved, drifted_us, before_us, old_mark = True, False, False, 0.0, 0.0, 0
    oldest_us = _OLDEST * method.camera_us
    n_background, filled, bin = 0, 0, 0
    skip2, turn2 = method.skip_px * method.skip_px, method.turn_px * method.turn_px
    for number in range(len(marks)):
        mark, turns = marks[number, 0], marks[number, 1] == 1
        ended = number == len(marks) - 1
        t_us = min(mark * method.friction_us, method.duration_us - 0.5)
        on_grid = mark % method.n_camera == 0 or ended
        slid = x[mark] != x[old_mark]
        if slid or not settled:
            steps = skin[mark - old_mark]
            rest = _advance(tip, slid, x[mark], steps[0], steps[1], steps[2], before, now, f)
            settled = not slid and rest < _SETTLED_MM
        moves = slid or not settled or s[mark] != s[old_mark]
        stops = moved and not moves  # what is left below `skip` is looked at now: nothing would come later
        drifts = on_grid and (t_us - drifted_us) * fastest_drift > method.skip_px
        if moves or stops or drifts or (ended and awake):
            drifted_us = t_us
            # Pins outside the contact follow the skin alone: between camera steps they turn where it does.
            for i in range(n if on_grid or turns or stops else tip.n_contact):
                _place(tip, i, s[mark], f, t_us / method.duration_us, place_px)
                cx, cy = place_px[i, 0], place_px[i, 1]
                pin = tip.pin[i]
                d2 = (cx - at_px[pin, 0]) ** 2 + (cy - at_px[pin, 1]) ** 2
                turned = d2 < work.seen_d2[i] and work.seen_d2[i] > turn2
                old = on_grid and t_us - work.looked_us[i] >= oldest_us
                due = d2 > skip2 if on_grid else turns and i >= tip.n_contact and d2 > turn2
                late = (old or stops or ended) and d2 > _STILL_PX2
                if turned or due or late:
                    if not awake:
                        camera.wake(pixels, light, at_px, first, neighbours, work.near_px)
                        awake = True
                    # Where it turned, unless it did not; then where it is, if that is far enough from there.
                    for present in range(0 if turned else 1, 2):
                        if present and turned:
                            d2 = (cx - at_px[pin, 0]) ** 2 + (cy - at_px[pin, 1]) ** 2
                            if not ((on_grid and d2 > skip2) or (late and d2 > _STILL_PX2)):
                                break
                        to_us = t_us if present else before_us
                        camera.look(
                            pixels, light, sink, tally, work.ramp, work.near_px, at_px, first, neighbours,
                            pin, max(work.looked_us[i], to_us - oldest_us), cx if present else seen_px[i, 0],
                            cy if present else seen_px[i, 1], to_us,
                        )  # fmt: skip
                        work.looked_us[i] = to_us
                        d2 = 0.0
                elif old:
                    work.looked_us[i] = t_us
                seen_px[i, 0], seen_px[i, 1], work.seen_d2[i] = cx, cy, d2
        moved, before_us, old_mark = moves, t_us, mark
        if on_grid and bin < len(raster.counts):
            bin, n_background, filled = _flushed(
                sink,
                background,
                raster,
                tally,
                bin,
                n_background,
                filled,
                np.inf if ended else t_us - oldest_us,
            )


@compiled(_nrt=False)
def _flushed(sink, background, raster, tally, bin, n_background, filled, until_us):  # type: ignore[no-untyped-def]
    """Finish the bins that end by a time: add their background, append their channels.

    Args:
        sink: slots of the bins.
        background: background events, sorted by time.
        raster: counts and channels to write.
        tally: counters.
        bin: first bin to finish.
        n_background: background events added so far.
        filled: channels written so far.
        until_us: no event before this time is still to come.

    Returns:
        bin, n_background and filled for the next call.
    """
    while bin < len(raster.counts):
        end_us = sink.start_us + (bin + 1) * sink.bin_us
        if end_us > until_us:
            break
        while n_background < len(background.t_us) and background.t_us[n_background] < end_us:
            camera.into_raster(
                sink, background.x[n_background], background.y[n_background],
                background.polarity[n_background], background.t_us[n_background],
            )  # fmt: skip
            n_background += 1
        if filled + sink.words.shape[1] * 64 > len(raster.channels):
            tally[OVERFLOW] += 1
            filled = 0
        upto = flush(
            bin & (len(sink.words) - 1), raster.needed, sink.words, sink.counts, raster.channels, filled
        )
        raster.counts[bin] = upto - filled
        filled = upto
        bin += 1
    return bin, n_background, filled


@compiled()
def _poisson(key, per_us, duration_us, width, height):  # type: ignore[no-untyped-def]
    """Return background events: times with exponential gaps, places and polarities uniform."""
    mean, gap_us = per_us * duration_us, 1 / per_us if per_us > 0 else np.inf
    capacity = int(mean + 8 * np.sqrt(mean)) + 64
    t, x, y = np.empty(capacity, np.int64), np.empty(capacity, np.int32), np.empty(capacity, np.int32)
    p = np.empty(capacity, np.uint8)
    n, now = 0, 0.0
    while per_us > 0 and n < capacity:
        now -= np.log(np.float32(camera.unit(camera.splitmix(key, 2 * n)))) * gap_us
        if now >= duration_us:
            break
        z = camera.splitmix(key, 2 * n + 1)
        column, row = (z >> np.uint64(40)) & _24_BITS, (z >> np.uint64(16)) & _24_BITS
        t[n], p[n] = int(now), z & np.uint64(1)
        x[n], y[n] = int(np.int64(column) * width * 2.0**-24), int(np.int64(row) * height * 2.0**-24)
        n += 1
    return t[:n].copy(), x[:n].copy(), y[:n].copy(), p[:n].copy()


@compiled()
def _in_order(t, y, x, p):  # type: ignore[no-untyped-def]
    """Return the order of events by time, row, column and polarity; times are not negative."""
    n = len(t)
    order, other = np.arange(n), np.empty(n, np.int64)
    most = t.max() if n else 0
    shift = 0
    while most >> shift:
        ends = np.zeros(_RADIX + 1, np.int64)
        for i in range(n):
            ends[((t[i] >> shift) & (_RADIX - 1)) + 1] += 1
        ends = np.cumsum(ends)
        for k in range(n):
            i = order[k]
            digit = (t[i] >> shift) & (_RADIX - 1)
            other[ends[digit]] = i
            ends[digit] += 1
        order, other = other, order
        shift += _RADIX_BITS
    for k in range(1, n):  # ties are few and short
        i, at = order[k], k
        while at > 0:
            j = order[at - 1]
            if t[j] != t[i] or (y[j], x[j], p[j]) <= (y[i], x[i], p[i]):
                break
            order[at] = j
            at -= 1
        order[at] = i
    return order
