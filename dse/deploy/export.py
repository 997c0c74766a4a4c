"""From a design point of a study to a bundle."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse import store
from dse.base import registry
from dse.base.records import Array, Network, Parameters
from dse.config import ConfigError, Sections
from dse.config.contracts import Source
from dse.data.recordings import RecordingError
from dse.data.recordings.files import locate
from dse.data.recordings.prepare import CARD
from dse.deploy.bundle import Bundle, BundleError, Input, check_unedited
from dse.deploy.verify import publish
from dse.engine.neurons import neuron_of
from dse.engine.neurons.fixed_point import BITS
from dse.models.snn.quantise import rounded
from dse.store import StoreError
from dse.study import precision
from dse.study.record import RunRecord, load_records
from dse.study.results import Study, sections_found, trained_on

_NUMBERS = "weight_bits", "pruned_after", "phi", "theta", "read_out_ms"
"""Columns of a point that say how its network is rounded and decides."""


def export(
    study: Study,
    point: Mapping[str, Any],
    folder: str | Path,
    targets: Sequence[str] = (),
    recordings: str | Path | None = None,
    refit: Sequence[str] = (),
    force: bool = False,
) -> Bundle:
    """Write the bundle of a design point; of several repeats, the one with accuracy nearest their mean.

    Args:
        study: the study of the point.
        point: a row of `study.points()`, e.g. from a skyline or a pick.
        folder: folder to write; a bundle in it is replaced.
        targets: names of targets that are written with it; their verdicts are the bundle's `targets`.
        recordings: to run the targets on; None: they are not verified.
        refit: parts of the split, such as train and validation, that the design is trained on once more,
            together; what is recorded of it was measured before. Absent: it stays as it was trained.
        force: whether a bundle in the folder is replaced though files of its targets were edited.

    Raises:
        ValueError: the point names no trial, or a phi, theta or precision that the study did not evaluate.
        BundleError: the folder holds something else or edited files of targets, the design's encoder must
            know the label, or a target is unknown or cannot be written or run on this machine.
        RecordingError: the recordings do not fit.
        StoreError: an artefact is damaged, or the bundle cannot be written.

    >>> dse.export(study, study.best("n_weights <= 20000"), "small", ["c99"]).targets["c99"].kind
    'not verified'
    """
    return written(bundle_of(study, point, refit), folder, targets, recordings, force)


def written(
    bundle: Bundle,
    folder: str | Path,
    targets: Sequence[str] = (),
    recordings: str | Path | None = None,
    force: bool = False,
) -> Bundle:
    """Write a bundle, with arguments and errors as of `export`; return it with the verdicts."""
    if not force:
        check_unedited(Path(folder))
    verified = publish(bundle, Path(folder), targets, recordings)
    return dataclasses.replace(bundle, targets={name: each.verdict for name, each in verified.items()})


def bundle_of(study: Study, point: Mapping[str, Any], refit: Sequence[str] = ()) -> Bundle:
    """Return the bundle of a design point, as `export` writes it."""
    if "trial" not in point:
        raise ValueError(f"a point must have the column trial, got the columns {', '.join(map(str, point))}")
    trial = int(point["trial"])
    records = load_records(study.folder, trial)
    if records[0].sections and (why := _sections_of(study, records[0]).reads_labels):
        raise BundleError(f"{study.folder}: trial {trial} cannot be deployed: {why}")
    stated = [name for name in _NUMBERS if not _is_missing(point.get(name))]
    numbers: dict[str, Any] = {name: float(point[name]) for name in stated}
    # The trained precision if it states none, or more bits than were trained.
    bits, pruned = numbers.pop("weight_bits", BITS), numbers.pop("pruned_after", 0.0)
    setting = min(int(bits), BITS), pruned
    head = next((head.name for head in records[0].heads if head.name == point.get("task")), "")
    accuracies = np.array([_accuracy(study, record, numbers, setting, head) for record in records])
    chosen = records[int(np.abs(accuracies - accuracies.mean()).argmin())]
    artefacts = store.run_file(study.folder, trial, chosen.repeat)
    evidence = {
        "study": study.space["study"],
        "seed": chosen.seed,
        "design": dict(chosen.design),
        "trial": trial,
        "repeat": chosen.repeat,
        "accuracy_of_repeats": accuracies.tolist(),
        "data": chosen.data,
        "recordings": _recordings(study, chosen),
        "licence": _licence(study, chosen),
        "confusion": _confusion(artefacts, head),
        "warnings": study.warnings,
        "environment": store.document(study.folder, store.ENVIRONMENT, []),
    }
    if refit:
        from dse.study.jobs import fitted_again

        fitted, evidence["refit"] = fitted_again(study.folder, chosen, refit), list(refit)
    else:
        fitted = store.fitted_of(store.load_arrays(artefacts / "weights.npz"))
    if setting != precision.AS_TRAINED:
        assert isinstance(fitted, Network)  # nothing else was evaluated at another precision
        evidence["precision"] = dict(zip(("weight_bits", "pruned"), setting, strict=True))
        fitted = rounded(fitted, *setting)
    sections = dataclasses.replace(_sections_of(study, chosen), test=None)
    return Bundle(
        fitted=fitted,
        sections=sections,
        classes=chosen.classes,
        record={str(name): store.plain(value) for name, value in point.items() if not _is_missing(value)},
        evidence=evidence,
        heads=chosen.heads,
        head=head,
        plugins=_plugins(sections, fitted),
        input=_input(sections, fitted, study.folder, artefacts),
        **numbers,
    )


def _recordings(study: Study, record: RunRecord) -> str | None:
    """Return the hash of the recordings that a run was trained on; None where they are no longer found."""
    with contextlib.suppress(RecordingError, OSError):
        sections, base = trained_on(study.folder, record)
        return sections.data.content(base)
    return None


def _licence(study: Study, record: RunRecord) -> str | None:
    """Return the licence that the data card beside the recordings states; None where none is known."""
    if record.sections["data"]["kind"] == "scene":
        return "none: they are simulated"
    for sections, base, _ in sections_found(study.folder, record):
        if isinstance(file := getattr(sections.data, "file", None), str):
            with contextlib.suppress(RecordingError, StoreError, AttributeError):
                if licence := store.read_json(locate(f"{file}{CARD}", base)).get("license"):
                    return str(licence)
    return None


def _confusion(run: Path, head: str) -> dict[str, Any] | None:
    """Return which class a run took for which: of the test set, or of the validation samples without one."""
    counts = store.load_arrays(run / (f"confusion_{head}.npz" if head else "confusion.npz"))
    of = "test" if "test" in counts else "validation"
    return {"of": of, "counts": counts[of].tolist()} if of in counts else None


def _sections_of(study: Study, record: RunRecord) -> Sections:
    """Return the sections in the record of a run."""
    try:
        return Sections.from_plain(record.sections, f"{study.folder}: trial {record.trial}")
    except ConfigError as error:
        raise BundleError(str(error)) from None


def _input(sections: Sections, fitted: Network | Parameters, study: Path, artefacts: Path) -> Input | None:
    """Return what recordings a design takes; None if neither its sections nor the files of a run say it."""
    encoder, preprocessing = sections.encoder, sections.preprocessing
    response = store.load_arrays(artefacts / "response.npz")
    if "shape" in response:
        step_ms = float(response["step_ms"])
        window_ms = int(response["shape"][1]) * step_ms
        step_ms *= fitted.steps_per_sample if isinstance(fitted, Network) else 1
    else:
        window_ms, step_ms = float(response["time_ms"][-1]), 0.0
    if preprocessing is not None:
        step_ms = preprocessing.bin_us / 1000
        frame = _frame(sections.data, study)
        return None if frame is None else Input("events", 0, *frame, round(window_ms / step_ms), step_ms)
    step_ms = getattr(sections.data, "step_ms", step_ms)
    if not step_ms:
        return None
    n_steps = round(window_ms / step_ms)
    return Input.of_channels(encoder, fitted.n_channels, n_steps, step_ms)


def _frame(data: Source, study: Path) -> tuple[int, int] | None:
    """Return the width and height of the frame of events; None if the recordings are not found.

    They are looked up beside the study, and beside the folder of results that it lies in.
    """
    if isinstance(getattr(data, "width", None), int):
        return data.width, data.height  # type: ignore[attr-defined]
    for base in (study, study.absolute().parents[1]):
        with contextlib.suppress(ConfigError, RecordingError):
            recordings = data.read(base)
            return recordings.width, recordings.height  # type: ignore[union-attr]
    return None


def _plugins(sections: Sections, fitted: Network | Parameters) -> tuple[str, ...]:
    """Return the sources of the plugins that the components of a classifier are from."""
    components: list[object] = [sections.data, sections.encoder, sections.model]
    classes = [type(component) for component in components]
    if isinstance(fitted, Network):
        classes += [neuron_of(layer.neuron) for layer in fitted.layers]
    plugins = [plugin for cls in classes if (plugin := registry.plugin_of(cls)) is not None]
    return tuple(dict.fromkeys(plugin.source for plugin in plugins))


def _accuracy(
    study: Study, record: RunRecord, rule: Mapping[str, float], setting: precision.Setting, head: str
) -> float:
    """Return the validation accuracy of one run at a decision rule and a precision, of a head or of all."""
    where = f"{study.folder}: trial {record.trial}"
    if record.numbers is None:
        raise ValueError(f"{where} failed: {record.reason}")
    folder = store.run_file(study.folder, record.trial, record.repeat)
    archive, own = folder, record
    if setting != precision.AS_TRAINED:
        evaluated = precision.evaluations(folder)
        if setting not in evaluated:
            weight_bits, pruned = setting
            raise ValueError(f"{where} was not evaluated at {weight_bits} bits with {pruned:g} pruned")
        archive, own = evaluated[setting]

    def arrays(kind: str) -> Mapping[str, Array]:
        return store.load_arrays(archive / (f"{kind}_{head}.npz" if head else f"{kind}.npz"))

    if "phi" in rule and "theta" in rule:
        measured, phi, theta = arrays("surface"), rule["phi"], rule["theta"]
        at = np.isclose(measured["phi"], phi)[:, None] & np.isclose(measured["theta"], theta)
        missing = f"phi {phi:g}, theta {theta:g}"
    elif "read_out_ms" in rule:
        measured = arrays("read_out")
        at = np.isclose(measured["decision_latency_ms"], rule["read_out_ms"])
        missing = f"{rule['read_out_ms']:g} ms"
    else:
        return float(own.measured.of_head(head).columns["accuracy"])
    if not at.any():
        raise ValueError(f"{where} was not evaluated at {missing}")
    return float(measured["accuracy"][at][0])


def _is_missing(value: Any) -> bool:
    import pandas

    return bool(pandas.api.types.is_scalar(value) and pandas.isna(value))
