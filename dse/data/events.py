"""Event recordings from structured arrays."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from dse.data.labels import Labels, label_arrays, place_for, stored_name, write
from dse.recordings import RecordingError
from dse.recordings.events import event_faults
from dse.recordings.formats.arrays import UNITS_US, USUAL
from dse.records import Array, Ints

_FIELDS = ("t", "x", "y", "p")


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
    """
    if time_unit not in UNITS_US:
        raise RecordingError(f"time_unit must be one of {', '.join(UNITS_US)}, got {time_unit!r}")
    parts = [_fields(_array(x), UNITS_US[time_unit], i) for i, x in enumerate(recordings)]
    if not parts:
        raise RecordingError("recordings must hold at least one recording, got none")
    events = {name: np.concatenate([part[name] for part in parts]) for name in _FIELDS}
    offsets = np.cumsum([0, *(len(part["t"]) for part in parts)])
    if not len(events["t"]):
        raise RecordingError("recordings must have events, got none")
    width = int(events["x"].max()) + 1 if width is None else int(width)
    height = int(events["y"].max()) + 1 if height is None else int(height)
    named = {"t_us": events["t"], "x": events["x"], "y": events["y"], "polarity": events["p"]}
    for fault in event_faults(**named, offsets=offsets, width=width, height=height):
        raise RecordingError(f"recordings: {fault}")
    columns = label_arrays(labels, len(parts))
    arrays = {**named, "offsets": offsets, **{stored_name(x): y for x, y in columns.items()}}
    arrays["polarity"] = arrays["polarity"].astype(np.uint8)
    path = place_for(file, arrays)
    write(path, arrays)
    return {
        "kind": "events",
        "file": str(path),
        "width": width,
        "height": height,
        "x": "x",
        "y": "y",
        "polarity": "polarity",
        "columns": {name: stored_name(name) for name in columns},
    }


def _array(events: Any) -> Array:
    if isinstance(events, tuple) and len({np.shape(column) for column in events}) == 1:
        return np.stack(events, axis=-1)
    return np.asarray(events)


def _fields(events: Array, unit_us: float, number: int) -> dict[str, Ints]:
    """Return t in us, x, y and p of a recording, each (event,) int64."""
    where = f"recordings: recording {number}"
    if events.dtype.names is None:
        if events.ndim != 2 or events.shape[1] != len(_FIELDS):
            raise RecordingError(
                f"{where} must be a structured array with fields t, x, y and p, or (event, 4), got "
                f"{events.dtype} of shape {events.shape}"
            )
        values = {name: events[:, k] for k, name in enumerate(_FIELDS)}
    else:
        by_name = {name.lower(): name for name in events.dtype.names}
        known = {
            key: next((by_name[name] for name in usual if name in by_name), None)
            for key, usual in USUAL.items()
        }
        if lacks := [key for key in ("t", "x") if known[key] is None]:
            raise RecordingError(
                f"{where} must have fields t and x, got {', '.join(events.dtype.names)} without {lacks[0]}"
            )
        absent = {"y": np.zeros(len(events), np.int64), "p": np.ones(len(events), np.int64)}
        values = {key: absent[key] if name is None else events[name] for key, name in known.items()}
    numbers = {}
    for key, column in values.items():
        scaled = (
            np.asarray(column, np.float64) * unit_us if key == "t" and unit_us != 1 else np.asarray(column)
        )
        if not np.isfinite(scaled.astype(np.float64)).all():
            raise RecordingError(f"{where} must have finite {key}, got NaN or infinity")
        whole = np.rint(scaled) if scaled.dtype.kind == "f" else scaled
        if key != "t" and (whole != scaled).any():
            raise RecordingError(
                f"{where} must have whole numbers as {key}, got {scaled[whole != scaled][0]}"
            )
        numbers[key] = whole.astype(np.int64)
    numbers["p"] = np.where(numbers["p"] == -1, 0, numbers["p"])
    return numbers
