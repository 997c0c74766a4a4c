"""From a bundle to answers on new recordings."""

from __future__ import annotations

import dataclasses
import glob
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse import dataset, registry
from dse.config.contracts import Source
from dse.deploy.bundle import Bundle, BundleError, read
from dse.hardware.counter import MeasuredPower, measured_power
from dse.measure import decision
from dse.measure.confusion import confusion
from dse.measure.heads import head_answers, head_slices, joint_label
from dse.measure.objectives.accuracy import wilson_se
from dse.measure.run import read_out
from dse.recordings import RecordingError, npz
from dse.recordings.event_files import EventFiles
from dse.recordings.events import EventFile
from dse.recordings.scene import COLUMNS, SceneTrials
from dse.records import Answers, Bools, Dataset, Floats, Ints, Response


@dataclass(frozen=True)
class Evaluation:
    """The answers of a bundle on new recordings.

    label: (n,) answered class; time_ms: (n,) time of the answer; decided: (n,) whether theta was reached.
    target: (n,) true class, -1 without a label in the file.
    accuracy, accuracy_se, confusion: over the labelled recordings; None if there are none.
    notes: the plugins that the bundle loaded, and the repairs of the recordings.
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


def evaluate(
    bundle: str | Path, data_file: str | Path, *, repair: bool = False, rest_s: float | None = None
) -> Evaluation:
    """Classify new recordings with the preprocessing, network and decision rule of a bundle.

    Args:
        bundle: folder of a bundle.
        data_file: recordings of the kind that the bundle was trained on, labelled or not.
        repair: whether to continue after faults in event files.
        rest_s: measure the power of this machine's processor: for so long at rest, then while it classifies.

    Raises:
        BundleError: the bundle is damaged or of a newer schema, or its classifier refuses the recordings.
        RecordingError: the recordings do not fit.
    """
    classifier = read(bundle)
    path = Path(data_file).absolute()
    source = _source_at(path, classifier.sections.data)
    kind = registry.name_of("recordings", source)
    if repair:
        if not isinstance(source, EventFiles):
            text = f"only event files can be repaired, got data of kind '{kind}'"
            raise RecordingError(f"{path.name}: {text}")
        source = dataclasses.replace(source, repair=True)
    kinds = {**classifier.sections.kinds, "data": kind}
    sections = dataclasses.replace(classifier.sections, data=source, kinds=kinds)
    data, notes = dataset.build_for(sections, path.parent, classifier.classes)
    if data.spikes.n_channels != classifier.fitted.n_channels:
        raise BundleError(
            f"{data_file}: must have {classifier.fitted.n_channels} input channels after preprocessing, "
            f"got {data.spikes.n_channels}"
        )
    data = dataclasses.replace(data, heads=classifier.heads)

    def respond() -> Response | Answers:
        return classifier.sections.model.respond(classifier.fitted, data, data.test)

    try:
        response = respond()
    except ValueError as error:  # recordings of another length, for one
        raise BundleError(f"{data_file}: {error}") from None
    power = None if rest_s is None else measured_power(respond, rest_s)
    label, time_ms, decided = _decide(classifier, data, response)
    target, classes = np.asarray(data.target[data.test]), classifier.classes
    for head in classifier.heads:
        if head.name == classifier.head:
            target, classes = np.where(target >= 0, head.of_class[target], -1), head.classes
    known = target >= 0
    correct, total = int((label == target)[known].sum()), int(known.sum())
    return Evaluation(
        classes=classes,
        label=label,
        time_ms=time_ms,
        decided=decided,
        target=target,
        accuracy=correct / total if total else None,
        accuracy_se=float(wilson_se(correct, total)) if total else None,
        confusion=_confusion(label[known], target[known], len(classes)) if total else None,
        notes=(*_on_plugins(classifier), *notes),
        power=power,
    )


def _on_plugins(bundle: Bundle) -> list[str]:
    names = ", ".join(Path(source).name for source in bundle.plugins)
    return [f"the bundle ran code of its plugins: {names}"] if names else []


def _decide(bundle: Bundle, data: Dataset, response: Response | Answers) -> tuple[Ints, Floats, Bools]:
    """Return the label, the time of the answer in ms, and whether theta was reached, by the decision rule.

    A label of -1 is a combination of the heads' answers that no training recording had.
    """
    if isinstance(response, Answers):
        column = (
            -1 if bundle.read_out_ms is None else int(np.abs(response.time_ms - bundle.read_out_ms).argmin())
        )
        label = response.label[:, column]
        for head in bundle.heads:
            if head.name == bundle.head:
                label = head.of_class[label]
        return label, np.full(len(label), response.time_ms[column]), np.ones(len(label), bool)
    n, n_steps = response.output.shape[:2]
    parts = dict(zip((x.name for x in bundle.heads), head_slices(data), strict=False))  # without heads: one
    output = response.output[..., parts.get(bundle.head, slice(None))]
    if bundle.phi is not None and bundle.theta is not None:
        label, step, decided = decision.decide(output, bundle.phi, bundle.theta)
        return label, (step + 1) * response.step_ms, decided
    if bundle.read_out_ms is not None:
        n_steps = min(n_steps, max(1, round(bundle.read_out_ms / response.step_ms)))
    if parts and not bundle.head:
        counts = output[:, :n_steps].sum(axis=1, dtype=np.int64)
        label = joint_label(head_answers(data, counts), bundle.heads)
    else:
        label = read_out(output[:, :n_steps])
    return label, np.full(n, n_steps * response.step_ms), np.ones(n, bool)


def _confusion(label: Ints, target: Ints, n_classes: int) -> Ints:
    """Return the counts of answers that are a class."""
    named = label >= 0
    return confusion(label[named], target[named], n_classes)


def _source_at(path: Path, data: Source) -> Source:
    """Return section `data` for new recordings at a path; a network of a scene may get those of a sensor.

    Raises:
        RecordingError: the file cannot be read.
    """
    if isinstance(data, SceneTrials):
        if path.suffix in (".yaml", ".yml"):
            return dataclasses.replace(data, scene=str(path))
        if path.suffix == ".npz" and "offsets" in npz.headers(path):
            # As `dse simulate` writes them: several recordings, the frame beside them.
            frame = npz.load(path, ("width", "height"))
            return EventFile(
                file=str(path),
                width=int(frame["width"]),
                height=int(frame["height"]),
                x="x",
                y="y",
                polarity="polarity",
                columns={name: name for name in COLUMNS},
            )
        data = EventFiles(folder=str(path.parent))
    if isinstance(data, EventFiles):
        if path.is_dir():
            return dataclasses.replace(data, folder=str(path))
        return dataclasses.replace(data, folder=str(path.parent), pattern=glob.escape(path.name))
    return dataclasses.replace(data, file=str(path))  # type: ignore[type-var]
