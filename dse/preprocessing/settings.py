"""What a search space says about preprocessing: section `preprocessing`; every key may be an axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dse.registry import param

POLARITIES = ("split", "merge", "ignore_off", "ignore_on")


class PreprocessingError(ValueError):
    """What the settings ask of a frame that it cannot give, in one sentence."""


@dataclass(frozen=True)
class Preprocessing:
    """How event recordings become spikes; a pair is [along x, along y], one number stands for both."""

    bin_ms: float = param(doc="width of a time bin: one step, to the microsecond", unit="ms", low=0.001)
    pool: int | tuple[int, int] = param(1, doc="sides of the pooling kernel", unit="pixels", low=1)
    stride: int | tuple[int, int] | None = param(
        None, doc="distance of pools; absent: the kernel's sides", unit="pixels", low=1
    )
    padding: int | tuple[int, int] = param(
        0, doc="empty pixels added on every side, fewer than the kernel's", unit="pixels", low=0
    )
    pool_threshold: int = param(
        1,
        doc="events in a pool and bin that make a spike; counts stop at 255",
        unit="events",
        low=1,
        high=254,
    )
    exceeds: bool = param(False, doc="true: a spike takes strictly more events than pool_threshold")
    polarity: str = param(
        "split", doc="ON and OFF apart, together, ON alone or OFF alone", choices=POLARITIES
    )
    crop: Literal["pins"] | tuple[int, int, int, int] | None = param(
        None,
        doc="[x, y, width, height] of the pixels to keep, or pins: the rectangle that sees pins (recorded "
        "events: where the training recordings have events)",
        unit="pixels",
        low=0,
    )
    time_ms: tuple[float, float] | None = param(
        None,
        doc="[from, to): events to keep, from a recording's first event (a simulated trial: from its start)",
        unit="ms",
        low=0,
    )
    rate_floor_hz: float = param(
        0.0,
        doc="pooled channels of a recording below this mean rate over the kept bins are silent; it looks at "
        "the whole window, so a device that answers while events come in cannot do it",
        unit="Hz",
        low=0,
    )

    def __post_init__(self) -> None:
        """Check what one key's bounds cannot say."""
        pool, padding = pair(self.pool), pair(self.padding)
        if any(edge >= side for edge, side in zip(padding, pool, strict=True)):
            raise ValueError(
                f"padding must be smaller than pool ({_shown(self.pool)}), else pools see no pixel; "
                f"got {_shown(self.padding)}"
            )
        if isinstance(self.crop, tuple) and min(self.crop[2:]) < 1:
            raise ValueError(
                f"crop must be [x, y, width, height] of at least one pixel, got {_shown(self.crop)}"
            )
        if self.time_ms is not None and self.time_ms[1] - self.time_ms[0] < 0.001:
            raise ValueError(
                f"time_ms must end at least 0.001 ms after it begins, got [{self.time_ms[0]:g}, "
                f"{self.time_ms[1]:g}]"
            )

    @property
    def bin_us(self) -> int:
        """Width of a bin in whole microseconds."""
        return round(self.bin_ms * 1000)


def pair(value: int | tuple[int, int]) -> tuple[int, int]:
    """Return one number as the same number along x and y."""
    return (value, value) if isinstance(value, int) else (value[0], value[1])


def _shown(value: int | tuple[int, ...]) -> str:
    return str(value if isinstance(value, int) else list(value))
