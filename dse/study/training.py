"""Training the missing runs of a study: which of them train together, when, and what is tried again.

Runs that can share batches train in cohorts (`dse.search.cohorts`); the grouping changes no result. A run
that the machine ends is begun again a few times, and then by the next session.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from dse import store
from dse.base.records import Dataset
from dse.config.contracts import has_rungs, trains_in_cohorts
from dse.data import dataset
from dse.data.recordings import RecordingError
from dse.measure.objectives import need_no_decisions
from dse.search import cohorts
from dse.study import checkpoints, jobs
from dse.study.claim import Coordinator, Key
from dse.study.data_sets import DataSets, Prepared, stop_if_blameless
from dse.study.executors.work import Failure
from dse.study.ledger import Entry
from dse.study.runs import Runs
from dse.study.session import Session
from dse.study.workers import OutOfTime

_LONGEST_S = 120.0  # estimated CPU seconds that a killed worker may lose
_PART, _CHECKPOINT_S = 0.2, 20.0  # where time ends: most of it for a cohort, and between checkpoints
_GLANCE_S = 1.0  # between looks at what other coordinators have trained


class Training:
    """The training of one study's runs.

    Args:
        session: of the study.
        data: the data sets of its designs.
        runs: that have ended.
        coordinator: shares trainings with others; None: nobody else trains.
    """

    def __init__(
        self, session: Session, data: DataSets, runs: Runs, coordinator: Coordinator | None = None
    ) -> None:
        self._session, self._space = session, session.space
        self._data, self._runs, self._coordinator = data, runs, coordinator
        self._costs: dict[Key, float] = {}  # of the next part of a run: estimated seconds
        self._begun: dict[Key, float] = {}  # when its job began
        self._is_late = False  # whether a job was left out that cannot end in time
        self._pace: dict[type, float] = {}  # seconds per estimated one that the last job of a family took

    def complete(
        self,
        entries: Sequence[Entry],
        repeats: int,
        after_each: Callable[[], None] = lambda: None,
        until: int | None = None,
    ) -> None:
        """Train every missing run of some designs up to a number of repeats, or wait for who trains it.

        Args:
            entries: the designs.
            repeats: runs of each.
            after_each: called when a run has ended.
            until: epochs of the rung to which they train; None: to their ends.

        Raises:
            StoreError: results cannot be written (the disk is full); nothing finished is lost.
            RecordingError: no data set of any design could be prepared.
            OutOfTime: the time is over.
        """
        runs = self._runs
        runs.recall(entries)
        designs = {(entry.trial, repeat): entry for entry in entries for repeat in range(repeats)}
        tried: set[Key] = set()
        while missing := [key for key in designs if key not in tried and not runs.stands(key, until)]:
            unclaimed = missing if self._coordinator is None else self._coordinator.unclaimed(missing)
            if unclaimed:
                tried |= self._train({key: designs[key] for key in unclaimed}, until, after_each)
            else:
                time.sleep(_GLANCE_S)
            if not tried.issuperset(missing):
                n_before = runs.count()
                runs.recall([designs[key] for key in missing])
                self._session.progress.expect(n_before - runs.count())  # what others have trained
                after_each()

    def _train(
        self, missing: Mapping[Key, Entry], until: int | None, after_each: Callable[[], None]
    ) -> set[Key]:
        """Train missing runs, but for those that other coordinators train by then; return the others."""
        planned = self._planned(self._prepared(missing), missing, until)
        tried = missing.keys() - {run.key for cohort in planned for run in cohort.runs}  # they failed
        running: set[Key] = set()

        def admitted(waiting: Iterable[jobs.TrainingJob]) -> Iterator[jobs.TrainingJob]:
            return self._claimed(self._in_time(waiting), running, tried)

        for cohort, ended, again in self._session.workers.attempts(jobs.train, planned, admitted):
            if isinstance(ended, Failure):
                runs, why = cohort.runs, ended
            elif ended[1] is None or not _by_machine(ended[1]):
                run, failure = cohort.runs[ended[0]], ended[1]
                if failure is None:
                    self._runs.settle(run.key, until)
                else:
                    self._runs.fail(missing[run.key], run.repeat, failure)
                running.discard(run.key)
                self._clock(cohort)
                after_each()
                continue
            else:
                runs, why = (cohort.runs[ended[0]],), ended[1]
            for run in self._unfinished(runs, why, until):
                if len(cohort.runs) == 1 and not _by_machine(why):
                    self._runs.fail(missing[run.key], run.repeat, why)
                elif again is None:
                    self._runs.leave(run.key, why)
                else:
                    again.append(dataclasses.replace(cohort, runs=(run,)))
        if self._coordinator is not None:
            self._coordinator.free()
        if self._is_late:
            raise OutOfTime
        return tried

    def _in_time(self, waiting: Iterable[jobs.TrainingJob]) -> Iterator[jobs.TrainingJob]:
        """Yield the jobs that can end in the time left, as they can begin; the others are left out."""
        for job in waiting:
            left_s, pace = self._session.workers.left_s, self._pace.get(type(job.runs[0].sections.model), 1.0)
            if left_s is not None and pace * self._cost(job) >= left_s:
                self._is_late = True
            else:
                self._begun |= dict.fromkeys((run.key for run in job.runs), time.monotonic())
                yield job

    def _clock(self, job: jobs.TrainingJob) -> None:
        """Take notice of how long a job of a family took."""
        run = job.runs[0]
        took_s = time.monotonic() - self._begun[run.key]
        self._pace[type(run.sections.model)] = took_s / max(self._cost(job), 1e-9)

    def _cost(self, job: jobs.TrainingJob) -> float:
        return sum(self._costs[run.key] for run in job.runs)

    def _claimed(
        self, waiting: Iterable[jobs.TrainingJob], running: set[Key], tried: set[Key]
    ) -> Iterator[jobs.TrainingJob]:
        """Yield jobs as they can begin, without the runs that another coordinator trains or has trained.

        The runs of each job are added to those that run, and to those that were tried.
        """
        for job in waiting:
            runs = job.runs
            if self._coordinator is not None:
                ours = self._coordinator.claim([run.key for run in runs], running)
                runs = tuple(run for run in runs if run.key in ours and not run.folder.is_file())
            if runs:
                running |= {run.key for run in runs}
                tried |= running
                yield dataclasses.replace(job, runs=runs)

    def _unfinished(self, runs: Sequence[jobs.Run], why: Failure, until: int | None) -> list[jobs.Run]:
        """Return the runs of a job that ended early which are not finished; record those that are."""
        stop_if_blameless(why)
        for run in runs:
            if run.folder.is_file():  # the worker died after publishing it
                self._runs.settle(run.key)
        return [run for run in runs if not self._runs.stands(run.key, until)]

    def _prepared(self, missing: Mapping[Key, Entry]) -> list[jobs.Run]:
        """Prepare the data sets of missing runs; return the runs that can be trained."""
        n_repeats, runs = self._space.search.repeats, []
        data = self._data.of(missing, with_folds=True, needs_one=not self._runs.count())
        for (trial, repeat), one in data.items():
            entry, why = missing[trial, repeat], one if isinstance(one, Failure) else None
            if isinstance(one, Prepared):
                one = dataclasses.replace(one, folds=one.folds[repeat % n_repeats :: n_repeats])
                why = next((fold for fold in one.folds if isinstance(fold, Failure)), None)
                if why is None:
                    runs.append(jobs.run_of(self._session, entry, repeat, one))
            if why is not None and why.by_machine:
                self._runs.leave((trial, repeat), why)
            elif why is not None:
                self._runs.fail(entry, repeat, why)
        return runs

    def _planned(
        self, runs: Sequence[jobs.Run], entries: Mapping[Key, Entry], until: int | None
    ) -> list[jobs.TrainingJob]:
        """Return the runs as cohorts, in the order of training; a run too large for a worker fails here."""
        execution, budget, workers = self._space.execution, self._session.budget, self._session.workers
        run_of = {run.data: run for run in runs}

        @functools.lru_cache(maxsize=8)
        def load(folder: Path) -> Dataset:
            with store.explained(self._data.cache):
                return dataset.load_or_prepare(run_of[folder].sections, run_of[folder].base, folder)

        fitting, demands = [], []
        for run in runs:
            demand = self._demand(run, load(run.data), until)
            if demand.alone_bytes > budget:
                text = (
                    f"training needs {demand.alone_bytes} bytes, more than the {budget} of a process; "
                    f"execution.memory_gib: {math.ceil(demand.alone_bytes / 2**30 * 100) / 100:g} is enough"
                )
                why = Failure("MemoryBudget", text)
                self._runs.fail(entries[run.key], run.repeat, why, demand.alone_bytes)
            else:
                fitting.append(run)
                demands.append(demand)
                self._runs.plan(run.key, demand.cost)
                self._costs[run.key] = demand.cost
        self._session.progress.plan([demand.cost for demand in demands])
        checkpoint_s, longest_s, left_s = execution.checkpoint_s, _LONGEST_S, workers.left_s
        if left_s is not None:
            longest_s, checkpoint_s = min(longest_s, _PART * left_s), min(checkpoint_s, _CHECKPOINT_S)
        plan = cohorts.plan(demands, budget, workers.n, longest_s)
        if left_s is not None:  # what is cheap first
            plan.reverse()
        else:  # the longest first, but for what trains alone: plain classifiers are soon in the tables
            plan.sort(key=lambda members: trains_in_cohorts(fitting[members[0]].sections.model))
        ranked_by = [name for name, _ in self._space.objectives]
        return [
            jobs.TrainingJob(
                tuple(fitting[i] for i in members),
                execution.device,
                execution.threads,
                until if has_rungs(fitting[members[0]].sections.model) else None,
                checkpoint_s,
                points_at_rung=not need_no_decisions(ranked_by),
            )
            for members in plan
        ]

    def _demand(self, run: jobs.Run, data: Dataset, until: int | None) -> cohorts.Demand:
        """Return what the next part of a run takes, to a rung or to its end."""
        demand = jobs.demand(run, data, self._space.execution.threads)
        epochs = max(checkpoints.folders(run.study, *run.key), default=0)
        rung = until if has_rungs(run.sections.model) else None
        if rung is not None and epochs > rung:  # what the run was at the rung is lost
            checkpoints.remove(run.study, *run.key)
            epochs = 0
        share = ((rung or run.sections.training.epochs) - epochs) / run.sections.training.epochs
        # Runs at one epoch may train together.
        return dataclasses.replace(demand, key=(demand.key, epochs), cost=demand.cost * share)


def _by_machine(why: Failure) -> bool:
    """Return whether the machine, not the design, ended a training: its data had been prepared before."""
    return why.by_machine or why.error == RecordingError.__name__
