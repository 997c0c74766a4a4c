"""The designs of a study, task by task: full read-outs on its first hardware profile, and their runs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse import store
from dse.base.records import Array
from dse.config import ConfigError, Sections
from dse.config.contracts import PLACES, Family, Source
from dse.config.parts import target_columns
from dse.config.values import plain
from dse.study import precision
from dse.study.audit import AuditRow
from dse.study.results import Study

if TYPE_CHECKING:
    import pandas

_LONGEST_LIST = 4
_SETTINGS = ("phi", "theta", "read_out_ms")


@dataclass(frozen=True)
class StudyTask:
    """The designs of a study for one task.

    table: one row per design: the columns of its full read-out.
    target: label columns that the task predicts.
    data: path of the recordings.
    split: how recordings were divided, in words.
    joint: whether the task is one head of a joint network.
    n_validation: number of validation recordings; 0 if it was not recorded.
    known: the audit's row of the cheap reader that validation chooses; None without an audit.
    """

    study: Study
    task: str
    table: pandas.DataFrame
    target: tuple[str, ...]
    data: str
    split: str
    joint: bool
    n_validation: int
    known: AuditRow | None = None

    @property
    def name(self) -> str:
        """The name of the study."""
        return self.study.folder.name

    def of(self, families: Iterable[str], *, transductive: bool = False) -> pandas.DataFrame:
        """Return the designs of some families that are, or are not, transductive."""
        of_families = self.table["family"].isin(list(families))
        return self.table[of_families & (self.table["transductive"] == transductive)]

    def model(self, trial: int) -> Family:
        """Return the family of a design, whose fields are its settings."""
        return sections_of(self.study.folder, trial).model

    def classes(self, trial: int) -> list[str]:
        """Return the classes of this task."""
        run = record(self.study.folder, trial)
        return list(run["heads"][self.task]["classes"] if self.joint else run["classes"])

    def columns(self, trial: int) -> list[Mapping[str, Any]]:
        """Return the columns of every run of a design for this task, on its first hardware profile."""
        several: list[Mapping[str, Any]] = []
        for path in store.runs_of(self.study.folder, trial):
            run = store.read_record(path)
            numbers = run["of_heads"][self.task] if self.joint else run
            chips = list(numbers.get("hardware", {}).values())
            several.append({**numbers.get("columns", {}), **(chips[0] if chips else {})})
        return several

    def arrays(self, trial: int, kind: str) -> list[dict[str, Array]]:
        """Return an artefact such as 'read_out' or 'confusion' of every run of a design for this task.

        Raises:
            StoreError: it is missing or damaged.
        """
        name = f"{kind}_{self.task}.npz" if self.joint else f"{kind}.npz"
        return [store.load_arrays(path / name) for path in store.runs_of(self.study.folder, trial)]


def tasks_of(study: Study) -> list[StudyTask]:
    """Return the designs of a study, task by task; nothing if every design failed.

    Raises:
        StoreError: a file is damaged.
    """
    points = study.points()
    if points.empty:
        return []
    full = full_read_outs(points)
    if "hardware" in full:
        full = full[full["hardware"] == full["hardware"].iloc[0]]
    parts, audit = [], study.audit
    for named, rows in full.groupby("task", sort=False):
        task = str(named)
        first = record(study.folder, int(rows["trial"].iloc[0]))
        joint = task in first.get("of_heads", {})
        sections = sections_of(study.folder, int(rows["trial"].iloc[0]))
        target = (task,) if joint else target_columns(sections.task.target)
        counts = first.get("samples", {})
        n = int(counts.get("validation", 0))
        of_data = _data(sections.data), _split(sections, counts)
        known = None if audit is None else audit.known(task)
        parts.append(StudyTask(study, task, rows, target, *of_data, joint, n, known))
    return parts


def full_read_outs(points: pandas.DataFrame) -> pandas.DataFrame:
    """Return the points that answer at the end of the window, at the precision of the training.

    Every row has a value of `transductive`, False by default.
    """
    for name in _SETTINGS:
        if name in points:
            points = points[points[name].isna()]
    points = precision.as_trained(points)
    leaky = points["transductive"].fillna(False).astype(bool) if "transductive" in points else False
    return points.assign(transductive=leaky)


def record(study: Path, trial: int) -> Mapping[str, Any]:
    """Return record.json of a design's first run.

    Raises:
        StoreError: it is missing or damaged.
    """
    folder = store.first_run(study, trial)
    content = store.read_record(folder)
    if "sections" not in content:
        raise store.damaged(folder, "is not the record of a finished run")
    return content


def sections_of(study: Path, trial: int) -> Sections:
    """Return the sections of a design, as its first run recorded them.

    Raises:
        StoreError: the record is missing or damaged, or names a component that is not known here.
    """
    try:
        return Sections.from_plain(record(study, trial)["sections"], f"{study}: trial {trial}")
    except ConfigError as error:
        raise store.StoreError(str(error)) from None


def best(rows: pandas.DataFrame) -> pandas.Series[Any] | None:
    """Return the most accurate design, or the one with more runs that is as accurate within standard errors.

    Of many designs with a single run the luckiest would win; of those that do not differ from it by more than
    the standard error of the difference, the ones with the most runs are taken, the most accurate first, then
    fewer weights, then the earlier trial.
    """
    known = rows[np.isfinite(rows["accuracy"].astype(float))]
    if known.empty:
        return None
    top = known.iloc[int(known["accuracy"].to_numpy().argmax())]
    errors = known["accuracy_se"].astype(float).fillna(0.0)
    error = np.hypot(errors, top["accuracy_se"] if np.isfinite(top["accuracy_se"]) else 0.0)
    near = known[known["accuracy"] >= top["accuracy"] - error]
    order = near.sort_values(
        ["repeats", "accuracy", "n_weights", "trial"], ascending=[False, False, True, True]
    )
    first: pandas.Series[Any] = order.iloc[0]
    return first


def described(row: pandas.Series[Any]) -> str:
    """Return a design as its axes: `receptors, hidden 80, true_rate 0.4`."""
    axes = [name for name in map(str, row.dropna().index) if "." in name]
    axes = [name for name in axes if name not in ("model.kind", "task.target")]
    short = [name.rsplit(".", 1)[-1] for name in axes]
    cells = []
    for name, key in zip(axes, short, strict=True):
        label = name if short.count(key) > 1 else key
        cells.append(_plain(row[name]) if key == "kind" else f"{label} {_plain(row[name])}")
    return ", ".join(cells)


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _data(source: Source) -> str:
    """Return the path of the recordings."""
    return str(next((place for name in PLACES if (place := getattr(source, name, None))), ""))


def _split(sections: Sections, counts: Mapping[str, int]) -> str:
    """Return the split of the recordings of a run, such as `train: repetition 0 (322); ...`."""
    keys = plain(sections.split)
    parts = ("train", "validation", "test")
    sizes = ", ".join(f"{part} {counts[part]}" for part in parts if counts.get(part))
    beside = f"; test: {Path(_data(sections.test)).name}" if sections.test is not None else ""
    rule = next((name for name in ("k_fold", "stratified", "leave_out") if keys.get(name)), None)
    if rule is None:
        chosen = [f"{part}: {_chosen(keys[part])}" for part in parts if keys.get(part)]
        return f"{'; '.join(chosen)}{beside} ({sizes})"
    settings = {name: x for name, x in keys[rule].items() if x is not None and name not in ("seed", "fold")}
    words = ", ".join(f"{name} {_values(x)}" for name, x in settings.items())
    return f"{rule.replace('_', '-')}: {words}{beside} ({sizes})"


def _chosen(columns: Mapping[str, object]) -> str:
    return " and ".join(f"{name} {_values(x)}" for name, x in columns.items())


def _values(values: object) -> str:
    """Return the values of a split in short form: `0 to 13`, `0 1 4`, `repetition 1`."""
    if isinstance(values, Mapping):
        return _chosen(values)
    several = list(values) if isinstance(values, list | tuple) else [values]
    if len(several) > _LONGEST_LIST:
        numbers = [x for x in several if isinstance(x, int | float)]
        whole = len(numbers) == len(several) and all(x == numbers[0] + k for k, x in enumerate(numbers))
        return (
            f"{several[0]} to {several[-1]}"
            if whole
            else f"{json.dumps(several[:3])[1:-1]}, ... ({len(several)})"
        )
    return " ".join(map(str, several))
