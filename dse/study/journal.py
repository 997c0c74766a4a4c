"""The journal of a study as it is on the disk: which designs were asked for, and what the sampler was told.

It is an Optuna journal of one JSON text per line, which `dse.study.ledger` writes. Reading it here changes,
repairs and locks nothing, so it may be read while a run writes it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

# Of Optuna's format: JournalOperation.CREATE_TRIAL and SET_TRIAL_STATE_VALUES, TrialState.RUNNING.
CREATE_TRIAL, SET_TRIAL_STATE, RUNNING = 4, 6, 0


@dataclass(frozen=True)
class Entry:
    """A design that was asked for.

    trial: its number, from 0. batch: number of the batch that it was asked for in.
    asked_s: when, in seconds since 1970. told_s: when the sampler was told of it; None: not yet.
    values: its objectives; None until told, and for a failed trial.
    """

    trial: int
    batch: int
    design: Mapping[str, Any]
    asked_s: float
    told_s: float | None = None
    values: tuple[float, ...] | None = None

    @property
    def told(self) -> bool:
        """Whether the sampler was told of it."""
        return self.told_s is not None


def read_journal(path: Path) -> list[Entry]:
    """Return the entries of a journal in the order of asking; none where there is no file.

    A line that is not whole, because it is being written, is left out.
    """
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    created: list[tuple[int, Mapping[str, Any], float]] = []
    told: dict[int, tuple[float, tuple[float, ...] | None]] = {}
    for line in lines:
        try:
            entry = json.loads(line)
            operation = entry["op_code"]
            if operation == CREATE_TRIAL:
                attributes = entry["user_attrs"]
                asked_s = seconds(entry["datetime_start"])
                created.append((int(attributes["batch"]), dict(attributes["design"]), asked_s))
            elif operation == SET_TRIAL_STATE and entry["state"] != RUNNING:
                values = entry.get("values")
                told[entry["trial_id"]] = (
                    seconds(entry["datetime_complete"]),
                    None if values is None else tuple(map(float, values)),
                )
        except (ValueError, KeyError, TypeError):
            continue
    return [Entry(trial, *asked, *told.get(trial, (None, None))) for trial, asked in enumerate(created)]


def seconds(text: str) -> float:
    """Return a moment in ISO 8601 as seconds since 1970.

    Raises:
        ValueError: the text is no moment.
    """
    return datetime.fromisoformat(text).timestamp()
