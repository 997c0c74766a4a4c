"""The status of a study: trials done, running and failed, the time left, and when each trial ended.

A run may be writing the folder, so this module only reads: it writes, repairs and locks nothing.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.base.records import Floats
from dse.config import ConfigError, load_space
from dse.skyline.admissible import COST
from dse.store import StoreError, is_held, read_record, run_file, runs_in, verify
from dse.study import claim, held
from dse.study.ledger import Entry, read_entries
from dse.study.precision import GROUPS, fronts
from dse.study.progress import seconds_left
from dse.study.record import STOPPED
from dse.study.results import Study

if TYPE_CHECKING:
    import pandas

    from dse.skyline.table import Goal

ENDED_EARLY = ("failed", STOPPED)

_OF_POINTS = ("trial", *GROUPS, "fits", COST, "transductive", "weight_bits", "pruned_after")
_CLOCKS_S = 60.0  # a file system's clock may be ahead by this

_Runs = dict[int, dict[int, float]]  # trial -> repeat -> when it ended, in seconds since 1970


@dataclass(frozen=True)
class Outcome:
    """How a trial ended, over its runs: 'finished', 'failed' or 'stopped', and the reason."""

    status: str
    reason: str
    n_runs: int


@dataclass(frozen=True)
class Status:
    """The status of a study.

    n_trials: designs to train; None if unknown.
    n_done: trials whose `search.repeats` runs have all finished or failed.
    running: designs that were proposed and are not done.
    outcomes: trial -> how it ended.
    n_runs: number of all runs, including those that repeat the front; None if unknown.
    n_runs_done: runs that have ended.
    hours: total length of all sessions, without the time between them.
    time_left_s: None if there is no estimate (`dse.study.progress`) or no run is missing.
    sign_s: the last that was heard of a session, in seconds since 1970: its start, a proposal, the end of a
        run; None before the first.
    is_running: whether a process holds the study; None if nobody can tell.
    points: the columns of its table of points that decide a front.
    ended: done trials in the order in which they ended. ended_hours: spent until then, NaN where unknown.
    """

    n_trials: int | None
    n_done: int
    running: tuple[Entry, ...]
    outcomes: Mapping[int, Outcome]
    n_runs: int | None
    n_runs_done: int
    hours: float
    time_left_s: float | None
    sign_s: float | None
    is_running: bool | None
    points: pandas.DataFrame
    ended: tuple[int, ...]
    ended_hours: tuple[float, ...]

    def trials_by_reason(self, status: str) -> list[tuple[str, list[int]]]:
        """Return (reason, trials) of the trials with a status, the most frequent reason first."""
        trials: dict[str, list[int]] = {}
        for trial, outcome in self.outcomes.items():
            if outcome.status == status:
                trials.setdefault(outcome.reason or "no reason was recorded", []).append(trial)
        return sorted(trials.items(), key=lambda group: (-len(group[1]), group[1]))


def status(folder: Path | str) -> Status:
    """Return the status of the study in a folder.

    A run ended when its record file was written. This time is clipped to the interval from the proposal of
    the trial to its report, so that a copied folder falls back on the book. Evaluations at other
    precisions do not count as runs. Runs that repeat the front are missing if a design on the front of the
    last table has fewer runs than `search.repeats_on_front`.

    Raises:
        StoreError: the folder has no search space, or one that no study wrote.
    """
    study = Study(Path(folder))
    search = _search(study)
    repeats, n_workers = search["repeats"], (study.space.get("execution") or {}).get("jobs", 1)
    goals = study.objectives
    entries = {entry.trial: entry for entry in read_entries(study.folder) if not entry.excluded}
    written = _written(study.folder)
    outcomes = _outcomes(study.folder, written)
    runs = _timed(written, entries, outcomes, repeats)
    done = {trial for trial, ends in runs.items() if len(ends) >= repeats}
    start_s, length_s, sign_s = _sessions(study.folder, entries, runs)
    columns = dict.fromkeys([*_OF_POINTS, *(goal.column for goal in goals)])
    points = _table(study.folder / held.POINTS, [*columns])
    points = points if "trial" in points else points.iloc[:0]

    n_trials = _n_trials(study.folder, search, entries)
    n_runs_done = sum(map(len, runs.values()))
    n_missing = None
    if n_trials is not None:
        begun = sum(min(len(ends), repeats) for ends in runs.values())
        n_missing = max(0, n_trials * repeats - begun) + _n_repeats_missing(points, goals, search, runs)

    # The points of a trial that ended after the tables were written are not known yet.
    ended = {trial: max(list(runs[trial].values())[:repeats]) for trial in done & outcomes.keys()}
    order = sorted(ended, key=lambda trial: (0.0 if math.isnan(ended[trial]) else ended[trial], trial))
    at_s = np.array([ended[trial] for trial in order])
    spent = np.clip(at_s[:, None] - start_s, 0, length_s).sum(axis=1) / 3600  # without what is between them
    moments = sorted(at for ends in runs.values() for at in ends.values() if math.isfinite(at))
    return Status(
        n_trials=n_trials,
        n_done=len(done),
        running=tuple(
            entry for trial, entry in entries.items() if not entry.is_reported and trial not in done
        ),
        outcomes=outcomes,
        n_runs=None if n_missing is None else n_runs_done + n_missing,
        n_runs_done=n_runs_done,
        hours=float(length_s.sum()) / 3600,
        time_left_s=_time_left_s(start_s, moments, n_missing, n_workers),
        sign_s=sign_s,
        is_running=is_held(study.folder),
        points=points,
        ended=tuple(order),
        ended_hours=tuple(np.where(np.isfinite(at_s), spent, np.nan).tolist()),
    )


def _search(study: Study) -> Mapping[str, Any]:
    """Return the settings of the search; a study writes every default."""
    search: Mapping[str, Any] = study.space.get("search") or {}
    for name in ("batch", "repeats", "repeats_on_front"):
        if name not in search:
            text = f"has no search.{name}, which a study writes with every default"
            raise StoreError(f"{study.folder / 'search_space.yaml'}: {text}")
    return search


def _written(folder: Path) -> _Runs:
    """Return trial -> repeat -> time of the record, for every run in the folder."""
    written: _Runs = {}
    for trial, repeats in runs_in(folder).items():
        for repeat in repeats:
            with contextlib.suppress(OSError):  # it is being removed
                at = os.stat(run_file(folder, trial, repeat)).st_mtime
                written.setdefault(trial, {})[repeat] = at
    return written


def _outcomes(folder: Path, written: _Runs) -> dict[int, Outcome]:
    """Return the outcomes of trials: from the table, or from the records of trials newer than the table."""
    outcomes = {}
    table = _table(folder / held.TRIALS, ("trial", "status", "reason", "repeats"))
    if len(table.columns) == 4:
        for trial, status, reason, n_runs in table.itertuples(index=False, name=None):
            if status == "excluded":
                continue
            outcomes[int(trial)] = Outcome(str(status), str(reason or ""), int(n_runs))
    for trial, runs in written.items():
        if trial not in outcomes or len(runs) > outcomes[trial].n_runs:
            records: list[dict[str, Any]] = []
            for repeat in runs:
                with contextlib.suppress(StoreError):
                    records.append(read_record(run_file(folder, trial, repeat)))
            bad = [record for record in records if record.get("status") in ENDED_EARLY]
            decisive = [*bad, *records, {}][0]
            outcomes[trial] = Outcome(
                str(decisive.get("status", "")), str(decisive.get("reason", "")), len(runs)
            )
    return outcomes


def _table(path: Path, columns: Sequence[str]) -> pandas.DataFrame:
    """Return the columns among `columns` that a table has; no columns if it cannot be read now."""
    import pandas
    import pyarrow.parquet

    try:
        verify(path)
        names = pyarrow.parquet.read_schema(path).names
        # Words are few among many points: as categories they are grouped in a fraction of the time.
        words = [name for name in GROUPS if name in columns]
        return pandas.read_parquet(path, columns=[n for n in columns if n in names], read_dictionary=words)
    except (StoreError, OSError, ValueError, pyarrow.ArrowException):
        return pandas.DataFrame()


def _timed(
    written: _Runs, entries: Mapping[int, Entry], outcomes: Mapping[int, Outcome], repeats: int
) -> _Runs:
    """Return the end of every run, NaN if it is unknown: a copied folder may lack its artefacts."""
    timed = {}
    for trial in sorted(written.keys() | outcomes.keys()):
        runs = written.get(trial) or dict.fromkeys(range(outcomes[trial].n_runs), math.nan)
        if (entry := entries.get(trial)) is not None:
            until_s = math.inf if entry.reported_s is None else entry.reported_s
            first = [at for at in runs.values() if not math.isnan(at)][:repeats]
            copied = len(first) < repeats or max(first) > until_s + _CLOCKS_S
            runs = {
                repeat: _between(at, entry.proposed_s, until_s)
                if number < repeats
                else (math.nan if copied else max(at, entry.proposed_s))
                for number, (repeat, at) in enumerate(runs.items())
            }
        timed[trial] = runs
    return timed


def _between(at: float, low: float, high: float) -> float:
    """Return a moment clipped to an interval; an unknown one becomes the last known end of the interval."""
    if math.isnan(at):
        return high if math.isfinite(high) else low
    return max(low, min(at, high))


def _sessions(folder: Path, entries: Mapping[int, Entry], runs: _Runs) -> tuple[Floats, Floats, float | None]:
    """Return when the sessions of a study began, and how long they were up to their last events, (session,).

    The last is the last start or event; None without any. Where the study records no start, all events are
    one session.
    """
    happened = [at for ends in runs.values() for at in ends.values() if math.isfinite(at)]
    happened += [entry.proposed_s for entry in entries.values()]
    happened += [entry.reported_s for entry in entries.values() if entry.reported_s is not None]
    events = np.sort(np.array(happened))
    try:
        moments = (session["started"] for session in claim.sessions(folder))
        starts = sorted(datetime.fromisoformat(moment).timestamp() for moment in moments)
    except (StoreError, ValueError, KeyError, TypeError, OverflowError):
        starts = []
    start_s = np.array(starts or events[:1].tolist())
    last = np.searchsorted(events, np.append(start_s[1:], np.inf)) - 1  # the last event of each
    length_s = np.maximum(events[last] - start_s, 0) if len(events) else np.zeros(len(start_s))
    return start_s, length_s, max((*starts, *events.tolist()), default=None)


def _n_trials(folder: Path, search: Mapping[str, Any], entries: Mapping[int, Entry]) -> int | None:
    """Return the final number of trials; a sampler without further designs ends a search early."""
    n_trials: int | None = search.get("n_trials")  # none is written of a grid
    if n_trials is None:
        try:
            n_trials = load_space(folder / "search_space.yaml").n_designs
        except ConfigError:  # a family or a chip that is not installed here
            return None
    newest = max((entry.batch for entry in entries.values()), default=0)
    last = [entry for entry in entries.values() if entry.batch == newest]
    if n_trials is not None and last and all(entry.is_reported for entry in last):
        before = len(entries) - len(last)
        if len(last) < min(search["batch"], n_trials - before):
            return len(entries)
    return n_trials


def _n_repeats_missing(
    points: pandas.DataFrame, goals: Sequence[Goal], search: Mapping[str, Any], runs: _Runs
) -> int:
    """Return the number of missing repeats of the designs on the fronts of the last table."""
    known = [goal for goal in goals if goal.column in points.columns]
    repeats, on_front = search["repeats"], search["repeats_on_front"]
    if on_front <= repeats or not known or points.empty:
        return 0
    front = {int(trial) for _, rows in fronts(points, known) for trial in rows["trial"]}
    made = [max(repeats, len(runs.get(trial, ()))) for trial in front]
    return sum(max(0, on_front - n) for n in made)


def _time_left_s(
    start_s: Floats, moments: Sequence[float], n_missing: int | None, n_workers: int
) -> float | None:
    """Return the estimated time left, from the runs of the last session; all runs count as equal work."""
    if not n_missing or not len(start_s):
        return None
    ended_s = [at for at in moments if at >= start_s[-1]]
    if not ended_s:
        return None
    return seconds_left(ended_s, [1.0] * len(ended_s), n_missing, n_workers, ended_s[-1])
