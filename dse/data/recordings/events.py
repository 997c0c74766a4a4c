"""Asynchronous events in an .npz file, end to end with offsets: time, address, polarity; read and written."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dse.base.records import Array, Block, Events, Ints
from dse.base.registry import fixed, register
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.source import FileSource, checked_offsets, class_names_key
from dse.store import atomic


@register("recordings", "events")
@dataclasses.dataclass(frozen=True)
class EventFile(FileSource):
    """Event recordings of an .npz file; recording i is events[offsets[i]:offsets[i+1]], which may be empty.

    An address is a pixel (`x`, `y`) or a `taxel`; polarity is 1 for ON and 0 for OFF.
    """

    width: int = fixed(doc="number of columns (or of taxels), addresses 0 to width - 1", low=1)
    height: int = fixed(1, doc="number of rows, addresses 0 to height - 1", low=1)
    t_us: str = fixed("t_us", doc="name of the array of time stamps, integers in microseconds")
    x: str | None = fixed(None, doc="name of the array of pixel columns")
    y: str | None = fixed(None, doc="name of the array of pixel rows")
    taxel: str | None = fixed(None, doc="name of the array of taxel numbers, instead of x and y")
    polarity: str | None = fixed(
        None, doc="name of the array of polarities, 1 for ON and 0 for OFF (default: all ON)"
    )
    offsets: str = fixed("offsets", doc="name of the array of the n + 1 borders between recordings")
    class_names: Mapping[str, str] = class_names_key()

    def __post_init__(self) -> None:
        if (self.x is None) == (self.taxel is None) or (self.y is not None and self.x is None):
            raise RecordingError("data must name the arrays of addresses: x (and y), or taxel")

    def _names(self) -> list[str]:
        optional = (self.x, self.y, self.taxel, self.polarity)
        return [self.t_us, *(name for name in optional if name is not None), self.offsets]

    def _count(self, shapes: arrays.Shapes) -> int | None:
        shape = shapes.get(self.offsets)
        return shape[0] - 1 if shape else None

    def channel_positions(self, base: Path) -> None:
        """Return None: an event's position is its address."""

    def read(self, base: Path) -> Events:
        """Return the recordings."""
        path, values = self._loaded(base)
        t_us = values[self.t_us]
        where = f"{path.name}: '{self.t_us}'"
        if t_us.ndim != 1:
            raise RecordingError(f"{where} must have one value per event, got shape {t_us.shape}")
        borders = checked_offsets(values[self.offsets], len(t_us), where, may_be_empty=True)
        fields = {
            "t_us": t_us,
            "x": values[self.taxel or self.x or ""],
            "y": np.zeros(len(t_us), np.int32) if self.y is None else values[self.y],
            "polarity": np.ones(len(t_us), np.uint8) if self.polarity is None else values[self.polarity],
        }
        for key, array in fields.items():
            if array.shape != t_us.shape or array.dtype.kind not in "biu":
                raise RecordingError(
                    f"{path.name}: '{getattr(self, key) or self.taxel}' must be one integer for each of the "
                    f"{len(t_us)} events, got {array.dtype} of shape {array.shape}"
                )
        wide = {key: array.astype(np.int64) for key, array in fields.items()}
        for fault in event_faults(**wide, offsets=borders, width=self.width, height=self.height):
            raise RecordingError(f"{path.name}: {fault}")
        return Events(
            t_us=wide["t_us"],
            x=wide["x"].astype(np.int32),
            y=wide["y"].astype(np.int32),
            polarity=wide["polarity"].astype(np.uint8),
            offsets=borders,
            width=self.width,
            height=self.height,
            columns=self._labelled(values, len(borders) - 1, path, base),
        )


def event_faults(
    t_us: Ints, x: Ints, y: Ints, polarity: Ints, offsets: Ints, width: int, height: int
) -> list[str]:
    """Return what is wrong with events: order and sign of times, addresses outside the frame, polarity.

    t_us, x, y, polarity: (n_events,) int64. offsets: (n + 1,) borders of the recordings.
    """
    falls = np.diff(t_us, prepend=t_us[:1]) < 0
    falls[offsets[:-1][np.diff(offsets) > 0]] = False
    tests = [
        (t_us < 0, "time must be >= 0 us", t_us),
        (falls, "times must not decrease within a recording", t_us),
        ((x < 0) | (x >= width), f"address must be in [0, {width - 1}]", x),
        ((y < 0) | (y >= height), f"row y must be in [0, {height - 1}]", y),
        ((polarity < 0) | (polarity > 1), "polarity must be 0 or 1", polarity),
    ]
    faults = []
    for is_bad, rule, values in tests:
        if is_bad.any():
            event = int(is_bad.argmax())
            recording = int(np.searchsorted(offsets, event, side="right")) - 1
            faults.append(
                f"{rule}, got {values[event]} at event {event - offsets[recording]} of recording {recording}"
            )
    return faults


@contextlib.contextmanager
def event_archive(
    path: Path, width: int, height: int, duration_us: int, columns: Mapping[str, Array]
) -> Iterator[Callable[[Block], None]]:
    """Yield a function that takes the next recording; the file appears when the block succeeds, whole.

    Memory holds the events, each value in the smallest unsigned type that holds its range: no event is later
    than `duration_us`. `columns` hold one value for each recording that will be given.

    Raises:
        RecordingError: the disk refuses (full, read-only, ...), or another number of recordings was given.
    """
    ranges = {"t_us": duration_us, "x": width - 1, "y": height - 1, "polarity": 1}
    parts = {name: [np.zeros(0, np.min_scalar_type(most))] for name, most in ranges.items()}
    offsets = [0]

    def append(block: Block) -> None:
        for name, gathered in parts.items():
            gathered.append(getattr(block, name).astype(gathered[0].dtype))
        offsets.append(offsets[-1] + len(block.t_us))

    yield append
    for column, values in columns.items():
        if len(values) != len(offsets) - 1:
            raise RecordingError(
                f"{path}: column '{column}' must have one value for each of the {len(offsets) - 1} "
                f"recordings, got {len(values)}"
            )
    events = {name: np.concatenate(parts.pop(name)) for name in ranges}
    try:
        with atomic(path) as temporary, temporary.open("wb") as file:
            arrays: dict[str, Any] = {**events, "offsets": offsets, "width": width, "height": height}
            np.savez(file, **(arrays | dict(columns)))
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else str(error)
        raise RecordingError(f"{path}: cannot be written: {why}; no partial file remains") from error
