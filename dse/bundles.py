"""From a point of a study to a bundle, and from a bundle to answers on new recordings."""

from __future__ import annotations

import glob
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dse import dataset, decision, store
from dse.deploy.bundle import Bundle, BundleError, read, write
from dse.measure import read_out
from dse.metrics.accuracy import wilson_se
from dse.metrics.confusion import confusion
from dse.recordings import RecordingError, npz
from dse.recordings.scene import COLUMNS
from dse.records import Array
from dse.study import Study

_SECTIONS = ("data", "task", "window", "preprocessing", "encoder", "model", "training")


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
                "answer": self.classes[label],
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
        BundleError: the bundle is damaged or of a newer schema.
        RecordingError: the recordings do not fit.
    """
    from dse.models.response import respond

    found = read(bundle)
    path = Path(data_file).absolute()
    own = _at(path, found.sections["data"])
    if repair and own["kind"] != "event_files":
        raise RecordingError(
            f"{path.name}: only event files can be repaired, got data of kind '{own['kind']}'"
        )
    sections = {**found.sections, "data": {**own, "repair": True} if repair else own}
    data, notes = dataset.build_for(sections, path.parent, found.classes)
    if data.spikes.n_channels != found.network.n_channels:
        raise BundleError(
            f"{data_file}: must have {found.network.n_channels} input channels after preprocessing, "
            f"got {data.spikes.n_channels}"
        )
    response = respond(found.network, data, data.test)
    n, n_steps = response.output.shape[:2]
    if found.phi is None or found.theta is None:
        label, step, decided = read_out(response.output), np.full(n, n_steps - 1), np.ones(n, bool)
    else:
        label, step, decided = decision.decide(response.output, found.phi, found.theta)
    target = np.asarray(data.target[data.test])
    known = target >= 0
    correct, total = int((label == target)[known].sum()), int(known.sum())
    return Evaluation(
        classes=found.classes,
        label=label,
        time_ms=(step + 1) * response.step_ms,
        decided=decided,
        target=target,
        accuracy=correct / total if total else None,
        accuracy_se=float(wilson_se(correct, total)) if total else None,
        confusion=confusion(label[known], target[known], len(found.classes)) if total else None,
        notes=tuple(notes),
    )


def _at(path: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    """Return section `data` for new recordings at a path; what was trained on a scene may meet a sensor.

    Raises:
        RecordingError: the file cannot be read.
    """
    if data["kind"] not in ("scene", "event_files"):
        return {**data, "file": str(path)}
    if data["kind"] == "scene" and path.suffix in (".yaml", ".yml"):
        return {**data, "scene": str(path)}
    if data["kind"] == "scene" and path.suffix == ".npz" and "offsets" in npz.headers(path):
        # As `dse simulate` writes them: several recordings, the frame beside them.
        frame = {name: int(value) for name, value in npz.load(path, ("width", "height")).items()}
        fields = {name: name for name in ("x", "y", "polarity")}
        return {
            "kind": "events",
            "file": str(path),
            **frame,
            **fields,
            "columns": {name: name for name in COLUMNS},
        }
    own = {"kind": "event_files"} if data["kind"] == "scene" else dict(data)
    if path.is_dir():
        return {**own, "folder": str(path)}
    return {**own, "folder": str(path.parent), "pattern": glob.escape(path.name)}


def export(study: Study, point: Mapping[str, Any], folder: str | Path) -> Bundle:
    """Write the bundle of a design point; of several repeats, the one whose accuracy is nearest their mean.

    Args:
        study: where the point is from.
        point: a row of `study.points()`, as a skyline or a pick returns it.
        folder: where the bundle is published; a bundle that is there is replaced.

    Raises:
        ValueError: the point names no trial, or phi and theta that the study did not evaluate.
        BundleError: the folder holds something else.
        StoreError: an artefact is damaged, or the bundle cannot be written.
    """
    if "trial" not in point:
        raise ValueError(f"a point must name its trial, got the columns {', '.join(map(str, point))}")
    trial = int(point["trial"])
    phi, theta = (_setting(point.get(name)) for name in ("phi", "theta"))
    records = study.runs(trial)
    accuracies = np.array([_accuracy(study, record, phi, theta) for record in records])
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
    made = Bundle(
        network=store.network_of(store.load_arrays(artefacts / "weights.npz")),
        sections={name: chosen["sections"][name] for name in _SECTIONS if chosen["sections"].get(name)},
        classes=tuple(chosen["classes"]),
        phi=phi,
        theta=theta,
        record={str(name): _plain(value) for name, value in point.items() if not _is_missing(value)},
        evidence=evidence,
    )
    write(made, Path(folder))
    return made


def _setting(value: Any) -> float | None:
    """Return phi or theta of a point; None for the full read-out, which has neither."""
    return None if value is None or math.isnan(value) else float(value)


def _accuracy(study: Study, record: Mapping[str, Any], phi: float | None, theta: float | None) -> float:
    """Return the validation accuracy of one run at a point.

    Raises:
        ValueError: the run failed, or it was not evaluated there.
    """
    where = f"{study.folder}: trial {record['trial']}"
    if record["status"] != "finished":
        raise ValueError(f"{where} failed: {record['reason']}")
    if phi is None or theta is None:
        return float(record["columns"]["accuracy"])
    folder = store.run_folder(study.folder, record["trial"], record["repeat"])
    surface = store.load_arrays(folder / "surface.npz")
    at = np.isclose(surface["phi"], phi)[:, None] & np.isclose(surface["theta"], theta)
    if not at.any():
        raise ValueError(f"{where} was not evaluated at phi {phi:g}, theta {theta:g}")
    return float(surface["accuracy"][at][0])


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _is_missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))
