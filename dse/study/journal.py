"""Reading the journal of a study: the designs that the sampler proposed, and the results that it received.

The journal is an Optuna journal (`dse.study.lines`), which `dse.study.ledger` writes. This module
changes, repairs and locks nothing, so it can read while a run writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from dse.store import StoreError
from dse.study import lines
from dse.study.lines import CREATE_TRIAL, SET_TRIAL_STATE

# Of Optuna's format: JournalOperation.SET_TRIAL_USER_ATTR and SET_TRIAL_SYSTEM_ATTR, TrialState.RUNNING.
SET_INTERMEDIATE_VALUE, SET_USER_ATTRIBUTE, SET_SYSTEM_ATTRIBUTE, RUNNING = 7, 8, 9, 0
EXCLUDED = "excluded"
"""User attribute of a trial that is not trained: why."""
ENQUEUED = "enqueued"
"""User attribute of a trial that the user asked for."""


@dataclass(frozen=True)
class Entry:
    """A design that the sampler proposed.

    trial: its number, from 0. batch: number of its batch.
    proposed_s: when the sampler proposed it, in seconds since 1970.
    reported_s: when the sampler received its result, in seconds since 1970; None: not yet.
    values: its objectives; None before the report, and for a failed trial.
    excluded: why it is not trained; '' if it is.
    enqueued: whether the user asked for it (`dse enqueue`), not the sampler.
    """

    trial: int
    batch: int
    design: Mapping[str, object]
    proposed_s: float
    reported_s: float | None = None
    values: tuple[float, ...] | None = None
    excluded: str = ""
    enqueued: bool = False

    @property
    def is_reported(self) -> bool:
        """Whether the sampler received its result."""
        return self.reported_s is not None


def read_journal(path: Path) -> list[Entry]:
    """Return the entries of a journal in the order of proposal; an empty list if there is no file.

    An incomplete line, which a run is writing, is skipped. Of a damaged journal, trials are read up to the
    first one that is missing.
    """
    try:
        content = lines.read(path)
    except StoreError:
        return []
    logs = lines.counted(content.logs) if content.faults else content.logs
    created: list[tuple[int, Mapping[str, object], float]] = []
    excluded: dict[int, str] = {}
    enqueued: set[int] = set()
    reports: dict[int, tuple[float, tuple[float, ...] | None]] = {}
    for entry in logs:
        try:
            operation = entry["op_code"]
            if operation == CREATE_TRIAL:
                attributes = entry["user_attrs"]
                proposed_s = seconds(entry["datetime_start"])
                created.append((int(attributes["batch"]), dict(attributes["design"]), proposed_s))
                if attributes.get(ENQUEUED):
                    enqueued.add(len(created) - 1)
                if entry["state"] != RUNNING:
                    reports[len(created) - 1] = proposed_s, None
                    excluded[len(created) - 1] = str(attributes[EXCLUDED])
            elif operation == SET_USER_ATTRIBUTE and EXCLUDED in entry["user_attr"]:
                excluded[entry["trial_id"]] = str(entry["user_attr"][EXCLUDED])
            elif operation == SET_TRIAL_STATE and entry["state"] != RUNNING:
                values = entry.get("values")
                reports[entry["trial_id"]] = (
                    seconds(entry["datetime_complete"]),
                    None if values is None else tuple(map(float, values)),
                )
        except (ValueError, KeyError, TypeError):
            continue
    entries = (
        Entry(trial, *proposal, *reports.get(trial, (None, None))) for trial, proposal in enumerate(created)
    )
    return [
        replace(entry, excluded=excluded.get(entry.trial, ""), enqueued=entry.trial in enqueued)
        for entry in entries
    ]


def seconds(text: str) -> float:
    """Return a moment in ISO 8601 as seconds since 1970.

    Raises:
        ValueError: the text is no moment.
    """
    return datetime.fromisoformat(text).timestamp()
