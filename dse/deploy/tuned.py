"""Weights that were trained on as a torch module, back in a bundle, which is measured and priced anew."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse import registry, store
from dse.config import Sections
from dse.deploy.bundle import Bundle, BundleError, read, write
from dse.deploy.reference import prepared
from dse.hardware.profile import Profile, load
from dse.measure.on_chips import columns_on
from dse.measure.run import Measurement, measure
from dse.native.extras import require_torch
from dse.neurons.fixed_point import BITS
from dse.records import Network, Outcome, Response
from dse.store import StoreError
from dse.study import imported
from dse.study.record import RunRecord, load_records
from dse.study.results import Study
from dse.study.results import open as open_study

if TYPE_CHECKING:
    from torch import Tensor

_OF_DESIGN = ("trial", "task", "family", "weight_bits", "pruned_after", "phi", "theta", "read_out_ms")
"""Columns of a record, beside the axes of its search space, that no training changes."""
_OF_STUDY = ("train_s", "t_p_", "t_h_", "t_c_")
"""Beginnings of columns of a training, and of the best among all settings of a study."""


def import_weights(
    folder: str | Path, file: str | Path, data_file: str | Path, out: str | Path, hardware: str | None = None
) -> Bundle:
    """Write a bundle with the weights of a file, measured on recordings and priced like any design.

    Args:
        folder: the bundle whose module was trained on.
        file: `torch.save(module.state_dict(), file)`.
        data_file: labelled recordings; the record of the new bundle holds what was measured on them.
        out: folder of the new bundle; an existing bundle is replaced.
        hardware: profile, by name or file, that costs are computed on; None: that of the record, if any.

    Raises:
        BundleError: a bundle is damaged, the weights are not of its network or no numbers, or no recording
            has a label.
        ConfigError: the profile does not exist or is wrong.
        MissingExtra: torch is not installed.
        RecordingError: the recordings do not fit.
        StoreError: the bundle cannot be written.
    """
    require_torch("importing a torch module")
    bundle = with_weights(read(folder), Path(file))
    bundle = dataclasses.replace(bundle, record=_record(bundle, data_file, hardware))
    write(bundle, Path(out))
    return bundle


def import_into(bundle: Bundle, results: str | Path) -> int:
    """Add a bundle with imported weights to the study that it is from, as a trial; return its number.

    The trial has the design that the bundle was exported from. It is measured on the study's own recordings,
    with all decision rules and hardware of the study, in 8 bits.

    Raises:
        BundleError: its weights were not imported, or it is of another study, search space or sensor.
        ConfigError: a hardware profile of the study has changed.
        StoreError: the study is damaged, runs now, lacks its recordings or has these weights already.
    """
    study, evidence = open_study(results), bundle.evidence
    about = evidence.get("imported")
    if not about:
        raise BundleError("the bundle holds the weights that its study trained: there is nothing to import")
    assert isinstance(bundle.fitted, Network)  # nothing else is imported
    name, here = evidence["study"], study.space["study"]
    if name != here:
        raise BundleError(f"{results}: is study '{here}', and the bundle was exported from study '{name}'")
    origin = next((x for x in _runs(study, int(evidence["trial"])) if x.repeat == evidence["repeat"]), None)
    if origin is None or not origin.finished:
        raise BundleError(f"{results}: has no run {evidence['repeat']} of trial {evidence['trial']}")
    _check_same(bundle, origin, f"{results}: trial {origin.trial}")
    taken = {"study": name, "trial": origin.trial, "weights": about["file"], "checksum": about["checksum"]}
    return imported.add(study.folder, origin, bundle.fitted, taken)


def _runs(study: Study, trial: int) -> list[RunRecord]:
    try:
        return load_records(study.folder, trial)
    except StoreError as error:
        if isinstance(error, store.Damaged):
            raise
        return []


def _check_same(bundle: Bundle, origin: RunRecord, where: str) -> None:
    """Check that a bundle is of a run: its data, preprocessing, network and seed."""
    there = dataclasses.replace(Sections.from_plain(origin.sections, where), test=None).to_plain()
    here = bundle.sections.to_plain()
    for section in dict.fromkeys([*here, *there]):
        if section == "data":  # its paths may differ; its content is compared below
            continue
        a, b = (json.loads(json.dumps(x.get(section), default=store.plain)) or {} for x in (there, here))
        for key in dict.fromkeys([*a, *b]):
            if a.get(key) != b.get(key):
                text = f"{section}.{key} is {a.get(key)!r}, and {b.get(key)!r} in the bundle"
                raise BundleError(f"{where} has another search space than the bundle: {text}")
    if bundle.evidence["data"] != origin.data or tuple(bundle.classes) != origin.classes:
        raise BundleError(f"{where} was trained on other recordings than the bundle")
    if bundle.evidence["seed"] != origin.seed:
        raise BundleError(f"{where} has seed {origin.seed}, and the bundle {bundle.evidence['seed']}")


def with_weights(bundle: Bundle, file: Path) -> Bundle:
    """Return a bundle with the weights in a file; its record still is that of the old ones.

    Raises:
        BundleError: the file is damaged, or its weights are not of the bundle's network or no numbers.
    """
    from dse.deploy import module as modules

    state = _state(file)
    module = modules.of_bundle(bundle)
    expected: Mapping[str, Tensor] = module.state_dict()
    for name in [*expected, *state]:
        if name not in state:
            raise BundleError(f"{file}: must be a state of this bundle's module, but lacks {name}")
        if name not in expected:
            raise BundleError(f"{file}: must be a state of this bundle's module, which has no {name}")
        here, there = state[name], expected[name]
        if here.shape != there.shape:
            raise BundleError(f"{file}: {name} must be {tuple(there.shape)}, got {tuple(here.shape)}")
        if not bool(here.isfinite().all()):
            raise BundleError(f"{file}: {name} must hold finite numbers, got {here[~here.isfinite()][0]}")
    trained = dict(module.named_parameters())
    for name, values in expected.items():
        if name not in trained and not bool((state[name] == values).all()):
            raise BundleError(f"{file}: {name} must be that of the bundle: it is a module of another network")
    module.load_state_dict(dict(state))
    evidence = {**bundle.evidence, "imported": {"file": file.name, "checksum": store.checksum(file)}}
    return dataclasses.replace(bundle, fitted=module.network(), evidence=evidence, targets={})


def _state(file: Path) -> dict[str, Tensor]:
    """Return the state dict in a file."""
    import torch

    from dse.deploy.module import loaded

    state = loaded(file)
    if not isinstance(state, dict) or not all(isinstance(x, torch.Tensor) for x in state.values()):
        raise BundleError(f"{file}: must be written by torch.save(module.state_dict(), FILE)")
    return state


def _record(bundle: Bundle, data_file: str | Path, hardware: str | None) -> dict[str, object]:
    """Return the record of a bundle as measured on recordings, with the columns of a design point."""
    name = hardware or bundle.record.get("hardware")
    chip = None if name is None else load(str(name))
    data = prepared(bundle, data_file).dataset
    samples = data.test[data.target[data.test] >= 0]
    if not samples.size:
        raise BundleError(f"{data_file}: must have labelled recordings to measure the bundle on, got none")
    data = dataclasses.replace(data, validation=samples, test=samples[:0])
    try:
        response = bundle.sections.model.respond(bundle.fitted, data, samples)
    except ValueError as error:
        raise BundleError(f"{data_file}: {error}") from None
    assert isinstance(response, Response)
    phi, theta = ([] if x is None else [x] for x in (bundle.phi, bundle.theta))
    precision = bundle.evidence.get("precision") or {}
    measured = measure(
        Outcome(bundle.fitted, response, None, {}),
        data,
        np.array(phi),
        np.array(theta),
        [] if chip is None else [chip],
        int(precision.get("weight_bits", BITS)),
        bundle.read_out_ms,
    )
    of_design = {k: x for k, x in bundle.record.items() if k in _OF_DESIGN or "." in k}
    columns = _of_point(measured.heads[bundle.head] if bundle.head else measured, bundle, chip)
    columns = {k: x for k, x in columns.items() if not k.startswith(_OF_STUDY)}
    plain = {k: store.plain(x) for k, x in (of_design | columns).items()}
    return {**plain, **({} if chip is None else {"hardware": chip.name}), "measured_on": Path(data_file).name}


def _of_point(measured: Measurement, bundle: Bundle, chip: Profile | None) -> dict[str, Any]:
    """Return the columns at the decision rule of a bundle, and those on a chip."""
    of_chip = {} if chip is None else measured.hardware[chip.name]
    at: tuple[int, ...] = (0, 0)
    if bundle.phi is not None:
        of_rule, load = measured.points, measured.points_load
    elif bundle.read_out_ms is not None:
        of_rule, load, at = measured.read_outs, measured.read_outs_load, (0,)  # multiples of the time
    else:
        return {**measured.columns, **of_chip}
    if chip is not None and load is not None:
        of_chip = columns_on(chip, load.mapped(lambda counts: np.asarray(counts[at])))
    declared = registry.columns()
    of_design = {k: x for k, x in measured.columns.items() if k not in declared or declared[k].of_design}
    columns = {**of_design, **{name: x[at] for name, x in of_rule.items()}, **of_chip}
    return {name: np.asarray(x).item() for name, x in columns.items()}
