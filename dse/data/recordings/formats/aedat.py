"""AEDAT 2.0 of jAER: a text header, then addresses with time stamps."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, ClassVar

import numpy as np

from dse.base.records import Block
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.formats import Clock, Format, Repairs, block_of, open_file, read_words

_LINE_BYTES = 1 << 16  # of the longest header line
# Name of the chip, in lower case, -> width, height.
# Source: iniVation, AEDAT File Formats, Supported Devices; the sizes are those of the user guides.
_CHIPS = {
    r"dvs128|tmpdiff128": (128, 128),
    r"davis128(mono|rgb)?": (128, 128),
    r"davis208(mono)?|pixelparade": (208, 192),
    r"davis240[a-z]?|sbret[0-9]+": (240, 180),
    r"davis346[a-z]*": (346, 260),
    r"davis640(mono|rgb)?": (640, 480),
}
_WORD_BYTES = 8
_PERIOD_US = 1 << 32  # 1.2 hours
_CHIP = re.compile(rb"#\s*AEChip:\s*(?:\S*\.)?(\w+)\s*$")
_END_2 = re.compile(rb"#\s*end of ascii header\s*$", re.IGNORECASE)
_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]")
_UNNAMED = "DVS128"  # files without the chip's name are older than the DAVIS


def read_version(file: BinaryIO, name: str, version: str) -> None:
    """Read the first line, which must be of that version."""
    must, line = f"#!AER-DAT{version}", file.readline(32)
    if line.rstrip(b"\r\n") != must.encode() or not line.endswith(b"\n"):
        got = f"begins with {line.rstrip()!r}" if line else "is empty"
        raise RecordingError(f"{name}: the file must begin with the line '{must}' at byte 0, it {got}")


@register("recordings.formats", "aedat2")
@dataclass(frozen=True)
class Aedat2(Format):
    """AEDAT 2.0 of a DVS128 or a DAVIS camera, as stated in the AEChip line of the header.

    Words that are no pixel's event (frames, inertial samples, external inputs) are passed over. The chips
    count rows from the bottom and columns from the right; here (0, 0) is the upper left pixel, as in later
    versions. The 32-bit time may wrap.

    Source: iniVation, AEDAT File Formats, AEDAT 2.0; where it and jAER differ (the direction of the columns,
    and a DVS128's polarity bit, which is 0 for ON) jAER, which wrote the files.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".aedat", ".aedat2")
    marks: ClassVar[tuple[bytes, ...]] = (b"#!AER-DAT2", b"#!AER-DAT1")

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the size of the chip that the header names, None if it names none."""
        chip, _ = _read_header_2(path)
        return None if chip is None else _size(chip, path.name)

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events.

        Of a DVS128, bits 14-8 are the row, 7-1 the column, 0 OFF; bit 15 is an external input. Of a DAVIS,
        bit 31 marks frames and inertial samples, 30-22 are the row, 21-12 the column, 11 ON, 10 an input.
        """
        chip, start = _read_header_2(path)
        if chip is None:
            broken(
                "the header must name the chip in a line '# AEChip: ...', but has none",
                f"treats an unnamed camera as a {_UNNAMED}",
            )
            chip = _UNNAMED
        (width, height), clock = _size(chip, path.name), Clock(_PERIOD_US)
        for at, data in read_words(path, start, _WORD_BYTES, broken):
            address, time = np.frombuffer(data, ">u4").reshape(-1, 2).astype(np.int64).T
            if chip.lower() in ("dvs128", "tmpdiff128"):
                is_event, unknown = address >> 15 == 0, address >> 16 != 0
                x, y, polarity = address >> 1 & 127, address >> 8 & 127, ~address & 1
            else:
                is_event, unknown = address & (1 << 31 | 1 << 10) == 0, address < 0
                x, y, polarity = address >> 12 & 1023, address >> 22 & 511, address >> 11 & 1
            broken.where(
                unknown, f"the address at byte {{}} must be valid for a {chip}, got {{:#010x}}",
                "drops words with an address that the chip does not have",
                at + np.arange(len(time)) * _WORD_BYTES, address,
            )  # fmt: skip
            time[is_event] = clock(time[is_event])
            yield from block_of(time, width - 1 - x, height - 1 - y, polarity, is_event)


def _read_header_2(path: Path) -> tuple[str | None, int]:
    """Return the chip's name, None if no line says it, and where the first event begins."""
    with open_file(path) as file:
        read_version(file, path.name, "2.0")
        chip = None
        while True:
            start = file.tell()
            line = file.readline(_LINE_BYTES)
            # An event may begin with the byte of '#' too, but the bytes after it are hardly ever all text.
            if not line.startswith(b"#") or _CONTROL.search(line):
                return chip, start
            if _END_2.match(line):
                return chip, file.tell()
            if match := _CHIP.match(line):
                chip = match[1].decode(errors="replace")


def _size(chip: str, name: str) -> tuple[int, int]:
    size = next((size for names, size in _CHIPS.items() if re.fullmatch(names, chip.lower())), None)
    if size is None:
        raise RecordingError(f"{name}: the header's AEChip must be a DVS128 or a DAVIS, got '{chip}'")
    return size
