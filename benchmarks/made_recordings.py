"""Recordings made by formulas, of kinds that nobody tunes for: sets of `benchmarks.yardstick`.

Each names what alone tells its classes, or how its shape is unusual: `rhythms` frequencies at random phases,
`bumps` the form of an event at a random time, `levels` means under drift, `orders` which of two channels is
first, `counts` how many events there were, `lags` by how much a channel follows another; `few_long` 15
recordings of 2 500 steps, `characters` 26 classes of 6, `wide` 300 channels, `pens` eight steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]
Rng = np.random.Generator


def rhythms(rng: Rng) -> Iterator[tuple[Array, str]]:
    t = np.arange(200)[:, None] * 0.005
    for k in range(8):
        hz = (2 + 1.6 * k) * rng.normal(1, 0.03) * (1 + 0.5 * np.arange(3))
        wave = np.sin(2 * np.pi * (hz * t + rng.uniform(size=3)))
        yield rng.uniform(0.5, 1.5, 3) * wave + rng.normal(0, 0.8, wave.shape), f"{k}"


def bumps(rng: Rng) -> Iterator[tuple[Array, str]]:
    rise = np.linspace(0, 1, int(rng.integers(32, 96)))
    for name, form in (("plateau", rise**0), ("rise", rise), ("fall", 1 - rise)):
        for channel in range(2):
            signal = rng.normal(0, 1, (160, 3))
            begin = int(rng.integers(16, 48))
            signal[begin : begin + len(form), channel] += (4 + rng.normal()) * form
            signal[begin : begin + len(form), 2] += 2 * rng.normal() * form
            yield signal, f"{name} {channel}"


def levels(rng: Rng) -> Iterator[tuple[Array, str]]:
    means = 300 + 20 * np.random.default_rng(5).normal(size=(5, 6))
    for k, mean in enumerate(means):
        drift = rng.normal(0, 1, (100, 6)).cumsum(axis=0)
        yield mean + rng.normal(0, 9, 6) + drift + rng.normal(0, 3, drift.shape), f"{k}"


def orders(rng: Rng) -> Iterator[tuple[Array, str]]:
    t = np.arange(150)
    for first in range(4):
        for second in {*range(4)} - {first}:
            signal = rng.normal(0, 0.4, (150, 4))
            at = int(rng.integers(10, 80))
            for channel, step in ((first, at), (second, at + int(rng.integers(10, 50)))):
                signal[:, channel] += rng.uniform(1, 2) * np.exp(-0.5 * ((t - step) / 4) ** 2)
            yield signal, f"{first} {second}"


def counts(rng: Rng) -> Iterator[tuple[Array, str]]:
    t = np.arange(240)
    for n in range(1, 6):
        signal = rng.normal(0, 0.25, (240, 2))
        apart = rng.multinomial(240 - 16 - 18 * (n - 1), np.full(n + 1, 1 / (n + 1)))
        for step in 8 + 18 * np.arange(n) + apart[:n].cumsum():
            signal += rng.uniform(0.7, 1.4, 2) * np.exp(-0.5 * ((t - step) / 3) ** 2)[:, None]
        yield signal, f"{n}"


def lags(rng: Rng) -> Iterator[tuple[Array, str]]:
    for lag in (0, 4, 8, 12):
        sound = _smooth(rng, 240, 1, 7)[:, 0]
        signal = np.stack([sound[20:220], sound[20 - lag : 220 - lag]], axis=1)
        yield signal + rng.normal(0, 0.5, signal.shape), f"{lag}"


def few_long(rng: Rng) -> Iterator[tuple[Array, str]]:
    for k in range(3):
        yield _smooth(rng, 2500, 4, 8 * 2**k) + 0.5 * _smooth(rng, 2500, 4, 3), f"{k}"


def characters(rng: Rng) -> Iterator[tuple[Array, str]]:
    fixed = np.random.default_rng(7)
    for k in range(26):
        yield _warped(rng, _smooth(fixed, 152, 3, 25).cumsum(axis=0) / 8, 152, 0.4), f"{k:02d}"


def wide(rng: Rng) -> Iterator[tuple[Array, str]]:
    fixed = np.random.default_rng(8)
    mixed = fixed.normal(size=(5, 300)) * (fixed.random((5, 300)) < 0.1)
    for k in range(4):
        sources = _warped(rng, _smooth(fixed, 120, 5, 15), 120, 0.3)
        yield sources @ mixed + rng.normal(0, 0.5, (120, 300)), f"{k}"


def pens(rng: Rng) -> Iterator[tuple[Array, str]]:
    fixed = np.random.default_rng(10)
    for k in range(10):
        drawn = _warped(rng, fixed.normal(0, 30, (24, 2)).cumsum(axis=0), 8, 12)
        yield np.rint(drawn.clip(-300, 300)), f"{k}"


MADE: dict[str, tuple[Callable[[Rng], Iterator[tuple[Array, str]]], int, float]] = {
    "rhythms": (rhythms, 30, 5.0),
    "bumps": (bumps, 30, 10.0),
    "levels": (levels, 30, 20.0),
    "orders": (orders, 20, 8.0),
    "counts": (counts, 40, 10.0),
    "lags": (lags, 50, 4.0),
    "few_long": (few_long, 5, 2.0),
    "characters": (characters, 6, 10.0),
    "wide": (wide, 12, 10.0),
    "pens": (pens, 150, 10.0),
}
"""Name -> recordings of one round, a signal (step, channel) and its class each; rounds; ms per step.

As many rounds test as train.
"""


def made(name: str, seed: int) -> tuple[Array, Array, Array, float]:
    """Return signals (recording, step, channel), classes, which of them train, and ms per step."""
    of_round, n_rounds, step_ms = MADE[name]
    rng = np.random.default_rng([seed, *name.encode()])
    rounds = [[*of_round(rng)] for _ in range(2 * n_rounds)]
    signals, labels = zip(*(one for each in rounds for one in each), strict=True)
    return np.stack(signals), np.array(labels), np.arange(len(labels)) < len(labels) // 2, step_ms


def _smooth(rng: Rng, n_steps: int, n_channels: int, width: int) -> Array:
    """Return noise of unit variance that changes within `width` steps, (step, channel)."""
    kernel = np.hanning(width + 2)[1:-1]
    noise = rng.normal(size=(n_steps + width, n_channels))
    whole = [np.convolve(x, kernel / np.linalg.norm(kernel), "same") for x in noise.T]
    return np.stack(whole, axis=1)[width // 2 : width // 2 + n_steps]


def _warped(rng: Rng, form: Array, n_steps: int, noise: float) -> Array:
    """Return a form at another pace and size, with noise, (step, channel)."""
    u = np.linspace(0, 1, n_steps)
    pace = u + 0.08 * np.sin(np.pi * u * rng.integers(1, 3)) * rng.normal()
    at = np.clip(pace * rng.normal(1, 0.05), 0, 1) * (len(form) - 1)
    signal = np.stack([np.interp(at, np.arange(len(form)), x) for x in form.T], axis=1)
    return signal * rng.normal(1, 0.1) + noise * _smooth(rng, n_steps, form.shape[1], 5)
