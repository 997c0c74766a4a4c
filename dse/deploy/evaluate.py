"""From a bundle to answers on new recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from dse.base.records import Answers, Bools, Floats, Ints, Response
from dse.deploy.bundle import Bundle, read
from dse.deploy.reference import answered, decided, prepared, source_at
from dse.measure.confusion import confusion
from dse.measure.hardware.counter import MeasuredPower, measured_power
from dse.measure.objectives.accuracy import wilson_se


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
    named = known & (label >= 0)
    return Evaluation(
        classes=classes,
        label=label,
        time_ms=time_ms,
        decided=reached,
        target=target,
        accuracy=correct / total if total else None,
        accuracy_se=float(wilson_se(correct, total)) if total else None,
        confusion=confusion(label[named], target[named], len(classes)) if total else None,
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
