"""Arrays, or a file of recordings -> the answers of a classifier, with what speaks for each class."""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dse.base.records import Answers, Dataset, Floats, Ints, Response
from dse.data.given import from_arrays
from dse.data.recordings.source import Sampled
from dse.data.recordings.time_series import TimeSeries
from dse.deploy.classifier import BundleError, Classifier
from dse.deploy.reference import answered, decided, prepared, read_out_number
from dse.measure.heads import softmax
from dse.models.counts.readouts import Readouts


def predicted(bundle: Classifier, data: Any, axes: str | None = None) -> tuple[Ints, Floats]:
    """Return the class that a classifier answers to each recording, (n,), and `shares`, (n, class).

    Args:
        bundle: as read or exported.
        data: recordings of the kind that it was trained on: a file, or arrays as of `dse.data.from_arrays`.
        axes: of the arrays.

    Raises:
        BundleError: it was not trained on sampled signals and gets arrays, or refuses the recordings.
        RecordingError: the recordings do not fit.
    """
    with _as_file(bundle, data, axes) as (of_file, path):
        new = prepared(of_file, path).dataset
        response = answered(of_file, new, path)
        label, time_ms, _ = decided(of_file, new, response)
    return label, shares(bundle, new, response, label, time_ms)


def shares(
    bundle: Classifier, data: Dataset, response: Response | Answers, label: Ints, time_ms: Floats
) -> Floats:
    """Return what speaks for each class, (n, class); rows sum to 1, and the answer has the most.

    Of a spiking network it is the share of output spikes until the answer, where each class begins with one
    spike; of layers of weights, the softmax of their outputs. What answers a class alone, and one head of
    several, gives it the accuracy on validation, and the others equal parts of the rest.
    """
    n_classes = len(bundle.answers)
    model: object = bundle.sections.model
    if isinstance(model, Readouts) and isinstance(response, Answers) and not bundle.heads:
        return softmax(model.scores(bundle.fitted, data, data.test, read_out_number(bundle, response)))
    if isinstance(response, Answers) or response.output.shape[2] != n_classes:
        least = 1.01 / n_classes  # the answer has more than any other class
        accuracy = bundle.record.get("accuracy")
        right = max(accuracy, least) if isinstance(accuracy, float) else 1.0
        parts = np.full((len(label), n_classes), (1 - right) / max(n_classes - 1, 1))
        parts[np.flatnonzero(label >= 0), label[label >= 0]] = right
        return parts
    step = np.rint(time_ms / response.step_ms).astype(np.int64)
    until = np.arange(response.output.shape[1])[None, :, None] < step[:, None, None]
    counts = 1.0 + np.where(until, response.output, 0).sum(axis=1)
    return np.asarray(counts / counts.sum(axis=1, keepdims=True))


@contextlib.contextmanager
def _as_file(bundle: Classifier, data: Any, axes: str | None) -> Iterator[tuple[Classifier, Path]]:
    """Yield a file of recordings, and the classifier of such files."""
    if isinstance(data, str | Path):
        yield bundle, Path(data)
        return
    trained = bundle.sections.data
    if bundle.sections.encoder is None or not isinstance(trained, Sampled):
        raise BundleError("data must be a file: arrays are for classifiers of sampled signals")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recordings.npz"
        from_arrays(data, step_ms=trained.step_ms, axes=axes, file=path)
        source = TimeSeries(
            file=str(path), step_ms=trained.step_ms, offsets="offsets", positions=trained.positions
        )
        yield dataclasses.replace(bundle, sections=dataclasses.replace(bundle.sections, data=source)), path
