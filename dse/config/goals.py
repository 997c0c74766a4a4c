"""Readers of the sections decision, precision, hardware, objectives, search and execution."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping, Sequence
from itertools import chain, product
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from dse import registry
from dse.config.axes import Axis, n_combinations
from dse.config.chips import chips
from dse.config.contracts import SamplerSettings
from dse.config.device import missing, missing_package
from dse.config.expressions import ExpressionError, column_names, condition_faults, parse
from dse.config.faults import known_names
from dse.config.locate import hardware_names, is_hardware_file
from dse.config.parts import Part, read_fixed, read_or_axis
from dse.config.settings import Decision, Evaluation, ExecutionSettings, Precision, Reach, Search
from dse.config.space import DecisionGrid, SearchSettings
from dse.config.values import Report, blamed, echo, keys_of, read_fields
from dse.config.yaml_lines import Raw

_BATCH = 8
_STORAGE = re.compile(r"(postgresql|sqlite)://.")
AUTO = "auto"
"""The sampler that is chosen by the number of designs."""
_FEW = 12
_DECISION = {"phi": {"range": [0, 60], "step": 2}, "theta": {"range": [0.2, 1.0], "step": 0.05}}


def decision(raw: Raw, report: Report) -> DecisionGrid | None:
    """Read the decision parameters, each a value, a list, a choice or a stepped range; None after a fault."""
    written = {**_DECISION, **raw} if isinstance(raw, dict) else raw or _DECISION
    if isinstance(written, dict):
        written = {
            key: {"choice": value} if isinstance(value, list) else value for key, value in written.items()
        }
    values, good = read_fields(Decision, written, ("decision",), report, read_or_axis)
    every_ms = values.pop("read_out_every_ms", None)
    reach = values.get("phi")
    grids = {key: value.values if isinstance(value, Axis) else (value,) for key, value in values.items()}
    if isinstance(reach, Reach):
        grids["phi"] = ()
    elif any(isinstance(x, dict) for x in grids.get("phi") or ()):
        report(("decision", "phi"), "decision.phi must be integers, or up_to and step alone")
        good = False
    for key, numbers in grids.items():
        if numbers is None:
            text = f"decision.{key} is evaluated on a grid, so its range needs a step"
            report(("decision", key, "range"), text)
            good = False
    if not good:
        return None
    return DecisionGrid(
        phi=np.unique(np.asarray(grids["phi"], dtype=np.int64)),
        theta=np.unique(np.asarray(grids["theta"], dtype=np.float64)),
        phi_step=reach.step if isinstance(reach, Reach) else None,
        read_out_every_ms=every_ms,
    )


def precision(raw: Raw, report: Report) -> Precision | None:
    """Read section `precision`: how trained networks are rounded and pruned; None after a fault."""
    values, good = read_fields(Precision, raw, ("precision",), report, read_fixed)
    for key in ("weight_bits", "pruned"):
        if values.get(key) == ():
            report(("precision", key), f"precision.{key} must hold at least one value, got []")
            good = False
    if not good:
        return None
    rising = {key: tuple(sorted(set(values[key]))) for key in ("weight_bits", "pruned")}
    return Precision(**rising, within=values["within"])


def hardware(raw: Raw, report: Report, base: Path) -> tuple[str, ...]:
    """Read the names of hardware profiles, or their files; what files hold is checked where they are loaded.

    Args:
        raw: the list as written.
        report: called with (path, sentence) for every mistake.
        base: folder of the search space, which files are relative to.
    """
    known = hardware_names()
    names: dict[str, None] = {}
    for index, name in enumerate(_names("hardware", raw, report)):
        where = ("hardware", index)
        if name in names:
            report(where, f"hardware '{name}' is named twice")
        elif is_hardware_file(name) and not (base / name).is_file():
            report(where, f"hardware '{name}' must be a file, relative to the search space; there is none")
        elif not is_hardware_file(name) and name not in known:
            report(where, f"unknown hardware '{name}'; {known_names(name, known)}")
        names[name] = None
    return tuple(names)


def targets(raw: Raw, report: Report) -> tuple[str, ...]:
    """Read the names of targets that designs are to be exported to.

    Args:
        raw: the list as written.
        report: called with (path, sentence) for every mistake.
    """
    known = registry.known("targets")
    names: dict[str, None] = {}
    for index, name in enumerate(_names("targets", raw, report)):
        if name in names:
            report(("targets", index), f"target '{name}' is named twice")
        elif name not in known:
            report(("targets", index), f"unknown target '{name}'; {known_names(name, known)}")
        names[name] = None
    return tuple(names)


def check_neurons(names: Sequence[str], model: Part, report: Report, base: Path) -> None:
    """Report each chip that can run the neurons of no design, as these need programmable ones.

    Args:
        names: hardware profiles, or their files.
        model: section `model`.
        report: called with (path, sentence) for every such chip.
        base: folder of the search space, which files are relative to.
    """
    neurons: list[str] = []
    for part in model.entries.values() or [model]:
        named = part.components("neurons")
        if not named:
            return  # this family has no neurons
        neurons += named
    if set(neurons) != set(programmed_neurons(model)):
        return
    run = f"cannot run neuron {' or '.join(dict.fromkeys(neurons))}: its neurons cannot be programmed"
    for chip in chips(names, base):
        if chip.is_fixed:
            report(("hardware", chip.place), f"hardware '{chip.name}' {run}")


def programmed_neurons(model: Part) -> list[str]:
    """Return the neurons in section `model` that need programmable ones, each once."""
    known: dict[str, Any] = registry.known("neurons")
    named = [name for part in model.entries.values() or [model] for name in part.components("neurons")]
    return [name for name in dict.fromkeys(named) if getattr(known[name], "programmed", False)]


def check_steps(sections: Mapping[str, Part], report: Report) -> None:
    """Report neurons whose parameters need other input steps than the search space has.

    Args:
        sections: data .. training.
        report: called with (path, sentence) for every mistake.
    """
    data, model = sections.get("preprocessing", sections.get("data")), sections["model"]
    if data is None or not data.good:
        return
    steps = {getattr(built, "step_ms", None) for built in data.at_ends()}
    for part in model.entries.values() or [model]:
        parts = [x for built in part.at_ends() for x in (built, getattr(built, "neuron", None))]
        checks = [getattr(x, "check_step", None) for x in parts]
        messages: dict[str, None] = {}
        for check, step_ms in product(filter(None, checks), filter(None, steps)):
            try:
                check(step_ms)
            except ValueError as error:
                messages.setdefault(str(error))
        keys = part.values.keys() | {axis.place[1] for axis in part.axes.values()}
        for message in messages:
            report(*blamed(message, keys, ("model",)))


def objectives(
    raw: Raw,
    profiles: Sequence[str],
    report: Report,
    *,
    has_test: bool = True,
    evaluation: Evaluation | None = None,
) -> tuple[tuple[str, str], ...]:
    """Read objectives written `name:max`, `name:min` or `name` alone for the direction it declares.

    Args:
        raw: the list as written.
        profiles: hardware profiles of the search space.
        report: called with (path, sentence) for every mistake.
        has_test: whether the search space has a test set.
        evaluation: what else is tested.
    """
    known = registry.columns()
    of_hardware = registry.columns("hardware")
    directions: dict[str, str] = {}
    texts = _names("objectives", raw, report)
    if raw == [] or raw is None:
        report(("objectives",), f"objectives must hold at least one objective; {known_names('', known)}")
    for index, text in enumerate(texts):
        where = ("objectives", index)
        name, colon, direction = text.partition(":")
        name, direction = name.strip(), direction.strip()
        if name not in known:
            report(where, f"unknown objective '{name}'; {known_names(name, known)}")
            continue
        natural = known[name].direction
        if colon and direction not in ("max", "min"):
            report(where, f"objective '{name}' must be followed by :max or :min, got '{text}'")
        elif colon and direction != natural:
            report(where, f"objective '{name}' must be '{name}:{natural}', got '{text}'")
        if name in directions:
            report(where, f"objective '{name}' is named twice")
        if name in of_hardware and not profiles:
            report(where, f"objective '{name}' needs a hardware profile in section 'hardware', got none")
        if known[name].of_test and not has_test:
            text = "needs a test set: section 'test', or key test of the split"
            report(where, f"objective '{name}' {text}")
        key = known[name].of_evaluation
        if key and getattr(evaluation, key, None) is None:
            report(where, f"objective '{name}' needs {key} in section 'evaluation', got none")
        if not known[name].selects:
            report(where, f"objective '{name}' cannot select designs: the test set is only for reporting")
        directions[name] = natural
    return tuple(directions.items())


def limits(
    raw: Raw, axes: Mapping[str, Axis], profiles: Sequence[str], targets: Sequence[str], report: Report
) -> tuple[str, ...]:
    """Read conditions on what is known of a design before it is trained.

    Args:
        raw: a condition or a list of them, as written.
        axes: of the search space.
        profiles: hardware profiles of the search space.
        targets: its targets.
        report: called with (path, sentence) for every mistake.
    """
    texts = [raw] if isinstance(raw, str) else [] if raw is None else raw
    if not (isinstance(texts, list) and all(isinstance(text, str) for text in texts)):
        report(("limits",), f"limits must be a list of conditions, got {echo(raw)}")
        return ()
    for index, text in enumerate(texts):
        for message in _limit_faults(text, axes, profiles, targets):
            report(("limits", index) if isinstance(raw, list) else ("limits",), message)
        if text in texts[:index]:
            report(("limits", index), f"limit '{text}' is stated twice")
    return tuple(texts)


def _limit_faults(
    text: str, axes: Mapping[str, Axis], profiles: Sequence[str], targets: Sequence[str]
) -> list[str]:
    """Return what is wrong with a limit, a sentence each."""
    try:
        tree = parse(text)
    except ExpressionError as error:
        return [f"limit: {error}"]
    columns, of_hardware = registry.columns(), registry.columns("hardware")
    known = {name: column.known for name, column in columns.items() if column.known}
    is_text = {name: axis.is_text for name, axis in axes.items()} | {"task": True, "family": True}
    names = dict.fromkeys(column_names(tree))
    faults = []
    for name in names:
        if name in columns and name not in known:
            faults.append(
                f"limit '{text}': column '{name}' is known only after training; {known_names('', known)}"
            )
        elif name not in known and name not in is_text:
            of_targets = registry.columns_of_targets()
            able = [target for target, known_there in of_targets.items() if name in known_there]
            unable = [target for target in targets if target in of_targets and target not in able]
            if not able:
                others = dict.fromkeys([*known, *is_text, *chain(*of_targets.values())])
                faults.append(f"limit '{text}': unknown column '{name}'; {known_names(name, others)}")
            elif unable or not targets:
                faults.append(
                    f"limit '{text}': column '{name}' needs targets that know it before training in section "
                    f"'targets' ({', '.join(able)}), got {', '.join(unable) or 'none'}"
                )
        elif name in of_hardware and not profiles:
            faults.append(
                f"limit '{text}': column '{name}' needs a hardware profile in section 'hardware', got none"
            )
    if not names:
        faults.append(f"limit '{text}' must name a column, an axis, task or family")
    return faults or condition_faults(tree, f"limit '{text}'", is_text, {"fits"})


def search(
    raw: Raw,
    axes: Mapping[str, Axis],
    report: Report,
    folds: int | None = None,
    *,
    check_packages: bool = False,
    base: Path | None = None,
    is_shared: bool = False,
) -> SearchSettings | None:
    """Read the search settings together with the sampler's own keys; None after a fault.

    Args:
        raw: the section as written.
        axes: of the search space.
        report: called with (path, sentence) for every mistake.
        folds: of a cross-validation, of which every repeat is one; None without.
        check_packages: whether the package that a sampler may need must be installed here.
        base: folder of the search space, beside which earlier studies must be; None: they are not looked for.
        is_shared: whether several coordinators divide the designs.
    """
    earlier = raw.get("from") if isinstance(raw, dict) else None
    warm = _earlier(earlier, report, base)
    if isinstance(raw, dict):
        raw = {key: value for key, value in raw.items() if key != "from"}
    known: dict[str, type[SamplerSettings]] = registry.known("search.samplers")
    keys = raw if isinstance(raw, dict) else {}
    stepless = [axis for axis in axes.values() if axis.values is None]
    name = keys.get("sampler") or ("tpe" if stepless else "grid")
    if name == AUTO:
        name = automatic(n_combinations(axes.values()), keys.get("n_trials"))
        raw = {**keys, "sampler": name}
    cls = known.get(name) if isinstance(name, str) else None
    own_keys = list(keys_of(cls)) if cls else []
    values, good = read_fields(Search, raw, ("search",), report, read_fixed, also=own_keys)
    if cls is None:
        if isinstance(name, str):
            report(("search", "sampler"), f"unknown sampler '{name}'; {known_names(name, known)}")
        return None
    written = {key: value for key, value in keys.items() if key in own_keys}
    options, good_options = read_fields(cls, written, ("search",), report, read_fixed)
    if name == "grid":
        for axis in stepless:
            text = f"{axis.name} needs a step or a choice for the grid sampler, got {axis.to_plain()}"
            report((*axis.name.split("."), "range"), text)
    conditional = [axis.name for axis in axes.values() if axis.condition is not None]
    if conditional and not cls.conditional:
        others = ", ".join(other for other, other_cls in known.items() if other_cls.conditional)
        text = f"search.sampler '{name}' cannot search {conditional[0]}, an axis that only some designs have"
        report(("search", "sampler"), f"{text}; these can: {others}")
    package = cls.requires
    if check_packages and package and (lack := missing_package(package, package)):
        report(("search", "sampler"), f"search.sampler '{name}' {lack}")
        return None
    if not (good and good_options) or warm is None:
        return None
    stop = values["stop"]
    if stop is not None and all(x is None for x in vars(stop).values()):
        report(("search", "stop"), f"search.stop must state at least one of {', '.join(vars(stop))}")
        return None
    if values["repeats"] is None:
        values["repeats"] = folds or 1
    on_front = values["repeats_on_front"] > values["repeats"]
    undecided = values["front_undecided"]
    if undecided is not None and not on_front:
        text = f"needs search.repeats_on_front above search.repeats, {values['repeats']}"
        report(("search", "front_undecided"), f"search.front_undecided {text}")
        return None
    if undecided is not None and undecided[0] >= undecided[1]:
        text = f"must be two probabilities, rising, got [{undecided[0]:g}, {undecided[1]:g}]"
        report(("search", "front_undecided"), f"search.front_undecided {text}")
        return None
    if values["front_trainings"] is not None and undecided is None:
        report(("search", "front_trainings"), "search.front_trainings needs search.front_undecided")
        return None
    for key in ("repeats", *(["repeats_on_front"] if on_front else [])):
        if folds and values[key] % folds:
            text = f"must be a multiple of split.k_fold.k = {folds}, one run per fold, got {values[key]}"
            report(("search", key), f"search.{key} {text}")
            return None
    if name != "grid" and values["n_trials"] is None:
        report(("search",), f"search.n_trials is required for sampler '{name}'")
        return None
    # A grid learns nothing from its results: designs that are proposed at once share the most passes.
    whole = name == "grid" and stop is None and not is_shared
    size = n_combinations(axes.values()) or 1 if whole else _BATCH
    settings = values | {"sampler": name, "batch": values["batch"] or size}
    return SearchSettings(**settings, options=options, warm=warm)


def automatic(n_designs: int | None, n_trials: Raw) -> str:
    """Return the sampler that `auto` stands for.

    A grid that is trained whole needs no sampler. Of the others, Sobol points lead while designs are few, and
    TPE from then on (results/README.md, section Search).

    Args:
        n_designs: of the grid; None: there is none.
        n_trials: as written; None: all.
    """
    n = n_trials if type(n_trials) is int else None
    if n_designs is not None and (n is None or n >= n_designs):
        return "grid"
    return "sobol" if n is not None and n < _FEW else "tpe"


def _earlier(raw: Raw, report: Report, base: Path | None) -> tuple[str, ...] | None:
    """Read the folders of earlier studies; None after a fault."""
    names = [raw] if isinstance(raw, str) else raw or []
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        report(("search", "from"), f"search.from must be a list of folders of studies, got {echo(raw)}")
        return None
    good = True
    for index, name in enumerate(names):
        where = ("search", "from", index) if isinstance(raw, list) else ("search", "from")
        if base is not None and not (base / name / "search_space.yaml").is_file():
            report(
                where, f"search.from: '{name}' must be the folder of a study, relative to the search space"
            )
            good = False
        if name in names[:index]:
            report(where, f"search.from: '{name}' is named twice")
            good = False
    return tuple(names) if good else None


def execution(raw: Raw, report: Report, *, check_device: bool) -> ExecutionSettings | None:
    """Read section `execution`; `check_device`: the device must be available here. None after a fault."""
    values, good = read_fields(ExecutionSettings, raw, ("execution",), report, read_fixed)
    if good and check_device and (lack := missing(values["device"])):
        report(("execution", "device"), f"execution.device {values['device']} {lack}")
        good = False
    if good:
        named = [key for key in ("address", "scheduler_file") if values[key] is not None]
        if named and values["backend"] != "dask":
            report(("execution", named[0]), f"execution.{named[0]} needs execution.backend dask")
            good = False
        elif len(named) == 2:
            report(("execution", named[1]), "execution must have address or scheduler_file, not both")
            good = False
        if values["storage"] is not None and (text := _storage_fault(values["storage"])):
            report(("execution", "storage"), f"execution.storage {text}")
            good = False
    return ExecutionSettings(**values) if good else None


def _storage_fault(url: str) -> str:
    """Return what is wrong with the address of a database; '' if nothing is."""
    if _STORAGE.match(url) is None:
        return f"must begin with postgresql:// or sqlite:///, got {echo(url)}"
    with contextlib.suppress(ValueError):  # of a place that is no URL: the database will say so
        if urlsplit(url).password is not None:
            return "must not hold a password, as it is stored with the study: use PGPASSWORD or ~/.pgpass"
    return ""


def _names(section: str, raw: Raw, report: Report) -> list[str]:
    names = [raw] if isinstance(raw, str) else raw or []
    if isinstance(names, list) and all(isinstance(name, str) for name in names):
        return names
    report((section,), f"{section} must be a list of names, got {echo(raw)}")
    return []
