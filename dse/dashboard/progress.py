"""How a study goes: what is done, under way and failed, the time left, and how its front grew.

Everything is read from the folder while a run may be writing it, so nothing here writes, repairs or locks.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.config import ConfigError, load_space
from dse.figures.progress import draw_progress
from dse.figures.progress import gather_progress as gather_curves
from dse.records import Array
from dse.skyline.front import skyline
from dse.store import StoreError, read_json, run_folder
from dse.study.precision import as_trained
from dse.study.results import Study

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

MAX_LISTED = 50
"""Trials under way, reasons, and trials of a reason that are listed; the counts are of all."""

ENDED_BADLY = ("failed", "pruned")

# Of Optuna's journal format: JournalOperation.CREATE_TRIAL and SET_TRIAL_STATE_VALUES, TrialState.RUNNING.
_CREATE_TRIAL, _SET_TRIAL_STATE, _RUNNING = 4, 6, 0
_GROUPS = ("task", "family", "hardware")
_OF_POINTS = ("trial", *_GROUPS, "fits", "transductive", "weight_bits", "pruned_after")
_CLOCKS_S = 60.0  # by which the clock of a file system may be ahead

_Runs = dict[int, dict[int, float]]  # trial -> repeat -> when it ended, in seconds since 1970


@dataclass(frozen=True)
class _Asked:
    """A trial of the journal; when it was asked for and told of (None: not yet), in seconds since 1970."""

    batch: int
    design: Mapping[str, Any]
    asked_s: float
    told_s: float | None


@dataclass(frozen=True)
class _Outcome:
    """How a trial ended, over so many runs, as the table of trials says it."""

    status: str
    reason: str
    n_runs: int


@dataclass(frozen=True)
class _Sessions:
    """When a study ran: (session,) its starts, in seconds since 1970, and how long something happened."""

    start_s: Array
    length_s: Array

    def hours(self, at_s: Array) -> Array:
        """Return the time spent until some moments, without what lay between sessions; NaN for NaN."""
        spent = np.clip(at_s[:, None] - self.start_s, 0, self.length_s).sum(axis=1) / 3600
        return np.where(np.isfinite(at_s), spent, np.nan)


def gather_progress(folder: Path | str) -> dict[str, Any]:
    """Gather how a study goes, as plain values that JSON can hold.

    A trial is done when all of its first `search.repeats` runs have ended, well or not. No record says when a
    run ended: the time of its file does, kept between when its trial was asked for and told of, so that a
    copied folder falls back on the journal. Evaluations at other precisions are no runs.

    The time left is that of the runs that are missing, at the mean wall time between runs that ended in the
    last session, counted from its start. Runs that repeat the front are missing where the front of the last
    table lacks them.

    Returns:
        trials: {total, done, running, failed, pruned}; total is None where nothing tells it;
        runs: {total, done};
        running: [{trial, design}] of trials that were asked for and are not done, the first `MAX_LISTED`;
        failed, pruned: [{reason, count, trials}], the most frequent reason first, each with its first trials;
        hours: spent in all sessions, without what lay between them;
        time_left_s: None where it is unknown or nothing is missing;
        last: when a run last ended, ISO 8601 in UTC, None where none has;
        hypervolume: [{task, hardware, hypervolume, trials, hours}], where the curves of the figure end;
        figure: `dse.figures.progress.draw_progress` as JSON, None where it has no curve.

    Raises:
        StoreError: there is no search space in the folder, or not as a study writes it.
    """
    study = Study(Path(folder))
    space = study.space
    objectives = dict(text.split(":") for text in space["objectives"])
    search = space.get("search") or {}
    lacking = [name for name in ("n_trials", "batch", "repeats", "repeats_on_front") if name not in search]
    if lacking:
        text = f"has no search.{lacking[0]}, which a study writes with every default"
        raise StoreError(f"{study.folder / 'search_space.yaml'}: {text}")
    repeats = int(search["repeats"])
    asked = _journal(study.folder / "journal.log")
    found = _found(study.folder)
    outcomes = _outcomes(study.folder, found)
    runs = _timed(found, asked, outcomes, repeats)
    done = {trial for trial, ends in runs.items() if len(ends) >= repeats}
    sessions = _sessions(study.folder, asked, runs)
    points = _points(study.folder, list(objectives))

    total = _n_trials(study.folder, search, asked)
    n_done = sum(map(len, runs.values()))
    n_missing = None
    if total is not None:
        begun = sum(min(len(ends), repeats) for ends in runs.values())
        n_missing = max(0, total * repeats - begun) + _front_lacks(points, objectives, search, runs)

    # The points of a trial that ended after the tables were written are not known yet.
    ended = {trial: max(list(runs[trial].values())[:repeats]) for trial in done & outcomes.keys()}
    order = sorted(ended, key=lambda trial: (0.0 if math.isnan(ended[trial]) else ended[trial], trial))
    hours = sessions.hours(np.array([ended[trial] for trial in order]))
    growth = gather_curves(points, objectives, order, hours.tolist())
    running = [trial for trial, entry in asked.items() if entry.told_s is None and trial not in done]
    moments = [at for ends in runs.values() for at in ends.values() if math.isfinite(at)]
    return {
        "trials": {"total": total, "done": len(done), "running": len(running)}
        | {status: sum(o.status == status for o in outcomes.values()) for status in ENDED_BADLY},
        "runs": {"total": None if n_missing is None else n_done + n_missing, "done": n_done},
        "running": [{"trial": trial, "design": dict(asked[trial].design)} for trial in running[:MAX_LISTED]],
        **{status: _by_reason(outcomes, status) for status in ENDED_BADLY},
        "hours": float(sessions.length_s.sum()) / 3600,
        "time_left_s": _time_left_s(sessions, moments, n_missing),
        "last": datetime.fromtimestamp(max(moments), UTC).isoformat(timespec="seconds") if moments else None,
        "hypervolume": [
            {
                "task": curve.task,
                "hardware": curve.hardware,
                "hypervolume": float(curve.hypervolume[-1]),
                "trials": int(curve.trials[-1]),
                "hours": float(curve.hours[-1]) if np.isfinite(curve.hours[-1]) else None,
            }
            for curve in growth.curves
        ],
        "figure": _plain(draw_progress(growth)) if growth.curves else None,
    }


def _journal(path: Path) -> dict[int, _Asked]:
    """Return trial -> what the journal says, in the order of asking.

    Read as text and not through `dse.study.ledger.Ledger`, which cuts off a half-written line and
    removes lock files: the run that writes them may be alive. What is not a whole line yet is left out.
    """
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    # What JSON cannot hold must not reach the page.
    decode = json.JSONDecoder(parse_constant=lambda _: None).decode
    created: list[tuple[int, Mapping[str, Any], float]] = []
    told_s: dict[int, float] = {}
    for line in lines:
        try:
            entry = decode(line)
            operation = entry["op_code"]
            if operation == _CREATE_TRIAL:
                said = entry["user_attrs"]
                created.append((int(said["batch"]), dict(said["design"]), _seconds(entry["datetime_start"])))
            elif operation == _SET_TRIAL_STATE and entry["state"] != _RUNNING:
                told_s[entry["trial_id"]] = _seconds(entry["datetime_complete"])
        except (ValueError, KeyError, TypeError):
            continue
    return {trial: _Asked(*asked, told_s.get(trial)) for trial, asked in enumerate(created)}


def _seconds(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()


def _found(folder: Path) -> _Runs:
    """Return trial -> repeat -> time of the record, of every run that is there."""
    found: _Runs = {}
    for trial, at in _numbered(folder / "artefacts", ""):
        runs = {}
        for repeat, path in _numbered(at, "repeat_"):
            try:
                runs[repeat] = os.stat(f"{path}/record.json").st_mtime
            except OSError:  # it is being removed
                continue
        if runs:
            found[trial] = dict(sorted(runs.items()))
    return dict(sorted(found.items()))


def _numbered(folder: Path | str, prefix: str) -> list[tuple[int, str]]:
    """Return (number, path) of what a folder holds under names of a prefix and a number."""
    try:
        names = os.listdir(folder)
    except OSError:
        return []
    of = {name: name.removeprefix(prefix) for name in names if name.startswith(prefix)}
    return [(int(n), f"{folder}/{name}") for name, n in of.items() if n.isascii() and n.isdigit()]


def _outcomes(folder: Path, found: _Runs) -> dict[int, _Outcome]:
    """Return how trials ended: from the table, and from the records of those that it is too old for."""
    outcomes = {}
    table = _table(folder / "trials.parquet", ("trial", "status", "reason", "repeats"))
    if len(table.columns) == 4:
        for trial, status, reason, n_runs in table.itertuples(index=False, name=None):
            outcomes[int(trial)] = _Outcome(str(status), str(reason or ""), int(n_runs))
    for trial, runs in found.items():
        if trial not in outcomes or len(runs) > outcomes[trial].n_runs:
            records = [_record(run_folder(folder, trial, repeat)) for repeat in runs]
            bad = [record for record in records if record.get("status") in ENDED_BADLY]
            told = bad[0] if bad else records[0]
            outcomes[trial] = _Outcome(str(told.get("status", "")), str(told.get("reason", "")), len(runs))
    return outcomes


def _record(folder: Path) -> dict[str, Any]:
    """Return the record of a run, without checking its files: they are many, and may be large."""
    try:
        record = read_json(folder / "record.json")
    except StoreError:
        return {}
    return record if isinstance(record, dict) else {}


def _table(path: Path, wanted: Sequence[str]) -> pandas.DataFrame:
    """Return those of some columns that a table has, none where it cannot be read now."""
    import pandas
    import pyarrow.parquet

    try:
        names = pyarrow.parquet.read_schema(path).names
        # Words are few among many points: as categories they are grouped in a fraction of the time.
        words = [name for name in _GROUPS if name in wanted]
        return pandas.read_parquet(path, columns=[n for n in wanted if n in names], read_dictionary=words)
    except (OSError, ValueError, pyarrow.ArrowException):
        return pandas.DataFrame()


def _points(folder: Path, objectives: Sequence[str]) -> pandas.DataFrame:
    """Return the columns of the design points that decide a front."""
    points = _table(folder / "points.parquet", tuple(dict.fromkeys([*_OF_POINTS, *objectives])))
    return points if "trial" in points.columns else points.iloc[:0]


def _timed(
    found: _Runs, asked: Mapping[int, _Asked], outcomes: Mapping[int, _Outcome], repeats: int
) -> _Runs:
    """Return when every run ended, NaN where nothing says it: a folder may come without its artefacts."""
    timed = {}
    for trial in sorted(found.keys() | outcomes.keys()):
        runs = found.get(trial) or dict.fromkeys(range(outcomes[trial].n_runs), math.nan)
        if (entry := asked.get(trial)) is not None:
            until_s = math.inf if entry.told_s is None else entry.told_s
            first = [at for at in runs.values() if not math.isnan(at)][:repeats]
            copied = len(first) < repeats or max(first) > until_s + _CLOCKS_S
            runs = {
                repeat: _between(at, entry.asked_s, until_s)
                if number < repeats
                else (math.nan if copied else max(at, entry.asked_s))
                for number, (repeat, at) in enumerate(runs.items())
            }
        timed[trial] = runs
    return timed


def _between(at: float, low: float, high: float) -> float:
    """Return a moment kept within two, and the last that is known of these where it is unknown."""
    if math.isnan(at):
        return high if math.isfinite(high) else low
    return max(low, min(at, high))


def _sessions(folder: Path, asked: Mapping[int, _Asked], runs: _Runs) -> _Sessions:
    """Return the sessions that the study notes when they start; before it did, all that happened is one."""
    happened = [at for ends in runs.values() for at in ends.values() if math.isfinite(at)]
    happened += [entry.asked_s for entry in asked.values()]
    happened += [entry.told_s for entry in asked.values() if entry.told_s is not None]
    events = np.sort(np.array(happened))
    try:
        starts = sorted(_seconds(session["started"]) for session in read_json(folder / "environment.json"))
    except (StoreError, ValueError, KeyError, TypeError):
        starts = []
    start_s = np.array(starts or events[:1].tolist())
    last = np.searchsorted(events, np.append(start_s[1:], np.inf)) - 1  # the last event of each
    length_s = np.maximum(events[last] - start_s, 0) if len(events) else np.zeros(len(start_s))
    return _Sessions(start_s, length_s)


def _n_trials(folder: Path, search: Mapping[str, Any], asked: Mapping[int, _Asked]) -> int | None:
    """Return how many trials there will be; a sampler that has no other design ends a search early."""
    n_trials = search["n_trials"]
    if n_trials is None:
        try:
            n_trials = load_space(folder / "search_space.yaml").n_designs
        except ConfigError:  # a family or a chip that is not installed here
            return None
    newest = max((entry.batch for entry in asked.values()), default=0)
    last = [entry for entry in asked.values() if entry.batch == newest]
    if n_trials is not None and last and all(entry.told_s is not None for entry in last):
        before = len(asked) - len(last)
        if len(last) < min(search["batch"], n_trials - before):
            return len(asked)
    return n_trials if n_trials is None else int(n_trials)


def _front_lacks(
    points: pandas.DataFrame, objectives: Mapping[str, str], search: Mapping[str, Any], runs: _Runs
) -> int:
    """Return how many runs the fronts of the last table lack to have their repeats."""
    repeats, wanted = int(search["repeats"]), int(search["repeats_on_front"])
    known = [(name, way) for name, way in objectives.items() if name in points.columns]
    if wanted <= repeats or not known or points.empty:
        return 0
    by = [name for name in _GROUPS if name in points.columns]
    table = as_trained(points)
    front: set[int] = set()
    for _, own in table.groupby(by, observed=True) if by else [((), table)]:
        front |= {int(trial) for trial in skyline(own.drop(columns=by), known).rows["trial"]}
    return sum(max(0, wanted - max(repeats, len(runs.get(trial, ())))) for trial in front)


def _by_reason(outcomes: Mapping[int, _Outcome], status: str) -> list[dict[str, Any]]:
    trials: dict[str, list[int]] = {}
    for trial, outcome in outcomes.items():
        if outcome.status == status:
            trials.setdefault(outcome.reason or "no reason was recorded", []).append(trial)
    ordered = sorted(trials.items(), key=lambda group: (-len(group[1]), group[1]))
    return [
        {"reason": reason, "count": len(group), "trials": group[:MAX_LISTED]}
        for reason, group in ordered[:MAX_LISTED]
    ]


def _time_left_s(sessions: _Sessions, moments: Sequence[float], n_missing: int | None) -> float | None:
    if not n_missing or not len(sessions.start_s):
        return None
    began = float(sessions.start_s[-1])
    ended = [at for at in moments if at >= began]
    return (max(ended) - began) / len(ended) * n_missing if ended else None


def _plain(figure: plotly.graph_objects.Figure) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(figure.to_json())
    found["layout"].pop("template", None)
    return found
