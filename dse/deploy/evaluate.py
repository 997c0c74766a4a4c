"""From a bundle to answers on recordings: counted where they are labelled, or what speaks for each class."""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from dse.data.given import from_arrays
from dse.deploy.bundle import Bundle, read
from dse.deploy.classifier import BundleError, Classifier
from dse.deploy.reference import answered, decided, prepared, read_out_number, source_at
from dse.hardware.counter import MeasuredPower, measured_power
from dse.measure.confusion import confusion
from dse.measure.heads import softmax
from dse.measure.objectives.accuracy import wilson_se
from dse.models.counts.readouts import Readouts
from dse.recordings.source import Sampled
from dse.recordings.time_series import TimeSeries
from dse.records import Answers, Bools, Dataset, Floats, Ints, Response


@dataclass(frozen=True)
class Evaluation:
    """The answers of a bundle on new recordings.

    label: (n,) answered class; time_ms: (n,) time of the answer; decided: (n,) whether theta was reached.
    target: (n,) true class, -1 without a label in the file.
    accuracy, accuracy_se, confusion: over the labelled recordings; None if there are none.
    notes: whether it was trained on these recordings, and the repairs of the recordings.
    power: of this machine's processor at rest and while it classifies; None unless requested.
    """

    classes: tuple[str, ...]
    label: Ints
    time_ms: Floats
    decided: Bools
    target: Ints
    accuracy: float | None
    accuracy_se: float | None
    confusion: Ints | None
    notes: tuple[str, ...] = ()
    power: MeasuredPower | None = None

    @property
    def decision_latency_ms(self) -> float:
        """Mean time of the answer."""
        return float(self.time_ms.mean())

    @property
    def undecided(self) -> float:
        """Fraction of recordings that never reach theta."""
        return float(1 - self.decided.mean())

    @property
    def answers(self) -> list[dict[str, object]]:
        """One row per recording, in the file's order; `true` is None without a label."""
        return [
            {
                "recording": i,
                "answer": self.classes[label] if label >= 0 else None,
                "true": self.classes[target] if target >= 0 else None,
                "time_ms": float(time_ms),
                "decided": bool(decided),
            }
            for i, (label, target, time_ms, decided) in enumerate(
                zip(self.label, self.target, self.time_ms, self.decided, strict=True)
            )
        ]

    @property
    def columns(self) -> dict[str, object]:
        """The numbers as one row, named as in the record of a trial."""
        power = self.power
        of_power = {} if power is None else {"power_idle_w": power.idle_w, "power_w": power.running_w}
        return {
            "recordings": len(self.label),
            "labelled": int((self.target >= 0).sum()),
            "accuracy": self.accuracy,
            "accuracy_se": self.accuracy_se,
            "decision_latency_ms": self.decision_latency_ms,
            "undecided": self.undecided,
            **of_power,
        }


class Deployable(Protocol):
    """What has a bundle, such as a pick."""

    def bundle(self) -> Bundle:
        """Return the bundle."""


def evaluate(
    bundle: Bundle | Deployable | str | Path,
    data_file: str | Path,
    *,
    repair: bool = False,
    rest_s: float | None = None,
) -> Evaluation:
    """Classify new recordings with the preprocessing, network and decision rule of a bundle.

    Args:
        bundle: as `export` returns it, its folder, or a pick.
        data_file: recordings of the kind that the bundle was trained on, labelled or not.
        repair: whether to continue after faults in event files.
        rest_s: measure the power of this machine's processor: for so long at rest, then while it classifies.

    Raises:
        BundleError: the bundle is damaged or of a newer schema, or its classifier refuses the recordings.
        RecordingError: the recordings do not fit.

    >>> found = dse.evaluate("bundle", "touch.npz")
    >>> found.classes, found.label.shape
    (('denim', 'silk'), (40,))
    """
    if isinstance(bundle, str | Path):
        classifier = read(bundle)
    else:
        classifier = bundle if isinstance(bundle, Bundle) else bundle.bundle()
    new = prepared(classifier, data_file, repair=repair)
    data, notes = new.dataset, new.notes
    del new  # the recordings themselves are not needed any more

    def respond() -> Response | Answers:
        return answered(classifier, data, data_file)

    response = respond()
    power = None if rest_s is None else measured_power(respond, rest_s)
    label, time_ms, reached = decided(classifier, data, response)
    target, classes = classifier.answered(np.asarray(data.target[data.test])), classifier.answers
    known = target >= 0
    correct, total = int((label == target)[known].sum()), int(known.sum())
    return Evaluation(
        classes=classes,
        label=label,
        time_ms=time_ms,
        decided=reached,
        target=target,
        accuracy=correct / total if total else None,
        accuracy_se=float(wilson_se(correct, total)) if total else None,
        confusion=_confusion(label[known], target[known], len(classes)) if total else None,
        notes=(*_known(classifier, Path(data_file).absolute()), *notes),
        power=power,
    )


def _known(bundle: Bundle, path: Path) -> list[str]:
    """Return a sentence if the design was trained and selected on these recordings."""
    trained = bundle.evidence.get("recordings")
    if not trained or source_at(path, bundle.sections.data).content(path.parent) != trained:
        return []
    text = "the design was trained and selected on these recordings"
    return [f"{text}: this accuracy does not say how it does on new ones"]


def _confusion(label: Ints, target: Ints, n_classes: int) -> Ints:
    """Return the counts of answers that are a class."""
    named = label >= 0
    return confusion(label[named], target[named], n_classes)


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
