"""A Dataset on disk, under a name that follows from everything it is made of; shared by memory map."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import secrets
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from dse.dataset.sections import Resolved
from dse.recordings import RecordingError
from dse.recordings.files import locate
from dse.records import Array, Dataset, Spikes

# Raised when the same sections and files give another data set than before.
_VERSION = 1
_SECTIONS = ("data", "test", "window", "split", "preprocessing", "encoder")
_FILES = ("file", "labels")
_OF_SPIKES = ("row_offsets", "channel")
_OF_DATASET = ("target", "start", "start_low", "start_high", "train", "validation", "test")


def dataset_key(resolved: Resolved, base: Path) -> str:
    """Return a hash of all that a data set follows from: the sections, and the contents of the files.

    Where the files lie and what they are called does not matter.

    Raises:
        RecordingError: a file is not found.
    """
    parts: dict[str, Any] = {name: dict(resolved.get(name) or {}) for name in _SECTIONS}
    for name in ("data", "test"):
        for key in _FILES:
            if parts[name].get(key) is not None:
                parts[name][key] = _content(locate(parts[name][key], base))
    text = json.dumps([_VERSION, resolved["task"]["target"], parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def save(dataset: Dataset, folder: Path) -> None:
    """Write a data set to a folder, whole or not at all; a folder that is there already is kept."""
    folder = Path(folder)
    if folder.exists():
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}")
    part.mkdir()
    try:
        for name, array in _arrays(dataset).items():
            np.save(part / f"{name}.npy", array)
        spikes = dataset.spikes
        meta = {
            "schema": "dse/dataset/1",
            "classes": list(dataset.classes),
            "n_steps": dataset.n_steps,
            "spikes": {"n_steps": spikes.n_steps, "n_channels": spikes.n_channels, "step_ms": spikes.step_ms},
        }
        (part / "meta.json").write_text(json.dumps(meta, indent=1))
        os.replace(part, folder)
    except OSError:
        # Another worker may have written the same data set meanwhile.
        if not (folder / "meta.json").is_file():
            raise
    finally:
        shutil.rmtree(part, ignore_errors=True)


def load(folder: Path) -> Dataset:
    """Return a data set from its folder, arrays memory-mapped and read-only.

    Raises:
        RecordingError: the folder holds no data set, or a damaged one.
    """
    folder = Path(folder)
    try:
        meta = json.loads((folder / "meta.json").read_text())
        arrays = {
            name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in (*_OF_SPIKES, *_OF_DATASET)
        }
        spikes = Spikes(**{name: arrays.pop(name) for name in _OF_SPIKES}, **meta["spikes"])
        return Dataset(spikes=spikes, classes=tuple(meta["classes"]), n_steps=meta["n_steps"], **arrays)
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        raise RecordingError(f"{folder}: no readable data set ({error})") from None


def _arrays(dataset: Dataset) -> dict[str, Array]:
    spikes = {name: getattr(dataset.spikes, name) for name in _OF_SPIKES}
    return spikes | {name: getattr(dataset, name) for name in _OF_DATASET}


def _content(path: Path) -> str:
    about = path.stat()
    return _hash_of(path, about.st_size, about.st_mtime_ns)


@functools.lru_cache(maxsize=64)
def _hash_of(path: Path, size: int, modified_ns: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
