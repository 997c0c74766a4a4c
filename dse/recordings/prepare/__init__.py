"""Public recordings as the shipped search spaces read them: one file per set that is converted here.

A set is converted from the files that its authors publish, number by number: nothing is filtered, resampled
or rescaled. Beside the result stands a record of its origin, licence and checksums. Sets whose authors' files
have no documented layout are listed with their origin, and are not converted.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.prepare import icub
from dse.records import Array
from dse.store import atomic, checksum


@dataclass(frozen=True)
class PublicSet:
    """A public set of recordings.

    file: that the search spaces read, relative to the folder of recordings.
    origin: where its authors publish it. licence: that its authors state; '' if none.
    files: names of the authors' files that are converted.
    convert: folder of these -> arrays of the result; None: their layout is not documented.
    """

    file: str
    origin: str
    licence: str
    files: tuple[str, ...] = ()
    convert: Callable[[Path], Mapping[str, Array]] | None = None


SETS = {
    "icub": PublicSet(
        "icub_roboskin20_test/icub_roboskin20_test200.npz",
        "github.com/tasbolat1/transfer_learning at a745c42, folder temp_data",
        "",
        icub.FILES,
        icub.convert,
    ),
    "fabric_slide": PublicSet(
        "fabric_slide/fabric_slide_train_val.npz", "github.com/wngfra/FabricSlide at eceb771", "MIT"
    ),
    "braille": PublicSet(
        "braille7_events/braille7_train_val.npz",
        "github.com/neuromorphic-polito/L2MU-Braille at 72344f6",
        "Apache-2.0",
    ),
    "evtouch": PublicSet(
        "evtouch_objects/evtouch_objects.npz", "github.com/clear-nus/TactileSGNet at f224d38", ""
    ),
    "sankar": PublicSet(
        "sankar_ridged_textures/sankar_rigid_finger_train_val.npz",
        "github.com/ssankar6/SciAdv-Hybrid_robotics_with_tactile_sensing at d657260",
        "",
    ),
}
RECORD = ".origin.json"
"""Ends the name of the record of a result."""


def prepare(name: str, source: Path, out: Path) -> Path:
    """Convert a public set and return the path of the result; the record of its origin stands beside it.

    Args:
        name: of `SETS`.
        source: folder with the authors' files.
        out: folder of recordings.

    Raises:
        RecordingError: no such set, a file is missing or holds something else, or the result is already
            there and another.
        OSError: the result cannot be written.
    """
    if name not in SETS:
        raise RecordingError(f"unknown set '{name}'; known: {', '.join(SETS)}")
    public = SETS[name]
    if public.convert is None:
        raise RecordingError(
            f"{name}: the layout of its authors' files ({public.origin}) is not documented, "
            "so they are not converted"
        )
    if missing := [file for file in public.files if not (source / file).is_file()]:
        raise RecordingError(f"{source}: has no {missing[0]}; {name} needs {', '.join(public.files)}")
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **dict(public.convert(source)))  # type: ignore[arg-type]
    target, content = out / public.file, buffer.getvalue()
    if target.exists() and target.read_bytes() != content:
        raise RecordingError(f"{target}: is another file than is made from {source}; move it away first")
    with atomic(target) as temporary:
        temporary.write_bytes(content)
    record = {
        "set": name,
        "origin": public.origin,
        "licence": public.licence or "none stated: ask its authors before you pass it on",
        "source_sha256": {file: checksum(source / file) for file in public.files},
        "result_sha256": {target.name: checksum(target)},
    }
    with atomic(target.with_name(f"{target.name}{RECORD}")) as temporary:
        temporary.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return target
