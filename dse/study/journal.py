"""Reading the journal of a study: the designs that the sampler proposed, and the results that it received.

The journal is an Optuna journal of one JSON text per line, which `dse.study.ledger` writes. This module
changes, repairs and locks nothing, so it can read while a run writes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

# Of Optuna's format: JournalOperation.CREATE_TRIAL and SET_TRIAL_STATE_VALUES, TrialState.RUNNING.
CREATE_TRIAL, SET_TRIAL_STATE, RUNNING = 4, 6, 0


@dataclass(frozen=True)
class Entry:
    """A design that the sampler proposed.

    trial: its number, from 0. batch: number of its batch.
    proposed_s: when the sampler proposed it, in seconds since 1970.
    reported_s: when the sampler received its result, in seconds since 1970; None: not yet.
    values: its objectives; None before the report, and for a failed trial.
    """

    trial: int
    batch: int
    design: Mapping[str, object]
    proposed_s: float
    reported_s: float | None = None
    values: tuple[float, ...] | None = None

    @property
    def is_reported(self) -> bool:
        """Whether the sampler received its result."""
        return self.reported_s is not None


def read_journal(path: Path) -> list[Entry]:
    """Return the entries of a journal in the order of proposal; an empty list if there is no file.

    An incomplete line, which a run is writing, is skipped.
    """
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    created: list[tuple[int, Mapping[str, object], float]] = []
    reports: dict[int, tuple[float, tuple[float, ...] | None]] = {}
    for line in lines:
        try:
            entry = json.loads(line)
            operation = entry["op_code"]
            if operation == CREATE_TRIAL:
                attributes = entry["user_attrs"]
                proposed_s = seconds(entry["datetime_start"])
                created.append((int(attributes["batch"]), dict(attributes["design"]), proposed_s))
            elif operation == SET_TRIAL_STATE and entry["state"] != RUNNING:
                values = entry.get("values")
                reports[entry["trial_id"]] = (
                    seconds(entry["datetime_complete"]),
                    None if values is None else tuple(map(float, values)),
                )
        except (ValueError, KeyError, TypeError):
            continue
    return [
        Entry(trial, *proposal, *reports.get(trial, (None, None))) for trial, proposal in enumerate(created)
    ]


def seconds(text: str) -> float:
    """Return a moment in ISO 8601 as seconds since 1970.

    Raises:
        ValueError: the text is no moment.
    """
    return datetime.fromisoformat(text).timestamp()
