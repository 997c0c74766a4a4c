"""Where a data file named in a YAML is found on this machine."""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path

from dse.recordings import RecordingError


def locate(file: str, base: Path) -> Path:
    """Return where a data file is: absolute, beside the YAML (`base`), in $DSE_DATA, or here; first hit wins.

    Raises:
        RecordingError: it is in none of these places; the sentence lists them.
    """
    folders = [base, *(Path(x) for x in [os.environ.get("DSE_DATA", "")] if x), Path.cwd()]
    places = [Path(file)] if Path(file).is_absolute() else [folder / file for folder in folders]
    for place in places:
        if place.is_file():
            return place
    looked = ", ".join(str(x.parent) for x in places)
    hint = (
        ""
        if Path(file).is_absolute()
        else " (DSE_DATA names another folder, --set data.file=FILE another file)"
    )
    raise RecordingError(f"data file '{file}' not found; looked in {looked}{hint}")


def content(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal; it is read again only where size or time have changed.

    Raises:
        RecordingError: it cannot be read.
    """
    try:
        about = path.stat()
        return _content(path, about.st_size, about.st_mtime_ns)
    except OSError as error:
        raise RecordingError(f"{path.name}: cannot be read: {error.strerror or error}") from error


@functools.cache
def _content(path: Path, size: int, modified_ns: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
