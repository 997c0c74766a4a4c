"""The header that the files of Prophesee cameras begin with: text lines, each with a '%' in front."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dse.recordings import RecordingError
from dse.recordings.formats import Broken, open_file

_MOST_BYTES = 1 << 16
_LONGEST_LINE = 1 << 10
# Printable, so that words that happen to begin with '%' are not taken for a line; nothing is tried twice.
_LINE = re.compile(rb"%(?: *+([^\x00-\x20\x7f]++)[ \t]*+([^\x00-\x08\x0a-\x1f\x7f]*+)|[ \t]*+)\r?\n")
_GEOMETRY = re.compile(r"(\d{1,5})x(\d{1,5})")


@dataclass(frozen=True)
class Header:
    """The text lines before the words.

    fields: first word of a line in small letters -> the rest of it; so are the parts of a '% format' line.
    end: bytes of the header.
    """

    fields: Mapping[str, str]
    end: int

    @property
    def evt(self) -> str | None:
        """The version of the EVT encoding, such as '2.0', where a line states it."""
        if "evt" in self.fields:
            return self.fields["evt"]
        named = re.fullmatch(r"EVT(\d)(\d?)", self.fields.get("format", ""))
        return f"{named[1]}.{named[2] or 0}" if named else None

    @property
    def frame(self) -> tuple[int, int] | None:
        """Width and height in pixels, where the lines state them."""
        geometry = _GEOMETRY.fullmatch(self.fields.get("geometry", ""))
        width, height = geometry.groups() if geometry else map(self.fields.get, ("width", "height"))
        if width and height and _GEOMETRY.fullmatch(f"{width}x{height}") and int(width) and int(height):
            return int(width), int(height)
        return None


def parse(head: bytes) -> Header:
    """Return the header that the first bytes of a file hold; without one it has no fields and ends at 0."""
    fields: dict[str, str] = {}
    end = 0
    while line := _LINE.match(head, end):
        end = line.end()
        key, value = ((x or b"").decode("latin-1").strip() for x in line.groups())
        if key.lower() == "format":
            value, *parts = value.split(";")
            fields |= {name.lower(): rest for name, _, rest in (part.partition("=") for part in parts)}
        fields[key.lower()] = value
        if key == "end":
            break
    return Header(fields, end)


def read_header(path: Path) -> Header:
    """Return the header of a file.

    Raises:
        RecordingError: the file cannot be opened, or its header is longer than any camera's.
    """
    with open_file(path) as file:
        head = file.read(_MOST_BYTES)
    header = parse(head)
    if header.end > _MOST_BYTES - _LONGEST_LINE:
        raise RecordingError(f"{path.name}: the header must end within {_MOST_BYTES - _LONGEST_LINE} bytes")
    return header


def read_evt_header(path: Path, version: str, broken: Broken) -> Header:
    """Return the header of a file whose words must be of one version of EVT, in the usual byte order.

    Raises:
        RecordingError: the header says that it is another version, or `broken` raised it where it says none.
    """
    header = read_header(path)
    if header.evt is None:
        broken(
            f"the header must state the encoding in a line '% evt {version}', which is missing",
            f"reads the data after {header.end} bytes of header as EVT {version}",
        )
    elif header.evt != version:
        raise RecordingError(
            f"{path.name}: the encoding must be EVT {version} for this reader, got '% evt {header.evt}'"
        )
    if (order := header.fields.get("endianness", "little")) != "little":
        raise RecordingError(f"{path.name}: endianness must be little, got '{order}'")
    return header


def report_early(n: int, unstated: str, start: int, broken: Broken) -> None:
    """Report events, if any, of the words from byte `start` on whose time or place was not stated before."""
    if n:
        broken(
            f"events must not come before the first {unstated}, got {n} from byte {start} on",
            f"drops events before the first {unstated}",
            n,
        )


def report_unknown(n: int, version: str, kind: int, byte: int, broken: Broken) -> None:
    """Report n words of a type that the version of EVT does not have, the first of them by type and place."""
    broken(
        f"the word type must be one of EVT {version}, got {kind:#x} at byte {byte}",
        "skips words of unknown type",
        n,
    )
