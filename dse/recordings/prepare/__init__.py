"""Public recordings as the shipped search spaces read them: one file per set.

A set is converted from the files that its authors publish, number by number: nothing is filtered, resampled
or rescaled. Beside each file of the result stands a record of its origin, licence and checksums, and whether
the recordings are those of the published results. Parts that no search space reads, such as held-out
repetitions, become files of their own.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.prepare import braille, evtouch, fabric, icub, sankar
from dse.recordings.prepare.parts import Converted, digest
from dse.records import Array
from dse.store import atomic, checksum


@dataclass(frozen=True)
class PublicSet:
    """A public set of recordings.

    file: that the search spaces read, relative to the folder of recordings; other parts stand beside it.
    origin: where its authors publish it. licence: that its authors state; '' if none.
    files: names of the authors' files that are converted.
    convert: folder of these -> files of the result.
    digest: of `file`, as the published results of `dse` were computed on it.
    """

    file: str
    origin: str
    licence: str
    files: tuple[str, ...]
    convert: Callable[[Path], Converted]
    digest: str


SETS = {
    "icub": PublicSet(
        "icub_roboskin20_test/icub_roboskin20_test200.npz",
        "github.com/tasbolat1/transfer_learning at a745c42",
        "",
        icub.FILES,
        icub.convert,
        "38edd90a1bdc10a5f124f4be9c586ba4ebe774df2bd5546d3bf5027273c70c61",
    ),
    "fabric_slide": PublicSet(
        "fabric_slide/fabric_slide_train_val.npz",
        "github.com/wngfra/FabricSlide at eceb771",
        "MIT",
        fabric.FILES,
        fabric.convert,
        "1512ad369e099b1a5fc78885da5dadc9a760fbb02dfccb660378240d6fddcf3b",
    ),
    "braille": PublicSet(
        "braille7_events/braille7_train_val.npz",
        "github.com/neuromorphic-polito/L2MU-Braille at 72344f6",
        "Apache-2.0",
        braille.FILES,
        braille.convert,
        "1bf2e5817fe34f887cdcb85b5d66f65709013c63c2327c96f0106299794ff380",
    ),
    "evtouch": PublicSet(
        "evtouch_objects/evtouch_objects.npz",
        "github.com/clear-nus/TactileSGNet at f224d38, Ev-Objects.zip",
        "",
        evtouch.FILES,
        evtouch.convert,
        "6d64d551c0e31507e1039e16eb1abca2324ab659c93a576b0e3224a9f9c62426",
    ),
    "sankar": PublicSet(
        "sankar_ridged_textures/sankar_rigid_finger_train_val.npz",
        "github.com/ssankar6/SciAdv-Hybrid_robotics_with_tactile_sensing at d657260",
        "",
        sankar.FILES,
        sankar.convert,
        sankar.DIGEST,
    ),
}
RECORD = ".origin.json"
"""Ends the name of the record of a file."""


@dataclass(frozen=True)
class Written:
    """A file of a converted set.

    published: whether it is that of the published results; None: no search space reads it.
    """

    path: Path
    published: bool | None


def prepare(name: str, source: Path, out: Path) -> list[Written]:
    """Convert a public set and write its files, the one that search spaces read first, each with its record.

    Args:
        name: of `SETS`.
        source: folder with the authors' files.
        out: folder of recordings.

    Raises:
        RecordingError: no such set, a file is missing or holds something else, or a file of the result is
            already there and another; then nothing is written.
        OSError: the result cannot be written.
    """
    if name not in SETS:
        raise RecordingError(f"unknown set '{name}'; known: {', '.join(SETS)}")
    public = SETS[name]
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
    written = []
    for target, arrays in sorted(targets.items(), key=lambda item: item[0] != main):
        published = digest(arrays) == public.digest if target == main else None
        _write(target, arrays)
        record = {
            "set": name,
            "origin": public.origin,
            "licence": public.licence or "none stated: ask its authors before you pass it on",
            "as_in_published_results": published,
            "source_sha256": sources,
            "result_sha256": {target.name: checksum(target)},
        }
        with atomic(target.with_name(f"{target.name}{RECORD}")) as temporary:
            temporary.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        written.append(Written(target, published))
    return written


def _write(target: Path, arrays: Mapping[str, Array]) -> None:
    if target.exists():
        return
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **dict(arrays))  # type: ignore[arg-type]
    with atomic(target) as temporary:
        temporary.write_bytes(buffer.getvalue())


def _holds(path: Path, arrays: Mapping[str, Array]) -> bool:
    """Return whether an archive holds exactly these arrays."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return digest({name: archive[name] for name in archive.files}) == digest(arrays)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error):
        return False
