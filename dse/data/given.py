"""Arrays, events and data sets of Python -> the file that a component of section `data` reads."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse import store
from dse.base.records import Array, Ints
from dse.data.recordings import RecordingError
from dse.data.recordings.arrays import cells_of
from dse.data.recordings.events import event_faults
from dse.data.recordings.formats.arrays import UNITS_US, USUAL
from dse.data.recordings.source import label_columns
from dse.data.recordings.time_series import FRAMES, USUAL_AXES, are_axes, of_cube

FOLDER = "recordings"
"""Where files go that are given no name, below the working folder."""

Labels = Mapping[str, Sequence[Any]] | Sequence[Any]
"""Label columns by name, or the one column `label`."""


def from_arrays(
    signals: Any,
    labels: Labels | None = None,
    *,
    step_ms: float,
    axes: str | None = None,
    positions: Sequence[tuple[int, int]] | None = None,
    file: str | Path | None = None,
) -> dict[str, Any]:
    """Return section `data` for sampled recordings, which are written to an .npz file.

    Args:
        signals: (recording, step, channel), (recording, step) of one channel such as scikit-learn's X,
            (recording, step, row, column), or a list of recordings of different lengths, (step, channel) or
            (step,) each; also tensors and data frames.
        labels: (recording,) numbers or texts, which become the label column `label`, or a mapping from the
            names of label columns to these.
        step_ms: sampling period.
        axes: order of the axes, e.g. 'recording channel step', or 'channel step' of each in a list.
        positions: x and y of every channel.
        file: where to write; None: a file in the folder `recordings`, named by its contents.

    Raises:
        RecordingError: recordings without samples, with NaN, or of different channels; labels that do not
            fit.

    >>> dse.data.from_arrays(np.zeros((6, 50, 2)), ["denim", "silk"] * 3, step_ms=4, file="zeros.npz")
    {'kind': 'time_series', 'step_ms': 4.0, 'offsets': 'offsets', 'file': ..., 'columns': ...}
    """
    if not np.isfinite(step_ms) or step_ms <= 0:
        raise RecordingError(f"step_ms must be a number > 0, got {step_ms!r}")
    cube = signals if isinstance(signals, list | tuple) else np.asarray(signals)
    if isinstance(cube, list | tuple) or cube.dtype.kind == "O":
        if not len(cube):
            raise RecordingError("signals must hold at least one recording, got none")
        cube, axes = cells_of([_recording(np.asarray(x), axes, i) for i, x in enumerate(cube)]), None
    else:
        axes = axes or " ".join(FRAMES if cube.ndim == len(FRAMES) else USUAL_AXES[: cube.ndim])
        if not are_axes(axes.split()) or len(axes.split()) != cube.ndim:
            raise RecordingError(
                f"signals must be ({', '.join(axes.split())}), with axes recording, step and perhaps "
                f"channel, got shape {cube.shape}"
            )
    flat, borders = of_cube(cube, axes, "signals")
    data: dict[str, Any] = {"kind": "time_series", "step_ms": float(step_ms), "offsets": "offsets"}
    if positions is not None:
        data["positions"] = [[int(x), int(y)] for x, y in positions]
    return data | _written({"signal": flat, "offsets": borders}, labels, file)


def _recording(array: Array, axes: str | None, number: int) -> Array:
    """Return a recording as (step, channel)."""
    names = axes.split() if axes else ["step", "channel"][: array.ndim]
    where = f"signals: recording {number}"
    if len(names) != array.ndim or sorted(names) not in (["channel", "step"], ["step"]):
        raise RecordingError(f"{where} must be (step, channel) or (step,), got shape {array.shape}")
    if array.dtype.kind not in "biuf":
        raise RecordingError(f"{where} must hold numbers, got {array.dtype}")
    return array[:, None] if array.ndim == 1 else array if names[0] == "step" else array.T


def from_events(
    recordings: Iterable[Any],
    labels: Labels | None = None,
    *,
    width: int | None = None,
    height: int | None = None,
    time_unit: str = "us",
    file: str | Path | None = None,
) -> dict[str, Any]:
    """Return section `data` for event recordings, which are written to an .npz file.

    Args:
        recordings: structured arrays with fields t, x, y and p (or the usual names of these; y and p may be
            absent), as of tonic, arrays (event, 4) with these columns, or tuples of the four. Polarity is 1
            for ON, 0 or -1 for OFF.
        labels: as of `from_arrays`.
        width: of the frame; None: as large as the addresses need.
        height: as width.
        time_unit: of t: s, ms, us or ns.
        file: as of `from_arrays`.

    Raises:
        RecordingError: times that fall, addresses outside of the frame, other fields; labels that do not fit.

    >>> touch = np.arange(100), np.arange(100) % 8, np.zeros(100, int), np.ones(100, int)
    >>> dse.data.from_events([touch, touch], ["denim", "silk"], file="events.npz")
    {'kind': 'events', 'width': 8, 'height': 1, 'x': 'x', 'y': 'y', 'polarity': 'polarity', ...}
    """
    if time_unit not in UNITS_US:
        raise RecordingError(f"time_unit must be one of {', '.join(UNITS_US)}, got {time_unit!r}")
    parts = [_fields(x, UNITS_US[time_unit], f"recordings: recording {i}") for i, x in enumerate(recordings)]
    if not parts:
        raise RecordingError("recordings must hold at least one recording, got none")
    t_us, x, y, polarity = np.concatenate(parts, axis=1)
    offsets = np.cumsum([0, *(part.shape[1] for part in parts)])
    if not len(t_us):
        raise RecordingError("recordings must have events, got none")
    width = int(x.max()) + 1 if width is None else int(width)
    height = int(y.max()) + 1 if height is None else int(height)
    for fault in event_faults(t_us, x, y, polarity, offsets, width, height):
        raise RecordingError(f"recordings: {fault}")
    data = {"kind": "events", "width": width, "height": height, "x": "x", "y": "y", "polarity": "polarity"}
    arrays = {"t_us": t_us, "x": x, "y": y, "polarity": polarity.astype(np.uint8), "offsets": offsets}
    return data | _written(arrays, labels, file)


def _fields(events: Any, unit_us: float, where: str) -> Ints:
    """Return t in us, x, y and p of a recording, (4, event) int64."""
    columns = isinstance(events, tuple) and len({np.shape(column) for column in events}) == 1
    events = np.stack(events, axis=-1) if columns else np.asarray(events)
    if events.dtype.names is None:
        if events.ndim != 2 or events.shape[1] != len(USUAL):
            raise RecordingError(
                f"{where} must be a structured array with fields t, x, y and p, or (event, 4), got "
                f"{events.dtype} of shape {events.shape}"
            )
        values = dict(zip(USUAL, events.T, strict=True))
    else:
        by_name = {name.lower(): events[name] for name in events.dtype.names}
        known = {key: next((x for x in usual if x in by_name), None) for key, usual in USUAL.items()}
        values = {key: by_name[name] for key, name in known.items() if name is not None}
        if lacks := [key for key in ("t", "x") if key not in values]:
            got = f"{', '.join(events.dtype.names)} without {lacks[0]}"
            raise RecordingError(f"{where} must have fields t and x, got {got}")
    found = np.zeros((len(USUAL), len(events)), np.int64)
    found[3] = 1  # without polarity all are ON
    for k, key in enumerate(USUAL):
        if key not in values:
            continue
        column = np.asarray(values[key])
        if key == "t" and unit_us != 1:
            column = column.astype(np.float64) * unit_us
        if not np.isfinite(column.astype(np.float64)).all():
            raise RecordingError(f"{where} must have finite {key}, got NaN or infinity")
        found[k] = np.rint(column) if column.dtype.kind == "f" else column
        if key != "t" and (found[k] != column).any():
            raise RecordingError(
                f"{where} must have whole numbers as {key}, got {column[found[k] != column][0]}"
            )
    found[3][found[3] == -1] = 0
    return found


def from_dataset(
    dataset: Any,
    *,
    step_ms: float | None = None,
    axes: str = "step channel",
    time_unit: str = "us",
    file: str | Path | None = None,
) -> dict[str, Any]:
    """Return section `data` for a data set, whose samples are written to an .npz file.

    Structured arrays become events (the frame is the attribute `sensor_size` of the data set, if it has one),
    other samples signals. Labels become the column `label`; numbers are replaced by the names in the
    attribute `classes`, if the data set has one.

    Args:
        dataset: yields (sample, label), by index or one after the other.
        step_ms: sampling period of signals, which need it.
        axes: of a signal of two axes.
        time_unit: of events.
        file: as of `from_arrays`.

    Raises:
        RecordingError: no pairs, signals without step_ms; as of `from_arrays` and `from_events`.

    >>> pairs = [(np.zeros((50, 2)), "denim"), (np.ones((40, 2)), "silk")]
    >>> dse.data.from_dataset(pairs, step_ms=4, file="pairs.npz")
    {'kind': 'time_series', 'step_ms': 4.0, 'offsets': 'offsets', 'file': ..., 'columns': ...}
    """
    samples, labels = [], []
    for number, item in enumerate(_items(dataset)):
        if not isinstance(item, tuple | list) or len(item) != 2:
            raise RecordingError(f"dataset: item {number} must be (sample, label), got {type(item).__name__}")
        samples.append(np.asarray(item[0]))
        label = np.asarray(item[1])
        if label.size != 1:
            raise RecordingError(f"dataset: the label of item {number} must be one value, got {label.shape}")
        labels.append(label.item())
    if not samples:
        raise RecordingError("dataset must hold at least one sample, got none")
    names = getattr(dataset, "classes", None)
    if names is not None and all(isinstance(x, int) and 0 <= x < len(names) for x in labels):
        labels = [str(names[x]) for x in labels]
    if samples[0].dtype.names is not None:
        size = getattr(dataset, "sensor_size", None)
        frame = {"width": int(size[0]), "height": int(size[1])} if size is not None else {}
        return from_events(samples, labels, time_unit=time_unit, file=file, **frame)
    if step_ms is None:
        raise RecordingError("step_ms is required for signals: the time between two samples in ms")
    one_axis = samples[0].ndim == 1
    return from_arrays(samples, labels, step_ms=step_ms, axes=None if one_axis else axes, file=file)


def _items(dataset: Any) -> Iterator[Any]:
    if hasattr(dataset, "__len__") and hasattr(dataset, "__getitem__"):
        return (dataset[i] for i in range(len(dataset)))
    return iter(dataset)


def _written(arrays: dict[str, Array], labels: Labels | None, file: str | Path | None) -> dict[str, Any]:
    """Write recordings with their labels, whole or not at all; return the keys `file` and `columns`."""
    given: Mapping[str, Any] = labels if isinstance(labels, Mapping) else {"label": labels}
    found = {str(name): _values(values) for name, values in given.items() if values is not None}
    label_columns(found, {name: name for name in found}, {}, len(arrays["offsets"]) - 1, "labels")
    columns = {name: f"label_{name}" for name in found}
    arrays |= {columns[name]: values for name, values in found.items()}
    if file is None:
        digest = hashlib.sha256()
        for name, array in sorted(arrays.items()):
            digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data if array.size else b"")
        path = Path(FOLDER) / f"{digest.hexdigest()[:16]}.npz"
    else:
        path = Path(file)
        path = path if path.suffix == ".npz" else path.with_name(f"{path.name}.npz")
    path = path.absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    with store.published(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]
    return {"file": str(path), "columns": columns}


def _values(values: Any) -> Array:
    """Return labels as an array, of objects where they are no numbers or texts."""
    try:
        array = np.asarray(values)
    except ValueError:  # lists of different lengths
        array = cells_of(list(values))
    is_text = array.dtype.kind == "O" and all(isinstance(x, str) for x in array.ravel())
    return array.astype(str) if is_text else array
