"""Send-on-delta: a channel sends an event when it has moved by a threshold since the last one.

Of each channel and threshold theta, r is the last level sent, at first the recording's first sample, or, with
start 'mean', the channel's mean over the training recordings, rounded to the least threshold:

    d = x[t] - r;  where |d| >= theta: ON (d > 0) or OFF (d < 0) at t, and r moves

    reference 'value':  r = x[t]                                   send-on-delta (Miskowicz, Sensors 6, 2006)
    reference 'step':   r = r + sign(d) theta                      delta modulation, lags behind fast changes
    reference 'level':  r = r + sign(d) theta floor(|d| / theta)   levels crossed, several at once one spike

At most one spike per channel, threshold and sample. From the first sample on, a constant added to a channel
changes nothing; from the mean, the first spikes of a recording send the level that it rests at. ON and OFF
are spike channels of their own (polarity 'separate'), or one that says only that there was a change
('merged': half the inputs, for chips with few).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from dse.config.contracts import RunningEncoder
from dse.encoders.sampled import OneByOne
from dse.native.compiled import compiled
from dse.records import Floats, Ints, Signals
from dse.registry import fixed, param, register

REFERENCES = ("step", "value", "level")
POLARITIES = ("separate", "merged")
STARTS = ("sample", "mean")
_RULES = (*REFERENCES, "digits")  # the last that of `quantised`


class Deltas(OneByOne):
    """An encoder whose spikes say that a channel has moved by a threshold.

    thresholds, reference, polarity, start, means: as the parameters of `SendOnDelta`.
    """

    thresholds: tuple[float, ...]
    reference: str
    polarity: str
    start: str
    means: tuple[float, ...]

    @property
    def learns(self) -> bool:
        """Whether it learns the means of the channels."""
        return self.start == "mean"

    def fitted(
        self, signals: Signals, first: Ints, n_steps: int, target: Ints, n_classes: int, train: Ints
    ) -> Self:
        """Return the encoder with the means of the windows of the training recordings."""
        if not self.learns:
            return self
        begins = signals.offsets[train] + first[train]
        total = sum(signals.values[begin : begin + n_steps].sum(axis=0, dtype=np.float64) for begin in begins)
        least = min(self.thresholds)
        means = np.round(total / (len(train) * n_steps) / least) * least
        return replace(self, means=tuple(means.tolist()))  # type: ignore[type-var]

    def first_level(self, n_in: int) -> Floats | None:
        """Return the level that a recording begins at, (channel,) float64; None: its first sample.

        Raises:
            ValueError: the means have not been learnt, or are those of another number of channels.
        """
        if not self.learns:
            return None
        if len(self.means) != n_in:
            raise ValueError(f"encoder.start mean must know {n_in} means, got {len(self.means)}")
        return np.asarray(self.means, dtype=np.float64)

    def _copies(self) -> int:
        return len(self.thresholds) * (1 if self.polarity == "merged" else 2)

    def _encoded(self, signals: Signals, i: int, first: int, length: int) -> tuple[Ints, Ints]:
        thresholds = np.asarray(self.thresholds, dtype=np.float64)
        rule, merged = _RULES.index(self.reference), self.polarity == "merged"
        values = signals.values[signals.offsets[i] : signals.offsets[i + 1]]
        counts = np.zeros(length, dtype=np.int64)
        level = self.first_level(values.shape[1])
        level = values[0].astype(np.float64) if level is None else level
        return counts, _encode(values, level, thresholds, rule, merged, first, first + length, counts)

    def running(self, n_in: int, step_ms: float) -> RunningEncoder:
        """Return the encoder at the start of a recording."""
        return _Running(self, n_in)


@register("encoders", "send_on_delta")
@dataclass(frozen=True)
class SendOnDelta(Deltas):
    """ON and OFF spikes of each channel at each of several thresholds (Miskowicz, Sensors 6, 2006).

    Each recording is encoded from its first sample on, as a running sensor would encode it. Copy 2 k + p is
    of threshold k and polarity p (0 OFF, 1 ON); merged, copy k is of threshold k.
    """

    thresholds: tuple[float, ...] = param(
        (1.0, 2.0, 4.0, 8.0, 16.0),
        doc="send thresholds; each gets its own copy of the channels",
        unit="sensor units",
        low=0,
        low_open=True,
    )
    reference: str = param("step", doc="where the reference level moves at a spike", choices=REFERENCES)
    polarity: str = param(
        "separate", doc="ON and OFF spikes use separate channels, or share one (merged)", choices=POLARITIES
    )

    start: str = param(
        "sample",
        choices=STARTS,
        doc="level that a recording begins at: its first sample, or the mean of the training recordings, so "
        "that the level it rests at is sent too (a shortcut where sessions or placement set that level)",
    )
    means: tuple[float, ...] = fixed((), doc="fitted: of each channel, for start mean")

    def __post_init__(self) -> None:
        """Check what one value alone cannot say."""
        if not self.thresholds:
            raise ValueError("thresholds must hold at least one threshold, got []")


class _Running:
    """Send-on-delta within one recording; it holds the levels sent last."""

    def __init__(self, encoder: Deltas, n_in: int) -> None:
        self._thresholds = np.asarray(encoder.thresholds, dtype=np.float64)
        self._rule, self._merged = _RULES.index(encoder.reference), encoder.polarity == "merged"
        self._level = np.zeros((len(self._thresholds), n_in))
        self._sign = np.zeros(n_in, np.int8)
        self._channels = np.empty(len(self._thresholds) * n_in, np.int32)
        self._first = encoder.first_level(n_in)
        self._begun = False

    def step(self, values: Floats) -> Ints:
        if not self._begun:
            self._level[:] = values if self._first is None else self._first
            self._begun = True
        n = _send(
            values, self._thresholds, self._rule, self._merged, self._level, self._sign, True,
            self._channels, 0,
        )  # fmt: skip
        return self._channels[:n].copy()


@compiled()
def _send(values, thresholds, rule, merged, r, sign, is_kept, channels, filled):  # type: ignore[no-untyped-def]
    """Append the channels that spike at one sample; return their new end.

    Args:
        values: (channel,) the sample.
        thresholds: (threshold,).
        rule: place in `_RULES`.
        merged: whether ON and OFF are one channel.
        r: (threshold, channel) levels sent last, which move; of digits the first is that of all.
        sign: (channel,) int8, overwritten.
        is_kept: whether spikes are listed.
        channels: int32 with room for all that may spike.
        filled: where they begin.
    """
    n = len(values)
    for k in range(len(thresholds)):
        theta = thresholds[k]
        for c in range(n):
            x, at = np.float64(values[c]), 0 if rule == 3 else k
            d = x - r[at, c]
            sign[c] = 0
            if abs(d) >= theta:
                sign[c] = 1 if d > 0 else -1
                if rule == 1:
                    r[at, c] = x
                elif rule != 2:
                    r[at, c] += sign[c] * theta
                else:
                    r[at, c] += sign[c] * (theta * np.floor(abs(d) / theta))
        if is_kept and merged:
            for c in range(n):
                if sign[c] != 0:
                    channels[filled] = k * n + c
                    filled += 1
        elif is_kept:
            for c in range(n):
                if sign[c] < 0:
                    channels[filled] = 2 * k * n + c
                    filled += 1
            for c in range(n):
                if sign[c] > 0:
                    channels[filled] = (2 * k + 1) * n + c
                    filled += 1
    return filled


@compiled()
def _encode(values, level, thresholds, rule, merged, first, end, counts):  # type: ignore[no-untyped-def]
    """Return the spike channels of steps first .. end - 1 in order; write how many per step to counts."""
    n, n_thresholds = values.shape[1], len(thresholds)
    channels = np.empty((end - first) * n_thresholds * n, dtype=np.int32)
    r = np.empty((n_thresholds, n))
    for k in range(n_thresholds):
        for c in range(n):
            r[k, c] = level[c]
    sign = np.zeros(n, dtype=np.int8)
    filled = 0
    for t in range(end):
        before = filled
        filled = _send(values[t], thresholds, rule, merged, r, sign, t >= first, channels, filled)
        if t >= first:
            counts[t - first] = filled - before
    return channels[:filled].copy()
