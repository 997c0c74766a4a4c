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
present places, is summed (at most I_w), and compared as light. The slow definition is scene.reference.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from dse.native.compiled import compiled
from dse.native.simd import LANES_16, bits, either, greater, load, lowest_bit, splat
from dse.preprocessing.kernels import add
from dse.records import Array

PAD = 32
"""Pixels of state around the frame, where pins may go and no event comes from."""

DISC = 6.2
"""Radius of a pin's disc beyond r, in units of w: light is 0.2 % of white there."""

EVENTS, DROPPED, OVERFLOW, LOST, LOOKS = range(5)
"""Places in `tally`: events sent, dropped in refractory time, not stored; looks at pins outside; looks."""

N_TALLY = 5
LEVEL, LAST, OFF_GAIN, ON_GAIN = range(4)
_RAMP = np.arange(16, dtype=np.float32)
_NEVER_NEAR = np.float32(-1.0)
_NEVER_FAR = np.float32(np.inf)
_TABLE = 8192
_LEAST_SHARE = 1e-5  # of white, where the logarithm's table ends; a disc ends at 2e-3


class Light(NamedTuple):
    """A pin's image.

    radius, edge, disc: in pixels; light beyond the disc is black.
    black: light without a pin; white is 1. top: light at the centre.
    white: (n,) share of white over squared distance, `per_px2` entries to a square pixel.
    distance2: (n,) float32 squared distance over light above black, `per_light` entries to white.
    """

    radius: float
    edge: float
    disc: float
    black: float
    top: float
    white: Array
    per_px2: float
    distance2: Array
    per_light: float


class Pixels(NamedTuple):
    """State of the frame's pixels, flat with PAD around, (height + 2 PAD) rows of `stride`.

    near, far: float32 squared distances at which the next ON and OFF come; near is infinite before the first
        look.
    own: (..., 4) float32 of each pixel, side by side for the cache: e^(L_ref), 0 before the first look; time
        of the last event sent, us; e^(-theta_off); e^(theta_on).
    theta: (height, width, 2) float32 thresholds theta_off, theta_on.
    gain: (height, width, 2) float32 e^(-theta_off), e^(theta_on).
    """

    near: Array
    far: Array
    own: Array
    theta: Array
    gain: Array
    stride: int
    width: int
    height: int
    key: int
    refractory_us: float


class Sink(NamedTuple):
    """Where events go: into an event list, or into the slots of a pooled raster.

    t_us, x, y, polarity: (capacity,) of an event list; without entries for a raster.
    words, counts: slots of bins as in preprocessing.kernels, a power of two of them.
    the rest: arrays and numbers of preprocessing.Pooling; bin b covers start_us + [b, b + 1) bin_us before
        end_us, of n_bins.
    """

    t_us: Array
    x: Array
    y: Array
    polarity: Array
    words: Array
    counts: Array
    first_x: Array
    n_x: Array
    first_y: Array
    n_y: Array
    pools_x: int
    pools_y: int
    poles: int
    only: int
    start_us: int
    end_us: int
    bin_us: int
    n_bins: int


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
    return Light(radius_px, edge_px, disc, black, top, white, per_px2, distance2, per_light)


@compiled(_nrt=False)
def splitmix(key, counter):  # type: ignore[no-untyped-def]
    """Return 64 random bits that follow from a key and a counter (splitmix64)."""
    z = np.uint64(key) + np.uint64(counter + 1) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@compiled(_nrt=False)
def unit(z):  # type: ignore[no-untyped-def]
    """Return 64 random bits as a number in (0, 1)."""
    return (np.int64(z >> np.uint64(12)) + 0.5) * 2.0**-52


@compiled(_nrt=False)
def phase(key, pixel):  # type: ignore[no-untyped-def]
    """Return the start phase of a pixel in (-1, 1)."""
    return 2 * unit(splitmix(key, pixel)) - 1


@compiled()
def start_phases(key, height, width):  # type: ignore[no-untyped-def]
    """Return the start phases of all pixels, (height, width) float64."""
    found = np.empty((height, width))
    for y in range(height):
        for x in range(width):
            found[y, x] = phase(key, y * width + x)
    return found


@compiled(inline="always", _nrt=False)
def _near(light, level):  # type: ignore[no-untyped-def]
    """Return the squared distance below which light is at least `level`; negative where it never is."""
    if level >= light.top:
        return _NEVER_NEAR
    return _distance2(light, level)


@compiled(inline="always", _nrt=False)
def _far(light, level):  # type: ignore[no-untyped-def]
    """Return the squared distance above which light is at most `level`; infinite where it never is."""
    if level <= light.black:
        return _NEVER_FAR
    return _distance2(light, level)


@compiled(inline="always", _nrt=False)
def _distance2(light, level):  # type: ignore[no-untyped-def]
    """Return D(level)^2 from the table; 0 above the light at the centre."""
    place = max(0.0, (level - light.black) * light.per_light)
    k = min(int(place), len(light.distance2) - 2)
    here = light.distance2[k]
    return here + np.float32(place - k) * (light.distance2[k + 1] - here)


@compiled(inline="always", _nrt=False)
def _set(pixels, light, at, level):  # type: ignore[no-untyped-def]
    """Set a pixel's level, and the distances of its next events."""
    pixels.own[at, LEVEL] = level
    pixels.near[at] = _near(light, level * pixels.own[at, ON_GAIN])
    pixels.far[at] = _far(light, level * pixels.own[at, OFF_GAIN])


@compiled(_nrt=False)
def _begin(pixels, light, at, x, y, white):  # type: ignore[no-untyped-def]
    """Give a pixel the state that it had at t = 0 under a share of white."""
    above = phase(pixels.key, y * pixels.width + x)
    theta = pixels.theta[y, x, 0] if above > 0 else pixels.theta[y, x, 1]
    level = (light.black + (1 - light.black) * min(1.0, white)) * np.exp(np.float32(above) * theta)
    own = pixels.own
    own[at, LAST] = -np.inf
    own[at, OFF_GAIN], own[at, ON_GAIN] = pixels.gain[y, x, 0], pixels.gain[y, x, 1]
    _set(pixels, light, at, min(1.0, max(light.black, level)))


@compiled(inline="always", _nrt=False)
def _near_pins(light, at_px, first, neighbours, i, cx, cy, near_px):  # type: ignore[no-untyped-def]
    """Write the centres of the pins whose discs overlap that of pin i at (cx, cy); return how many."""
    n = 0
    reach2 = 4 * light.disc * light.disc
    for k in range(first[i], first[i + 1]):
        px, py = at_px[neighbours[k], 0], at_px[neighbours[k], 1]
        if (px - cx) ** 2 + (py - cy) ** 2 < reach2:
            near_px[n, 0] = px
            near_px[n, 1] = py
            n += 1
    return n


@compiled(_nrt=False)
def wake(pixels, light, at_px, first, neighbours, near_px):  # type: ignore[no-untyped-def]
    """Give all pixels the state of t = 0; those that no pin lights get it at the first look.

    Args:
        pixels: arrays to fill.
        light: image of a pin.
        at_px: (pin, 2) centres at t = 0.
        first: (pin + 1,) where each pin's neighbours begin.
        neighbours: pins that may come near.
        near_px: (most neighbours, 2) work space.
    """
    for at in range(len(pixels.near)):
        pixels.near[at] = _NEVER_NEAR
        pixels.far[at] = _NEVER_FAR
    for y in range(pixels.height):
        for at in range((y + PAD) * pixels.stride + PAD, (y + PAD) * pixels.stride + PAD + pixels.width):
            pixels.near[at] = _NEVER_FAR
            pixels.own[at, LEVEL] = 0
    disc = light.disc
    for i in range(len(at_px)):
        px, py = at_px[i, 0], at_px[i, 1]
        n_near = _near_pins(light, at_px, first, neighbours, i, px, py, near_px)
        for y in range(max(0, int(np.ceil(py - disc))), min(pixels.height - 1, int(np.floor(py + disc))) + 1):
            half = np.sqrt(max(0.0, disc * disc - (y - py) ** 2))
            for x in range(
                max(0, int(np.ceil(px - half))), min(pixels.width - 1, int(np.floor(px + half))) + 1
            ):
                at = (y + PAD) * pixels.stride + x + PAD
                if pixels.own[at, LEVEL] == 0:
                    white = _white(light, (x - px) ** 2 + (y - py) ** 2)
                    for k in range(n_near):
                        d2 = (x - near_px[k, 0]) ** 2 + (y - near_px[k, 1]) ** 2
                        if d2 < disc * disc:
                            white += _white(light, d2)
                    _begin(pixels, light, at, x, y, white)


@compiled(inline="always", _nrt=False)
def _send(pixels, sink, tally, at, x, y, pole, t_us):  # type: ignore[no-untyped-def]
    """Send an event, unless its pixel rests."""
    if t_us - pixels.own[at, LAST] < pixels.refractory_us:
        tally[DROPPED] += 1
        return
    pixels.own[at, LAST] = t_us
    n = tally[EVENTS]
    tally[EVENTS] = n + 1
    stamp = int(t_us)
    if len(sink.t_us):
        if n >= len(sink.t_us):
            tally[OVERFLOW] += 1
            return
        sink.t_us[n] = stamp
        sink.x[n] = x
        sink.y[n] = y
        sink.polarity[n] = pole
        return
    into_raster(sink, x, y, pole, stamp)


@compiled(inline="always", _nrt=False)
def into_raster(sink, x, y, pole, stamp):  # type: ignore[no-untyped-def]
    """Count an event in the raster's slots."""
    if sink.only >= 0 and pole != sink.only:
        return
    since = stamp - sink.start_us
    if since < 0 or stamp >= sink.end_us:
        return
    b = int(since * (1.0 / sink.bin_us))  # a division costs more than the event; one off at a border
    if b * sink.bin_us > since:
        b -= 1
    elif (b + 1) * sink.bin_us <= since:
        b += 1
    if b < sink.n_bins:
        add(
            b & (len(sink.words) - 1), x, y, pole if sink.poles == 2 else 0, sink.first_x, sink.n_x,
            sink.first_y, sink.n_y, sink.pools_x, sink.pools_y, sink.words, sink.counts,
        )  # fmt: skip


@compiled(inline="always", _nrt=False)
def _crossed(pixels, light, sink, tally, at, x, y, d2, before2, t0, t1):  # type: ignore[no-untyped-def]
    """Send the events of a pixel whose squared distance to its pin went from before2 to d2 in a time."""
    if pixels.own[at, LEVEL] == 0:
        _begin(pixels, light, at, x, y, 0.0)
    near, far = pixels.near[at], pixels.far[at]
    if near < d2 < far:
        return
    rate = (t1 - t0) / (d2 - before2) if d2 != before2 else 0.0
    level, off, on = pixels.own[at, LEVEL], pixels.own[at, OFF_GAIN], pixels.own[at, ON_GAIN]
    pole = 1 if d2 <= near else 0
    while True:
        t = t0 + ((near if pole else far) - before2) * rate
        _send(pixels, sink, tally, at, x, y, pole, min(t1, max(t0, t)))
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
    pixels.own[at, LEVEL] = level
    pixels.near[at] = near
    pixels.far[at] = far


@compiled(inline="always", _nrt=False)
def _shared(pixels, light, sink, tally, at, x, y, white, white0, t0, t1):  # type: ignore[no-untyped-def]
    """Send the events of a pixel whose share of white went from white0 to white between two times."""
    if pixels.own[at, LEVEL] == 0:
        _begin(pixels, light, at, x, y, 0.0)
    level, off, on = pixels.own[at, LEVEL], pixels.own[at, OFF_GAIN], pixels.own[at, ON_GAIN]
    now = light.black + (1 - light.black) * min(1.0, white)
    if level * off < now < level * on:
        return
    before = np.log(light.black + (1 - light.black) * min(1.0, white0))
    rise = np.log(now) - before
    rate = (t1 - t0) / rise if rise != 0 else 0.0
    pole = 1 if now >= level * on else 0
    gain = on if pole else off
    while (now >= level * on) if pole else (now <= level * off):
        level *= gain
        t = t0 + (np.log(level) - before) * rate
        _send(pixels, sink, tally, at, x, y, pole, min(t1, max(t0, t)))
    _set(pixels, light, at, level)


@compiled(inline="always", _nrt=False)
def _white(light, d2):  # type: ignore[no-untyped-def]
    """Return the share of white at a squared distance within a disc, from the table."""
    place = d2 * light.per_px2
    k = min(int(place), len(light.white) - 2)
    return light.white[k] + (place - k) * (light.white[k + 1] - light.white[k])


@compiled(inline="always", _nrt=False)
def _pass(  # type: ignore[no-untyped-def]
    pixels, light, sink, tally, ramp, near_px, n_near, ox, oy, t0, cx, cy, t1
):
    """Look at the disc of a pin that moved straight from (ox, oy) to (cx, cy), at most a pixel."""
    disc = light.disc
    left, right = int(np.ceil(cx - disc)), int(np.floor(cx + disc))
    top, bottom = int(np.ceil(cy - disc)), int(np.floor(cy + disc))
    if left < -PAD or right + 16 > pixels.width + PAD or top < -PAD or bottom >= pixels.height + PAD:
        tally[LOST] += 1
        return
    lanes = load(ramp, 0, LANES_16)
    disc2 = np.float32(disc * disc)
    inside = splat(disc2, lanes)
    for start in range(left, right + 1, 16):
        dx = lanes + splat(np.float32(start - cx), lanes)
        dx2 = dx * dx
        for y in range(top, bottom + 1):
            gy = y - cy
            d2 = dx2 + splat(np.float32(gy * gy), lanes)
            at = (y + PAD) * pixels.stride + start + PAD
            crossed = either(
                greater(load(pixels.near, at, LANES_16), d2), greater(d2, load(pixels.far, at, LANES_16))
            )
            covered = bits(greater(inside, d2))
            found = bits(crossed) & covered
            if n_near:
                both = np.uint64(0)
                for k in range(n_near):
                    ny = y - near_px[k, 1]
                    if ny * ny < disc2:
                        nx = lanes + splat(np.float32(start - near_px[k, 0]), lanes)
                        both |= bits(greater(splat(np.float32(disc2 - ny * ny), lanes), nx * nx))
                both &= covered
                if 0 <= y < pixels.height:
                    found &= ~both
                    while both:
                        lane = lowest_bit(both)
                        both &= both - np.uint64(1)
                        x = start + lane
                        if 0 <= x < pixels.width:
                            others = 0.0
                            for k in range(n_near):
                                nx, ny = x - near_px[k, 0], y - near_px[k, 1]
                                nd2 = nx * nx + ny * ny
                                if nd2 < disc2:
                                    others += _white(light, nd2)
                            gx = x - cx
                            white = others + _white(light, gx * gx + gy * gy)
                            gx, hy = x - ox, y - oy
                            white0 = others + _white(light, gx * gx + hy * hy)
                            _shared(pixels, light, sink, tally, at + lane, x, y, white, white0, t0, t1)
            while found:
                lane = lowest_bit(found)
                found &= found - np.uint64(1)
                x = start + lane
                gx, hx, hy = x - cx, x - ox, y - oy
                _crossed(
                    pixels, light, sink, tally, at + lane, x, y, np.float32(gx * gx + gy * gy),
                    hx * hx + hy * hy, t0, t1,
                )  # fmt: skip


@compiled(inline="always", _nrt=False)
def look(  # type: ignore[no-untyped-def]
    pixels, light, sink, tally, ramp, near_px, at_px, first, neighbours, i, t0, cx, cy, t1
):
    """Move pin i straight to (cx, cy) between two times, and send the events of the pixels that see it.

    Args:
        pixels: state of the frame.
        light: image of a pin.
        sink: where events go.
        tally: (N_TALLY,) int64 counters.
        ramp: (16,) float32 0, 1, ...
        near_px: (most neighbours, 2) work space.
        at_px: (pin, 2) present centres; row i is moved.
        first: (pin + 1,) where each pin's neighbours begin.
        neighbours: pins that may come near.
        i: the pin.
        t0: time of its last look, us.
        cx: new column of its centre.
        cy: new row of its centre.
        t1: present time, us.
    """
    tally[LOOKS] += 1
    ox, oy = at_px[i, 0], at_px[i, 1]
    dx, dy = cx - ox, cy - oy
    n = max(1, int(np.ceil(np.sqrt(dx * dx + dy * dy))))
    for part in range(n):
        a, b = part / n, (part + 1) / n
        n_near = _near_pins(light, at_px, first, neighbours, i, ox + b * dx, oy + b * dy, near_px)
        _pass(
            pixels, light, sink, tally, ramp, near_px, n_near, ox + a * dx, oy + a * dy, t0 + a * (t1 - t0),
            ox + b * dx, oy + b * dy, t0 + b * (t1 - t0),
        )  # fmt: skip
    at_px[i, 0] = cx
    at_px[i, 1] = cy


def state(theta: Array, gain: Array, key: int, refractory_us: float) -> Pixels:
    """Return the pixels of a camera with nothing in them yet.

    Args:
        theta: (height, width, 2) float32 thresholds, OFF and ON.
        gain: (height, width, 2) float32 e^(-theta_off), e^(theta_on).
        key: of the trial.
        refractory_us: dead time.
    """
    height, width = theta.shape[:2]
    stride = width + 2 * PAD
    n = (height + 2 * PAD) * stride
    near, far = np.empty(n, dtype=np.float32), np.empty(n, dtype=np.float32)
    own = np.empty((n, 4), dtype=np.float32)
    return Pixels(near, far, own, theta, gain, stride, width, height, key, refractory_us)


def ramp() -> Array:
    """Return what `look` takes as `ramp`."""
    return _RAMP
