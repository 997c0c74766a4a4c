"""The event camera as it is defined: the whole frame drawn every 0.1 ms, every pixel compared with its level.

    I(x, y) = I_b + (I_w - I_b) min(1, sum_i 1 / (1 + exp((d_i - r) / w))),   I_b = 1 / contrast,  I_w = 1
    L = ln I,   d_i: distance of the pixel's centre (x + 1/2, y + 1/2) from the present place of pin i

The light of all pins adds up and is never more than white. A pixel holds a level L_ref:

    t = 0        L_ref = L + phase theta, clamped to [ln I_b, ln I_w]; theta of OFF if phase > 0, else of ON
    ON           while L >= L_ref + theta_on:   L_ref += theta_on
    OFF          while L <= L_ref - theta_off:  L_ref -= theta_off
    when         between two frames L is linear in time; whole microseconds, rounded down
    dead time    an event less than t_ref after the last one sent is not sent; its L_ref moves all the same

This is slow and meant to be read. The fast camera of scenes is measured against it (benchmarks/scene.py).
"""

from __future__ import annotations

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Block, Floats
from dse.scene import background, simulate
from dse.scene.camera import phase
from dse.scene.scene import Camera, Scene
from dse.scene.trial import trial

STEP_MS = 0.1

_REACH_EDGES = 12  # a pin's light at r + 12 w is 6e-6 of white
_NEVER_US = -1e18


def events(scene: Scene, k: int, step_ms: float = STEP_MS) -> Block:
    """Return trial k as the definition sees it, background included, sorted by time, row and column."""
    paths = simulate.pin_paths(scene, k, step_ms)
    start = start_levels(scene, k)
    seen = camera(paths.t_s, paths.px, paths.radius_px, paths.edge_px, start, thresholds(scene), scene.camera)
    return in_order([seen, background.events(scene, k)])


def thresholds(scene: Scene) -> Floats:
    """Return the contrast thresholds (height, width, 2) float32 of the camera's pixels: OFF, ON."""
    return simulate.thresholds_and_gains(scene)[0]


def start_levels(scene: Scene, k: int) -> Floats:
    """Return the phase (height, width) in (-1, 1) of each pixel's level at the start of trial k."""
    width, height = scene.sensor.frame_px
    return np.asarray(start_phases(trial(scene, k).key, height, width))


@compiled()
def start_phases(key, height, width):  # type: ignore[no-untyped-def]
    """Return the start phases of all pixels, (height, width) float64."""
    phases = np.empty((height, width))
    for y in range(height):
        for x in range(width):
            phases[y, x] = phase(key, y * width + x)
    return phases


def camera(
    t_s: Floats,
    px: Floats,
    radius_px: float,
    edge_px: float,
    start: Floats,
    thresholds: Floats,
    camera: Camera,
    resets: Block | None = None,
) -> Block:
    """Return what the camera sends while pins move, without background; sorted by time, row and column.

    Args:
        t_s: (n,) times of the frames.
        px: (n, pin, 2) places of the pins, x and y in pixels from the top left corner of the frame.
        radius_px: radius r of a pin's image.
        edge_px: logistic scale w of its edge.
        start: (height, width) phase of each pixel's level in (-1, 1).
        thresholds: (height, width, 2), [..., 0] OFF, [..., 1] ON, in log light.
        camera: contrast and dead time.
        resets: background events, sorted by time, that set their pixel's level to its light as a real
            pixel's do; by definition they do not. This is how that simplification is measured.
    """
    none = np.zeros(0, np.int64)
    noise = (none, none, none) if resets is None else (resets.t_us, resets.x, resets.y)
    sent = _watch(
        1e6 * np.asarray(t_s, np.float64), np.ascontiguousarray(px, np.float64), radius_px, edge_px,
        1 / camera.contrast, camera.refractory_us, start.astype(np.float64), thresholds.astype(np.float64),
        *(a.astype(np.int64) for a in noise),
    )  # fmt: skip
    return in_order([Block(*sent)])


def frame(px: Floats, radius_px: float, edge_px: float, contrast: float, size: tuple[int, int]) -> Floats:
    """Return the light (height, width) of one frame, white is 1; `size` is (width, height), px (pin, 2)."""
    light = np.empty(size[::-1])
    _draw(np.ascontiguousarray(px, np.float64), radius_px, edge_px, 1 / contrast, light)
    return light


def in_order(blocks: list[Block]) -> Block:
    """Return the events of all blocks sorted by time, row, column, polarity."""
    t, x, y, p = (
        np.concatenate([getattr(b, name) for b in blocks]) for name in ("t_us", "x", "y", "polarity")
    )
    order = np.lexsort((p, x, y, t))
    return Block(t[order], x[order], y[order], p[order])


@compiled()
def _draw(px, radius, edge, dark, light):  # type: ignore[no-untyped-def]
    """Write the light of every pixel to `light` (height, width)."""
    height, width = light.shape
    reach = radius + _REACH_EDGES * edge
    light[:] = 0.0
    for i in range(len(px)):
        at_x, at_y = px[i, 0] - 0.5, px[i, 1] - 0.5
        for y in range(max(0, int(np.ceil(at_y - reach))), min(height, int(np.floor(at_y + reach)) + 1)):
            for x in range(max(0, int(np.ceil(at_x - reach))), min(width, int(np.floor(at_x + reach)) + 1)):
                d = np.sqrt((x - at_x) ** 2 + (y - at_y) ** 2)
                if d <= reach:
                    light[y, x] += 1 / (1 + np.exp((d - radius) / edge))
    for y in range(height):
        for x in range(width):
            light[y, x] = dark + (1 - dark) * min(1.0, light[y, x])


@compiled()
def _watch(  # type: ignore[no-untyped-def]
    t_us, px, radius, edge, dark, dead_us, phase, threshold, reset_us, reset_x, reset_y
):
    """Return t_us, x, y and polarity of the events between the frames, in the order of frames and pixels."""
    height, width = phase.shape
    light = np.empty((height, width))
    _draw(px[0], radius, edge, dark, light)
    drawn = light.copy()
    level = np.log(light)
    reference = np.empty((height, width))
    for y in range(height):
        for x in range(width):
            theta = threshold[y, x, 0] if phase[y, x] > 0 else threshold[y, x, 1]
            reference[y, x] = min(0.0, max(np.log(dark), level[y, x] + phase[y, x] * theta))
    last_us = np.full((height, width), _NEVER_US)
    sent = np.empty((1 << 16, 4), np.int64)
    n, n_reset = 0, 0
    for k in range(1, len(px)):
        _draw(px[k], radius, edge, dark, light)
        for y in range(height):
            for x in range(width):
                if light[y, x] == drawn[y, x]:
                    continue
                drawn[y, x] = light[y, x]
                before, now = level[y, x], np.log(light[y, x])
                level[y, x] = now
                while True:
                    if now >= reference[y, x] + threshold[y, x, 1]:
                        reference[y, x] += threshold[y, x, 1]
                        polarity = 1
                    elif now <= reference[y, x] - threshold[y, x, 0]:
                        reference[y, x] -= threshold[y, x, 0]
                        polarity = 0
                    else:
                        break
                    part = (reference[y, x] - before) / (now - before)
                    at_us = t_us[k - 1] + part * (t_us[k] - t_us[k - 1])
                    if at_us - last_us[y, x] < dead_us:
                        continue
                    last_us[y, x] = at_us
                    if n == len(sent):
                        longer = np.empty((2 * n, 4), np.int64)
                        longer[:n] = sent
                        sent = longer
                    sent[n, 0], sent[n, 1], sent[n, 2], sent[n, 3] = int(at_us), x, y, polarity
                    n += 1
        while n_reset < len(reset_us) and reset_us[n_reset] <= t_us[k]:
            y, x = reset_y[n_reset], reset_x[n_reset]
            reference[y, x] = level[y, x]
            n_reset += 1
    sent = sent[:n]
    columns, rows = sent[:, 1].astype(np.int32), sent[:, 2].astype(np.int32)
    return sent[:, 0].copy(), columns, rows, sent[:, 3].astype(np.uint8)
