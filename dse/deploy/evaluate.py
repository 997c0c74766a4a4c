"""From a point of a study to a bundle, and from a bundle to answers on new recordings."""

from __future__ import annotations

import dataclasses
import glob
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dse import dataset, registry, store
from dse.config import ConfigError, Sections
from dse.config.contracts import Source
from dse.deploy.bundle import Bundle, BundleError, read, write
from dse.measure import decision
from dse.measure.confusion import confusion
from dse.measure.heads import head_answers, head_slices, joint_label
from dse.measure.objectives.accuracy import wilson_se
from dse.measure.run import read_out
from dse.models.snn.quantise import BITS, exponents, rounded
from dse.recordings import RecordingError, npz
from dse.recordings.event_files import EventFiles
from dse.recordings.events import EventFile
from dse.recordings.scene import COLUMNS, SceneTrials
from dse.records import Answers, Array, Dataset, Network, Response
from dse.study import precision
from dse.study.results import Study


@dataclass(frozen=True)
class Evaluation:
    """What a bundle answers on new recordings.

    label: (n,) answered class; time_ms: (n,) when; decided: (n,) whether theta was reached.
    target: (n,) true class, -1 where the file has no label.
    accuracy, accuracy_se, confusion: over the labelled recordings; None where there are none.
    notes: what had to be repaired in the recordings.
    """

    classes: tuple[str, ...]
    label: Array
    time_ms: Array
    decided: Array
    target: Array
    accuracy: float | None
    accuracy_se: float | None
    confusion: Array | None
    notes: tuple[str, ...] = ()

    @property
    def decision_latency_ms(self) -> float:
        """Mean time of the answer."""
        return float(self.time_ms.mean())

    @property
    def undecided(self) -> float:
        """Fraction of recordings that never reach theta."""
        return float(1 - self.decided.mean())

    @property
    def answers(self) -> list[dict[str, Any]]:
        """One row per recording, in the file's order; `true` is None where it has no label."""
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
    def columns(self) -> dict[str, Any]:
        """The numbers as one row, named as in the record of a trial."""
        return {
            "recordings": len(self.label),
            "labelled": int((self.target >= 0).sum()),
            "accuracy": self.accuracy,
            "accuracy_se": self.accuracy_se,
            "decision_latency_ms": self.decision_latency_ms,
            "undecided": self.undecided,
        }


def evaluate(bundle: str | Path, data_file: str | Path, *, repair: bool = False) -> Evaluation:
    """Answer on new recordings with a bundle's own preprocessing, network and decision rule.

    Args:
        bundle: folder of a bundle.
        data_file: recordings of the kind that the bundle was trained on, labelled or not.
        repair: whether to go on after faults in event files.

    Raises:
        BundleError: the bundle is damaged or of a newer schema, or its classifier refuses the recordings.
        RecordingError: the recordings do not fit.
    """
    found = read(bundle)
    path = Path(data_file).absolute()
    source = _at(path, found.sections.data)
    kind = registry.name_of("recordings", source)
    if repair:
        if not isinstance(source, EventFiles):
            text = f"only event files can be repaired, got data of kind '{kind}'"
            raise RecordingError(f"{path.name}: {text}")
        source = dataclasses.replace(source, repair=True)
    kinds = {**found.sections.kinds, "data": kind}
    sections = dataclasses.replace(found.sections, data=source, kinds=kinds)
    data, notes = dataset.build_for(sections, path.parent, found.classes)
    if data.spikes.n_channels != found.fitted.n_channels:
        raise BundleError(
            f"{data_file}: must have {found.fitted.n_channels} input channels after preprocessing, "
            f"got {data.spikes.n_channels}"
        )
    data = dataclasses.replace(data, heads=found.heads)
    try:
        said = found.sections.model.respond(found.fitted, data, data.test)
    except ValueError as error:  # recordings of another length, for one
        raise BundleError(f"{data_file}: {error}") from None
    label, time_ms, decided = _answered(found, data, said)
    target, classes = np.asarray(data.target[data.test]), found.classes
    for head in found.heads:
        if head.name == found.head:
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
        notes=tuple(notes),
    )


def _answered(bundle: Bundle, data: Dataset, said: Response | Answers) -> tuple[Array, Array, Array]:
    """Return what a bundle's decision rule makes of its classifier: label, time of the answer, decided.

    A label of -1 is a combination of the heads' answers that no training recording had.
    """
    if isinstance(said, Answers):
        column = -1 if bundle.read_out_ms is None else int(np.abs(said.time_ms - bundle.read_out_ms).argmin())
        label = said.label[:, column]
        for head in bundle.heads:
            if head.name == bundle.head:
                label = head.of_class[label]
        return label, np.full(len(label), said.time_ms[column]), np.ones(len(label), bool)
    n, n_steps = said.output.shape[:2]
    parts = dict(zip((x.name for x in bundle.heads), head_slices(data), strict=False))  # without heads: one
    output = said.output[..., parts.get(bundle.head, slice(None))]
    if bundle.phi is not None and bundle.theta is not None:
        label, step, decided = decision.decide(output, bundle.phi, bundle.theta)
        return label, (step + 1) * said.step_ms, decided
    if bundle.read_out_ms is not None:
        n_steps = min(n_steps, max(1, round(bundle.read_out_ms / said.step_ms)))
    if parts and not bundle.head:
        counts = output[:, :n_steps].sum(axis=1, dtype=np.int64)
        label = joint_label(head_answers(data, counts), bundle.heads)
    else:
        label = read_out(output[:, :n_steps])
    return label, np.full(n, n_steps * said.step_ms), np.ones(n, bool)


def _confusion(label: Array, target: Array, n_classes: int) -> Array:
    """Return the counts of answers that are a class."""
    named = label >= 0
    return confusion(label[named], target[named], n_classes)


def _at(path: Path, data: Source) -> Source:
    """Return section `data` for new recordings at a path; what was trained on a scene may meet a sensor.

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


def export(study: Study, point: Mapping[str, Any], folder: str | Path) -> Bundle:
    """Write the bundle of a design point; of several repeats, the one whose accuracy is nearest their mean.

    Args:
        study: where the point is from.
        point: a row of `study.points()`, as a skyline or a pick returns it.
        folder: where the bundle is published; a bundle that is there is replaced.

    Raises:
        ValueError: the point names no trial, or a phi, theta or precision that the study did not evaluate.
        BundleError: the folder holds something else, or the design's encoder must know the label.
        StoreError: an artefact is damaged, or the bundle cannot be written.
    """
    if "trial" not in point:
        raise ValueError(f"a point must have the column trial, got the columns {', '.join(map(str, point))}")
    trial = int(point["trial"])
    phi, theta, read_out_ms = (_setting(point.get(name)) for name in ("phi", "theta", "read_out_ms"))
    records = study.runs(trial)
    if "sections" in records[0] and (why := _sections_of(study, records[0]).reads_labels):
        raise BundleError(f"{study.folder}: trial {trial} cannot be deployed: {why}")
    head = str(point.get("task", "")) if point.get("task") in records[0].get("of_heads", {}) else ""
    setting = _precision(point)
    accuracies = np.array(
        [_accuracy(study, record, setting, head, phi, theta, read_out_ms) for record in records]
    )
    chosen = records[int(np.abs(accuracies - accuracies.mean()).argmin())]
    artefacts = store.run_folder(study.folder, trial, chosen["repeat"])
    evidence = {
        "study": study.space["study"],
        "seed": chosen["seed"],
        "trial": trial,
        "repeat": chosen["repeat"],
        "accuracy_of_repeats": accuracies.tolist(),
        "data": chosen["data"],
        "warnings": study.warnings,
        "environment": store.read_json(study.folder / "environment.json"),
    }
    fitted = store.fitted_of(store.load_arrays(artefacts / "weights.npz"))
    if setting != precision.AS_TRAINED:
        assert isinstance(fitted, Network)  # nothing else was evaluated at another precision
        fitted = rounded(fitted, *setting)
        weight_bits, pruned = setting
        shared = exponents(fitted, weight_bits)
        evidence["precision"] = {"weight_bits": weight_bits, "pruned": pruned, "exponents": shared}
    made = Bundle(
        fitted=fitted,
        sections=dataclasses.replace(_sections_of(study, chosen), test=None),
        classes=tuple(chosen["classes"]),
        phi=phi,
        theta=theta,
        record={str(name): store.plain(value) for name, value in point.items() if not _is_missing(value)},
        evidence=evidence,
        read_out_ms=read_out_ms,
        heads=store.heads_of({"name": name, **of} for name, of in chosen.get("heads", {}).items()),
        head=head,
        plugins=tuple(study.space.get("plugins", ())),
    )
    write(made, Path(folder))
    return made


def _sections_of(study: Study, record: Mapping[str, Any]) -> Sections:
    """Return the sections that a run was recorded with.

    Raises:
        BundleError: they name what is not there, such as a component of a plugin.
    """
    try:
        return Sections.from_plain(record["sections"], f"{study.folder}: trial {record['trial']}")
    except ConfigError as error:
        raise BundleError(str(error)) from None


def _precision(point: Mapping[str, Any]) -> precision.Setting:
    """Return the precision of a point: as trained where it says none, or more bits than can be taken away."""
    bits, pruned = (_setting(point.get(name)) for name in ("weight_bits", "pruned_after"))
    return BITS if bits is None else min(int(bits), BITS), pruned or 0.0


def _setting(value: Any) -> float | None:
    """Return phi or theta of a point; None for the full read-out, which has neither."""
    return None if _is_missing(value) else float(value)


def _accuracy(
    study: Study,
    record: Mapping[str, Any],
    setting: precision.Setting,
    head: str,
    phi: float | None,
    theta: float | None,
    read_out_ms: float | None,
) -> float:
    """Return the validation accuracy of one run at a point.

    Raises:
        ValueError: the run failed, or it was not evaluated there.
    """
    where = f"{study.folder}: trial {record['trial']}"
    if record["status"] != "finished":
        raise ValueError(f"{where} failed: {record['reason']}")
    suffix = f"_{head}" if head else ""
    folder = store.run_folder(study.folder, record["trial"], record["repeat"])
    numbers, files = record, None
    if setting != precision.AS_TRAINED:
        evaluated = {x.setting: x for x in precision.rows(folder)}.get(setting)
        if evaluated is None:
            weight_bits, pruned = setting
            raise ValueError(f"{where} was not evaluated at {weight_bits} bits with {pruned:g} pruned")
        numbers, files = evaluated.numbers, evaluated.files

    def arrays(name: str) -> Mapping[str, Array]:
        return store.load_arrays(folder / name) if files is None else files[name]

    if phi is not None and theta is not None:
        found = arrays(f"surface{suffix}.npz")
        at = np.isclose(found["phi"], phi)[:, None] & np.isclose(found["theta"], theta)
        missing = f"phi {phi:g}, theta {theta:g}"
    elif read_out_ms is not None:
        found = arrays(f"read_out{suffix}.npz")
        at = np.isclose(found["decision_latency_ms"], read_out_ms)
        missing = f"{read_out_ms:g} ms"
    else:
        own = numbers["of_heads"][head] if head else numbers
        return float(own["columns"]["accuracy"])
    if not at.any():
        raise ValueError(f"{where} was not evaluated at {missing}")
    return float(found["accuracy"][at][0])


def _is_missing(value: Any) -> bool:
    import pandas

    return bool(pandas.api.types.is_scalar(value) and pandas.isna(value))
