"""Recordings: what a sensor wrote, read from a file; where it is cut, how it is split, what is predicted.

A component of section `recordings` is a frozen dataclass with the methods of `Source`; to add a file
format, add one file here that registers such a class. Nothing downstream knows which file it was.
"""

from __future__ import annotations

from typing import ClassVar, Protocol, cast

from dse.base.text import one_line
from dse.config.contracts import PLACES as PLACES
from dse.config.contracts import EventSource as EventSource
from dse.config.contracts import Recordings as Recordings
from dse.config.contracts import Source as Source


class RecordingError(ValueError):
    """What is wrong with recordings, in a line or a line per fault: where, what must be, what was found."""

    def __init__(self, *lines: str) -> None:
        super().__init__("\n".join(map(one_line, lines)))


class Simulated(EventSource, Protocol):
    """Trials of a scene: their time counts from the start of the record, and all last equally long."""

    simulated: ClassVar[bool] = True

    @property
    def duration_us(self) -> int:
        """Length of a record."""

    def pins(self) -> tuple[int, int, int, int]:
        """Return x, y, width and height of the pixels that see pins."""


def trials_of(source: EventSource) -> Simulated | None:
    """Return a source as trials of a simulator; None if its events were recorded."""
    return cast(Simulated, source) if source.simulated else None
