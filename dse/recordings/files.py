"""Find the data files that a YAML file names, and hash them."""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path
from typing import Literal

from dse.recordings import RecordingError


def locate(name: str, base: Path, kind: Literal["file", "folder"] = "file") -> Path:
    """Return the path of data: absolute, or the first below `base`, $DSE_DATA and the working folder.

    Raises:
        RecordingError: they are in none of these places; the sentence lists them.
    """
    roots = [base, *(Path(x) for x in [os.environ.get("DSE_DATA", "")] if x), Path.cwd()]
    places = [Path(name)] if Path(name).is_absolute() else [root / name for root in roots]
    for place in places:
        if place.is_file() if kind == "file" else place.is_dir():
            return place
    for place in places:
        if place.exists():
            raise RecordingError(f"data {kind} '{name}': {place} must be a {kind}, and is none")
    looked = ", ".join(str(place.parent) for place in places)
    hint = f" (DSE_DATA sets another folder, --set data.{kind}={kind.upper()} another {kind})"
    advice = "" if Path(name).is_absolute() else hint
    raise RecordingError(f"data {kind} '{name}' not found; looked in {looked}{advice}")


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
