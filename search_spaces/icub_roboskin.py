"""Recordings of the iCub's skin in the order of time: a plugin of threshold_icub.yaml.

The published file, (recording, 6, 10, 75), has lost that order: its buffer of (75 steps, 60 taxels) was read
as (6, 75, 10). In the order of this source a step differs from the one before by 14 % of the signal's
standard deviation; as stored, by 151 %.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from dse.base.records import Signals
from dse.base.registry import register
from dse.data.recordings.time_series import TimeSeries


@register("recordings", "icub_roboskin")
@dataclasses.dataclass(frozen=True)
class IcubRoboSkin(TimeSeries):
    """Sampled recordings of an .npz file, (recording, 75, 60), put back into the order of time."""

    def read(self, base: Path) -> Signals:
        signals = super().read(base)
        values = signals.values.reshape(-1, 75, 6, 10).transpose(0, 2, 1, 3).reshape(-1, 60)
        return dataclasses.replace(signals, values=np.ascontiguousarray(values))
