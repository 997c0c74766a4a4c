"""The jobs of a worker: prepare a data set, or train a cohort of runs and record each run.

A job holds paths and settings only; spikes are read from the prepared data set as a memory map.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse import dataset, seeds, store
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
from dse.config.resolved import LeftOut, Sections
from dse.dataset.cache import mark_used, usual_root
from dse.dataset.files import read_meta
from dse.hardware.profile import Profile
from dse.measure.heads import head_sizes, head_slices
from dse.measure.numbers import Numbers
from dse.measure.run import Measurement, Moved, OfTargets, UnseenTargets, accuracies, measure
from dse.models.snn.quantise import rounded
from dse.neurons.fixed_point import STATE_LIMIT
from dse.recordings import RecordingError
from dse.recordings.windows import with_crops
from dse.records import (
    Answers,
    Array,
    Dataset,
    Ints,
    Network,
    Outcome,
    Parameters,
    Response,
)
from dse.search.cohorts import Demand
from dse.study import checkpoints, precision
from dse.study.checkpoints import Checkpoint
from dse.study.executors.work import Failure
from dse.study.precision import Setting
from dse.study.record import RunRecord, plain_rungs
from dse.study.results import sections_found

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

# Shortest time between two messages about the work in progress.
_MESSAGE_S = 0.5


@dataclasses.dataclass(frozen=True)
class Preparation:
    """Prepare data sets that have most of their work in common, one after the other.

    designs: key of the data set -> sections of its design. base: folder that recordings are relative to.
    cache: root of the cache. threads: number of threads that simulate trials.
    progress_file: in which the work in progress is written, now and then.
    """

    designs: Mapping[str, Sections]
    base: Path
    cache: Path
    threads: int = 1
    progress_file: Path | None = None


@dataclasses.dataclass(frozen=True)
class Fold:
    """A training of a design without some groups.

    sections: of the design, with the groups left out.
    data: folder of its prepared data set, whose test set they are.
    """

    sections: Sections
    data: Path

    @property
    def left_out(self) -> LeftOut:
        """The groups."""
        assert self.sections.left_out is not None
        return self.sections.left_out


@dataclasses.dataclass(frozen=True)
class Run:
    """Train a design once, and once more for each of its folds.

    sections: of the design.
    data: folder of the prepared data set, named as its key; base: folder that recordings are relative to.
    folder: file of the run.
    phi, theta: decision grid. hardware: profiles that the full read-out is priced on.
    phi_step: distance of phi up to what the outputs of training samples reach; None: phi is given.
    read_out_every_ms: as of `dse.measure.run.measure`.
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
    phi: tuple[float, ...]
    theta: tuple[float, ...]
    hardware: tuple[Profile, ...]
    phi_step: int | None = None
    read_out_every_ms: float | None = None
    folds: tuple[Fold, ...] = ()

    @property
    def study(self) -> Path:
        """The folder of the study."""
        return self.folder.parents[1]

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
        return measure(
            outcome,
            data,
            np.array(self.phi),
            np.array(self.theta),
            self.hardware,
            weight_bits,
            self.read_out_every_ms,
            self._moved(outcome.network, data),
            unseen,
        )

    def _moved(self, fitted: Network | Parameters, data: Dataset) -> Iterator[Moved]:
        """Yield what the run answers to moved windows of the validation samples with room for every shift."""
        evaluation = self.sections.evaluation
        if evaluation is None or evaluation.shifts is None:
            return
        fits = np.all([dataset.has_room(data, shift) for shift in evaluation.shifts], axis=0)
        samples = data.validation[fits[data.validation]]
        for shift in evaluation.shifts:
            yield shift, samples, self.sections.model.respond(fitted, dataset.shifted(data, shift), samples)


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


def prepare(job: Preparation) -> Iterator[str | tuple[str, Failure]]:
    """Make the data sets that are not in the cache.

    Yields:
        The key of a data set that cannot be made, and why; a text is work in progress (`Workers.stream`).
    """
    is_due = _timer(_MESSAGE_S)

    def say(text: str) -> None:
        if job.progress_file is not None and is_due():
            with contextlib.suppress(OSError):
                job.progress_file.write_text(text, "utf-8")

    for key, sections in job.designs.items():
        try:
            with store.explained(job.cache):
                dataset.prepare(sections, job.base, job.cache, job.threads, say)
        except store.StoreError:
            raise  # a full disk is not the data set's fault
        except Exception as error:
            yield key, Failure.of(error)
    if job.progress_file is not None:
        job.progress_file.unlink(missing_ok=True)


@dataclasses.dataclass(frozen=True)
class Loaded:
    """A data set in a worker.

    leak: why evaluations on the data know the labels; '' if they do not.
    fitted: section -> key -> plain value that was fitted to the recordings.
    """

    data: Dataset
    leak: str
    fitted: Mapping[str, Mapping[str, object]]


_last: dict[Path, Loaded] = {}  # the data set that this process loaded last, by its folder


def load(run: Run, threads: int = 1) -> Loaded:
    """Return the data set of a run; a process keeps the one that it loaded last.

    It is complete in memory or mapped, so it may be evicted from the cache while it is in use.

    Raises:
        StoreError: the cache cannot be written.
        RecordingError: the data set was evicted, and its recordings have changed or cannot be read.
    """
    if run.data not in _last:
        _last.clear()  # before the next one takes memory
        with store.explained(run.data.parent):
            data = dataset.load_or_prepare(run.sections, run.base, run.data, threads)
        meta = read_meta(run.data)
        _last[run.data] = Loaded(data, meta.transductive, meta.fitted)
    mark_used(run.data)
    return _last[run.data]


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
    loaded = load(job.runs[0], job.threads)
    missing = set(left)
    for numbers, points in _at_one_epoch(job, left):
        span = Span([point.state for point in points], job.until, _timer(job.checkpoint_s))
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


def _timer(seconds: float) -> Callable[[], bool]:
    """Return a function that is true where so many seconds have passed since it last was."""
    last_s = time.monotonic()

    def is_due() -> bool:
        nonlocal last_s
        due = time.monotonic() - last_s >= seconds
        last_s = time.monotonic() if due else last_s
        return due

    return is_due


def _of(job: TrainingJob, numbers: Sequence[int]) -> TrainingJob:
    """Return a job of some of the runs."""
    return dataclasses.replace(job, runs=tuple(job.runs[number] for number in numbers))


def _without(job: TrainingJob, fold: Fold) -> Iterator[tuple[int, OfTargets | Failure]]:
    """Train the runs of a cohort without a fold; yield the number and the accuracies of each on the fold."""
    run = dataclasses.replace(job.runs[0], sections=fold.sections, data=fold.data)
    data = load(run, job.threads).data
    where = f"without {fold.left_out.column} {fold.left_out.name}"
    try:
        for number, outcome in _outcomes(job, data, f"{where}: "):
            assert not isinstance(outcome, Rung)  # folds never pause
            if isinstance(outcome, Exception):
                failure = Failure.of(outcome)
                yield number, dataclasses.replace(failure, message=f"{where}: {failure.message}")
            else:
                assert outcome.test is not None  # the fold is the test set
                phi, theta = np.array(run.phi), np.array(run.theta)
                yield (
                    number,
                    accuracies(outcome.test, data, data.test, phi, theta, run.read_out_every_ms),
                )
    except (store.StoreError, MemoryError):
        raise
    except Exception as error:
        raise RuntimeError(f"{where}: {error}") from error


def _outcomes(
    job: TrainingJob, data: Dataset, prefix: str = "", span: Span | None = None
) -> Iterator[tuple[int, Outcome | Rung | Exception]]:
    """Train the runs of a job on a data set.

    Args:
        job: of the runs.
        data: what they train on.
        prefix: begins the names of their random generators.
        span: from where to where, of families whose trainings can pause; None: from the start to the end.
    """
    first = job.runs[0]
    family = first.sections.model
    if not trains_in_cohorts(family):
        return (
            (number, _alone(run.sections, data, _generators(run, prefix)))
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


def _alone(sections: Sections, data: Dataset, rngs: Generators) -> Outcome:
    """Train a design alone, on crops as samples of their own unless its family draws crops."""
    model, training = sections.model, sections.training
    crops = 1 if getattr(model, "draws_crops", False) else training.crops
    return model.fit(with_crops(data, crops), training, rngs)


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
    for sections, base, key in sections_found(folder, record):
        if key == record.data:
            return trained_alone(sections, base, record.seed, record.design, record.repeat, parts)
    raise RecordingError(f"{folder}: the recordings of trial {record.trial} are not found, or have changed")


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
    run = Run(0, repeat, design, seed, sections, folder, base, folder, (), (), ())
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

    Args:
        job: the run.
        device: where it trains.
        ended: what it is now.
        loaded: what it was trained on.
        unseen: accuracies of the trainings without some groups.
        rungs: epochs -> what was measured there before.
        only_full: measure its full read-out alone.
    """
    outcome = ended.outcome if isinstance(ended, Rung) else ended
    assert outcome is not None  # the training pauses here
    data, leak = loaded.data, loaded.leak
    if only_full:
        job = dataclasses.replace(job, phi=(), theta=())
    elif job.phi_step is not None and isinstance(outcome.validation, Response):
        most = most_output_spikes(job.sections.model, outcome.network, data)
        job = dataclasses.replace(job, phi=tuple(range(0, most + job.phi_step, job.phi_step)))
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


@dataclass(frozen=True)
class Rounding:
    """Evaluate a trained run at some settings."""

    run: Run
    settings: tuple[Setting, ...]


def evaluate(job: Rounding) -> Iterator[tuple[Setting, Failure | None]]:
    """Evaluate a run at its settings, one after the other; each result is stored at once.

    Yields:
        A setting, and None after it is stored, or why it failed. An error that fails all settings is raised.
    """
    loaded = load(job.run)
    network = store.fitted_of(store.load_arrays(job.run.folder / "weights.npz"))
    trained = RunRecord.from_plain(store.read_record(job.run.folder), job.run.folder)
    run = job.run
    if run.phi_step is not None:  # the same settings as in training
        surface = next(x for x in trained.files if x.startswith("surface"))
        phi = store.load_arrays(run.folder / surface)["phi"]
        run = dataclasses.replace(run, phi=tuple(phi.tolist()))
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
    precision.save(run.folder, setting, dataclasses.replace(trained, numbers=numbers), measurement.files)
