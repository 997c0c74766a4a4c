"""Recordings from a data set that yields (sample, label), such as those of torch and tonic."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dse.data.events import from_events
from dse.data.signals import from_arrays
from dse.recordings import RecordingError


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
