"""Racing: designs train from rung to rung, and stop where they cannot reach the front any more.

A batch of designs is raced in rounds. A round names designs and the rung to which they train, or the end.
When all of them stand there, the next round is decided:

1. Until `dse.search.racing.LEAST` designs of a task and family have finished, as many go on to the end as are
   missing: half from the front at the rung, half drawn at random.
2. Then every design at the lowest rung is judged. The gain of its full read-out, at most
   (`dse.search.racing.most_gain`), is added to all its design points. It stops if these points would add
   next to nothing to the hypervolume of the front of the finished designs. The others go on to the next
   rung; at the last rung those that may add most go on to the end, an eighth of the batch at a time, and the
   rest is judged again.

A round is written to the disk before its designs train, and is decided from records of finished designs and
of designs at rungs alone. So the same designs stop for any number of workers, and after any interruption.

    racing/<batch>.json   the rounds of a batch       racing/audit.json   stopped designs that were trained on
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse import seeds, store
from dse.config import SearchSpace
from dse.config.expressions import named_columns
from dse.config.settings import Racing
from dse.hardware.profile import Profile
from dse.records import Bools, Floats, Ints
from dse.search.racing import LEAST, Scale, covered, evenly, is_certain, most_gain
from dse.study import checkpoints, points
from dse.study import trials as tables
from dse.study.fronts import GROUPS, fronts
from dse.study.journal import Entry
from dse.study.precision import as_trained
from dse.study.progress import Progress
from dse.study.record import Numbers, RunRecord
from dse.study.runs import Runs

if TYPE_CHECKING:
    import pandas

_FOLDER, _AUDIT = "racing", "audit.json"
_WAVES = 8
_OF_SIZE = {"n_weights", "memory_bytes", "n_cores", "fits", "task", "family", "hardware"}

Group = tuple[str, ...]
"""Task, family and chip: designs of a group compete."""


@dataclass
class _Finished:
    """What is known of a group's finished designs.

    front: their design points that no other dominates.
    values: trial -> full read-out, (objective,).
    at_rungs: epochs -> trial -> full read-out there.
    """

    front: pandas.DataFrame | None = None
    values: dict[int, Floats] = field(default_factory=dict)
    at_rungs: dict[int, dict[int, Floats]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Verdict:
    """What a design may add to its front's hypervolume at most, as a fraction; the reason if too little."""

    gain: float
    reason: str = ""


class Race:
    """The racing of one study."""

    def __init__(
        self,
        space: SearchSpace,
        folder: Path,
        profiles: Sequence[Profile],
        runs: Runs,
        progress: Progress,
    ) -> None:
        assert space.search.racing is not None
        self._space, self._folder, self._profiles = space, folder, tuple(profiles)
        self._runs, self._progress = runs, progress
        self._settings: Racing = space.search.racing
        self._finished: dict[Group, _Finished] = {}
        self._known: set[int] = set()  # trials in `_finished`
        self._stopped = {
            int(stop["trial"])
            for path in sorted((folder / _FOLDER).glob("[0-9]*.json"))
            for one in _rounds(path)
            for stop in one["stopped"]
        }

    def complete(self, batch: int, entries: Sequence[Entry], after_each: Callable[[], None]) -> None:
        """Train a batch of designs until each has finished, failed or stopped.

        Args:
            batch: its number.
            entries: its designs.
            after_each: called when a run has ended, or stands at its rung.

        Raises:
            StoreError, RecordingError: as in `Runs.complete`.
        """
        path = self._folder / _FOLDER / f"{batch:05d}.json"
        rounds = _rounds(path)
        repeats = self._space.search.repeats
        self._runs.recall(entries)
        upcoming: dict[str, Any] | None = None
        if not rounds:
            first = [entry.trial for entry in entries]
            upcoming = {"epochs": self._settings.rungs[0], "trials": first, "scouts": [], "stopped": []}
        while True:
            if upcoming is not None:
                rounds.append(upcoming)
                store.write_json(path, {"rounds": rounds})
            self._stop(rounds)
            stands = _stands(rounds)
            for epochs in sorted(set(stands.values()), key=lambda n: math.inf if n is None else n):
                there = [entry for entry in entries if stands.get(entry.trial, 0) == epochs]
                self._runs.complete(there, repeats, after_each, epochs)
            upcoming = self._next(entries, rounds, stands)
            if upcoming is None:
                break
        left = [e for e in entries if e.trial not in self._stopped or not self._runs.of(e.trial)]
        self._runs.complete(left, repeats, after_each)

    def _stop(self, rounds: Iterable[Mapping[str, Any]]) -> None:
        """Record what rounds have stopped, where an interruption has prevented it."""
        for stop in (stop for one in rounds for stop in one["stopped"]):
            trial, epochs = int(stop["trial"]), int(stop["epochs"])
            self._stopped.add(trial)
            at_rung = self._runs.paused(trial, self._space.search.repeats, epochs)
            if at_rung is not None and trial not in self._audited()["trials"]:
                self._runs.stop(trial, at_rung, epochs, stop["reason"])

    def _next(
        self,
        entries: Sequence[Entry],
        rounds: Sequence[Mapping[str, Any]],
        stands: Mapping[int, int | None],
    ) -> dict[str, Any] | None:
        """Return the next round of a batch; None: no design pauses."""
        repeats, rungs = self._space.search.repeats, self._settings.rungs
        at_rung = {
            trial: records
            for trial, epochs in stands.items()
            if epochs is not None and trial not in self._stopped
            for records in [self._runs.paused(trial, repeats, epochs)]
            if records is not None
        }
        if not at_rung:
            return None
        scouts = {trial for one in rounds for trial in one["scouts"]} & at_rung.keys()
        epochs = min(n for trial in scouts or at_rung if (n := stands[trial]) is not None)
        waiting = {trial: at_rung[trial] for trial in sorted(at_rung) if stands[trial] == epochs}
        later = [rung for rung in rungs if rung > epochs]
        upcoming: dict[str, Any] = {
            "epochs": later[0] if later else None,
            "trials": [],
            "scouts": [],
            "stopped": [],
        }
        if scouts:
            return {**upcoming, "trials": sorted(scouts & waiting.keys())}
        self._learn()
        table = self._comparable(waiting, checkpoints.rung_folder(self._folder, epochs))
        if more := self._scouts(waiting, table, epochs, (entries[0].batch, len(rounds))):
            return {**upcoming, "trials": more, "scouts": more}
        verdicts = self._verdicts(waiting, table, epochs)
        stopped = [
            {"trial": trial, "epochs": epochs, "reason": verdict.reason}
            for trial, verdict in verdicts.items()
            if verdict.reason
        ]
        ahead = sorted((t for t in waiting if not verdicts[t].reason), key=lambda t: (-verdicts[t].gain, t))
        most = len(ahead) if later else max(LEAST, len(entries) // _WAVES)
        return {**upcoming, "trials": sorted(ahead[:most]), "stopped": stopped}

    def _learn(self) -> None:
        """Take in the designs that have finished since, without those that only an audit trained on."""
        repeats = self._space.search.repeats
        new = {
            trial: records[:repeats]
            for trial, records in self._runs.trials().items()
            if trial not in self._known | self._stopped
            and len(records) >= repeats
            and all(record.finished for record in records[:repeats])
        }
        if not new:
            return
        self._known |= new.keys()
        table = self._comparable(new, self._folder)
        table = table[self._meets_limits(table)] if len(table) else table
        for group, rows in _by_group(table):
            known = self._finished.setdefault(group, _Finished())
            before = [] if known.front is None else [known.front]
            known.front = self._front([*before, rows])
        for trial, records in new.items():
            for group, values in self._full(records, [record.measured for record in records]):
                self._finished.setdefault(group, _Finished()).values[trial] = values
            for epochs in set.intersection(*(set(record.rungs) for record in records)):
                for group, values in self._full(records, [record.rungs[epochs] for record in records]):
                    of_rung = self._finished[group].at_rungs.setdefault(epochs, {})
                    of_rung[trial] = values

    def _front(self, tables_: Sequence[pandas.DataFrame]) -> pandas.DataFrame:
        import pandas

        from dse.skyline.front import skyline

        return skyline(pandas.concat(tables_, ignore_index=True), self._space.objectives).rows

    def _comparable(self, trials: Mapping[int, Sequence[RunRecord]], folder: Path) -> pandas.DataFrame:
        """Return the design points of trials that may be on a front."""
        from dse.skyline.front import comparable

        table = points.points_table(self._space, folder, trials, self._profiles)
        return table if table.empty else comparable(as_trained(table), self._space.objectives).rows

    def _full(
        self, records: Sequence[RunRecord], numbers: Sequence[Numbers]
    ) -> Iterator[tuple[Group, Floats]]:
        """Yield the objectives of a full read-out in each group of a trial; NaN where it has none.

        Args:
            records: runs of the trial.
            numbers: of each, at its end or at a rung.
        """
        design = records[0].design
        for head in list[str | None](numbers[0].of_heads) or [None]:
            of_head = [one.of_head(head) for one in numbers]
            named = head or self._space.task_name(design), self._space.kind("model", design)
            for chip in list[str | None](x.name for x in self._profiles) or [None]:
                known = chip if all(chip in one.hardware for one in of_head) else None
                row = tables.summary(of_head, known)
                values = [float(row.get(name, math.nan)) for name, _ in self._space.objectives]
                yield (*named, *([chip] if chip else [])), np.array(values)

    def _scouts(
        self,
        waiting: Mapping[int, Sequence[RunRecord]],
        table: pandas.DataFrame,
        epochs: int,
        seed: tuple[int, int],
    ) -> list[int]:
        """Return the designs that must finish before others of their task and family can be judged."""
        rng = seeds.generator(self._space.seed, {}, "racing", *seed)
        scouts: set[int] = set()
        for group, rows in _by_group(table):
            known = self._finished.get(group, _Finished())
            lacking = LEAST - len(known.at_rungs.get(epochs, {}).keys() & known.values.keys())
            here = sorted({int(trial) for trial in rows["trial"]} & waiting.keys())
            chosen = [trial for trial in here if trial in scouts][: max(0, lacking)]
            if lacking <= len(chosen):
                continue
            front = self._front([rows])["trial"]
            leaders = [t for t in dict.fromkeys(map(int, front)) if t not in chosen]
            chosen += evenly(leaders, (lacking - len(chosen) + 1) // 2)
            rest = [trial for trial in here if trial not in chosen]
            drawn = [rest[i] for i in rng.permutation(len(rest))]
            scouts |= {*chosen, *drawn[: max(0, lacking - len(chosen))]}
        return sorted(scouts)

    def _verdicts(
        self, waiting: Mapping[int, Sequence[RunRecord]], table: pandas.DataFrame, epochs: int
    ) -> dict[int, _Verdict]:
        """Return the verdict on every design at a rung; one without comparable points goes on, at last."""
        n_validation = min(
            (record.samples["validation"] for records in waiting.values() for record in records), default=1
        )
        verdicts: dict[int, list[_Verdict]] = {trial: [] for trial in waiting}
        full = {
            (trial, group): values
            for trial, records in waiting.items()
            for group, values in self._full(records, [record.measured for record in records])
        }
        for group, rows in _by_group(table):
            known = self._finished.get(group, _Finished())
            at = {int(t): np.flatnonzero(rows["trial"] == t) for t in rows["trial"].unique()}
            x = np.array([full[trial, group] for trial in at])
            judged = self._judged(known, rows, at, x, epochs, 0.5 / max(1, n_validation))
            for trial, verdict in judged.items():
                verdicts[trial].append(verdict)
        return {
            trial: max(of, key=lambda verdict: (not verdict.reason, verdict.gain))
            if of
            else _Verdict(-math.inf)
            for trial, of in verdicts.items()
        }

    def _judged(
        self,
        known: _Finished,
        rows: pandas.DataFrame,
        at: Mapping[int, Ints],
        x: Floats,
        epochs: int,
        end: float,
    ) -> dict[int, _Verdict]:
        """Return the verdicts on the designs of a group.

        Args:
            known: of its finished designs.
            rows: design points of those at the rung.
            at: trial -> places of its points in the rows.
            x: (trial, objective) full read-outs at the rung.
            epochs: of the rung.
            end: least distance of odds from 0 and 1.
        """
        of_rung = known.at_rungs.get(epochs, {})
        both = sorted(of_rung.keys() & known.values.keys())
        if known.front is None or len(both) < LEAST:
            return {trial: _Verdict(math.inf) for trial in at}
        before, after = (np.array([of[trial] for trial in both]) for of in (of_rung, known.values))
        goals = self._space.objectives
        n_changing = sum(not is_certain(before[:, g], after[:, g]) for g in range(len(goals)))
        confidence = 1 - (1 - self._settings.confidence) / max(1, n_changing)
        front, best, reach = [], [], []
        place = {row: number for number, places in enumerate(at.values()) for row in places}
        of_row = np.array([place[row] for row in range(len(rows))])
        for g, (name, direction) in enumerate(goals):
            front.append(known.front[name].to_numpy(float))
            values = rows[name].to_numpy(float)
            if is_certain(before[:, g], after[:, g]):
                best.append(values)
                reach.append(x[:, g])
                continue
            every = np.concatenate([front[g], values, before[:, g], after[:, g], x[:, g]])
            scale = Scale.of(every[np.isfinite(every)], direction, end)
            ok = np.isfinite(before[:, g]) & np.isfinite(after[:, g])
            here = scale.to(x[:, g])
            gain = most_gain(scale.to(before[ok, g]), scale.to(after[ok, g]), here, confidence)
            gain = np.where(np.isfinite(here), gain, math.inf)
            better = scale.back(scale.to(values) + gain[of_row])
            best.append(np.maximum(values, better) if direction == "max" else np.minimum(values, better))
            reach.append(scale.back(here + gain))
        sign = np.array([1.0 if direction == "max" else -1.0 for _, direction in goals])
        meets = self._meets_limits(rows.assign(**{x[0]: b for x, b in zip(goals, best, strict=True)}))
        if known.front.empty:
            gains = np.where(np.bincount(of_row, meets, len(at)) > 0, math.inf, 0.0)
        else:
            points_at_best = sign * np.array(best).T
            gains = _gains(points_at_best[meets], sign * np.array(front).T, of_row[meets], len(at))
        verdicts = {}
        for n, (trial, places) in enumerate(at.items()):
            why = f"would add at most {gains[n]:.3%} to the hypervolume of the front"
            why = why if meets[places].any() else "would meet the limits in no design point"
            so_far = (
                f"{goals[0][0]} {x[n, 0]:.4g} after {epochs} epochs, at most {reach[0][n]:.4g} at the end"
            )
            is_worth = gains[n] > self._settings.least_gain
            verdicts[trial] = _Verdict(float(gains[n]), "" if is_worth else f"{so_far}, {why}")
        return verdicts

    def _meets_limits(self, rows: pandas.DataFrame) -> Bools:
        """Return which design points meet the limits as far as objectives and size decide."""
        from dse.skyline.constraints import matches

        decided = {name for name, _ in self._space.objectives} | _OF_SIZE | self._space.axes.keys()
        meets = np.ones(len(rows), bool)
        for limit in self._space.limits or ():
            if named_columns([limit]) <= decided & set(rows.columns):
                meets &= matches(limit, rows)
        return meets

    def audit(
        self,
        entries: Sequence[Entry],
        after_each: Callable[[], None],
        points_now: Callable[[], pandas.DataFrame],
    ) -> list[str]:
        """Train some stopped designs to their ends; return what racing has saved and lost, in sentences.

        Args:
            entries: all designs.
            after_each: called when a run has ended.
            points_now: returns the design points of the study.
        """
        path, audited = self._folder / _FOLDER / _AUDIT, self._audited()
        if len(entries) > audited["designs"] and self._settings.audit:
            rng = seeds.generator(self._space.seed, {}, "racing audit", len(entries))
            left = sorted(self._stopped - set(audited["trials"]))
            drawn = sorted(left[i] for i in rng.permutation(len(left))[: self._settings.audit])
            audited = {"designs": len(entries), "trials": [*audited["trials"], *drawn]}
            store.write_json(path, audited)
        trials = set(audited["trials"])
        for trial in audited["trials"]:
            self._runs.train_on(trial)
        sample = [entry for entry in entries if entry.trial in trials]
        self._runs.complete(sample, self._space.search.repeats, after_each)
        sentences = [self._saved(entries, trials), *self._lost(trials, points_now)] if self._stopped else []
        if sentences and audited.get("sentences") != sentences:
            store.write_json(path, {**audited, "sentences": sentences})
        return sentences

    def _audited(self) -> dict[str, Any]:
        """Return how many designs there were at the last audit, and which stopped ones were trained on."""
        path = self._folder / _FOLDER / _AUDIT
        return dict(store.read_json(path)) if path.exists() else {"designs": 0, "trials": []}

    def _saved(self, entries: Sequence[Entry], audited: Collection[int]) -> str:
        """Return how many designs stopped and what that saved."""
        total = saved = 0
        for entry in entries:
            epochs = self._space.resolve(entry.design).training.epochs
            records = self._runs.of(entry.trial)
            at = records[0].stopped_at_epoch if records else None
            total, saved = total + epochs, saved + (0 if at is None else epochs - at)
        of = f"{len(self._stopped)} of {len(entries)} designs stopped early"
        again = f" (and {len(audited)} of these were trained on)" if audited else ""
        return f"racing: {of}{again}, which saves {saved / max(1, total):.0%} of all epochs"

    def _lost(self, audited: Collection[int], points_now: Callable[[], pandas.DataFrame]) -> Iterator[str]:
        """Yield what fronts would lack without the stopped designs that were trained on."""
        if not audited:
            return
        from dse.skyline.front import skyline
        from dse.skyline.goals import checked_goals, costs_of
        from dse.skyline.pareto import hypervolume

        goals, share, members = checked_goals(self._space.objectives), 0.0, set()
        for table, front in fronts(points_now(), self._space.objectives):
            missed = {int(trial) for trial in front["trial"]} & set(audited)
            if missed:
                members |= missed
                others = skyline(table[~table["trial"].isin(audited)], self._space.objectives).rows
                all_costs = costs_of(table, goals)
                reference = all_costs[np.isfinite(all_costs).all(axis=1)].max(axis=0)
                whole, less = (hypervolume(costs_of(rows, goals), reference) for rows in (front, others))
                share = max(share, 1 - less / whole if whole > 0 else 0.0)
        n = len(audited)
        if members:
            yield (
                f"racing: of {n} stopped designs, drawn at random and trained on, {len(members)} "
                f"{'are' if len(members) > 1 else 'is'} on the front: trial "
                f"{', '.join(map(str, sorted(members)))}; without, the hypervolume is {share:.2%} less"
            )
        else:
            yield f"racing: of {n} stopped designs, drawn at random and trained on, none is on the front"


def _gains(points: Floats, front: Floats, owner: Ints, n: int) -> Floats:
    """Return what the points of n designs would add to the hypervolume of a front, as fractions of it, (n,).

    Args:
        points: (k, objective), larger is better.
        front: (m, objective).
        owner: (k,) number of the design that a point is of.
        n: number of designs.
    """
    from dse.skyline.pareto import hypervolume, non_dominated

    gains, ahead = np.zeros(n), ~covered(points, front)
    worst = np.concatenate([points, front]).min(axis=0)
    span = np.maximum(np.concatenate([points, front]).max(axis=0) - worst, 1e-300)
    costs, base = (points - worst) / -span, (front - worst) / -span
    reference = np.full(front.shape[1], 0.01)  # so that points that are worst in one goal count
    whole = hypervolume(base, reference)
    for number in range(n):
        own = costs[ahead & (owner == number)]
        if not np.isfinite(own).all():
            gains[number] = math.inf
        elif len(own):
            own = own[non_dominated(own)]
            gains[number] = hypervolume(np.concatenate([base, own]), reference) / whole - 1
    return gains


def sentences(folder: Path) -> list[str]:
    """Return what racing has saved and lost in a study, as the last audit states it."""
    path = folder / _FOLDER / _AUDIT
    return list(store.read_json(path).get("sentences", [])) if path.exists() else []


def _rounds(path: Path) -> list[dict[str, Any]]:
    return list(store.read_json(path)["rounds"]) if path.exists() else []


def _stands(rounds: Sequence[Mapping[str, Any]]) -> dict[int, int | None]:
    """Return trial -> the rung to which the rounds let it train; None: to its end."""
    return {int(trial): one["epochs"] for one in rounds for trial in one["trials"]}


def _by_group(table: pandas.DataFrame) -> Iterator[tuple[Group, pandas.DataFrame]]:
    by = [name for name in GROUPS if name in table.columns]
    for group, rows in table.groupby(by, observed=True) if len(table) else ():
        yield tuple(map(str, group)), rows
