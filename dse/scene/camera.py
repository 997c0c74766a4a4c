"""The event camera, fast: level crossings around moved pins in closed form.

    I(d) = I_b + (I_w - I_b) / (1 + exp((d - r) / w)),   d = |pixel - centre of the pin|
    I_w = 1,   I_b = 1 / contrast

A pixel sends ON when ln I >= L_ref + theta_on, and L_ref rises by theta_on; OFF alike. I falls with d, so a
level is a distance: D(I) = r - w ln((I - I_b) / (I_w - I)). Of each pixel the squares of the two next
distances are kept; to test it are two comparisons of d^2, 16 pixels at a time. Levels are kept as e^(L_ref)
and multiplied by e^(+-theta).

At t = 0, L_ref = ln I + phase theta, phase in (-1, 1), theta that of OFF above ln I and of ON below it,
clamped to [ln I_b, ln I_w]. Within the refractory time of a pixel's last event its level still moves but no
event is sent (ESIM). Dark pixels have no state before a pin comes near; nothing happens before a pin moves.

A pin's pixels are those of the disc d <= r + 6.2 w; where discs overlap the light of neighbours, at their
present places, is summed (at most I_w), and compared as light. The slow definition is
benchmarks/scene_reference.py.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.native.simd import LANES_16, bits, either, greater, load, lowest_bit, splat
from dse.base.records import Block, Floats, Ints
from dse.scene.splitmix import splitmix, unit

PAD = 32
"""Pixels of state around the frame, where pins may go and no event comes from."""

DISC = 6.2
"""Radius of a pin's disc beyond r, in units of w: light is 0.2 % of white there."""

EVENTS, DROPPED, LOST, LOOKS = range(4)
"""Places in `tally`: events sent, dropped in refractory time; looks at pins outside; looks."""

LEVEL, LAST, OFF_GAIN, ON_GAIN = range(4)
_RAMP = np.arange(16, dtype=np.float32)
_NEVER_NEAR = np.float32(-1.0)
_NEVER_FAR = np.float32(np.inf)
_TABLE = 8192
_LEAST_SHARE = 1e-5  # of white, where the logarithm's table ends; a disc ends at 2e-3


class Light(NamedTuple):
    """A pin's image.

    disc: radius in pixels; light beyond it is black.
    black: light without a pin; white is 1. top: light at the centre.
    white: (n,) share of white over squared distance, `per_px2` entries to a square pixel.
    distance2: (n,) float32 squared distance over light above black, `per_light` entries to white.
    """

    disc: float
    black: float
    top: float
    white: Floats
    per_px2: float
    distance2: Floats
    per_light: float


class Pixels(NamedTuple):
    """State of the frame's pixels, flat with PAD around, (height + 2 PAD) rows of `stride`.

    near, far: float32 squared distances at which the next ON and OFF come; near is infinite before the first
        look.
    state: (..., 4) float32, side by side for the cache: e^(L_ref), 0 before the first look; time of the last
        event sent, us; e^(-theta_off); e^(theta_on).
    theta: (height, width, 2) float32 thresholds theta_off, theta_on.
    gain: (height, width, 2) float32 e^(-theta_off), e^(theta_on).
    """

    near: Floats
    far: Floats
    state: Floats
    theta: Floats
    gain: Floats
    stride: int
    width: int
    height: int
    key: int
    refractory_us: float


class View(NamedTuple):
    """What a look works on.

    pixels, light: state of the frame, image of a pin.
    sent: (capacity,) int64 events: bits of time, us, then row, column and polarity, so that they sort as they
        are. row_bits, column_bits: how many of them address the frame.
    tally: (4,) int64 counters; where there are more events than `sent` holds, it holds the first.
    at_px: (pin, 2) present centres of all pins; a look moves its pin.
    first, neighbours: where each pin's neighbours begin, (pin + 1,), and which they are: pins that may come
        near.
    near_px: (most neighbours, 2) work space.
    ramp: (16,) float32 0, 1, ...
    """

    pixels: Pixels
    light: Light
    sent: Ints
    row_bits: int
    column_bits: int
    tally: Ints
    at_px: Floats
    first: Ints
    neighbours: Ints
    near_px: Floats
    ramp: Floats


class Leg(NamedTuple):
    """A straight piece of a pin's way: centre and time, us, at its beginning and at its end."""

    x0: float
    y0: float
    t0: float
    x1: float
    y1: float
    t1: float


@functools.lru_cache(maxsize=8)
def light_of(radius_px: float, edge_px: float, contrast: float) -> Light:
    """Return the image of a pin."""
    black = 1 / contrast
    disc = radius_px + DISC * edge_px
    most_px2 = (disc + 1) ** 2  # a pin's last place is at most a pixel away
    per_px2 = (_TABLE - 1) / most_px2
    d = np.sqrt(np.arange(_TABLE) / per_px2)
    white = 1 / (1 + np.exp((d - radius_px) / edge_px))
    top = black + (1 - black) / (1 + np.exp(-radius_px / edge_px))
    per_light = (_TABLE - 1) / (1 - black)
    share = np.clip(np.arange(_TABLE) / (_TABLE - 1), _LEAST_SHARE, 1 - _LEAST_SHARE)
    distance = np.maximum(0.0, radius_px - edge_px * np.log(share / (1 - share)))
    distance2 = (distance**2).astype(np.float32)
    return Light(disc, black, top, white, per_px2, distance2, per_light)


def view(
    theta: Floats,
    gain: Floats,
    key: int,
    refractory_us: float,
    light: Light,
    at_px: Floats,
    neighbours: tuple[Ints, Ints],
    capacity: int,
) -> View:
    """Return a camera before `wake`, with room for `capacity` events.

    theta, gain: (height, width, 2) float32 thresholds, OFF and ON; e^(-theta_off), e^(theta_on). key: of the
    trial. at_px: (pin, 2) centres of the pins at rest. neighbours: where those of each pin begin, and which
    they are.
    """
    height, width = theta.shape[:2]
    stride = width + 2 * PAD
    n = (height + 2 * PAD) * stride
    near, far = np.full(n, _NEVER_NEAR), np.full(n, _NEVER_FAR)
    near.reshape(-1, stride)[PAD:-PAD, PAD:-PAD] = _NEVER_FAR
    return View(
        pixels=Pixels(
            near, far, np.zeros((n, 4), np.float32), theta, gain, stride, width, height, key, refractory_us
        ),
        light=light,
        sent=np.empty(capacity, np.int64),
        row_bits=height.bit_length(),
        column_bits=width.bit_length(),
        tally=np.zeros(4, np.int64),
        at_px=at_px,
        first=neighbours[0],
        neighbours=neighbours[1],
        near_px=np.zeros((int(np.diff(neighbours[0]).max(initial=0)) + 1, 2)),
        ramp=_RAMP,
    )


def in_order(sent: Ints, more: Block, frame_px: tuple[int, int]) -> Block:
    """Return what a camera has sent (see `View`) and more events, by time, row, column and polarity."""
    column_bits, row_bits = (side.bit_length() for side in frame_px)
    row = more.t_us << row_bits | more.y
    packed = np.sort(np.concatenate([sent, (row << column_bits | more.x) << 1 | more.polarity]))
    row = packed >> 1 + column_bits
    return Block(
        row >> row_bits,
        (packed >> 1 & (1 << column_bits) - 1).astype(np.int32),
        (row & (1 << row_bits) - 1).astype(np.int32),
        (packed & 1).astype(np.uint8),
    )


@compiled(_nrt=False)
def phase(key, pixel):  # type: ignore[no-untyped-def]
    """Return the start phase of a pixel in (-1, 1)."""
    return 2 * unit(splitmix(key, pixel)) - 1


@compiled(_nrt=False)
def wake(view):  # type: ignore[no-untyped-def]
    """Give the pixels that a pin lights the state of t = 0; others get it at the first look."""
    for i in range(len(view.at_px)):
        _wake_disc(view, i)


@compiled(forceinline=True, _nrt=False)
def look(view, i, x, y, t0, t1):  # type: ignore[no-untyped-def]
    """Move pin i straight to (x, y) between two times, us, and send the events of the pixels that see it."""
    view.tally[LOOKS] += 1
    ox, oy = view.at_px[i, 0], view.at_px[i, 1]
    dx, dy = x - ox, y - oy
    n_legs = max(1, int(np.ceil(np.sqrt(dx * dx + dy * dy))))
    for k in range(n_legs):
        a, b = k / n_legs, (k + 1) / n_legs
        leg = Leg(
            ox + a * dx, oy + a * dy, t0 + a * (t1 - t0), ox + b * dx, oy + b * dy, t0 + b * (t1 - t0)
        )  # fmt: skip
        n_near = _near_pins(view, i, leg.x1, leg.y1)
        _look_at_disc(view, n_near, leg)
    view.at_px[i, 0] = x
    view.at_px[i, 1] = y


@compiled(forceinline=True, _nrt=False)
def _index(pixels, x, y):  # type: ignore[no-untyped-def]
    """Return the place of a pixel in the flat arrays."""
    return (y + PAD) * pixels.stride + x + PAD


@compiled(forceinline=True, _nrt=False)
def _near_pins(view, i, cx, cy):  # type: ignore[no-untyped-def]
    """Write the centres of the pins whose discs overlap that of pin i at (cx, cy); return how many."""
    n = 0
    reach2 = 4 * view.light.disc * view.light.disc
    for k in range(view.first[i], view.first[i + 1]):
        px, py = view.at_px[view.neighbours[k], 0], view.at_px[view.neighbours[k], 1]
        if (px - cx) ** 2 + (py - cy) ** 2 < reach2:
            view.near_px[n, 0] = px
            view.near_px[n, 1] = py
            n += 1
    return n


@compiled(_nrt=False)
def _wake_disc(view, i):  # type: ignore[no-untyped-def]
    """Give the pixels of a pin's disc the state of t = 0, unless another pin's disc has done so."""
    pixels, light, disc = view.pixels, view.light, view.light.disc
    px, py = view.at_px[i, 0], view.at_px[i, 1]
    n_near = _near_pins(view, i, px, py)
    for y in range(max(0, int(np.ceil(py - disc))), min(pixels.height - 1, int(np.floor(py + disc))) + 1):
        half = np.sqrt(max(0.0, disc * disc - (y - py) ** 2))
        left, right = max(0, int(np.ceil(px - half))), min(pixels.width - 1, int(np.floor(px + half)))
        for x in range(left, right + 1):
            at = _index(pixels, x, y)
            if pixels.state[at, LEVEL] == 0:
                white = _white(light, (x - px) ** 2 + (y - py) ** 2)
                for k in range(n_near):
                    d2 = (x - view.near_px[k, 0]) ** 2 + (y - view.near_px[k, 1]) ** 2
                    if d2 < disc * disc:
                        white += _white(light, d2)
                _begin(pixels, light, at, x, y, white)


@compiled(forceinline=True, _nrt=False)
def _look_at_disc(view, n_near, leg):  # type: ignore[no-untyped-def]
    """Send the events of the pixels in a pin's disc after a leg of at most a pixel, 16 to a strip."""
    pixels, disc = view.pixels, view.light.disc
    left, right = int(np.ceil(leg.x1 - disc)), int(np.floor(leg.x1 + disc))
    top, bottom = int(np.ceil(leg.y1 - disc)), int(np.floor(leg.y1 + disc))
    if left < -PAD or right + 16 > pixels.width + PAD or top < -PAD or bottom >= pixels.height + PAD:
        view.tally[LOST] += 1
        return
    lanes = load(view.ramp, 0, LANES_16)
    for start in range(left, right + 1, 16):
        dx = lanes + splat(np.float32(start - leg.x1), lanes)
        dx2 = dx * dx
        for y in range(max(0, top), min(pixels.height - 1, bottom) + 1):
            _look_at_strip(view, n_near, leg, start, y, lanes, dx2)


@compiled(forceinline=True, _nrt=False)
def _look_at_strip(view, n_near, leg, start, y, lanes, dx2):  # type: ignore[no-untyped-def]
    """Send the events of the 16 pixels of row y from column `start` on.

    All 16 are tested together; those that have an event, or see several pins, are then served one by one.
    Sets of them are bits, the lowest for the first pixel.
    """
    pixels, at = view.pixels, _index(view.pixels, start, y)
    gy = y - leg.y1
    d2 = dx2 + splat(np.float32(gy * gy), lanes)
    covered = bits(greater(splat(np.float32(view.light.disc * view.light.disc), lanes), d2))
    crossed = covered & bits(
        either(greater(load(pixels.near, at, LANES_16), d2), greater(d2, load(pixels.far, at, LANES_16)))
    )
    shared = covered & _in_other_discs(view, n_near, start, y, lanes)
    served = crossed | shared
    while served:
        lane = lowest_bit(served)
        served &= served - np.uint64(1)
        x = start + lane
        gx, gy, hx, hy = x - leg.x1, y - leg.y1, x - leg.x0, y - leg.y0
        now2, before2 = gx * gx + gy * gy, hx * hx + hy * hy
        if not shared >> np.uint64(lane) & np.uint64(1):
            _send_by_distance(view, at + lane, x, y, before2, np.float32(now2), leg.t0, leg.t1)
        elif 0 <= x < pixels.width:
            others = _white_of_others(view, n_near, x, y)
            white0, white = others + _white(view.light, before2), others + _white(view.light, now2)
            _send_by_light(view, at + lane, x, y, white0, white, leg.t0, leg.t1)


@compiled(forceinline=True, _nrt=False)
def _in_other_discs(view, n_near, start, y, lanes):  # type: ignore[no-untyped-def]
    """Return which of 16 pixels lie in the discs of pins nearby."""
    disc2 = np.float32(view.light.disc * view.light.disc)
    inside = np.uint64(0)
    for k in range(n_near):
        ny = y - view.near_px[k, 1]
        if ny * ny < disc2:
            nx = lanes + splat(np.float32(start - view.near_px[k, 0]), lanes)
            inside |= bits(greater(splat(np.float32(disc2 - ny * ny), lanes), nx * nx))
    return inside


@compiled(forceinline=True, _nrt=False)
def _white_of_others(view, n_near, x, y):  # type: ignore[no-untyped-def]
    """Return the share of white that pins nearby give a pixel."""
    disc2 = np.float32(view.light.disc * view.light.disc)
    white = 0.0
    for k in range(n_near):
        nx, ny = x - view.near_px[k, 0], y - view.near_px[k, 1]
        d2 = nx * nx + ny * ny
        if d2 < disc2:
            white += _white(view.light, d2)
    return white


@compiled(forceinline=True, _nrt=False)
def _send_by_distance(view, at, x, y, d2_before, d2, t0, t1):  # type: ignore[no-untyped-def]
    """Send the events of a pixel whose squared distance to its pin changed from d2_before to d2."""
    pixels, light = view.pixels, view.light
    if pixels.state[at, LEVEL] == 0:
        _begin(pixels, light, at, x, y, 0.0)
    near, far = pixels.near[at], pixels.far[at]
    if near < d2 < far:
        return
    rate = (t1 - t0) / (d2 - d2_before) if d2 != d2_before else 0.0
    level, off, on = pixels.state[at, LEVEL], pixels.state[at, OFF_GAIN], pixels.state[at, ON_GAIN]
    pole = 1 if d2 <= near else 0
    while True:
        t = t0 + ((near if pole else far) - d2_before) * rate
        _send(view, at, x, y, pole, min(t1, max(t0, t)))
        if pole:
            level *= on
            near = _near(light, level * on)
            if near < d2:
                far = _far(light, level * off)
                break
        else:
            level *= off
            far = _far(light, level * off)
            if far > d2:
                near = _near(light, level * on)
                break
    pixels.state[at, LEVEL] = level
    pixels.near[at] = near
    pixels.far[at] = far


@compiled(forceinline=True, _nrt=False)
def _send_by_light(view, at, x, y, white_before, white, t0, t1):  # type: ignore[no-untyped-def]
    """Send the events of a pixel whose share of white changed from white_before to white."""
    pixels, light = view.pixels, view.light
    if pixels.state[at, LEVEL] == 0:
        _begin(pixels, light, at, x, y, 0.0)
    level, off, on = pixels.state[at, LEVEL], pixels.state[at, OFF_GAIN], pixels.state[at, ON_GAIN]
    now = light.black + (1 - light.black) * min(1.0, white)
    if level * off < now < level * on:
        return
    before = np.log(light.black + (1 - light.black) * min(1.0, white_before))
    rise = np.log(now) - before
    rate = (t1 - t0) / rise if rise != 0 else 0.0
    pole = 1 if now >= level * on else 0
    gain = on if pole else off
    while (now >= level * on) if pole else (now <= level * off):
        level *= gain
        t = t0 + (np.log(level) - before) * rate
        _send(view, at, x, y, pole, min(t1, max(t0, t)))
    _set(pixels, light, at, level)


@compiled(forceinline=True, _nrt=False)
def _send(view, at, x, y, pole, t_us):  # type: ignore[no-untyped-def]
    """Send an event, unless its pixel is refractory."""
    pixels = view.pixels
    if t_us - pixels.state[at, LAST] < pixels.refractory_us:
        view.tally[DROPPED] += 1
        return
    pixels.state[at, LAST] = t_us
    n = view.tally[EVENTS]
    view.tally[EVENTS] = n + 1
    if n < len(view.sent):
        row = int(t_us) << view.row_bits | y
        view.sent[n] = (row << view.column_bits | x) << 1 | pole


@compiled(_nrt=False)
def _begin(pixels, light, at, x, y, white):  # type: ignore[no-untyped-def]
    """Give a pixel the state that it had at t = 0 under a share of white."""
    above = phase(pixels.key, y * pixels.width + x)
    theta = pixels.theta[y, x, 0] if above > 0 else pixels.theta[y, x, 1]
    level = (light.black + (1 - light.black) * min(1.0, white)) * np.exp(np.float32(above) * theta)
    state = pixels.state
    state[at, LAST] = -np.inf
    state[at, OFF_GAIN], state[at, ON_GAIN] = pixels.gain[y, x, 0], pixels.gain[y, x, 1]
    _set(pixels, light, at, min(1.0, max(light.black, level)))


@compiled(forceinline=True, _nrt=False)
def _set(pixels, light, at, level):  # type: ignore[no-untyped-def]
    """Set a pixel's level, and the distances of its next events."""
    pixels.state[at, LEVEL] = level
    pixels.near[at] = _near(light, level * pixels.state[at, ON_GAIN])
    pixels.far[at] = _far(light, level * pixels.state[at, OFF_GAIN])


@compiled(forceinline=True, _nrt=False)
def _near(light, level):  # type: ignore[no-untyped-def]
    """Return the squared distance below which light is at least `level`; negative where it never is."""
    if level >= light.top:
        return _NEVER_NEAR
    return _distance2(light, level)


@compiled(forceinline=True, _nrt=False)
def _far(light, level):  # type: ignore[no-untyped-def]
    """Return the squared distance above which light is at most `level`; infinite where it never is."""
    if level <= light.black:
        return _NEVER_FAR
    return _distance2(light, level)


@compiled(forceinline=True, _nrt=False)
def _distance2(light, level):  # type: ignore[no-untyped-def]
    """Return D(level)^2 from the table; 0 above the light at the centre."""
    place = max(0.0, (level - light.black) * light.per_light)
    k = min(int(place), len(light.distance2) - 2)
    here = light.distance2[k]
    return here + np.float32(place - k) * (light.distance2[k + 1] - here)


@compiled(forceinline=True, _nrt=False)
def _white(light, d2):  # type: ignore[no-untyped-def]
    """Return the share of white at a squared distance within a disc, from the table."""
    place = d2 * light.per_px2
    k = min(int(place), len(light.white) - 2)
    return light.white[k] + (place - k) * (light.white[k + 1] - light.white[k])
