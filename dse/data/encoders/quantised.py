"""The quantised signal: a spike is a binary digit of how far a channel has moved since the last ones.

Of each channel, r is the level sent so far, at first the recording's first sample, or, with start 'mean', the
channel's mean over the training recordings, rounded to the step:

    m = floor(|x[t] - r| / step), at most 2^digits - 1;   r moves by m steps towards x[t]

Copy 2 j + p has a spike where digit digits - 1 - j of m is 1 and the channel fell (p = 0) or rose (p = 1).
Spikes times what they stand for (`rises`) add up to the signal in steps, as long as it moves by less than
2^digits steps per sample; send-on-delta loses how far a fast signal moves. A family that adds them up, such
as `kernels`, reads the signal; to others they are spikes at several thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Ints
from dse.base.registry import fixed, param, register
from dse.data.encoders.send_on_delta import STARTS, Deltas


@register("encoders", "quantised")
@dataclass(frozen=True)
class Quantised(Deltas):
    """Binary digits of a channel's changes, ON and OFF apart: what adds up to the quantised signal.

    Each recording is encoded from its first sample on, as a running sensor would encode it. The largest digit
    comes first.
    """

    reference, polarity = "digits", "separate"  # none of its parameters

    step: float = param(
        1.0, low=0, low_open=True, unit="sensor units", doc="change that the least digit stands for"
    )
    digits: int = param(
        7, low=1, high=15, doc="binary digits of a change; each gets its own two copies of the channels"
    )
    start: str = param(
        "sample",
        choices=STARTS,
        doc="level that a recording begins at, as of encoder send_on_delta: its first sample, or the mean of "
        "the training recordings, so that the level it rests at is sent too",
    )
    means: tuple[float, ...] = fixed((), doc="fitted: of each channel, for start mean")

    @property
    def thresholds(self) -> tuple[float, ...]:  # type: ignore[override]
        """What each digit stands for, in sensor units, the largest first."""
        return tuple(self.step * 2**k for k in reversed(range(self.digits)))

    def rises(self, n_in: int) -> Ints:
        """Return 2^digit of each channel, negative of those that say it fell, (n_channels,) int32."""
        powers = 2 ** np.arange(self.digits, dtype=np.int32)[::-1]
        return np.repeat(np.outer(powers, np.array([-1, 1], np.int32)).ravel(), n_in)
