"""Recordings: what a sensor wrote, read from a file; where it is cut, how it is split, what is predicted.

A component of section `recordings` is a frozen dataclass with the methods of `Source` below; to add a file
format, add one file here that registers such a class. Nothing downstream knows which file it was.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from dse.records import Array, Block, Rasters, Signals

if TYPE_CHECKING:
    from dse.preprocessing import Pooling

PLACES = ("file", "folder", "labels", "scene")
"""Keys of components that say where recordings lie: what lies there counts, not where."""


class RecordingError(ValueError):
    """What is wrong with recordings, in one line: where, what must be, what was found."""


class EventSource(Protocol):
    """Event recordings that need not all be in memory; `records.Events` is one that is."""

    @property
    def width(self) -> int:
        """Addresses x are below."""

    @property
    def height(self) -> int:
        """Addresses y are below."""

    @property
    def columns(self) -> Mapping[str, Array]:
        """Label columns, each (n,)."""

    @property
    def n_recordings(self) -> int:
        """Number n of recordings."""

    def blocks(self, i: int) -> Iterator[Block]:
        """Yield recording i from its begin, block by block; time never falls. It may be asked for again.

        Raises:
            RecordingError: anything wrong with the recording.
        """


@runtime_checkable
class Repaired(EventSource, Protocol):
    """Event recordings that may be read on after what is not sound in them."""

    def notes(self) -> list[str]:
        """Return what was repaired in what was read so far, a sentence each."""


@runtime_checkable
class Simulated(EventSource, Protocol):
    """Trials of a scene: their time counts from the start of the record, and all last equally long."""

    @property
    def duration_us(self) -> int:
        """Length of a record."""

    def pins(self) -> tuple[int, int, int, int]:
        """Return x, y, width and height of the pixels that see pins."""

    def raster(self, i: int, pooling: Pooling, n_bins: int) -> tuple[Array, Array]:
        """Return what `preprocessing.pool` makes of trial i from bin 0, without an event list in between.

        Several threads may ask for trials at once.
        """


Recordings = Signals | Rasters | EventSource


class Source(Protocol):
    """What every component of section `recordings` offers."""

    @property
    def columns(self) -> Mapping[str, str]:
        """Label column -> its name in the file."""

    def check(self, base: Path) -> list[str]:
        """Return the faults that the file's headers show; no samples are read."""

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only those label columns that its file holds."""

    def content(self, base: Path) -> str:
        """Return a hash of what lies at the component's `PLACES`, or of more that the recordings follow from.

        Raises:
            RecordingError: a file is not found.
        """

    def read(self, base: Path) -> Recordings:
        """Return the recordings.

        Raises:
            RecordingError: anything wrong with the file.
        """


@runtime_checkable
class Placed(Protocol):
    """A component of sampled signals or of spikes; where events lie follows from their addresses."""

    def channel_positions(self, base: Path) -> Array:
        """Return x, y and plane of every channel, (n_channels, 3) int32.

        Raises:
            RecordingError: the file cannot be read, or positions are given for another number of taxels.
        """
