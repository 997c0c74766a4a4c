"""Recordings: what a sensor wrote, read from a file; where it is cut, how it is split, what is predicted.

A component of section `recordings` is a frozen dataclass with the methods of `Source` below; to add a file
format, add one file here that registers such a class. Nothing downstream knows which file it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, Self

from dse.records import Events, Rasters, Signals

Recordings = Signals | Events | Rasters


class RecordingError(ValueError):
    """What is wrong with recordings, in one line: where, what must be, what was found."""


class Source(Protocol):
    """What every component of section `recordings` offers."""

    @property
    def columns(self) -> Mapping[str, str]:
        """Label column -> its name in the file."""

    def check(self, base: Path) -> list[str]:
        """Return the faults that the file's headers show; no samples are read."""

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only those label columns that its file holds."""

    def read(self, base: Path) -> Recordings:
        """Return the recordings.

        Raises:
            RecordingError: anything wrong with the file.
        """
