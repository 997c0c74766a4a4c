"""How pins move in a trial, and when the camera looks at them; compiled.

A mark is a friction step at which pins are placed: every texture step, the last step, and wherever the skin
turns. At a mark the texture filter of the pins in contact advances, pins get their places in the image, and
those are looked at (`camera.look`) that

- have turned since their last look: where they turned, and where they are now if that is far enough from it;
- are more than `skip_px` from their last look, at a step of the camera;
- have moved at all, if their last look is old, or nothing moves any more, or the record ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Floats, Ints
from dse.scene import camera

_SETTLED_MM = 1e-6
_STILL_PX2 = 1e-12


class Tip(NamedTuple):
    """The moving pins of a trial: those of the contact first.

    pin: (pin,) which pins of the sensor they are.
    rest_mm: (pin, 2). shear: (pin,). spread: (pin,) share of rest_mm by which the force's drift has
    moved a pin at the end. n_contact: pins that read the texture. start_mm: (2,).
    middle_px: (2,) where the axis of the dome is, pixel centres at whole numbers. scale: px/mm. lens: 1/mm2.
    lines, grid_mm: (pin of the contact, column, 2) float32 what each reads along the motion, mm; distance of
        columns.
    """

    pin: Ints
    rest_mm: Floats
    shear: Floats
    spread: Floats
    n_contact: int
    start_mm: Floats
    middle_px: Floats
    scale: float
    lens: float
    lines: Floats
    grid_mm: float


class Pins(NamedTuple):
    """State of the moving pins; a row each.

    texture_mm, filtered_mm: (pin, 2) what a pin reads of the texture, and that behind the texture filter.
    next_mm: (pin, 2) work space.
    at_px: (pin, 2) place at the present mark.
    mark_px, mark_d2: (pin, 2), (pin,) place at the mark before, and its squared distance from the last look.
    looked_us: (pin,) time of the last look.
    """

    texture_mm: Floats
    filtered_mm: Floats
    next_mm: Floats
    at_px: Floats
    mark_px: Floats
    mark_d2: Floats
    looked_us: Floats


class Steps(NamedTuple):
    """The method as the kernel reads it: times in us, the camera's step in friction steps.

    oldest_us: a pin that moves is looked at again after that time.
    """

    friction_us: float
    n_camera: int
    oldest_us: float
    skip_px: float
    turn_px: float
    duration_us: float


class Moment(NamedTuple):
    """A mark: its time, that of the mark before, and what happens at it.

    s_mm: deflection of the skin.
    drift: share of the record that is over, and so of the force's drift.
    on_grid: it is a step of the camera. turns: the skin turns. stops: nothing moves any more, but did at the
    mark before. ends: it is the last.
    """

    t_us: float
    before_us: float
    s_mm: float
    drift: float
    on_grid: bool
    turns: bool
    stops: bool
    ends: bool


def at_rest(n: int) -> Pins:
    """Return the state of n moving pins before a trial."""
    texture_mm, filtered_mm, next_mm, at_px, mark_px = np.zeros((5, n, 2))
    mark_d2, looked_us = np.zeros((2, n))
    return Pins(texture_mm, filtered_mm, next_mm, at_px, mark_px, mark_d2, looked_us)


def marks(s: Floats, n_texture: int) -> Ints:
    """Return the friction steps at which pins are placed, (mark, 2), and whether the skin turns there.

    They are every `n_texture`-th step, the last, and where s turns.
    """
    turns = np.zeros(len(s), bool)
    rises = np.diff(s)
    turns[1:-1] = rises[:-1] * rises[1:] < 0
    steps = np.arange(len(s))
    chosen = steps[1:][turns[1:] | (steps[1:] % n_texture == 0) | (steps[1:] == len(s) - 1)]
    return np.stack([chosen, turns[chosen]], axis=1)


@compiled(_nrt=False)
def paths(tip, pins, s, x, drift, constants, out):  # type: ignore[no-untyped-def]
    """Write the image centres (step, pin, 2) of the moving pins at every friction step to `out`."""
    _read(tip, x[0], pins.filtered_mm)
    _read(tip, x[0], pins.texture_mm)
    for k in range(len(s)):
        if k:
            _filter(tip, pins, x[k] != x[k - 1], x[k], constants)
        for i in range(len(tip.rest_mm)):
            _place(tip, i, s[k], pins.filtered_mm, drift[k], pins.at_px)
            out[k, i, 0] = pins.at_px[i, 0]
            out[k, i, 1] = pins.at_px[i, 1]


@compiled(_nrt=False)
def walk(tip, pins, s, x, marks, skin, view, steps):  # type: ignore[no-untyped-def]
    """Simulate a trial, mark by mark (see the module's docstring), from pins at rest.

    s, x: (n + 1,) deflection of the skin and slip distance. skin: (steps + 1, 3) constants of the texture
    filter for so many friction steps. view: its at_px holds the centres of all pins at rest.
    """
    drift_px_us = _begin(tip, pins, view, steps, x[0])
    camera.wake(view)
    settled, moved = True, False
    drifted_us, before_us, before = 0.0, 0.0, 0
    for number in range(len(marks)):
        mark, turns = marks[number, 0], marks[number, 1] == 1
        ends = number == len(marks) - 1
        on_grid = mark % steps.n_camera == 0 or ends
        t_us = min(mark * steps.friction_us, steps.duration_us - 0.5)
        slides = x[mark] != x[before]
        if slides or not settled:
            lag_mm = _filter(tip, pins, slides, x[mark], skin[mark - before])
            settled = not slides and lag_mm < _SETTLED_MM
        moves = slides or not settled or s[mark] != s[before]
        stops = moved and not moves  # what is left below `skip` is looked at now: nothing would come later
        drifts = on_grid and (t_us - drifted_us) * drift_px_us > steps.skip_px
        if moves or stops or drifts or (ends and view.tally[camera.LOOKS]):
            drifted_us = t_us
            moment = Moment(
                t_us, before_us, s[mark], t_us / steps.duration_us, on_grid, turns, stops, ends
            )  # fmt: skip
            # Pins outside the contact follow the skin alone: between camera steps they turn where it does.
            for i in range(len(tip.rest_mm) if on_grid or turns or stops else tip.n_contact):
                _follow(tip, pins, view, steps, moment, i)
        moved, before_us, before = moves, t_us, mark


@compiled(forceinline=True, _nrt=False)
def _begin(tip, pins, view, steps, x):  # type: ignore[no-untyped-def]
    """Place the pins at t = 0; return the fastest movement by the force's drift, px/us."""
    _read(tip, x, pins.filtered_mm)
    _read(tip, x, pins.texture_mm)
    fastest = 0.0
    for i in range(len(tip.rest_mm)):
        _place(tip, i, 0.0, pins.filtered_mm, 0.0, pins.mark_px)
        view.at_px[tip.pin[i], 0], view.at_px[tip.pin[i], 1] = pins.mark_px[i, 0], pins.mark_px[i, 1]
        r = np.sqrt(tip.rest_mm[i, 0] ** 2 + tip.rest_mm[i, 1] ** 2)
        fastest = max(fastest, tip.scale * abs(tip.spread[i]) * r / steps.duration_us)
    return fastest


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
def _filter(tip, pins, slides, x, constants):  # type: ignore[no-untyped-def]
    """Advance the texture filter by a step to slip distance x; return how far it is from rest, mm.

    constants: (3,) of the filter (tip.skin_filter). slides: whether the slip distance changed.
    """
    e, c0, c1 = constants[0], constants[1], constants[2]
    texture, filtered = pins.texture_mm, pins.filtered_mm
    if slides:
        _read(tip, x, pins.next_mm)
    lag = 0.0
    for i in range(tip.n_contact):
        for axis in range(2):
            end = pins.next_mm[i, axis] if slides else texture[i, axis]
            filtered[i, axis] = e * filtered[i, axis] + c0 * texture[i, axis] + c1 * end
            lag = max(lag, abs(end - filtered[i, axis]))
            texture[i, axis] = end
    return lag


@compiled(_nrt=False)
def _place(tip, i, s, f, drift, out):  # type: ignore[no-untyped-def]
    """Write the image centre of moving pin i to row i of out; f (pin, 2) is the filtered texture, mm."""
    x = tip.rest_mm[i, 0] * (1 + tip.spread[i] * drift) - tip.shear[i] * s + f[i, 0]
    y = tip.rest_mm[i, 1] * (1 + tip.spread[i] * drift) + f[i, 1]
    bend = tip.scale * (1 + tip.lens * (x * x + y * y))
    out[i, 0] = tip.middle_px[0] + bend * x
    out[i, 1] = tip.middle_px[1] + bend * y


@compiled(forceinline=True, _nrt=False)
def _follow(tip, pins, view, steps, moment, i):  # type: ignore[no-untyped-def]
    """Place moving pin i and, if due, look at it: where it turned, at the mark before, or where it is."""
    _place(tip, i, moment.s_mm, pins.filtered_mm, moment.drift, pins.at_px)
    skip2, turn2 = steps.skip_px * steps.skip_px, steps.turn_px * steps.turn_px
    d2 = _from_last_look(tip, pins, view, i)
    turned = d2 < pins.mark_d2[i] and pins.mark_d2[i] > turn2
    outside = i >= tip.n_contact
    far = d2 > skip2 if moment.on_grid else moment.turns and outside and d2 > turn2
    old = moment.on_grid and moment.t_us - pins.looked_us[i] >= steps.oldest_us
    late = (old or moment.stops or moment.ends) and d2 > _STILL_PX2
    if turned or far or late:
        at_turn = turned
        while True:
            place_px = pins.mark_px if at_turn else pins.at_px
            t_us = moment.before_us if at_turn else moment.t_us
            since_us = max(pins.looked_us[i], t_us - steps.oldest_us)
            camera.look(view, tip.pin[i], place_px[i, 0], place_px[i, 1], since_us, t_us)
            pins.looked_us[i] = t_us
            d2 = _from_last_look(tip, pins, view, i)
            if not at_turn or not ((moment.on_grid and d2 > skip2) or (late and d2 > _STILL_PX2)):
                break
            at_turn = False
    elif old:
        pins.looked_us[i] = moment.t_us
    pins.mark_px[i, 0], pins.mark_px[i, 1], pins.mark_d2[i] = pins.at_px[i, 0], pins.at_px[i, 1], d2


@compiled(forceinline=True, _nrt=False)
def _from_last_look(tip, pins, view, i):  # type: ignore[no-untyped-def]
    """Return the squared distance of moving pin i from its last look."""
    dx, dy = pins.at_px[i, 0] - view.at_px[tip.pin[i], 0], pins.at_px[i, 1] - view.at_px[tip.pin[i], 1]
    return dx**2 + dy**2
