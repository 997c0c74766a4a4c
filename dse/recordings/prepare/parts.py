"""What a conversion of a public set returns, and what the conversions share."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dse.recordings import RecordingError
from dse.records import Array


@dataclass(frozen=True)
class Converted:
    """A converted set. sources: the authors' files. parts: name of a file of the result -> its arrays."""

    sources: Sequence[Path]
    parts: Mapping[str, Mapping[str, Array]]


def digest(arrays: Mapping[str, Array]) -> str:
    """Return the SHA-256 of named arrays: of their names, types, shapes and numbers, in this order."""
    result = hashlib.sha256()
    for name, array in arrays.items():
        result.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        result.update(array.tobytes())
    return result.hexdigest()


def folder(source: Path, inside: str, pattern: str) -> list[Path]:
    """Return the sorted files of a pattern in `source/inside`, or else in a shorter end of that path.

    Raises:
        RecordingError: there is none.
    """
    ends = Path(inside).parts
    for start in range(len(ends) + 1):
        if files := sorted(source.joinpath(*ends[start:]).glob(pattern)):
            return files
    raise RecordingError(f"{source}: has no {inside}/{pattern}")
