"""Event file formats: how the bytes of one file become events.

A component of section `recordings.formats` is a frozen dataclass with the methods of `Format` below; to add
a format, add one file here that registers such a class. `checked` checks the events of all formats
in one place, so a reader checks its own bytes alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, ClassVar, Protocol

from dse.recordings import RecordingError
from dse.records import Block
from dse.registry import known

BLOCK_EVENTS = 1 << 16
"""Events per block at most, roughly: what bounds the memory of a reader."""

_HEAD_BYTES = 4096


class Broken(Protocol):
    """A reader calls it where a file is damaged; it returns only if the user asked for repair."""

    def __call__(self, fault: str, repair: str, n: int = 1) -> None:
        """Report a fault.

        Args:
            fault: what is wrong and where, as the beginning of a sentence: 'event 3 lies outside the frame'.
            repair: what repair does about every fault of this kind: 'drops events outside the frame'.
            n: how many things (events, words, bytes) this repair touches.

        Raises:
            RecordingError: the user did not ask for repair.
        """


class Format(Protocol):
    """What every event file format offers."""

    suffixes: ClassVar[tuple[str, ...]]

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the first 4 KiB (and the name, where the bytes carry no mark) are of this format."""

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the width and height that the file or the format states, if it does.

        Raises:
            RecordingError: the file cannot be opened.
        """

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events in the file's order, about BLOCK_EVENTS at a time at most, and no empty block.

        Raises:
            RecordingError: the file cannot be opened, or `broken` raised it.
        """


@dataclass(frozen=True)
class Repairs:
    """The faults of one file: an error at the first one, or with repair a note per kind.

    file: the name that the sentences begin with.
    repair: whether to repair a fault and continue.
    """

    file: str
    repair: bool
    _repaired: dict[str, tuple[str, int]] = field(default_factory=dict, init=False)

    def broken(self, fault: str, repair: str, n: int = 1) -> None:
        """Raise the fault, or count it; see `Broken`."""
        if not self.repair:
            raise RecordingError(f"{self.file}: {fault}; --repair {repair}")
        first, before = self._repaired.get(repair, (fault, 0))
        self._repaired[repair] = (first, before + n)

    @property
    def notes(self) -> list[str]:
        """What was repaired, one sentence per kind: its first fault, and how many there were."""
        return [
            f"{self.file}: {first}; --repair {repair} ({n} in all)"
            if n > 1
            else f"{self.file}: {first}; --repair {repair}"
            for repair, (first, n) in self._repaired.items()
        ]


def open_file(path: Path) -> BinaryIO:
    """Return the file, open for reading.

    Raises:
        RecordingError: it cannot be opened.
    """
    try:
        return path.open("rb")
    except OSError as problem:
        raise RecordingError(f"{path.name}: cannot be read: {problem.strerror or problem}") from problem


def named(name: str) -> Format:
    """Return the format of a name.

    Raises:
        RecordingError: there is no such format.
    """
    formats = known("recordings.formats")
    if name not in formats:
        raise RecordingError(f"format must be one of {', '.join(formats)}, got '{name}'")
    form: Format = formats[name]()
    return form


def detect(path: Path) -> Format:
    """Return the format of a file: by its content, or by its suffix where the content does not decide.

    Raises:
        RecordingError: the file cannot be opened, or several formats or none fit.
    """
    with open_file(path) as file:
        head = file.read(_HEAD_BYTES)
    formats: dict[str, Format] = {name: kind() for name, kind in known("recordings.formats").items()}
    fitting = {name: x for name, x in formats.items() if x.matches(path, head)}
    if len(fitting) != 1:
        pool = fitting or formats
        fitting = {name: x for name, x in pool.items() if path.suffix.lower() in x.suffixes} or fitting
    if len(fitting) == 1:
        return next(iter(fitting.values()))
    may = f"could be any of {', '.join(fitting)}" if fitting else "has no known format"
    raise RecordingError(f"{path.name}: {may}; set the key 'format' to one of {', '.join(formats)}")
