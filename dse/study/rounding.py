"""Trained runs at other precisions: which designs are evaluated there, and the job of a worker that does it.

A setting states how the weights of a trained network are rounded (`dse.study.precision`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from dse import store
from dse.base.records import Network, Outcome, Response
from dse.engine.neurons.fixed_point import STATE_LIMIT
from dse.models.snn.quantise import rounded
from dse.study import precision
from dse.study.claim import Key
from dse.study.data_sets import DataSets, Loaded, stop_if_blameless
from dse.study.executors.work import Failure
from dse.study.jobs import Run, run_of
from dse.study.ledger import Entry
from dse.study.precision import Setting, fronts
from dse.study.record import RunRecord
from dse.study.runs import Runs
from dse.study.session import Session

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Rounding:
    """Evaluate a trained run at some settings."""

    run: Run
    settings: tuple[Setting, ...]


def round_fronts(
    session: Session,
    runs: Runs,
    data: DataSets,
    entries: Sequence[Entry],
    points: Callable[[], pandas.DataFrame],
    after_each: Callable[[], None],
) -> None:
    """Evaluate designs on each family's fronts, and near them, unless they are evaluated already.

    A family without other precisions is skipped, with a note. `after_each` is called when a setting of a run
    has ended.

    Raises:
        StoreError: results cannot be written (the disk is full); nothing finished is lost.
    """
    precisions, goals = session.space.precision, session.space.objectives
    if precisions is None or not precisions.settings:
        return
    chosen: set[int] = set()
    for table, front in fronts(points(), goals):
        chosen |= precision.near(table, front, goals, precisions.within)
    jobs = _missing(session, runs, data, [x for x in entries if x.trial in chosen], precisions.settings)
    done, n_settings = 0, sum(len(job.settings) for job in jobs)
    for job, ended, again in session.workers.attempts(evaluate, jobs):
        trial = job.run.trial
        if isinstance(ended, Failure):
            stop_if_blameless(ended)
            left = precision.missing(job.run.folder, job.settings)
            if left and ended.by_machine and again is not None:
                again.append(replace(job, settings=left))
            else:
                text = f"precision: the evaluation of trial {trial} stopped early: {ended.reason}"
                session.progress.note(text)
            continue
        (weight_bits, pruned), why = ended
        if why is not None:
            at = f"trial {trial} at {weight_bits} bits, {pruned:g} pruned"
            session.progress.note(f"precision: {at} failed: {why.reason}")
        else:
            store.note_files(session.book, [precision.file_of(job.run.folder, (weight_bits, pruned))])
        done += 1
        session.progress.doing(f"precision: {done} of {n_settings} evaluations")
        after_each()


def _missing(
    session: Session, runs: Runs, data: DataSets, entries: Sequence[Entry], settings: Sequence[Setting]
) -> list[Rounding]:
    """Return the evaluations of finished runs that are missing."""
    missing: dict[Key, Entry] = {}
    lacking: dict[Key, tuple[Setting, ...]] = {}
    left_out: dict[str, None] = {}
    for entry in entries:
        for record in filter(lambda record: record.finished, runs.of(entry.trial)):
            run = store.run_file(session.folder, entry.trial, record.repeat)
            if refusal := precision.refusal(run):
                left_out[f"{record.sections['model']['kind']} {refusal}"] = None
            elif unknown := precision.missing(run, settings):
                key = entry.trial, record.repeat
                missing[key], lacking[key] = entry, unknown
    for text in left_out:
        session.progress.note(f"precision: skipped: {text}")
    jobs = []
    for key, prepared in data.of(missing).items():
        if isinstance(prepared, Failure):
            session.progress.note(f"precision: trial {key[0]} cannot be evaluated: {prepared.reason}")
        else:
            jobs.append(Rounding(run_of(session, missing[key], key[1], prepared), lacking[key]))
    return jobs


def evaluate(job: Rounding) -> Iterator[tuple[Setting, Failure | None]]:
    """Evaluate a run at its settings, one after the other; each result is stored at once.

    Yields:
        A setting, and None after it is stored, or why it failed. An error that fails all settings is raised.
    """
    loaded = job.run.loaded()
    network = store.fitted_of(store.load_arrays(job.run.folder / "weights.npz"))
    trained = RunRecord.from_plain(store.read_record(job.run.folder), job.run.folder)
    run = job.run
    if run.decision.phi_step is not None:  # the same settings as in training
        surface = next(x for x in trained.files if x.startswith("surface"))
        phi = store.load_arrays(run.folder / surface)["phi"]
        run = replace(run, decision=replace(run.decision, phi=phi))
    for setting in job.settings:
        why = None
        try:
            _evaluate(run, setting, network, loaded, trained)
        except (store.StoreError, MemoryError):
            raise  # a full disk is not the run's fault
        except Exception as error:
            why = Failure.of(error)
        yield setting, why


def _evaluate(run: Run, setting: Setting, network: object, loaded: Loaded, trained: RunRecord) -> None:
    """Measure a run at a setting and publish its file."""
    if not isinstance(network, Network):
        raise TypeError(f"only a Network can be rounded, got {type(network).__name__}")
    data, columns = loaded.data, trained.measured.columns
    fewer = rounded(network, *setting)
    validation = run.sections.model.respond(fewer, data, data.validation)
    test = run.sections.model.respond(fewer, data, data.test) if data.test.size else None
    assert isinstance(validation, Response)  # a network answers with spikes
    health = {
        "peak_state": validation.peak_state,
        "overflows_24_bit": validation.peak_state > STATE_LIMIT,
        "n_weights_dense": fewer.n_weights_dense,
    }
    reported = {name: x for name, x in health.items() if name in columns}  # not every family reports all
    outcome = Outcome(fewer, validation, test, {}, reported, columns.get("train_s", 0.0))
    measurement = run.measured(outcome, data, setting[0])
    numbers = measurement.numbers.with_columns(transductive=bool(loaded.leak))
    precision.save(run.folder, setting, replace(trained, numbers=numbers), measurement.files)
