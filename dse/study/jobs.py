"""The job of a worker that trains a cohort of runs, measures and records each.

A job holds paths and settings only; spikes are read from the prepared data set as a memory map.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from dse import store
from dse.base import seeds
from dse.base.records import (
    Answers,
    Array,
    Dataset,
    Ints,
    Network,
    Outcome,
    Parameters,
    Response,
)
from dse.config.contracts import (
    Family,
    FitRequest,
    Generators,
    Rung,
    Span,
    has_rungs,
    placed,
    trains_in_cohorts,
)
from dse.config.resolved import Sections
from dse.config.space import DecisionGrid
from dse.data import dataset
from dse.data.dataset.cache import usual_root
from dse.measure.hardware.profile import Profile
from dse.measure.heads import head_sizes, head_slices
from dse.measure.numbers import Numbers
from dse.measure.run import Measurement, Moved, OfTargets, UnseenTargets, accuracies, measure
from dse.models.crops import fit_alone
from dse.search.cohorts import Demand
from dse.study import checkpoints
from dse.study.checkpoints import Checkpoint
from dse.study.data_sets import Loaded, Prepared, load, timer
from dse.study.executors.work import Failure
from dse.study.ledger import Entry
from dse.study.record import RunRecord, plain_rungs
from dse.study.results import trained_on
from dse.study.session import Session

PROCESS_BYTES = 320 * 2**20
"""Memory of a worker in addition to arrays, rounded up: interpreter, libraries, compiled kernels."""

# At most, per spike of a batch: its row and its channel, in both orders, while they are gathered and sorted.
_SPIKE_BYTES = 64
# At most, per sample and step: spikes and updates of each layer, and their cumulative sums.
_ANSWER_BYTES = 216

_SAMPLES = 128
"""Training samples that a network answers at a time."""
_MOST_SAMPLES = 1024
"""Training samples that tell how far phi reaches, at most."""


@dataclasses.dataclass(frozen=True)
class Run:
    """Train a design once, and once more for each of its folds.

    sections: of the design.
    data: folder of the prepared data set, named as its key; base: folder that recordings are relative to.
    folder: file of the run.
    decision: grid. hardware: profiles that the full read-out is priced on.
    folds: groups that this run leaves out of training in turn.
    """

    trial: int
    repeat: int
    design: Mapping[str, object]
    seed: int
    sections: Sections
    data: Path
    base: Path
    folder: Path
    decision: DecisionGrid
    hardware: tuple[Profile, ...]
    folds: tuple[Prepared | Failure, ...] = ()

    @property
    def key(self) -> tuple[int, int]:
        """Trial and repeat."""
        return self.trial, self.repeat

    @property
    def study(self) -> Path:
        """The folder of the study."""
        return self.folder.parents[1]

    def loaded(self, threads: int = 1) -> Loaded:
        """Return its data set, as `dse.study.data_sets.load` does."""
        return load(self.data, self.sections, self.base, threads)

    def measured(
        self, outcome: Outcome, data: Dataset, weight_bits: int = 8, unseen: UnseenTargets | None = None
    ) -> Measurement:
        """Return the measurement of an outcome on the run's decision grid, and on moved windows.

        Args:
            outcome: of the design.
            data: what it was trained on.
            weight_bits: bits per weight of a spiking network.
            unseen: accuracies of the trainings without some groups.
        """
        moved = self._moved(outcome.network, data)
        return measure(outcome, data, self.decision, self.hardware, weight_bits, moved, unseen)

    def _moved(self, fitted: Network | Parameters, data: Dataset) -> Iterator[Moved]:
        """Yield what the run answers to moved windows of the validation samples with room for every shift."""
        evaluation = self.sections.evaluation
        if evaluation is None or evaluation.shifts is None:
            return
        fits = np.all([dataset.has_room(data, shift) for shift in evaluation.shifts], axis=0)
        samples = data.validation[fits[data.validation]]
        for shift in evaluation.shifts:
            yield shift, samples, self.sections.model.respond(fitted, dataset.shifted(data, shift), samples)


def run_of(session: Session, entry: Entry, repeat: int, prepared: Prepared) -> Run:
    """Return the run of a design in a study, on its data set."""
    space = session.space
    return Run(
        trial=entry.trial,
        repeat=repeat,
        design=entry.design,
        seed=space.seed,
        sections=prepared.sections,
        data=prepared.data,
        base=space.source.parent,
        folder=store.run_file(session.folder, entry.trial, repeat),
        decision=space.decision,
        hardware=session.profiles,
        folds=prepared.folds,
    )


@dataclasses.dataclass(frozen=True)
class TrainingJob:
    """A cohort: runs of the same data, repeat and family that share batches, to be trained in one job.

    until: epochs after which trainings pause at a rung; None: they train to their ends.
    checkpoint_s: seconds between two checkpoints.
    points_at_rung: design points are measured at a rung too, by which designs are ranked; otherwise the full
        read-out alone.
    """

    runs: tuple[Run, ...]
    device: str = "cpu"
    threads: int = 1
    until: int | None = None
    checkpoint_s: float = math.inf
    points_at_rung: bool = False


def demand(run: Run, data: Dataset, threads: int = 1) -> Demand:
    """Return the memory and time that training a run takes; a family without `fit_cohort` trains alone."""
    model, training = run.sections.model, run.sections.training
    if not trains_in_cohorts(model):
        return Demand((run.trial, run.repeat), 0, PROCESS_BYTES, 1.0)
    sizes = placed(model, data.positions)
    n_used = data.train.size + data.validation.size + data.test.size
    n_events = len(data.spikes.channel) / max(1, n_used * data.spikes.n_steps) * data.n_steps
    n_outputs = sum(head_sizes(data))
    shape = data.spikes.n_channels, n_outputs, data.n_steps
    workspace = sizes.workspace_bytes(*shape, training, threads)
    cost = sizes.cost(*shape, n_events, data.train.size, training)
    teacher: Family | None = training.teaching()
    if teacher is not None and trains_in_cohorts(teacher):
        larger = placed(teacher, data.positions)
        workspace += larger.memory_bytes(*shape, training) + larger.workspace_bytes(*shape, training, threads)
        cost += larger.cost(*shape, n_events, data.train.size, training)
    steps = data.n_steps * model.steps_per_sample
    batch = training.batch_size * (n_events * len(model.input_delays) * _SPIKE_BYTES + steps * 8)
    answers = (data.validation.size + data.test.size) * steps * (_ANSWER_BYTES + 2 * n_outputs)
    return Demand(
        (run.data, run.repeat, type(model), model.shares(training)),
        sizes.memory_bytes(*shape, training),
        PROCESS_BYTES + workspace + round(batch) + answers,
        cost * (1 + len(run.folds)),
    )


def train(job: TrainingJob) -> Iterator[tuple[int, Failure | None]]:
    """Train the runs of a cohort, first without their folds; measure and publish each as it finishes.

    Runs go on from their checkpoints. A run that fails without a fold is not trained any further. Folds are
    trained in the job that ends the training of their run, from the start.

    Yields:
        A run's number, and None after it or its rung is published, or why it failed. An error of all runs is
        raised.
    """
    unseen: list[dict[str, dict[str, OfTargets]]] = [{} for _ in job.runs]
    failed: dict[int, Failure] = {}
    for fold in job.runs[0].folds if job.until is None else ():
        assert isinstance(fold, Prepared)  # or it would not be trained
        left = [number for number in range(len(job.runs)) if number not in failed]
        for place, result in _without(_of(job, left), fold) if left else ():
            if isinstance(result, Failure):
                failed[left[place]] = result
            else:
                unseen[left[place]].setdefault(fold.left_out.column, {})[fold.left_out.name] = result
    yield from failed.items()
    # A cluster may run a job again by itself.
    published = [n for n, run in enumerate(job.runs) if run.folder.is_file()]
    yield from ((number, None) for number in published if number not in failed)
    left = [number for number in range(len(job.runs)) if number not in failed and number not in published]
    if not left:
        return
    loaded = job.runs[0].loaded(job.threads)
    missing = set(left)
    for numbers, points in _at_one_epoch(job, left):
        span = Span([point.state for point in points], job.until, timer(job.checkpoint_s))
        for place, ended in _outcomes(_of(job, numbers), loaded.data, span=span):
            number, rungs = numbers[place], points[place].rungs if points else {}
            if isinstance(ended, Rung) and ended.outcome is None:
                run = job.runs[number]
                about = {"trial": run.trial, "repeat": run.repeat, "rungs": plain_rungs(rungs)}
                checkpoints.save(run.study, ended.epochs, _training(run, job.device), about, ended.state)
                continue
            missing.discard(number)
            why: Failure | None = None
            try:
                if isinstance(ended, Exception):
                    raise ended
                only_full = isinstance(ended, Rung) and not job.points_at_rung
                _publish(job.runs[number], job.device, ended, loaded, unseen[number], rungs, only_full)
            except (store.StoreError, MemoryError):
                raise  # a full disk is not the run's fault, and alone the run may have the memory
            except Exception as error:
                why = Failure.of(error)
            del ended  # before the next one answers
            yield number, why
    if missing:
        raise RuntimeError(
            f"{type(job.runs[0].sections.model).__name__}.fit_cohort left out designs {sorted(missing)}"
        )


def _at_one_epoch(job: TrainingJob, numbers: Sequence[int]) -> Iterator[tuple[list[int], list[Checkpoint]]]:
    """Yield runs that stand at the same epoch, with their checkpoints; without any, those at the start.

    They are all the runs of a job, unless it was killed between the checkpoints of two runs.
    """
    groups: dict[int, dict[int, Checkpoint | None]] = {}
    for number in numbers:
        run, point = job.runs[number], None
        if has_rungs(run.sections.model):
            point = checkpoints.newest(run.study, run.trial, run.repeat, _training(run, job.device))
        groups.setdefault(0 if point is None else point.epochs, {})[number] = point
    for _, members in sorted(groups.items()):
        yield list(members), [point for point in members.values() if point is not None]


def _of(job: TrainingJob, numbers: Sequence[int]) -> TrainingJob:
    """Return a job of some of the runs."""
    return dataclasses.replace(job, runs=tuple(job.runs[number] for number in numbers))


def _without(job: TrainingJob, fold: Prepared) -> Iterator[tuple[int, OfTargets | Failure]]:
    """Train the runs of a cohort without a fold; yield the number and the accuracies of each on the fold."""
    run = dataclasses.replace(job.runs[0], sections=fold.sections, data=fold.data)
    data = run.loaded(job.threads).data
    where = f"without {fold.left_out.column} {fold.left_out.name}"
    try:
        for number, outcome in _outcomes(job, data, f"{where}: "):
            assert not isinstance(outcome, Rung)  # folds never pause
            if isinstance(outcome, Exception):
                failure = Failure.of(outcome)
                yield number, dataclasses.replace(failure, message=f"{where}: {failure.message}")
            else:
                assert outcome.test is not None  # the fold is the test set
                yield number, accuracies(outcome.test, data, data.test, run.decision)
    except (store.StoreError, MemoryError):
        raise
    except Exception as error:
        raise RuntimeError(f"{where}: {error}") from error


def _outcomes(
    job: TrainingJob, data: Dataset, prefix: str = "", span: Span | None = None
) -> Iterator[tuple[int, Outcome | Rung | Exception]]:
    """Train the runs of a job on a data set, over a span of epochs if their trainings can pause.

    `prefix` begins the names of their random generators.
    """
    first = job.runs[0]
    family = first.sections.model
    if not trains_in_cohorts(family):
        return (
            (number, fit_alone(run.sections.model, data, run.sections.training, _generators(run, prefix)))
            for number, run in enumerate(job.runs)
        )

    def shared(purpose: str, *index: int) -> np.random.Generator:
        return seeds.generator(first.seed, {}, f"{prefix}{purpose}", first.repeat, *index)

    designs = [
        FitRequest(run.sections.model, run.sections.training, _generators(run, prefix)) for run in job.runs
    ]
    if span is not None and has_rungs(family):
        return family.fit_span(data, designs, shared, job.device, job.threads, span)
    return family.fit_cohort(data, designs, shared, job.device, job.threads)


def fitted_again(folder: Path, record: RunRecord, parts: Sequence[str]) -> Network | Parameters:
    """Return what the design of a run learns from several parts of its split together.

    Its encoder stays as it was fitted.

    Args:
        folder: of the study.
        record: of the run.
        parts: of train, validation and test.

    Raises:
        RecordingError: the recordings that it was trained on are not found.
        TrainingDiverged: it does not learn from these.
    """
    about = trained_on(folder, record)
    return trained_alone(*about, record.seed, record.design, record.repeat, parts)


def trained_alone(
    sections: Sections,
    base: Path,
    seed: int,
    design: Mapping[str, object],
    repeat: int,
    parts: Sequence[str] = (),
) -> Network | Parameters:
    """Return what a design learns, bit for bit as in its cohort.

    Args:
        sections: of the design, with those of its fold.
        base: folder that recordings are relative to.
        seed: of the study.
        design: its axes.
        repeat: of the design.
        parts: of the split that it learns from together; none: train.

    Raises:
        RecordingError: anything wrong with the recordings.
        TrainingDiverged: it does not learn.
    """
    folder = dataset.prepare(sections, base, usual_root())
    data = dataset.load(folder)
    if parts:
        whole = np.sort(np.concatenate([getattr(data, part) for part in parts]))
        data = dataclasses.replace(data, train=whole)
    run = Run(0, repeat, design, seed, sections, folder, base, folder, DecisionGrid(), ())
    ((_, outcome),) = _outcomes(TrainingJob((run,)), data)
    if isinstance(outcome, Exception):
        raise outcome
    assert isinstance(outcome, Outcome)  # nobody has asked for a pause
    return outcome.network


def _generators(run: Run, prefix: str = "") -> Generators:
    """Return the random generators of a run, by purpose; `prefix` begins their names."""

    def rngs(purpose: str, *index: int) -> np.random.Generator:
        return seeds.generator(run.seed, run.design, f"{prefix}{purpose}", run.repeat, *index)

    return rngs


def _training(run: Run, device: str) -> str:
    """Return a hash of what the result of a training follows from."""
    sections = {name: x for name, x in run.sections.to_plain().items() if name not in ("data", "test")}
    parts = [sections, run.design, run.seed, run.repeat, run.data.name, device]  # data by their content
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=store.plain).encode()).hexdigest()


def _publish(
    job: Run,
    device: str,
    ended: Outcome | Rung,
    loaded: Loaded,
    unseen: UnseenTargets,
    rungs: Mapping[int, Numbers],
    only_full: bool = False,
) -> None:
    """Measure a run that has finished, or stands at a rung, and write its record and its arrays.

    `unseen` are accuracies of the trainings without some groups, `rungs` what was measured before, by epochs;
    `only_full` leaves out decisions.
    """
    outcome = ended.outcome if isinstance(ended, Rung) else ended
    assert outcome is not None  # the training pauses here
    data, leak = loaded.data, loaded.leak
    grid = job.decision
    if only_full:
        grid = dataclasses.replace(grid, theta=np.zeros(0))
    elif grid.phi_step is not None and isinstance(outcome.validation, Response):
        most = most_output_spikes(job.sections.model, outcome.network, data)
        grid = dataclasses.replace(grid, phi=np.arange(0, most + grid.phi_step, grid.phi_step))
    job = dataclasses.replace(job, decision=grid)
    measurement = job.measured(outcome, data, unseen=unseen)
    record = RunRecord(
        trial=job.trial,
        repeat=job.repeat,
        design=job.design,
        seed=job.seed,
        numbers=measurement.numbers.with_columns(transductive=bool(leak)),
        sections=job.sections.with_fitted(loaded.fitted).to_plain(),
        classes=tuple(data.classes),
        heads=data.heads,
        data=job.data.name,
        samples={"train": data.train.size, "validation": data.validation.size, "test": data.test.size},
        leak=leak,
        rungs=rungs,
    )
    if isinstance(ended, Rung):
        record = dataclasses.replace(record, rungs={**rungs, ended.epochs: record.measured})
    if isinstance(ended, Rung):
        checkpoints.save(job.study, ended.epochs, _training(job, device), record.to_plain(), ended.state)
    else:
        parts = _arrays(outcome, measurement, data)
        store.save_run(job.folder, record.to_plain(), parts)
        checkpoints.remove(job.study, job.trial, job.repeat)


def _arrays(outcome: Outcome, measurement: Measurement, data: Dataset) -> dict[str, dict[str, Array]]:
    """Return the parts of a run."""
    tested = outcome.test
    return {
        "weights.npz": store.record_arrays(outcome.network),
        "response.npz": _response_arrays(outcome.validation, data, data.validation),
        "history.npz": dict(outcome.history),
        **measurement.files,
        **({} if tested is None else {"response_test.npz": _response_arrays(tested, data, data.test)}),
    }


def most_output_spikes(model: Family, fitted: Network | Parameters, data: Dataset) -> int:
    """Return the most output spikes of one head in a training sample, of `_MOST_SAMPLES` spread over all."""
    most, n = 0, data.train.size
    samples = data.train[np.unique(np.linspace(0, n - 1, min(n, _MOST_SAMPLES)).astype(np.int64))]
    for first in range(0, samples.size, _SAMPLES):
        response = model.respond(fitted, data, samples[first : first + _SAMPLES])
        assert isinstance(response, Response)  # as on the validation set
        for outputs in head_slices(data):
            counts = response.output[..., outputs].sum(axis=(1, 2), dtype=np.int64)
            most = max(most, int(counts.max()))
    return most


def _response_arrays(response: Response | Answers, data: Dataset, index: Ints) -> dict[str, Array]:
    """Return the response to some samples, with their numbers and their (joint) classes, `target`."""
    return {**store.response_arrays(response, index), "target": np.asarray(data.target[index])}
