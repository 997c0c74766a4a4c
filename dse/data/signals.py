"""Sampled recordings from arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse.data.labels import Labels, label_arrays, place_for, stored_name, write
from dse.recordings import RecordingError
from dse.recordings.borders import end_to_end
from dse.records import Array, Ints

_AXES = ("recording", "step", "channel")


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
        signals: (recording, step, channel), (recording, step) of one channel such as scikit-learn's X, or a
            list of recordings of different lengths, (step, channel) or (step,) each; also tensors and data
            frames.
        labels: (recording,) numbers or texts, which become the label column `label`, or a mapping from the
            names of label columns to these.
        step_ms: sampling period.
        axes: order of the axes, e.g. 'recording channel step', or 'channel step' of each in a list.
        positions: x and y of every channel.
        file: where to write; None: a file in the folder `recordings`, named by its contents.

    Raises:
        RecordingError: recordings without samples, with NaN, or of different channels; labels that do not
            fit.
    """
    if not np.isfinite(step_ms) or step_ms <= 0:
        raise RecordingError(f"step_ms must be a number > 0, got {step_ms!r}")
    flat, borders = _end_to_end(signals, axes)
    columns = label_arrays(labels, len(borders) - 1)
    arrays = {"signal": flat, "offsets": borders, **{stored_name(x): y for x, y in columns.items()}}
    path = place_for(file, arrays)
    write(path, arrays)
    data: dict[str, Any] = {
        "kind": "time_series",
        "file": str(path),
        "step_ms": float(step_ms),
        "offsets": "offsets",
        "columns": {name: stored_name(name) for name in columns},
    }
    if positions is not None:
        data["positions"] = [[int(x), int(y)] for x, y in positions]
    return data


def _end_to_end(signals: Any, axes: str | None) -> tuple[Array, Ints]:
    """Return samples (sum of lengths, channel) and the borders of the recordings."""
    if isinstance(signals, list | tuple):
        parts = [_recording(np.asarray(x), axes, i) for i, x in enumerate(signals)]
        if not parts:
            raise RecordingError("signals must hold at least one recording, got none")
        for i, part in enumerate(parts):
            if part.shape[1] != parts[0].shape[1]:
                raise RecordingError(
                    f"signals must have the same channels in every recording, got {parts[0].shape[1]} in "
                    f"recording 0 and {part.shape[1]} in recording {i}"
                )
        offsets = np.cumsum([0, *map(len, parts)])
        return end_to_end(np.concatenate(parts), offsets, "signals")
    cube = np.asarray(signals)
    if cube.dtype.kind == "O":
        return _end_to_end(list(cube), axes)
    names = axes.split() if axes else list(_AXES[: cube.ndim])
    if len(names) != cube.ndim or sorted(names) not in (sorted(_AXES), sorted(_AXES[:2])):
        raise RecordingError(
            f"signals must be ({', '.join(names)}), with axes recording, step and perhaps channel, got shape "
            f"{cube.shape}"
        )
    if "channel" not in names:
        cube, names = cube[..., None], [*names, "channel"]
    return end_to_end(cube.transpose([names.index(name) for name in _AXES]), None, "signals")


def _recording(array: Array, axes: str | None, number: int) -> Array:
    """Return a recording as (step, channel)."""
    names = axes.split() if axes else ["step", "channel"][: array.ndim]
    if len(names) != array.ndim or sorted(names) not in (["channel", "step"], ["step"]):
        raise RecordingError(
            f"signals: recording {number} must be (step, channel) or (step,), got shape {array.shape}"
        )
    if array.dtype.kind not in "biuf":
        raise RecordingError(f"signals: recording {number} must hold numbers, got {array.dtype}")
    if array.ndim == 1:
        return array[:, None]
    return array if names[0] == "step" else array.T
