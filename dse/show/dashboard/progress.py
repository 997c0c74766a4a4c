"""The progress of a study, as plain values for the page."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from dse.show.dashboard.write import plain_figure
from dse.show.figures import progress
from dse.store import plain_cell
from dse.study.results import Study
from dse.study.status import ENDED_EARLY, Status, status

MAX_LISTED = 50
"""Largest number of running trials, of reasons, and of trials per reason in a list; counts include all."""


def gather_progress(folder: Path | str) -> dict[str, Any]:
    """Gather the progress of a study (`dse.study.status`), as plain values that JSON can hold.

    Returns:
        trials: {total, done, running, failed, stopped}; total is None if it is unknown;
        runs: {total, done};
        running: [{trial, design}] of proposed trials without all their runs, the first `MAX_LISTED`;
        failed, stopped: [{reason, count, trials}], the most frequent reason first, each with first trials;
        hours: total length of all sessions, without the time between them;
        time_left_s: None if there is no estimate or no run is missing;
        sign: the last that was heard of a session, ISO 8601 in UTC, None before the first;
        is_running: whether a process holds the study, None if nobody can tell;
        hypervolume: [{task, hardware, hypervolume, trials, hours}] at the ends of the figure's curves;
        figure: `dse.show.figures.progress` as JSON, None if it has no curve.
    """
    now = status(folder)
    sign = None if now.sign_s is None else datetime.fromtimestamp(now.sign_s, UTC)
    objectives = dict(Study(Path(folder)).objectives)
    growth = progress.gather_progress(now.points, objectives, now.ended, now.ended_hours)
    return {
        "trials": {"total": now.n_trials, "done": now.n_done, "running": len(now.running)}
        | {how: sum(outcome.status == how for outcome in now.outcomes.values()) for how in ENDED_EARLY},
        "runs": {"total": now.n_runs, "done": now.n_runs_done},
        "running": [
            {"trial": entry.trial, "design": plain_cell(entry.design)} for entry in now.running[:MAX_LISTED]
        ],
        **{how: _by_reason(now, how) for how in ENDED_EARLY},
        "hours": now.hours,
        "time_left_s": now.time_left_s,
        "sign": None if sign is None else sign.isoformat(timespec="seconds"),
        "is_running": now.is_running,
        "hypervolume": [
            {
                "task": curve.task,
                "hardware": curve.hardware,
                "hypervolume": float(curve.hypervolume[-1]),
                "trials": int(curve.trials[-1]),
                "hours": float(curve.hours[-1]) if np.isfinite(curve.hours[-1]) else None,
            }
            for curve in growth
        ],
        "figure": plain_figure(progress.ProgressFigure().draw(growth)) if growth else None,
    }


def _by_reason(now: Status, how: str) -> list[dict[str, Any]]:
    return [
        {"reason": reason, "count": len(trials), "trials": trials[:MAX_LISTED]}
        for reason, trials in now.trials_by_reason(how)[:MAX_LISTED]
    ]
