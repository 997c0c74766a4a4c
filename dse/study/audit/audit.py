"""Every probe on every task of a search space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.config import SearchSpace
from dse.data.dataset.parts import Progress, silent
from dse.data.recordings import RecordingError
from dse.data.recordings.doubts import silent_windows
from dse.study.audit import conditions, numbers, position
from dse.study.audit.gather import designs, material, values_of, without_labels
from dse.study.audit.material import Material
from dse.study.audit.rows import AuditRow

_HOW = (
    "a shortcut is at least half of what readers of counts over time reach above chance, and no accident "
    "(p < 0.001); accuracy is that of validation samples, test that of the test set, which decides nothing; "
    "without: accuracy of the same reader where the shortcut does not help"
)


KNOWN = "counts over time"
"""The probe whose rows say what the recordings hold."""


@dataclass(frozen=True)
class Audit:
    """The rows of an audit, task by task, and sentences about them."""

    rows: tuple[AuditRow, ...]
    notes: tuple[str, ...]

    @property
    def shortcuts(self) -> list[str]:
        """Return the probes that have found a shortcut, each with its task."""
        return list(dict.fromkeys(f"{row.probe} ({row.task})" for row in self.rows if row.shortcut))

    def known(self, task: str) -> AuditRow | None:
        """Return the reader of counts over time that validation chooses for a task; None: it was not read."""
        rows = [row for row in self.rows if row.task == task and row.probe == KNOWN and row.accuracy]
        return max(rows, key=lambda row: row.accuracy or 0.0, default=None)


def audit(space: SearchSpace, root: Path, shifts: Sequence[int] = (), progress: Progress = silent) -> Audit:
    """Return what could pass for skill in the recordings and the split of a search space.

    Probes run on the spikes of its first design, for each of its targets. If the encoder of that design reads
    labels, a row says so, and the others are of the first design whose encoder reads none. root: of the cache
    of prepared data. shifts: steps by which windows are moved; empty: an eighth of their length.

    Raises:
        RecordingError: the recordings do not fit the search space, or have no room for the shifts.
        OSError: the cache cannot be written.
    """
    notes = [_HOW]
    if (k_fold := space.split.k_fold) is not None:
        notes.append(f"audited on fold {k_fold.fold} of {k_fold.k}")
    rows: list[AuditRow] = []
    for design in designs(space):
        read = material(space, design, root, shifts, progress)
        if read.reads_labels and (honest := without_labels(space, design)) is not None:
            leaky, design = read, honest
            read = material(space, design, root, shifts, progress)
            rows.append(conditions.of_encoder(leaky, read))
        if shifts and not position.has_room_for(read, shifts).any():
            steps = ", ".join(map(str, shifts))
            text = f"no validation window of {read.task} can be moved by {steps} steps in its recording"
            raise RecordingError(text)
        if values := values_of(design):
            notes.append(f"audited at {values}")
        probed, sentences = probe(read, shifts)
        rows += probed
        notes += sentences
    return Audit(tuple(rows), tuple(dict.fromkeys(notes)))


def probe(read: Material, shifts: Sequence[int] = ()) -> tuple[list[AuditRow], list[str]]:
    """Return the rows of one task, and sentences about what could not be probed."""
    if len(np.unique(read.codes)) < 2:
        return [], [f"{read.task}: training has one class, so that there is nothing to tell apart"]
    moved = position.rows(read, shifts)
    verdict = "the better of these is what shortcuts are compared with"
    rows = [
        read.row(KNOWN, score, verdict, test=read.on_test(score.reader)) for score in read.scores.values()
    ]
    rows += [*numbers.rows(read), *moved, *conditions.rows(read)]
    n_spikes = read.counts(read.validation, 1).sum(axis=1)
    notes = [f"{read.task}: {text}" for text in silent_windows(n_spikes)]
    for part, drawn, every in (
        ("training", read.train, read.drawn_from[0]),
        ("validation", read.validation, read.drawn_from[1]),
    ):
        if len(drawn) < every:
            notes.append(f"{read.task}: {len(drawn)} of {every} {part} samples are drawn")
    if not moved:
        notes.append(f"{read.task}: windows have no room to move in their recordings")
    constant = [name for name, values in read.columns.items() if len(set(values[read.train].tolist())) == 1]
    constant = [name for name in constant if name not in read.split_columns]
    if constant:
        notes.append(f"{read.task}: training has one value of {', '.join(constant)}")
    return rows, notes
