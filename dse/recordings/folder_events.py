"""Event recordings that are read from their files on request, block by block."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from dse.recordings import RecordingError
from dse.recordings.folders import by_path
from dse.recordings.formats import Format, Repairs
from dse.recordings.formats.checked import checked
from dse.records import Array, Block, FrontEnd

LEFT_OUT = "--repair skips the file"

_MOST_NOTES = 50


@dataclass(frozen=True)
class FolderEvents:
    """Event recordings of files; recording i is the file `names[i]` below `folder`.

    width, height: the frame of all of them.
    columns: label columns, each (n,).
    formats: (n,) what reads each file.
    repair: whether damaged files are repaired; else they raise an error.
    left_out: why files were left out, one sentence each.
    """

    width: int
    height: int
    columns: Mapping[str, Array]
    folder: Path
    names: tuple[str, ...]
    formats: tuple[Format, ...]
    repair: bool
    left_out: tuple[str, ...] = ()
    front_end: ClassVar[FrontEnd | None] = "preprocessing"
    simulated: ClassVar[bool] = False
    _repaired: dict[int, list[str]] = field(default_factory=dict, init=False, compare=False)

    @property
    def n_recordings(self) -> int:
        return len(self.names)

    def blocks(self, i: int) -> Iterator[Block]:
        """Yield the events of recording i; every call reads its file.

        Raises:
            RecordingError: the file is damaged and `repair` is false; the message names file and place.
        """
        name, whole = self.names[i], False
        repairs = Repairs(name, self.repair)
        try:
            yield from _sound(self.folder, name, self.formats[i], (self.width, self.height), repairs)
            whole = True
        finally:
            # A reader that stops early has met only some of the faults.
            if whole or i not in self._repaired:
                self._repaired[i] = repairs.notes

    def notes(self) -> list[str]:
        """Return what was repaired in the files read so far: a sentence for each file and kind of fault."""
        notes = [*self.left_out, *(note for i in sorted(self._repaired) for note in self._repaired[i])]
        more = len(notes) - _MOST_NOTES
        return notes if more <= 0 else [*notes[:_MOST_NOTES], f"{self.folder.name}: {more} more repairs"]


def unusable(folder: Path, name: str, form: Format, frame: tuple[int, int]) -> str | None:
    """Return why a file holds no valid event, None if it holds one; reading stops at the first."""
    repairs = Repairs(name, repair=True)
    try:
        if next(_sound(folder, name, form, frame, repairs), None) is not None:
            return None
        why = repairs.notes[0].partition("; --repair")[0]
    except RecordingError as error:
        why = str(error)
    return f"{why}; {LEFT_OUT}"


def _sound(
    folder: Path, name: str, form: Format, frame: tuple[int, int], repairs: Repairs
) -> Iterator[Block]:
    try:
        yield from checked(form.blocks(folder / name, repairs.broken), *frame, repairs.broken)
    except RecordingError as error:
        raise RecordingError(by_path(error, name)) from None
    except OSError as error:
        raise RecordingError(f"{name}: cannot be read: {error.strerror or error}") from None
