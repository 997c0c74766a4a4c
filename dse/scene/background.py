"""Background events: uniform in place and time, whatever the pins do."""

from __future__ import annotations

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Block
from dse.scene.scene import Scene
from dse.scene.splitmix import splitmix, unit
from dse.scene.trial import generator

_24_BITS = np.uint64(0xFFFFFF)


def events(scene: Scene, k: int) -> Block:
    """Return the background events of trial k: uniform in place and time, sorted by time.

    Their rate is noise_hz and, where noise of log light comes near the threshold, the rate at which it
    crosses it (Rice: bandwidth exp(-theta^2 / (2 rms^2))); a pixel cannot send more often than it rests, nor
    the frame more than the readout passes. Background events leave the levels of pixels as they are.
    """
    width, height = scene.sensor.frame_px
    key = int(generator(scene, k, "background").integers(2**63))
    per_us = rate_hz(scene) * width * height * 1e-6
    return Block(*_poisson(key, per_us, round(scene.duration_ms * 1000), width, height))


def rate_hz(scene: Scene) -> float:
    """Return the rate of background events of a pixel."""
    camera = scene.camera
    rate = camera.noise_hz
    if camera.noise_rms > 0:
        rate += camera.bandwidth_hz * float(np.exp(-((camera.threshold / camera.noise_rms) ** 2) / 2))
    if camera.refractory_us > 0:
        rate = min(rate, 1e6 / camera.refractory_us)
    width, height = scene.sensor.frame_px
    return min(rate, camera.readout_mev_s * 1e6 / (width * height))


@compiled()
def _poisson(key, per_us, duration_us, width, height):  # type: ignore[no-untyped-def]
    """Return background events: times with exponential gaps, places and polarities uniform."""
    mean, gap_us = per_us * duration_us, 1 / per_us if per_us > 0 else np.inf
    capacity = int(mean + 8 * np.sqrt(mean)) + 64
    t, x, y = np.empty(capacity, np.int64), np.empty(capacity, np.int32), np.empty(capacity, np.int32)
    p = np.empty(capacity, np.uint8)
    n, now = 0, 0.0
    while per_us > 0 and n < capacity:
        now -= np.log(np.float32(unit(splitmix(key, 2 * n)))) * gap_us
        if now >= duration_us:
            break
        z = splitmix(key, 2 * n + 1)
        column, row = (z >> np.uint64(40)) & _24_BITS, (z >> np.uint64(16)) & _24_BITS
        t[n], p[n] = int(now), z & np.uint64(1)
        x[n], y[n] = int(np.int64(column) * width * 2.0**-24), int(np.int64(row) * height * 2.0**-24)
        n += 1
    return t[:n].copy(), x[:n].copy(), y[:n].copy(), p[:n].copy()
