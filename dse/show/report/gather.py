"""Studies -> the report: rows of what others publish and of chips, and notes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from dse.base import registry
from dse.show.report import Published
from dse.show.report.designs import StudyTask, record, tasks_of
from dse.show.report.hardware import on_chips
from dse.show.report.rows import Row, of_readers
from dse.study import health, held, pricing, rivals
from dse.study.audit import Audit
from dse.study.question import Question
from dse.study.results import Study

_HOW = (
    "designs are selected on validation: the most accurate one, or one with more runs that is as accurate "
    "within the standard errors; `test` is the same design on the test set",
    "`corrected` is the accuracy expected on other recordings, with its 90 % interval; designs are compared "
    "by `ours`, which was measured",
    "`ours` is the mean over the runs; `se` the standard error over the runs, or Wilson's over the "
    "recordings where there is one run or all agree",
)
_READER = (
    "`reader` is what a plain reader of the same data answers (`dse audit`; validation chooses it), on the "
    "test set where there is one"
)


@dataclass(frozen=True)
class Report:
    """Whether to spike, rows, sentences about them, and the audit of each study that has one."""

    spikes: list[str]
    rows: list[Row]
    notes: list[str] = field(default_factory=list)
    audits: dict[str, Audit] = field(default_factory=dict)


def report(studies: Sequence[Study], hardware: Sequence[str] = ()) -> Report:
    """Return how chips compare, after what others publish beside designs of these studies.

    Args:
        studies: with finished trials or without.
        hardware: profiles to compare; empty: those of each study.

    Raises:
        ConfigError: a profile does not exist, or is wrong.
        StoreError: a study's folder is damaged.
    """
    parts = [part for study in studies for part in tasks_of(study)]
    rows: list[Row] = []
    of_published: list[str] = []
    for source in published().values():
        beside, sentences = source.rows(parts)
        rows += beside
        of_published += sentences
    notes: list[str] = []
    if any(row.reader is not None for row in rows):
        notes.append(_READER)
    for study in studies:
        of_chips, verdicts = _of_hardware(study, [part for part in parts if part.study is study], hardware)
        rows += of_chips
        notes += verdicts
    notes += [
        f"{part.name}, {part.task}: predicted by classifiers of several tasks" for part in parts if part.joint
    ]
    notes += [*of_readers(parts), *(text for part in parts for text in _leaks(part))]
    for study in studies:
        sentences = [*health.failures(study.trials), *health.faults(study.trials)]
        notes += [f"{study.folder.name}: {text}" for text in sentences]
        notes += _warnings(study)
    audits = {study.folder.name: audit for study in studies if (audit := study.audit) is not None}
    for name, audit in audits.items():
        if audit.shortcuts:
            notes.append(f"{name}: shortcuts that could pass for skill: {', '.join(audit.shortcuts)}")
    how = _HOW if rows else ()
    spikes = [
        text for study in studies for text in rivals.sentences(study, Question(hardware=tuple(hardware)))
    ]
    return Report(spikes, rows, list(dict.fromkeys([*how, *notes, *of_published])), audits)


def published() -> dict[str, Published]:
    """Return what others publish, by name (section `reports`)."""
    return {name: component() for name, component in registry.known("reports").items()}


def gather_marks(study: Study) -> list[dict[str, object]]:
    """Return the published designs that are compared with a study, as plain values (fields of `Mark`).

    Raises:
        StoreError: the study's folder is damaged.
    """
    parts = tasks_of(study)
    marks = [mark for source in published().values() for mark in source.marks(parts)]
    return [{**vars(mark), "values": dict(mark.values)} for mark in marks]


def _of_hardware(
    study: Study, parts: Sequence[StudyTask], hardware: Sequence[str]
) -> tuple[list[Row], list[str]]:
    """Return the winner on each chip, task by task; nothing for fewer than two chips."""
    points = study.points()
    names = hardware or (list(dict.fromkeys(points["hardware"])) if "hardware" in points else [])
    if len(names) < 2 or points.empty:
        return [], []
    if hardware:
        points = pricing.points(study.folder, hardware)
    rows: list[Row] = []
    notes: list[str] = []
    for part in parts:
        of_chips, sentences = on_chips(part, points, hardware)
        rows += of_chips
        notes += sentences
    return rows, notes


def _leaks(part: StudyTask) -> list[str]:
    """Return why designs are transductive, one sentence per reason."""
    leaky = part.table.loc[part.table["transductive"], "trial"]
    why = [str(record(part.study.folder, int(trial)).get("transductive", "")) for trial in leaky]
    where = "transductive designs appear only in rows marked as such"
    return [f"{part.name}, {part.task}: {why.count(text)} {where}: {text}" for text in dict.fromkeys(why)]


def _warnings(study: Study) -> list[str]:
    """Return the warnings of a study's data sets; of warnings that differ only in numbers, the first."""
    kinds: dict[str, list[str]] = {}
    for text in [*study.warnings, *held.remarks(study.folder)]:
        kinds.setdefault(re.sub(r"\d+", "", text), []).append(text)
    return [
        f"{study.folder.name}: warning: {first}" + (f" (and {len(more)} of the kind)" if more else "")
        for first, *more in kinds.values()
    ]
