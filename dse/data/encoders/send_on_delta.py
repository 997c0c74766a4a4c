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

from dse.base.native.compiled import compiled
from dse.base.records import Floats, Ints, Signals
from dse.base.registry import fixed, param, register
from dse.config.contracts import RunningEncoder
from dse.data.encoders.sampled import OneByOne

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

    def begun(self, values: Floats) -> Floats:
        """Return the levels sent last, (threshold, channel) float64, before a recording's first sample."""
        level = self.first_level(len(values))
        return np.tile(values if level is None else level, (len(self.thresholds), 1)).astype(np.float64)

    def sent(self, values: Floats, level: Floats, first: int) -> tuple[Ints, Ints]:
        """Return the spikes per step of samples (step, channel) from `first` on, and their channels.

        `level` becomes the levels sent last.
        """
        thresholds = np.asarray(self.thresholds, dtype=np.float64)
        counts = np.zeros(len(values) - first, dtype=np.int64)
        rule, merged = _RULES.index(self.reference), self.polarity == "merged"
        return counts, _encode(values, thresholds, rule, merged, level, first, counts)

    def _encoded(self, signals: Signals, i: int, first: int, length: int) -> tuple[Ints, Ints]:
        values = signals.values[signals.offsets[i] : signals.offsets[i + 1]]
        return self.sent(values[: first + length], self.begun(values[0]), first)

    def running(self, n_in: int, step_ms: float) -> RunningEncoder:
        """Return the encoder at the start of a recording."""
        self.first_level(n_in)
        return _Running(self)


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

    def __init__(self, encoder: Deltas) -> None:
        self._encoder = encoder
        self._level: Floats | None = None

    def step(self, values: Floats) -> Ints:
        if self._level is None:
            self._level = self._encoder.begun(values)
        return self._encoder.sent(values[None], self._level, 0)[1]


@compiled()
def _encode(values, thresholds, rule, merged, r, first, counts):  # type: ignore[no-untyped-def]
    """Return the spike channels of steps from `first` on in order; write how many per step to counts.

    values: (step, channel) samples. rule: place in `_RULES`. r: (threshold, channel) levels sent last, which
    move; of digits the first is that of all. counts: (step - first,) int64.
    """
    n = values.shape[1]
    channels = np.empty(len(counts) * len(thresholds) * n, dtype=np.int32)
    sign = np.zeros(n, dtype=np.int8)
    filled = 0
    for t in range(len(values)):
        before = filled
        for k in range(len(thresholds)):
            theta = thresholds[k]
            for c in range(n):
                x, at = np.float64(values[t, c]), 0 if rule == 3 else k
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
            for p in range(1 if merged else 2) if t >= first else range(0):
                for c in range(n):
                    if sign[c] != 0 and (merged or (sign[c] > 0) == (p == 1)):
                        channels[filled] = (k if merged else 2 * k + p) * n + c
                        filled += 1
        if t >= first:
            counts[t - first] = filled - before
    return channels[:filled].copy()
