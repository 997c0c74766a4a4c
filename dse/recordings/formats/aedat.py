"""What the AEDAT versions share: the line that names the version, and the chips that headers name."""

from __future__ import annotations

import re
from typing import BinaryIO

from dse.recordings import RecordingError

LINE_BYTES = 1 << 16
"""Longest header line."""

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


def chip_frame(chip: str) -> tuple[int, int] | None:
    """Return the width and height of a chip, None if it is not known."""
    for names, size in _CHIPS.items():
        if re.fullmatch(names, chip.lower()):
            return size
    return None


def read_version(file: BinaryIO, name: str, version: str) -> None:
    """Read the first line, which must be of that version.

    Raises:
        RecordingError: the file is empty, or begins otherwise.
    """
    must, line = f"#!AER-DAT{version}", file.readline(32)
    if line.rstrip(b"\r\n") != must.encode() or not line.endswith(b"\n"):
        got = f"begins with {line.rstrip()!r}" if line else "is empty"
        raise RecordingError(f"{name}: the file must begin with the line '{must}' at byte 0, it {got}")
