"""Warm start: what earlier studies have trained on the axes of a search space (`search.from`)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dse import dataset, seeds, store
from dse.config import ConfigError, Fault, SearchSpace
from dse.config.axes import Axis
from dse.config.resolved import Sections
from dse.config.values import as_tuple
from dse.config.yaml_lines import Raw
from dse.study.held import plain_space
from dse.study.ledger import Entry, read_entries
from dse.study.record import RunRecord, load_record

_SAME = ("decision", "evaluation")
"""Sections of the file that an evaluation follows from, beside the sections of a design."""


@dataclass(frozen=True)
class Earlier:
    """A trial of an earlier study on the axes of a search space.

    folder: of the study. trial: its number there.
    design: with the values of this space's axes.
    records: of its finished runs, repeat 0 first.
    is_alike: whether decisions, evaluation and hardware of the studies are the same.
    """

    folder: Path
    trial: int
    design: Mapping[str, Raw]
    records: Sequence[RunRecord]
    is_alike: bool


def earlier_trials(space: SearchSpace) -> list[Earlier]:
    """Return the finished trials of the earlier studies that a search space names."""
    now = json.loads(json.dumps(space.to_plain()))
    trials: list[Earlier] = []
    faults = []
    for name in space.search.from_:
        folder = (space.source.parent / name).resolve()
        try:
            then = plain_space(folder / "search_space.yaml")
        except store.StoreError as error:
            faults.append(Fault(str(space.source), 0, f"search.from: {error}"))
            continue
        same = all(then.get(key) == now.get(key) for key in _SAME)
        is_alike = same and set(now["hardware"]) <= set(then.get("hardware", ()))
        of_study, designs = [], 0
        for entry in read_entries(folder):
            design = on_axes(space, entry.design)
            designs += design is not None
            if design is None or entry.excluded:
                continue
            if records := _finished(folder, entry.trial):
                of_study.append(Earlier(folder, entry.trial, design, records, is_alike))
        if not designs:
            text = (
                f"search.from: {folder} holds no design with the axes {', '.join(space.axes)} of this space"
            )
            faults.append(Fault(str(space.source), 0, text))
        trials += of_study
    if faults:
        raise ConfigError(faults)
    return trials


def on_axes(space: SearchSpace, design: Mapping[str, object]) -> dict[str, Raw] | None:
    """Return a design with the values of a space's axes; None if it is none of the space."""
    known: dict[str, Raw] = {}
    for name, written in design.items():
        axis = space.axes.get(name)
        value = None if axis is None else axis_value(axis, written)
        if value is None:
            return None
        known[name] = value[0]
    return known if set(known) == set(space.active(known)) else None


def axis_value(axis: Axis, written: object) -> tuple[Raw] | None:
    """Return the value of an axis that equals a written one, a whole number also on an axis of reals.

    Returns:
        The value, alone in a tuple; None if it is not on the axis.
    """
    value = as_tuple(written)
    if axis.values is not None:
        if axis.is_list and isinstance(value, tuple) and len(value) == 1 and value not in axis.values:
            value = value[0]  # a list of one may stand as its element
        same = [x for x in axis.values if x == value and isinstance(x, bool) == isinstance(value, bool)]
        return (same[0],) if same else None
    if not axis.is_int and type(value) is int:
        value = float(value)
    return (value,) if axis.contains(value) else None


def _finished(folder: Path, trial: int) -> list[RunRecord]:
    records = []
    for run in store.runs_of(folder, trial):
        try:
            record = load_record(run)
        except store.StoreError:  # damaged: it is trained again
            continue
        if record is not None and not record.failed and record.stopped_at_epoch is None:
            records.append(record)
    return sorted(records, key=lambda record: record.repeat)


class Takeover:
    """Runs of earlier studies that are those of this one: same design, data, training and seed."""

    def __init__(self, space: SearchSpace, folder: Path, trials: Sequence[Earlier]) -> None:
        self._space = space
        self._folder = folder
        self._of_design: dict[str, list[Earlier]] = {}
        # A race compares designs at rungs, which earlier trainings may not have measured.
        for trial in trials if space.search.racing is None else ():
            if trial.is_alike:
                self._of_design.setdefault(seeds.design_key(trial.design), []).append(trial)

    def over(self, entry: Entry) -> int:
        """Copy the runs of a design that are trained already; return how many.

        Raises:
            StoreError: a run cannot be written.
        """
        n, design = 0, on_axes(self._space, entry.design)
        for repeat in range(self._space.search.repeats if design is not None else 0):
            target = store.run_file(self._folder, entry.trial, repeat)
            source = None if design is None or target.exists() else self._equal(design, repeat)
            if source is not None:
                _copy(source, repeat, entry.trial, target)
                n += 1
        return n

    def _equal(self, design: Mapping[str, Raw], repeat: int) -> Earlier | None:
        for earlier in self._of_design.get(seeds.design_key(design), ()):
            for record in earlier.records:
                if record.repeat == repeat and self._is_equal(design, record):
                    return earlier
        return None

    def _is_equal(self, design: Mapping[str, Raw], record: RunRecord) -> bool:
        k_fold = self._space.split.k_fold
        sections = self._space.resolve(design)
        if k_fold is not None:
            sections = sections.on_fold(record.repeat % k_fold.k)
        is_seed = record.seed == self._space.seed and record.design == json.loads(json.dumps(dict(design)))
        return (
            is_seed
            and record.data == dataset.dataset_key(sections, self._space.source.parent)
            and all(_plain(record.sections, name) == _plain(sections, name) for name in ("model", "training"))
        )


def _plain(sections: Sections | Mapping[str, Any], name: str) -> Any:
    plain = sections.to_plain() if isinstance(sections, Sections) else sections
    return json.loads(json.dumps(plain.get(name)))


def _copy(earlier: Earlier, repeat: int, trial: int, target: Path) -> None:
    """Publish an earlier run as one of this study, with where it was trained."""
    source = store.run_file(earlier.folder, earlier.trial, repeat)
    record = store.read_record(source)
    taken = {"study": str(record["study"]), "trial": earlier.trial, "version": record.get("version")}
    about = {key: x for key, x in record.items() if key not in ("schema", "version", "study", "files")}
    parts = {name: store.load_arrays(source / name) for name in record["files"]}
    store.save_run(target, about | {"trial": trial, "taken_from": taken}, parts)
