"""Spikes and data sets on disk: written piece by piece, read as memory maps.

    spikes      row_offsets, channel, t_us (may be absent); start, low, high of the windows; positions of the
                channels; lengths; levels, rises (may be absent)
    data set    target, train, validation, test; `meta.json` names the spikes, which lie in the folder beside

Spikes alone are mapped: a map keeps a file open, and a study may have hundreds of data sets.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import DTypeLike

from dse.base.records import Array, Dataset, Head, Spikes
from dse.config.yaml_lines import Raw
from dse.data.dataset.parts import Part, Progress, silent
from dse.data.recordings import RecordingError
from dse.store import heads_of

_META = "meta.json"
_ABSENT = (FileNotFoundError, NotADirectoryError, IsADirectoryError)
_OF_SPIKES = ("row_offsets", "channel")
_OF_WINDOWS = ("start", "low", "high")
_OF_DATASET = ("target", "train", "validation", "test")


@dataclass(frozen=True)
class Meta:
    """What `meta.json` of a data set holds.

    spikes: name of the folder of its spikes. classes: names of the codes.
    fitted: section -> its keys that were fitted to the recordings, as plain data.
    warnings: what is suspicious about the recordings.
    heads: parts of a joint target (`dse.store.heads_document`).
    transductive: why an evaluation of these spikes has seen its own answers; '' where it has not.
    jitter_steps: how far training windows move, where the spikes have room for more.
    left_out: groups that are to be left out of training in turn: `column` and `values`.
    """

    spikes: str
    classes: list[str]
    fitted: dict[str, dict[str, Raw]]
    warnings: list[str]
    heads: list[dict[str, object]]
    transductive: str
    jitter_steps: int | None = None
    left_out: list[dict[str, Any]] | None = None


def write_spikes(parts: Sequence[Part], folder: Path, threads: int = 1, progress: Progress = silent) -> None:
    """Write the spikes and windows of several sources, laid end to end, one recording at a time.

    The parts, the data and perhaps a test file, agree in channels, step and window. The files are the same
    with any number of threads, which trials are simulated on.
    """
    n_stored, n = max(part.n_stored for part in parts), sum(len(part.start) for part in parts)
    done, filled = 0, 0
    with contextlib.ExitStack() as files:
        more: dict[str, Callable[[Array], None]] = {}

        def write(name: str, values: Array, dtype: DTypeLike) -> None:
            if name not in more:
                more[name] = files.enter_context(_growing(folder / f"{name}.npy", dtype))
            more[name](values)

        write("row_offsets", np.zeros(1), np.int64)
        for part in parts:
            for counts, channels, t_us in part.rows(threads):
                ends = np.full(n_stored, filled + len(channels), np.int64)
                ends[: len(counts)] = filled + np.cumsum(counts)
                write("row_offsets", ends, np.int64)
                write("channel", channels, np.int32)
                if t_us is not None:
                    write("t_us", t_us, np.int32)
                filled += len(channels)
                done += 1
                progress(f"preparing data: {done} of {n} recordings")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _OF_WINDOWS}
    arrays |= {"positions": parts[0].positions.astype(np.int32), "lengths": parts[0].lengths}
    for name, values in (arrays | {"levels": parts[0].levels, "rises": parts[0].rises}).items():
        if values is not None:
            np.save(folder / f"{name}.npy", values)
    _write_meta(
        folder,
        {
            "schema": "dse/spikes/2",
            "n_steps": parts[0].n_steps,
            "notes": [note for part in parts for note in part.notes()],
            "spikes": {
                "n_steps": n_stored,
                "n_channels": parts[0].n_channels,
                "step_ms": parts[0].step_ms,
            },
        },
    )


@dataclass(frozen=True)
class Stored:
    """Spikes with their windows.

    start, low, high: (n,) as in Dataset. n_steps: length of a window.
    positions, rises: as in Dataset.
    lengths, levels: as in Part, of the data without the test file.
    notes: what had to be repaired.
    """

    spikes: Spikes
    start: Array
    low: Array
    high: Array
    n_steps: int
    positions: Array
    lengths: Array
    levels: Array | None
    notes: list[str]
    rises: Array | None = None


def read_spikes(folder: Path) -> Stored:
    """Return the spikes of a folder, memory-mapped and read-only."""
    with _readable(folder, "spikes"):
        meta = json.loads((folder / _META).read_text(encoding="utf-8"))
        rows, channel = (np.load(folder / f"{name}.npy", mmap_mode="r") for name in _OF_SPIKES)
        t_us = np.load(path, mmap_mode="r") if (path := folder / "t_us.npy").is_file() else None
        spikes = Spikes(rows, channel, **meta["spikes"], t_us=t_us)
        arrays = {name: np.load(folder / f"{name}.npy") for name in (*_OF_WINDOWS, "positions", "lengths")}
        for name in ("levels", "rises"):
            arrays[name] = np.load(path) if (path := folder / f"{name}.npy").is_file() else None
        return Stored(spikes, **arrays, n_steps=meta["n_steps"], notes=meta["notes"])


def write_dataset(folder: Path, target: Array, split: tuple[Array, Array, Array], meta: Meta) -> None:
    """Write everything of a data set but its spikes to an empty folder.

    target: (n,) codes. split: train, validation and test indices. meta: what `read_meta` is to return.
    """
    for name, array in zip(_OF_DATASET, (target, *split), strict=True):
        np.save(folder / f"{name}.npy", array.astype(np.int64))
    stated = {name: value for name, value in vars(meta).items() if value is not None}
    _write_meta(folder, {"schema": "dse/dataset/3"} | stated)


def read_meta(folder: Path) -> Meta:
    """Return what a data set's `meta.json` holds.

    Raises:
        RecordingError: there is none, or a damaged one.
    """
    with _readable(folder, "data set"):
        meta = json.loads((folder / _META).read_text(encoding="utf-8"))
        return Meta(**{name: meta[name] for name in meta if name != "schema"})


def load(folder: Path) -> Dataset:
    """Return a data set from its folder, its spikes memory-mapped and read-only.

    Raises:
        RecordingError: the folder holds no data set, or a damaged one.
    """
    folder = Path(folder)
    meta = read_meta(folder)
    with _readable(folder, "data set"):
        arrays = {name: np.load(folder / f"{name}.npy") for name in _OF_DATASET}
        heads = heads_of(meta.heads)
    spikes = read_spikes(folder.parent / meta.spikes)
    return joined(spikes, tuple(meta.classes), **arrays, heads=heads, jitter_steps=meta.jitter_steps)


def joined(
    stored: Stored,
    classes: tuple[str, ...],
    target: Array,
    train: Array,
    validation: Array,
    test: Array,
    heads: tuple[Head, ...] = (),
    jitter_steps: int | None = None,
) -> Dataset:
    """Return a data set of spikes with their windows, and all that follows from labels.

    Training windows move by at most `jitter_steps`, and where that is None by all that is stored.
    """
    start, low, high = (x.astype(np.int32) for x in (stored.start, stored.low, stored.high))
    room_low, room_high = None, None
    if jitter_steps is not None:
        room_low, room_high = low, high
        low, high = np.maximum(low, start - jitter_steps), np.minimum(high, start + jitter_steps)
    return Dataset(
        spikes=stored.spikes, target=target, classes=classes, start=start, start_low=low, start_high=high,
        n_steps=stored.n_steps, train=train, validation=validation, test=test,
        positions=stored.positions, heads=heads, room_low=room_low, room_high=room_high, rises=stored.rises,
    )  # fmt: skip


@contextlib.contextmanager
def _growing(path: Path, dtype: DTypeLike) -> Iterator[Callable[[Array], None]]:
    """Yield a function that appends to a one-dimensional .npy; the header gets its length at the end."""
    header = {"descr": npy.dtype_to_descr(np.dtype(dtype)), "fortran_order": False}
    with path.open("wb") as file:
        npy.write_array_header_1_0(file, {**header, "shape": (0,)})  # numpy leaves room for any length
        begin, length = file.tell(), 0

        def append(values: Array) -> None:
            nonlocal length
            file.write(np.ascontiguousarray(values, dtype).data)
            length += len(values)

        yield append
        file.seek(0)
        npy.write_array_header_1_0(file, {**header, "shape": (length,)})
        assert file.tell() == begin


def _write_meta(folder: Path, meta: Mapping[str, object]) -> None:
    (folder / _META).write_text(json.dumps(meta, indent=1), encoding="utf-8")


@contextlib.contextmanager
def _readable(folder: Path, what: str) -> Iterator[None]:
    try:
        yield
    except (*_ABSENT, ValueError, KeyError, TypeError, AttributeError, EOFError) as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(f"{folder}: the {what} cannot be read ({error})") from None
