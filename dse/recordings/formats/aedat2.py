"""AEDAT 2.0, the files of jAER: a text header, then an address and a time stamp per word."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, ClassVar

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.formats import Broken, open_file
from dse.recordings.formats.aedat import LINE_BYTES, chip_frame, read_version
from dse.recordings.formats.words import read_words, unwrapped
from dse.records import Block, Bools, Ints
from dse.registry import register

_WORD_BYTES = 8
_PERIOD_US = 1 << 32  # 1.2 hours
_CHIP = re.compile(rb"#\s*AEChip:\s*(?:\S*\.)?(\w+)\s*$")
_END = re.compile(rb"#\s*end of ascii header\s*$", re.IGNORECASE)
_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]")
_UNNAMED = "DVS128"  # files without the chip's name are older than the DAVIS


@register("recordings.formats", "aedat2")
@dataclass(frozen=True)
class Aedat2:
    """AEDAT 2.0 of a DVS128 or a DAVIS camera, as stated in the AEChip line of the header.

    Words that are no pixel's event (frames, inertial samples, external inputs) are passed over. The chips
    count rows from the bottom and columns from the right; here (0, 0) is the upper left pixel, as in later
    versions. The 32-bit time may wrap.

    Source: iniVation, AEDAT File Formats, AEDAT 2.0; where it and jAER differ (the direction of the columns,
    and a DVS128's polarity bit, which is 0 for ON) jAER, which wrote the files.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".aedat", ".aedat2")

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the head names version 2, or version 1, which is refused with a reason."""
        return head.startswith((b"#!AER-DAT2", b"#!AER-DAT1"))

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the size of the chip that the header names, None if it names none.

        Raises:
            RecordingError: the header is not of this format, or its chip is not known.
        """
        with open_file(path) as file:
            chip = _read_header(file, path.name)
        return None if chip is None else _size(chip, path.name)

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events.

        Raises:
            RecordingError: the header is not of this format, its chip is not known, or `broken` raised it.
        """
        with open_file(path) as file:
            chip = _read_header(file, path.name)
            if chip is None:
                broken(
                    "the header must name the chip in a line '# AEChip: ...', but has none",
                    f"treats an unnamed camera as a {_UNNAMED}",
                )
                chip = _UNNAMED
            width, height = _size(chip, path.name)
            decode = _dvs128 if chip.lower() in ("dvs128", "tmpdiff128") else _davis
            at = file.tell()
        before = 0
        for data in read_words(path, at, _WORD_BYTES, broken):
            words = np.frombuffer(data, ">u4").reshape(-1, 2)
            address = words[:, 0].astype(np.uint32)
            is_event, x, y, polarity, is_unknown = decode(address)
            if is_unknown.any():
                first = int(is_unknown.argmax())
                broken(
                    f"the address at byte {at + first * _WORD_BYTES} must be valid for a {chip}, "
                    f"got {address[first]:#010x}",
                    "drops words with an address that the chip does not have",
                    int(is_unknown.sum()),
                )
            at += len(data)
            if is_event.any():
                t_us = unwrapped(words[is_event, 1].astype(np.int64), before, _PERIOD_US)
                before = int(t_us[-1])
                yield Block(t_us, width - 1 - x[is_event], height - 1 - y[is_event], polarity[is_event])


def _read_header(file: BinaryIO, name: str) -> str | None:
    """Read up to the first event; return the chip's name, None if no line says it."""
    read_version(file, name, "2.0")
    chip = None
    while True:
        start = file.tell()
        line = file.readline(LINE_BYTES)
        # An event may begin with the byte of '#' too, but the bytes after it are hardly ever all text.
        if not line.startswith(b"#") or _CONTROL.search(line):
            file.seek(start)
            return chip
        if _END.match(line):
            return chip
        if match := _CHIP.match(line):
            chip = match[1].decode(errors="replace")


def _size(chip: str, name: str) -> tuple[int, int]:
    size = chip_frame(chip)
    if size is None:
        raise RecordingError(f"{name}: the header's AEChip must be a DVS128 or a DAVIS, got '{chip}'")
    return size


def _dvs128(address: Ints) -> tuple[Bools, Ints, Ints, Ints, Bools]:
    """Return what are events, their column, row and polarity as stored, and which words are no DVS128's.

    Bits 14-8 row, 7-1 column, 0 polarity; bit 15 is an external input.
    """
    x, y = (address >> 1 & 127).astype(np.int32), (address >> 8 & 127).astype(np.int32)
    return address >> 15 == 0, x, y, (~address & 1).astype(np.uint8), address >> 16 != 0


def _davis(address: Ints) -> tuple[Bools, Ints, Ints, Ints, Bools]:
    """Return the same for the DAVIS family.

    Bit 31 is 1 for frames and inertial samples; 30-22 row, 21-12 column, 11 polarity; bit 10 is an external
    input.
    """
    x, y = (address >> 12 & 1023).astype(np.int32), (address >> 22 & 511).astype(np.int32)
    is_event = address & (1 << 31 | 1 << 10) == 0
    return is_event, x, y, (address >> 11 & 1).astype(np.uint8), np.zeros(len(address), dtype=bool)
