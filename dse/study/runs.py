"""The training runs of a study: reading finished runs and training missing ones.

A run is (trial, repeat). It is finished when its folder exists and is undamaged. A failed run is finished
too; its record has the reason. What the machine did (a worker killed, no memory, a lost file) fails no run:
the run is begun again a few times, and then by the next session. A data set is prepared once for equal data
sections, in a cache that all studies share, and read as a memory map. In a cross-validation, repeat r
validates on fold r modulo k. Runs that can share batches train in cohorts (dse.search.cohorts); the grouping
changes no result.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from dse import dataset, seeds, store
from dse.config import ConfigError, Fault, SearchSpace
from dse.config.contracts import has_rungs
from dse.config.resolved import Sections
from dse.config.yaml_lines import error_of
from dse.dataset import cache
from dse.dataset.shape import Shape
from dse.hardware.profile import Profile
from dse.measure.objectives import need_no_decisions
from dse.recordings import RecordingError
from dse.records import Dataset
from dse.registry import PluginError
from dse.search import cohorts
from dse.store import Damaged, StoreError
from dse.study import checkpoints, jobs, precision
from dse.study.claim import Coordinator, Key
from dse.study.executors.work import Failure
from dse.study.ledger import Entry
from dse.study.progress import Progress
from dse.study.record import RunRecord, load_record
from dse.study.workers import OutOfTime, Workers

Job = TypeVar("Job")
Part = TypeVar("Part")
_Member = tuple[int, int | None]  # the trial and the fold of a data set

UNTRAINED = "not trained: "
"""Begins the sentences about designs that the machine kept from being trained."""

_OVER_BUDGET = "MemoryBudget"
# How often work is begun that the machine ends, before it is left to the next session: in its cohort, alone
# beside others, and alone with the whole machine.
_ATTEMPTS = 3
_NAMED = 3
_LONGEST_S = 120.0  # estimated CPU seconds that a killed worker may lose
_PART, _CHECKPOINT_S = 0.2, 20.0  # where time ends: most of it for a cohort, and between checkpoints
_GLANCE_S = 1.0  # between looks at what other coordinators have trained


@dataclasses.dataclass(frozen=True)
class _Data:
    """The data sets of some designs and folds.

    sections, keys: of every design and fold whose sections are legal.
    failures: key -> why the data set cannot be made.
    refused: design and fold -> why its sections are illegal.
    """

    sections: dict[_Member, Sections]
    keys: dict[_Member, str]
    failures: dict[str, Failure]
    refused: dict[_Member, Failure]

    def failure(self, member: _Member) -> Failure | None:
        """Return why a design and fold cannot be trained, None if it can."""
        return self.refused.get(member) or self.failures.get(self.keys[member])


class Runs:
    """The runs of one study folder.

    Args:
        space: the search space.
        book: of the study, which the caller has locked or joined.
        profiles: of its hardware.
        workers: train.
        progress: is told what happens.
        coordinator: shares trainings with others; None: nobody else trains.
    """

    def __init__(
        self,
        space: SearchSpace,
        book: store.Book,
        profiles: Sequence[Profile],
        workers: Workers,
        progress: Progress,
        coordinator: Coordinator | None = None,
    ) -> None:
        self._space = space
        self._book, self._folder = book, book.folder
        self._profiles = tuple(profiles)
        self._workers = workers
        self._progress = progress
        self._coordinator = coordinator
        execution = space.execution
        self._budget = workers.memory_budget(execution.memory_gib, execution.device)
        self._cache = _opened_cache(book.folder, progress)
        self._records: dict[int, dict[int, RunRecord]] = {}  # trial -> repeat -> record
        self._data_keys: dict[tuple[str, int | None], str] = {}  # of designs, without models, and folds
        self._warned: set[str] = set()
        self._shapes: dict[str, Shape | None] = {}  # by the key of a data set
        self._work: dict[tuple[int, int], float] = {}  # of planned runs: estimated seconds of training
        self._costs: dict[Key, float] = {}  # the same of the next part of it
        self._begun: dict[Key, float] = {}  # when its job began
        self._is_late = False  # whether a job was left out that cannot end in time
        self._pace: dict[type, float] = {}  # seconds per estimated one that the last job of a family took
        self._untrained: dict[tuple[int, int], str] = {}  # why the machine could not train a run
        self._paused: dict[tuple[int, int, int], RunRecord] = {}  # runs at rungs: trial, repeat, epochs

    def of(self, trial: int) -> list[RunRecord]:
        """Return the records of a trial's finished runs, repeat 0 first."""
        return [record for _, record in sorted(self._records.get(trial, {}).items())]

    def trials(self) -> dict[int, list[RunRecord]]:
        """Return trial number -> records, for every trial with a finished run."""
        return {number: self.of(number) for number in sorted(self._records)}

    def count(self, repeats: int | None = None) -> int:
        """Return the number of finished runs, with `repeats` only among the first ones of every trial."""
        runs = (repeat for repeats_of in self._records.values() for repeat in repeats_of)
        return sum(repeats is None or repeat < repeats for repeat in runs)

    def _has(self, trial: int, repeat: int) -> bool:
        """Return whether a run has ended."""
        return repeat in self._records.get(trial, {})

    def is_untrained(self, trial: int) -> bool:
        """Return whether the machine kept a run of a trial from being trained."""
        return any(trial == number for number, _ in self._untrained)

    def untrained(self) -> list[str]:
        """Return a sentence on the designs that the machine kept from being trained, if there are any."""
        if not self._untrained:
            return []
        trials = sorted({trial for trial, _ in self._untrained})
        first = next(iter(self._untrained.values()))
        named = ", ".join(map(str, trials[:_NAMED])) + (" and others" if len(trials) > _NAMED else "")
        return [
            f"{UNTRAINED}{len(trials)} design{'s' * (len(trials) > 1)}, trial {named}, because of the "
            f"machine ({first}); the same command tries again"
        ]

    def recall(self, entries: Sequence[Entry]) -> None:
        """Read the runs that earlier sessions finished.

        A damaged run is removed and repeated, and so is a run that failed for memory that is available now.

        Raises:
            ConfigError: a run was trained on other data than its design has now.
        """
        for entry in entries:
            for repeat in range(max(self._space.search.repeats, self._space.search.repeats_on_front)):
                if self._has(entry.trial, repeat):
                    continue
                folder = store.run_file(self._folder, entry.trial, repeat)
                try:
                    record = load_record(folder)
                    if record is not None and not _is_of(entry, self._space.seed, record):
                        raise Damaged(f"{folder}: holds a run of another design or seed")
                except Damaged as error:
                    what = str(error).removesuffix(f"; {store.REMEDY}")
                    self._progress.note(f"{what}; this run is repeated")
                    self._forget(folder)
                    continue
                if record is None:
                    if store.known_as(folder):
                        store.note_files(self._book, [folder])
                elif (record.needs_bytes or math.inf) <= self._budget:
                    self._forget(folder)
                else:
                    self._check_data(record)
                    self._note(folder)
                    self._records.setdefault(entry.trial, {})[repeat] = record

    def _note(self, run: Path) -> None:
        """Let the book know a run that is as it should be, unless it does."""
        if not store.known_as(run):
            store.note_files(self._book, [run])

    def _forget(self, run: Path) -> None:
        """Remove a run, if it is there, and let the book know; another one may take its place then."""
        store.remove(run)
        if store.known_as(run):
            store.note_files(self._book, [run])

    def forget_checkpoints(self) -> None:
        """Remove the checkpoints of runs that have ended."""
        checkpoints.forget(self._folder, {(trial, x) for trial, of in self._records.items() for x in of})

    def paused(self, trial: int, repeats: int, epochs: int) -> list[RunRecord] | None:
        """Return the records of a trial's runs at a rung where all of them pause; None: not all do."""
        for repeat in range(repeats):
            if self._has(trial, repeat) or not self._is_paused(trial, repeat, epochs):
                return None
        return [self._paused[trial, repeat, epochs] for repeat in range(repeats)]

    def stop(self, trial: int, repeats: int, epochs: int, reason: str) -> None:
        """Record that racing stops the runs of a trial at a rung."""
        for repeat in range(repeats):
            if not self._has(trial, repeat) and self._is_paused(trial, repeat, epochs):
                at_rung = self._paused[trial, repeat, epochs]
                stopped = dataclasses.replace(at_rung, numbers=None, stopped_at_epoch=epochs, reason=reason)
                run = store.run_file(self._folder, trial, repeat)
                store.save_run(run, stopped.to_plain(), {})
                self._note(run)
                checkpoints.remove(self._folder, trial, repeat)
                self._keep(stopped)

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
        self.recall(entries)
        wanted = {(entry.trial, repeat): (entry, repeat) for entry in entries for repeat in range(repeats)}
        tried: set[Key] = set()
        while missing := [
            key
            for key in wanted
            if key not in tried and not self._has(*key) and not self._is_paused(*key, until)
        ]:
            unclaimed = missing if self._coordinator is None else self._coordinator.unclaimed(missing)
            if unclaimed:
                tried |= self._train([wanted[key] for key in unclaimed], until, after_each)
            else:
                time.sleep(_GLANCE_S)
            if not tried.issuperset(missing):
                n_before = self.count()
                self.recall([wanted[key][0] for key in missing])
                self._progress.expect(n_before - self.count())  # what others have trained
                after_each()

    def _train(
        self, missing: Sequence[tuple[Entry, int]], until: int | None, after_each: Callable[[], None]
    ) -> set[Key]:
        """Train missing runs, but for those that other coordinators train by then; return the others."""
        waiting = self._planned(self._prepared(missing), until)
        tried = {(entry.trial, repeat) for entry, repeat in missing}
        tried -= {(run.trial, run.repeat) for cohort in waiting for run in cohort.runs}  # they failed
        running: set[Key] = set()
        for attempt in range(_ATTEMPTS):
            if not waiting:
                break
            is_last = attempt == _ATTEMPTS - 1
            again: list[jobs.TrainingJob] = []
            claimed = self._claimed(self._in_time(waiting), running, tried)
            for cohort, ended in self._attempted(jobs.train, claimed, is_last):
                if isinstance(ended, Failure):
                    runs, why = cohort.runs, ended
                elif ended[1] is None or not _by_machine(ended[1]):
                    run = cohort.runs[ended[0]]
                    self._settle(run, ended[1], until)
                    running.discard((run.trial, run.repeat))
                    self._clock(cohort)
                    after_each()
                    continue
                else:
                    runs, why = (cohort.runs[ended[0]],), ended[1]
                unfinished = self._unfinished(runs, why, until)
                if len(cohort.runs) == 1 and not _by_machine(why):
                    for run in unfinished:
                        self._settle(run, why)
                elif is_last:
                    for run in unfinished:
                        self._leave((run.trial, run.repeat), why)
                else:
                    again += [dataclasses.replace(cohort, runs=(run,)) for run in unfinished]
            waiting = again
        if self._coordinator is not None:
            self._coordinator.free()
        if self._is_late:
            raise OutOfTime
        return tried

    def _in_time(self, waiting: Iterable[jobs.TrainingJob]) -> Iterator[jobs.TrainingJob]:
        """Yield the jobs that can end in the time left, as they can begin; the others are left out."""
        for job in waiting:
            left_s, pace = self._workers.left_s, self._pace.get(type(job.runs[0].sections.model), 1.0)
            if left_s is not None and pace * self._cost(job) >= left_s:
                self._is_late = True
            else:
                self._begun |= dict.fromkeys(((run.trial, run.repeat) for run in job.runs), time.monotonic())
                yield job

    def _clock(self, job: jobs.TrainingJob) -> None:
        """Take notice of how long a job of a family took."""
        run = job.runs[0]
        took_s = time.monotonic() - self._begun[run.trial, run.repeat]
        self._pace[type(run.sections.model)] = took_s / max(self._cost(job), 1e-9)

    def _cost(self, job: jobs.TrainingJob) -> float:
        return sum(self._costs[run.trial, run.repeat] for run in job.runs)

    def _claimed(
        self, waiting: Iterable[jobs.TrainingJob], running: set[Key], tried: set[Key]
    ) -> Iterator[jobs.TrainingJob]:
        """Yield jobs as they can begin, without the runs that another coordinator trains or has trained.

        Args:
            waiting: the jobs.
            running: runs that are claimed and have not ended; those of each job are added.
            tried: runs that were begun before; those of each job are added.
        """
        for job in waiting:
            runs = job.runs
            if self._coordinator is not None:
                keys = [(run.trial, run.repeat) for run in runs]
                ours = self._coordinator.claim(keys, running)
                runs = tuple(run for run, key in zip(runs, keys, strict=True) if key in ours)
                runs = tuple(run for run in runs if not run.folder.is_file())
            if runs:
                running |= {(run.trial, run.repeat) for run in runs}
                tried |= running
                yield dataclasses.replace(job, runs=runs)

    def _attempted(
        self, function: Callable[[Job], Iterable[Part]], waiting: Iterable[Job], one_by_one: bool
    ) -> Iterator[tuple[Job, Part | Failure]]:
        """Yield what `Workers.stream` does, of one job at a time where each is to have the machine alone."""
        for jobs_at_once in ([job] for job in waiting) if one_by_one else [waiting]:
            yield from self._workers.stream(function, jobs_at_once)

    def shapes(self, designs: Iterable[Mapping[str, object]]) -> None:
        """Prepare the data sets of some designs, so that `shape` knows them; failures are for training."""
        needed = {}
        for design in designs:
            with contextlib.suppress(ValueError):
                sections = self._resolved(design, self._fold(0))
                needed[dataset.dataset_key(sections, self._space.source.parent)] = sections
        self._prepare(needed)

    def shape(self, sections: Sections) -> Shape | None:
        """Return the shape of a design's data set, prepared if it is absent; None if it cannot be."""
        fold = self._fold(0)
        sections = sections if fold is None else sections.on_fold(fold)
        key = dataset.dataset_key(sections, self._space.source.parent)
        if key not in self._shapes:
            failed = self._prepare({key: sections})
            with store.explained(self._cache):
                data = None if failed else dataset.find(self._cache, key)
            self._shapes[key] = None if data is None else Shape.of(data)
        return self._shapes[key]

    def evaluate(
        self,
        entries: Sequence[Entry],
        settings: Sequence[precision.Setting],
        after_each: Callable[[], None] = lambda: None,
    ) -> None:
        """Evaluate the finished runs of some designs at other precisions, unless they are evaluated already.

        A family without other precisions is skipped, with a note.

        Args:
            entries: the designs.
            settings: of `dse.study.precision`.
            after_each: called when a setting of a run has ended.

        Raises:
            StoreError: results cannot be written (the disk is full); nothing finished is lost.
        """
        incomplete, lacking = self._to_round(entries, settings)
        done, n_settings = 0, sum(map(len, lacking.values()))
        data = self._data(incomplete)
        evaluations = []
        for entry, repeat in incomplete:
            member = entry.trial, self._fold(repeat)
            if why := data.failure(member):
                self._progress.note(f"precision: trial {entry.trial} cannot be evaluated: {why.reason}")
            else:
                folder = self._cache / data.keys[member]
                run = self._run(entry, repeat, data.sections[member], folder)
                evaluations.append(jobs.Rounding(run, lacking[entry.trial, repeat]))
        for attempt in range(_ATTEMPTS):
            again = []
            for job, ended in self._attempted(jobs.evaluate, evaluations, attempt == _ATTEMPTS - 1):
                if isinstance(ended, Failure):
                    _stop_if_blameless(ended)
                    left = precision.missing(job.run.folder, job.settings)
                    if left and ended.by_machine and attempt < _ATTEMPTS - 1:
                        again.append(dataclasses.replace(job, settings=left))
                        continue
                    self._progress.note(
                        f"precision: the evaluation of trial {job.run.trial} stopped early: {ended.reason}"
                    )
                    continue
                (weight_bits, pruned), failed = ended
                if failed is not None:
                    at = f"trial {job.run.trial} at {weight_bits} bits, {pruned:g} pruned"
                    self._progress.note(f"precision: {at} failed: {failed.reason}")
                else:
                    path = precision.file_of(job.run.folder, (weight_bits, pruned))
                    store.note_files(self._book, [path])
                done += 1
                self._progress.doing(f"precision: {done} of {n_settings} evaluations")
                after_each()
            evaluations = again

    def _to_round(
        self, entries: Sequence[Entry], settings: Sequence[precision.Setting]
    ) -> tuple[list[tuple[Entry, int]], dict[tuple[int, int], tuple[precision.Setting, ...]]]:
        """Return the runs that are not evaluated at all settings, and the missing settings of each."""
        incomplete, lacking = [], {}
        left_out: dict[str, None] = {}
        for entry in entries:
            for record in self.of(entry.trial):
                if not record.finished:
                    continue
                repeat = record.repeat
                folder = store.run_file(self._folder, entry.trial, repeat)
                if why := precision.refusal(folder):
                    left_out[f"{record.sections['model']['kind']} {why}"] = None
                elif missing := precision.missing(folder, settings):
                    incomplete.append((entry, repeat))
                    lacking[entry.trial, repeat] = missing
        for text in left_out:
            self._progress.note(f"precision: skipped: {text}")
        return incomplete, lacking

    def _is_paused(self, trial: int, repeat: int, until: int | None) -> bool:
        """Return whether a run stands at the rung to which it is to train."""
        if until is None:
            return False
        key = trial, repeat, until
        if key not in self._paused and (record := checkpoints.at_rung(self._folder, *key)) is not None:
            self._check_data(record)
            self._paused[key] = record
        return key in self._paused

    def _planned(self, runs: Sequence[jobs.Run], until: int | None = None) -> list[jobs.TrainingJob]:
        """Return the runs as cohorts, in the order of training; a run too large for a worker fails here."""
        run_of = {run.data: run for run in runs}

        @functools.lru_cache(maxsize=8)
        def load(folder: Path) -> Dataset:
            with store.explained(self._cache):
                return dataset.load_or_prepare(run_of[folder].sections, run_of[folder].base, folder)

        fitting, demands, execution = [], [], self._space.execution
        for run in runs:
            demand = jobs.demand(run, load(run.data), execution.threads)
            epochs = max(checkpoints.folders(self._folder, run.trial, run.repeat), default=0)
            rung = until if has_rungs(run.sections.model) else None
            if rung is not None and epochs > rung:  # what the run was at the rung is lost
                checkpoints.remove(self._folder, run.trial, run.repeat)
                epochs = 0
            # Runs at one epoch may train together.
            share = ((rung or run.sections.training.epochs) - epochs) / run.sections.training.epochs
            demand = dataclasses.replace(demand, key=(demand.key, epochs), cost=demand.cost * share)
            if demand.alone_bytes > self._budget:
                text = (
                    f"training needs {demand.alone_bytes} bytes, more than the {self._budget} of a process; "
                    f"execution.memory_gib: {math.ceil(demand.alone_bytes / 2**30 * 100) / 100:g} is enough"
                )
                self._fail(run.trial, run.repeat, run.design, Failure(_OVER_BUDGET, text), demand.alone_bytes)
            else:
                fitting.append(run)
                demands.append(demand)
                key = run.trial, run.repeat
                self._work[key] = self._work.get(key, 0.0) + demand.cost
                self._costs[key] = demand.cost
        self._progress.plan([demand.cost for demand in demands])
        device, threads, checkpoint_s = execution.device, execution.threads, execution.checkpoint_s
        longest_s, left_s = _LONGEST_S, self._workers.left_s
        if left_s is not None:
            longest_s, checkpoint_s = min(longest_s, _PART * left_s), min(checkpoint_s, _CHECKPOINT_S)
        plan = cohorts.plan(demands, self._budget, self._workers.n, longest_s)
        if left_s is not None:  # what is cheap first: rivals of every kind are soon in the tables
            plan.reverse()
        ranked_by = [name for name, _ in self._space.objectives]
        return [
            jobs.TrainingJob(
                tuple(fitting[i] for i in members),
                device,
                threads,
                until if has_rungs(fitting[members[0]].sections.model) else None,
                checkpoint_s,
                points_at_rung=not need_no_decisions(ranked_by),
            )
            for members in plan
        ]

    def _unfinished(self, runs: Sequence[jobs.Run], why: Failure, until: int | None) -> list[jobs.Run]:
        """Return the runs of a job that ended early which are not finished; record those that are."""
        _stop_if_blameless(why)
        unfinished = []
        for run in runs:
            if run.folder.is_file():  # the worker died after publishing it
                self._settle(run, None)
            elif not self._has(run.trial, run.repeat) and not self._is_paused(run.trial, run.repeat, until):
                unfinished.append(run)
        return unfinished

    def _leave(self, key: tuple[int, int], why: Failure) -> None:
        """Leave a run to the next session, because of the machine."""
        self._untrained[key] = why.reason
        self._progress.note(f"trial {key[0]} is not trained: {why.reason}; the next run tries again")

    def _settle(self, run: jobs.Run, why: Failure | None, until: int | None = None) -> None:
        """Record a run that has ended, unless it is recorded already."""
        if self._has(run.trial, run.repeat):
            return
        record = load_record(run.folder) if why is None else None
        if record is not None:
            self._note(run.folder)
            self._keep(record)
        elif why is None and self._is_paused(run.trial, run.repeat, until):
            self._progress.doing(f"trial {run.trial} has trained {until} epochs")
        elif why is None:  # it was published
            raise StoreError(f"{run.folder}: was removed while the study ran; run the same command again")
        else:
            self._fail(run.trial, run.repeat, run.design, why)

    def _keep(self, record: RunRecord) -> None:
        self._records.setdefault(record.trial, {})[record.repeat] = record
        work = self._work.get((record.trial, record.repeat), 0.0)
        self._progress.advance(_sentence(record), work)

    def _fail(
        self,
        number: int,
        repeat: int,
        design: Mapping[str, object],
        why: Failure,
        needs_bytes: int | None = None,
    ) -> None:
        """Record a failed run; `needs_bytes` lets a later session with more memory repeat it."""
        record = RunRecord(
            trial=number,
            repeat=repeat,
            design=design,
            seed=self._space.seed,
            reason=why.reason,
            details=why.details,
            needs_bytes=needs_bytes,
        )
        folder = store.run_file(self._folder, number, repeat)
        store.save_run(folder, record.to_plain(), {})
        store.note_files(self._book, [folder])
        checkpoints.remove(self._folder, number, repeat)
        self._keep(record)

    def _prepared(self, missing: Sequence[tuple[Entry, int]]) -> list[jobs.Run]:
        """Prepare the data sets of missing runs; return the runs that can be trained."""
        data = self._data(missing)
        needed = set(data.keys.values())
        self._refuse_evaluation(data.failures.values())
        first = next(iter(data.failures.values()), None)
        if first is not None and not self._records and len(data.failures) == len(needed):
            is_plain = first.error == RecordingError.__name__
            raise RecordingError(first.message if is_plain else f"data cannot be prepared: {first.reason}")
        self._warn(needed - data.failures.keys())
        folds, failures = self._folds(data, [(e.trial, self._fold(r)) for e, r in missing])
        runs = []
        for entry, repeat in missing:
            member = entry.trial, self._fold(repeat)
            of_run = folds.get(member, ())[repeat % self._space.search.repeats :: self._space.search.repeats]
            why = data.failure(member) or next((failures[x.data] for x in of_run if x.data in failures), None)
            if why is None:
                folder = self._cache / data.keys[member]
                runs.append(self._run(entry, repeat, data.sections[member], folder, of_run))
            elif why.by_machine:
                self._leave((entry.trial, repeat), why)
            else:
                self._fail(entry.trial, repeat, entry.design, why)
        return runs

    def _refuse_evaluation(self, failures: Iterable[Failure]) -> None:
        """Raise what the recordings say against section `evaluation`, with its places in the file."""
        texts = dict.fromkeys(text for failure in failures for text in failure.message.split("\n"))
        if faults := [text for text in texts if text.startswith("evaluation.")]:
            raise error_of(self._space.source, faults)

    def _folds(
        self, data: _Data, members: Iterable[_Member]
    ) -> tuple[dict[_Member, tuple[jobs.Fold, ...]], dict[Path, Failure]]:
        """Prepare the data sets without the groups that evaluations leave out.

        Returns:
            Folds of every design whose data set is prepared; folder -> why a fold's data set cannot be.
        """
        if self._space.evaluation is None or not self._space.evaluation.groups:
            return {}, {}
        base = self._space.source.parent
        folds: dict[_Member, tuple[jobs.Fold, ...]] = {}
        for member in dict.fromkeys(members):
            if data.failure(member) is None:
                sections = data.sections[member]
                left_out = dataset.left_out(self._cache / data.keys[member])
                without = [dataclasses.replace(sections, left_out=x) for x in left_out]
                folds[member] = tuple(
                    jobs.Fold(x, self._cache / dataset.dataset_key(x, base)) for x in without
                )
        failed = self._prepare({x.data.name: x.sections for of in folds.values() for x in of})
        return folds, {self._cache / key: why for key, why in failed.items()}

    def _data(self, runs: Sequence[tuple[Entry, int]]) -> _Data:
        """Prepare the data sets of some runs."""
        designs = {(entry.trial, self._fold(repeat)): entry.design for entry, repeat in runs}
        sections, refused = {}, {}
        for member, design in designs.items():
            try:
                sections[member] = self._resolved(design, member[1])
            except ValueError as error:  # keys that are legal one by one and not together
                refused[member] = Failure(type(error).__name__, str(error))
        keys = {member: self._data_key(designs[member], member[1]) for member in sections}
        failures = self._prepare({key: sections[m] for m, key in keys.items()})
        return _Data(sections, keys, failures, refused)

    def _fold(self, repeat: int) -> int | None:
        """Return the fold that a repeat validates on; None without cross-validation."""
        k_fold = self._space.split.k_fold
        return None if k_fold is None else repeat % k_fold.k

    def _data_key(self, design: Mapping[str, Any], fold: int | None) -> str:
        """Return the key of the data set of a design and fold, which its model and training do not change."""
        axes = self._space.axes
        shared = {name: x for name, x in design.items() if axes[name].place[0] not in ("model", "training")}
        place = seeds.design_key(shared), fold
        if place not in self._data_keys:
            sections = self._resolved(design, fold)
            self._data_keys[place] = dataset.dataset_key(sections, self._space.source.parent)
        return self._data_keys[place]

    def _resolved(self, design: Mapping[str, object], fold: int | None) -> Sections:
        """Return the sections of a design, with its fold."""
        sections = self._space.resolve(design)
        return sections if fold is None else sections.on_fold(fold)

    def _prepare(self, needed: Mapping[str, Sections]) -> dict[str, Failure]:
        """Make the data sets that are not in the cache; return the failures by key.

        Args:
            needed: key -> sections of a design.
        """
        failures: dict[str, Failure] = {}
        missing = [key for key in needed if not self._is_prepared(key)]
        if not missing:
            return failures
        for attempt in range(_ATTEMPTS):
            waiting = self._preparations(needed, missing)
            for job, event in self._attempted(jobs.prepare, waiting, attempt == _ATTEMPTS - 1):
                if isinstance(event, str):
                    self._progress.doing(event)
                elif isinstance(event, Failure):
                    _stop_if_blameless(event)
                    unfinished = [key for key in job.designs if key not in failures]
                    failures |= {key: event for key in unfinished if not self._is_prepared(key)}
                else:
                    key, failure = event
                    failures[key] = failure
            missing = [key for key, why in failures.items() if why.by_machine]
            if not missing or attempt == _ATTEMPTS - 1:
                break
            for key in missing:
                del failures[key]
        return failures

    def _preparations(self, needed: Mapping[str, Sections], missing: Sequence[str]) -> list[jobs.Preparation]:
        """Return the jobs, one for all designs with the same spikes; the jobs share the threads."""
        groups: dict[str, list[str]] = {}
        for key in missing:
            groups.setdefault(dataset.same_spikes(needed[key]), []).append(key)
        threads = max(1, self._workers.n // len(groups)) * self._space.execution.threads
        base = self._space.source.parent
        return [
            jobs.Preparation(
                {key: needed[key] for key in keys},
                base,
                self._cache,
                threads,
                self._folder / f"{store.TEMPORARY}{keys[0]}",
            )
            for keys in groups.values()
        ]

    def _is_prepared(self, key: str) -> bool:
        with store.explained(self._cache):
            return dataset.find(self._cache, key) is not None

    def _run(
        self,
        entry: Entry,
        repeat: int,
        sections: Sections,
        data: Path,
        folds: Sequence[jobs.Fold] = (),
    ) -> jobs.Run:
        return jobs.Run(
            trial=entry.trial,
            repeat=repeat,
            design=entry.design,
            seed=self._space.seed,
            sections=sections,
            data=data,
            base=self._space.source.parent,
            folder=store.run_file(self._folder, entry.trial, repeat),
            phi=tuple(self._space.decision.phi.tolist()),
            theta=tuple(self._space.decision.theta.tolist()),
            hardware=self._profiles,
            phi_step=self._space.decision.phi_step,
            read_out_every_ms=self._space.decision.read_out_every_ms,
            folds=tuple(folds),
        )

    def _warn(self, keys: Iterable[str]) -> None:
        """Print the warnings about data sets once, and store them with the study."""
        warnings = [text for key in sorted(keys) for text in dataset.read_meta(self._cache / key).warnings]
        for text in dict.fromkeys(warnings):
            if text not in self._warned:
                self._warned.add(text)
                self._progress.note(f"warning: {text}")
        with self._book.together():
            known = self._book.document(store.WARNINGS, [])
            if set(warnings) - set(known):
                self._book.keep(store.WARNINGS, list(dict.fromkeys([*known, *warnings])))

    def remark(self, sentences: Sequence[str], prefix: str) -> None:
        """Print sentences about the study, and store them as warnings in place of those with the prefix."""
        known = self._book.document(store.WARNINGS, [])
        for text in sentences:
            self._progress.note(f"warning: {text}")
        now = [*(text for text in known if not text.startswith(prefix)), *sentences]
        if now != known:
            self._book.keep(store.WARNINGS, now)

    def _check_data(self, record: RunRecord) -> None:
        if not record.data:
            return
        if self._data_key(record.design, self._fold(record.repeat)) != record.data:
            text = (
                f"data: the recordings differ from those that trial {record.trial} was trained on; "
                "restore them, or use another --results folder"
            )
            raise ConfigError([Fault(str(self._space.source), 0, text)])


def _opened_cache(folder: Path, progress: Progress) -> Path:
    """Return the user's cache, or one in the study's folder if the user's cannot be written."""
    with store.explained(folder / "cache"):
        try:
            root, note = cache.opened_root(folder / "cache")
        except ValueError as error:
            raise StoreError(str(error)) from None
    if note:
        progress.note(note)
    return root


def _is_of(entry: Entry, seed: int, record: RunRecord) -> bool:
    return seeds.design_key(record.design) == seeds.design_key(entry.design) and record.seed == seed


def _by_machine(why: Failure) -> bool:
    """Return whether the machine, not the design, ended a training: its data had been prepared before."""
    return why.by_machine or why.error == RecordingError.__name__


def _stop_if_blameless(failure: Failure) -> None:
    """Raise an error that is not the design's fault: a full disk, or a plugin's file that has changed."""
    if failure.error in (StoreError.__name__, Damaged.__name__, PluginError.__name__):
        raise StoreError(failure.message)


def _sentence(record: RunRecord) -> str:
    name = f"trial {record.trial}" + (f" repeat {record.repeat}" if record.repeat else "")
    if record.stopped_at_epoch is not None:
        return f"{name} stopped after {record.stopped_at_epoch} epochs: {record.reason}"
    if record.numbers is None:
        return f"{name} failed: {record.reason}"
    return f"{name} accuracy {record.numbers.columns['accuracy']:.3f}"
