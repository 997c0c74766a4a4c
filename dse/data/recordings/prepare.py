"""Public recordings as the shipped search spaces read them: a component of section `datasets` per set.

A set is converted from the files that its authors publish, number by number: nothing is filtered, resampled
or rescaled. Beside each file of the result stands its data card (Croissant 1.1, REFERENCES.md): origin,
licence, arrays, checksums, and whether the recordings are those of the published results. Parts that no
search space reads, such as held-out repetitions, become files of their own.

The scripts of `datasets/` hold the shipped sets; a plugin registers more.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from dse.base import registry
from dse.base.records import Array
from dse.config.locate import shipped_folder
from dse.data.recordings import RecordingError
from dse.store import atomic, checksum


@dataclass(frozen=True)
class Converted:
    """A converted set. sources: the authors' files. parts: name of a file of the result -> its arrays."""

    sources: Sequence[Path]
    parts: Mapping[str, Mapping[str, Array]]


class PublicSet(Protocol):
    """A component of section `datasets`: a public set of recordings.

    file: that the search spaces read, relative to the folder of recordings; other parts stand beside it.
    origin: where its authors publish it. licence: that its authors state; '' if none.
    files: names of the authors' files that are converted.
    digest: of `file`, as the published results of `dse` were computed on it.
    """

    file: ClassVar[str]
    origin: ClassVar[str]
    licence: ClassVar[str]
    files: ClassVar[tuple[str, ...]]
    digest: ClassVar[str]

    def convert(self, source: Path) -> Converted:
        """Return the files of the result from the folder of the authors' files.

        Raises:
            RecordingError: a file is missing or holds something else.
        """


CARD = ".croissant.json"
"""Ends the name of the data card of a file."""

_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "recordSet": "cr:recordSet",
    "field": "cr:field",
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "isArray": "cr:isArray",
    "arrayShape": "cr:arrayShape",
    "source": "cr:source",
    "fileObject": "cr:fileObject",
}
_TYPES = {"b": "sc:Boolean", "i": "sc:Integer", "u": "sc:Integer", "f": "sc:Float", "U": "sc:Text"}


def sets() -> dict[str, PublicSet]:
    """Return the public sets by name: those of `datasets/`, and of plugins."""
    for script in sorted(shipped_folder("datasets").glob("*.py")):
        registry.load_plugin(str(script))
    return {name: one() for name, one in registry.known("datasets").items()}


def named(name: str) -> PublicSet:
    """Return a public set.

    Raises:
        RecordingError: there is none of this name.
    """
    known = sets()
    if name not in known:
        raise RecordingError(f"unknown set '{name}'; known: {', '.join(known)}")
    return known[name]


def prepare(name: str, source: Path, out: Path) -> dict[Path, bool | None]:
    """Convert a public set and write its files with their data cards, the one that search spaces read first.

    Args:
        name: of `sets`.
        source: folder with the authors' files.
        out: folder of recordings.

    Returns:
        File -> whether it is that of the published results; None: no search space reads it.

    Raises:
        RecordingError: no such set, a file is missing or holds something else, or a file of the result is
            already there and another; then nothing is written.
        OSError: the result cannot be written.
    """
    public = named(name)
    needs = f"{name} needs {', '.join(public.files)} of {public.origin}"
    if not source.is_dir():
        raise RecordingError(f"{source}: is no folder; {needs}")
    try:
        converted = public.convert(source)
    except RecordingError as error:
        raise RecordingError(f"{error}; {needs}") from None
    main = out / public.file
    targets = {main.parent / part: arrays for part, arrays in converted.parts.items()}
    if main not in targets:
        raise RecordingError(f"{source}: has none of the recordings that search spaces read ({main.name})")
    for target, arrays in targets.items():
        if target.exists() and not _holds(target, arrays):
            raise RecordingError(f"{target}: is another file than is made from {source}; move it away first")
    sources = {os.path.relpath(path, source): checksum(path) for path in converted.sources}
    written: dict[Path, bool | None] = {}
    for target, arrays in sorted(targets.items(), key=lambda item: item[0] != main):
        published = digest(arrays) == public.digest if target == main else None
        if not target.exists():
            buffer = io.BytesIO()
            np.savez_compressed(buffer, **dict(arrays))  # type: ignore[arg-type]
            with atomic(target) as temporary:
                temporary.write_bytes(buffer.getvalue())
        card = data_card(name, public, target, arrays, sources, published)
        with atomic(target.with_name(f"{target.name}{CARD}")) as temporary:
            temporary.write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")
        written[target] = published
    return written


def data_card(
    name: str,
    public: PublicSet,
    target: Path,
    arrays: Mapping[str, Array],
    sources: Mapping[str, str],
    published: bool | None,
) -> dict[str, Any]:
    """Return what is known of a file of a converted set, as Croissant describes data.

    sources: the authors' files -> SHA-256. published: as of `prepare`.
    """
    files = {target.name: checksum(target), **sources}
    known = public.licence or "none stated: ask its authors before you pass it on"
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": name,
        "description": str(type(public).__doc__).partition("\n")[0],
        "url": f"https://{public.origin.split()[0]}",
        "isBasedOn": public.origin,
        "license": f"https://spdx.org/licenses/{known}" if public.licence else known,
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": file,
                "name": file,
                "contentUrl": file,
                "encodingFormat": "application/zip" if file == target.name else "application/octet-stream",
                "sha256": digest,
            }
            for file, digest in files.items()
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "arrays",
                "name": "arrays",
                "field": [
                    {
                        "@type": "cr:Field",
                        "@id": f"arrays/{key}",
                        "name": key,
                        "dataType": _TYPES.get(array.dtype.kind, "sc:Text"),
                        "isArray": True,
                        "arrayShape": ",".join(map(str, array.shape)),
                        "source": {"fileObject": {"@id": target.name}},
                    }
                    for key, array in arrays.items()
                ],
            }
        ],
        "sameAsPublishedResults": published,
    }


def _holds(path: Path, arrays: Mapping[str, Array]) -> bool:
    """Return whether an archive holds exactly these arrays."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return digest({name: archive[name] for name in archive.files}) == digest(arrays)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error):
        return False


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
