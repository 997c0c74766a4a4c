"""Slowly and fast adapting receptors: a channel's value and its changes drive Izhikevich neurons.

Of channel x of a recording, with `low` and `high` learnt from training recordings and dt in seconds:

    V[t] = (x[t] - low) / (high - low)                   not clipped; 0 where high = low
    I_SA[t]  = gain gain_sa V[t]
    I_FA+[t] = gain gain_fa max(+(V[t] - V[t-1]) / dt, 0),   I_FA-[t] likewise of the falling part; 0 at t = 0

    low, high: 1st and 99th percentile of the channel over the windows of the training recordings, after the
    smoothing; smallest and largest value where those two coincide, as they do for sparse spikes. With
    `full_scale`, as published: 0 and that number, the largest value of the sensor.

The current is constant within a sensor step, which the neurons integrate in round(step / solver_ms) equal
steps, at least one (dse.engine.neurons.izhikevich states how they saturate). Every recording is encoded from
its first sample on, as a running sensor would encode it. SA carries the resting level: leave it out (`sa:
false`), or remove the mean (`window.remove_mean`), where the level gives a label away.

A channel has at most one spike per step, and a neuron may fire more often than the sensor samples: with
`spikes_per_step` k, copy j = 1 .. k of a receptor spikes in the steps in which it fired j times or more.
Further spikes are merged. Copies are planes: (j - 1) n_kinds + kind, the kinds being SA (if any), FA+, FA-.

Source: Rasouli et al., an extreme learning machine for texture recognition, Eq. (4) (REFERENCES.md). Its
gains of 50 (SA) and 5000 (FA) give currents of one size where its derivative is per ms: 5 here, per s.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar, Self

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Floats, Ints, Signals
from dse.base.registry import fixed, param, register
from dse.config.contracts import RunningEncoder
from dse.data.encoders.sampled import OneByOne, RunningAverage, smoothed
from dse.engine.neurons.izhikevich import FA, FLOOR_MV, METHODS, PEAK_MV, SA, A, B, C, D, Method

FA_RISING, FA_FALLING = "FA rising", "FA falling"
KINDS = ("SA", FA_RISING, FA_FALLING)
"""Names of the kinds, in the order of their planes."""


@register("encoders", "receptors")
@dataclasses.dataclass(frozen=True)
class Receptors(OneByOne):
    """Three receptors per channel: slowly adapting, fast adapting to rising and to falling values."""

    learns: ClassVar[bool] = True

    gain: float = param(1.0, low=0, doc="factor on the currents of all receptors; sets the spike rate")
    gain_sa: float = param(50.0, low=0, doc="current of SA (slowly adapting) receptors per normalised value")
    gain_fa: float = param(
        5.0, low=0, unit="s", doc="current of FA (fast adapting) receptors per normalised change per second"
    )
    full_scale: float | None = param(
        None,
        low=0,
        low_open=True,
        doc="largest possible value of the sensor: values are divided by it, as published (default: scaled "
        "by the range of each channel in training recordings)",
    )
    sa: bool = param(True, doc="include SA receptors, which signal the resting level")
    smoothing_ms: float = param(
        0.0, low=0, unit="ms", doc="length of a causal moving average of the signal before encoding; 0: none"
    )
    spikes_per_step: int = param(
        1,
        low=1,
        high=16,
        doc="largest number of spikes per sensor step; the k-th spike of a step has its "
        "own copy of the channels",
    )
    method: Method = param(  # noqa: RUF009
        "euler",
        choices=METHODS,
        doc="integration of the neuron equations; half_steps: the membrane "
        "potential advances in two half steps",
    )
    solver_ms: float = param(
        1.0,
        low=0,
        low_open=True,
        unit="ms",
        doc="approximate longest integration step; the published 1 ms loses a third of the spikes at 136 "
        "spikes/s",
    )
    low: tuple[float, ...] = fixed((), doc="fitted: the value of each channel that is normalised to 0")
    high: tuple[float, ...] = fixed((), doc="fitted: the value of each channel that is normalised to 1")

    def _copies(self) -> int:
        return (3 if self.sa else 2) * self.spikes_per_step

    def fitted(
        self, signals: Signals, first: Ints, n_steps: int, target: Ints, n_classes: int, train: Ints
    ) -> Self:
        """Return the encoder with the range of every channel: `full_scale`, or of training recordings."""
        if self.full_scale is not None:
            n = signals.n_channels
            return dataclasses.replace(self, low=(0.0,) * n, high=(float(self.full_scale),) * n)
        windows = (self._smooth(signals, int(i), int(first[i]), n_steps) for i in train)
        samples = np.concatenate([window.astype(np.float32) for window in windows])
        low, high = np.percentile(samples, (1, 99), axis=0)
        narrow = low == high
        low = np.where(narrow, samples.min(axis=0), low)
        high = np.where(narrow, samples.max(axis=0), high)
        return dataclasses.replace(self, low=tuple(low.tolist()), high=tuple(high.tolist()))

    def currents(self, values: Floats, step_ms: float) -> Floats:
        """Return the currents of all receptors, (step, kind x channel) float64, SA first.

        values: (step, channel) smoothed samples from a recording's first on.

        Raises:
            ValueError: the range is not known, or is that of other channels.
        """
        if len(self.low) != values.shape[1] or len(self.high) != values.shape[1]:
            raise ValueError(
                f"encoder receptors must be fitted to training recordings of {values.shape[1]} channels "
                f"first, got a range of {len(self.low)}"
            )
        low, span = np.array(self.low), np.subtract(self.high, self.low)
        level = (values - low) / np.where(span > 0, span, np.inf)
        change = np.diff(level, axis=0, prepend=level[:1]) / (step_ms / 1000)
        slow = [self.gain_sa * level] if self.sa else []
        fast = [self.gain_fa * np.maximum(sign * change, 0.0) for sign in (1, -1)]
        return np.asarray(self.gain * np.concatenate([*slow, *fast], axis=1))

    def solver_steps(self, step_ms: float) -> int:
        """Return how many steps the neurons take per sensor step."""
        return max(1, round(step_ms / self.solver_ms))

    def fire(self, current: Floats, step_ms: float, state: Floats) -> Ints:
        """Return how often each receptor fires in each step, (step, kind x channel); `state` moves on."""
        fired, steps = np.zeros(current.shape, dtype=np.int64), self.solver_steps(step_ms)
        half_steps = self.method == "half_steps"
        _fire(current, parameters(self.sa), step_ms / steps, steps, half_steps, state, fired)
        return fired

    def _encoded(self, signals: Signals, i: int, first: int, length: int) -> tuple[Ints, Ints]:
        current = self.currents(self._smooth(signals, i, 0, first + length), signals.step_ms)
        fired = self.fire(current, signals.step_ms, at_rest(parameters(self.sa), signals.n_channels))
        step, channel = self.copies(fired[first:])
        return np.bincount(step, minlength=length), channel

    def copies(self, fired: Ints) -> tuple[Ints, Ints]:
        """Return step and channel of every spike, given how often each receptor fired, (step, receptor)."""
        copies = fired[:, None, :] > np.arange(self.spikes_per_step)[:, None]
        step, channel = np.nonzero(copies.reshape(len(fired), -1))
        return step, channel

    def running(self, n_in: int, step_ms: float) -> RunningEncoder:
        """Return the encoder at the start of a recording."""
        self.currents(np.zeros((1, n_in)), step_ms)
        return _Running(self, n_in, step_ms)

    def _smooth(self, signals: Signals, i: int, first: int, length: int) -> Floats:
        """Return some steps of a recording, (step, channel) float64, smoothed from its first sample on."""
        values = smoothed(signals, i, first, length, self.smoothing_ms)
        if not np.isfinite(values).all():
            raise ValueError(f"recording {i} must hold finite numbers, got NaN or infinite ones")
        return values


def parameters(sa: bool) -> Floats:
    """Return a, b, c, d of the kinds of receptors, (kind, 4): SA (if any), FA+, FA-."""
    kinds = [*([SA] if sa else []), FA, FA]
    return np.array([(kind.a, kind.b, kind.c, kind.d) for kind in kinds])


class _Running:
    """Receptors within one recording: the running average, the last value and the states of the neurons."""

    def __init__(self, encoder: Receptors, n_in: int, step_ms: float) -> None:
        self._encoder, self._step_ms = encoder, step_ms
        self._state = at_rest(parameters(encoder.sa), n_in)
        self._smooth = RunningAverage(round(encoder.smoothing_ms / step_ms), n_in)
        self._last: Floats | None = None

    def step(self, values: Floats) -> Ints:
        now = self._smooth.step(values)
        last = now if self._last is None else self._last
        current = self._encoder.currents(np.stack([last, now]), self._step_ms)[1:]
        self._last = now
        fired = self._encoder.fire(current, self._step_ms, self._state)
        return self._encoder.copies(fired)[1].astype(np.int32)


def at_rest(kinds: Floats, n_in: int) -> Floats:
    """Return v and u of the receptors of every kind at the start of a recording, (kind, 2, channel)."""
    c, b = kinds[:, 2], kinds[:, 1]
    return np.repeat(np.stack([c, b * c], axis=1)[:, :, None], n_in, axis=2)


@compiled()
def _fire(current, kinds, step_ms, solver_steps, half_steps, state, fired):  # type: ignore[no-untyped-def]
    """Count the spikes of receptors in each sensor step, by dse.engine.neurons.izhikevich, into `fired`.

    Constants of a kind are numbers, not arrays: more arrays than these and the loop over its receptors is not
    vectorised. current, fired: (step, kind x receptor), fired int64. kinds: (kind, 4) a, b, c, d. state:
    (kind, 2, receptor) v and u, which become those after the last step. half_steps: whether v takes two half
    steps.
    """
    n = current.shape[1] // len(kinds)
    half = 0.5 * step_ms
    v, u = np.empty(n), np.empty(n)
    for kind in range(len(kinds)):
        a, b, c, d = kinds[kind, 0], kinds[kind, 1], kinds[kind, 2], kinds[kind, 3]
        v[:] = state[kind, 0]
        u[:] = state[kind, 1]
        for t in range(len(current)):
            now, count = current[t, kind * n : (kind + 1) * n], fired[t, kind * n : (kind + 1) * n]
            for _ in range(solver_steps):
                for k in range(n):
                    x, w, drive = v[k], u[k], D * now[k]
                    if half_steps:
                        x = _held(x + half * ((A * x + B) * x + C - w + drive))
                        x = x + half * ((A * x + B) * x + C - w + drive)
                        seen = _held(x)
                    else:
                        seen = x
                        x = x + step_ms * ((A * x + B) * x + C - w + drive)
                    w = w + step_ms * (a * (b * seen - w))
                    spiked = x >= PEAK_MV
                    v[k] = c if spiked else (x if x > FLOOR_MV else FLOOR_MV)
                    u[k] = w + d if spiked else w
                    count[k] += 1 if spiked else 0
        state[kind, 0] = v
        state[kind, 1] = u


@compiled(_nrt=False)
def _held(v):  # type: ignore[no-untyped-def]
    """Return v between floor and peak."""
    v = v if v > FLOOR_MV else FLOOR_MV
    return v if v < PEAK_MV else PEAK_MV
