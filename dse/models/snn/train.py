"""Training: designs that share their data go through the same batches side by side.

Batch order, crops and the probe batch come from generators that the designs share; neurons, weights and
dropout from each design's own. A design's result is bitwise the same alone and in any cohort.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Sequence

from dse.base.records import Array, Dataset, Outcome
from dse.base.seeds import move_to
from dse.engine import engines
from dse.engine.member import Engine, as_part, of_part
from dse.measure.heads import output_labels
from dse.models.snn import whiten
from dse.models.snn.cohort import Cohort
from dse.models.snn.outcome import deployed, outcome
from dse.models.snn.outputs import train_outputs
from dse.models.snn.quantise import masks
from dse.models.snn.respond import counts_of_layers, validated
from dse.models.snn.settings import Stack
from dse.models.snn.trainee import Trainee
from dse.models.teacher import Teachers
from dse.models.training import FitRequest, Generators, Rung, Span, TrainingDiverged

Ended = tuple[int, Outcome | Rung | TrainingDiverged]
"""Number of a design, and how its training has ended or pauses."""


def train(
    dataset: Dataset,
    designs: Sequence[FitRequest[Stack]],
    shared: Generators,
    device: str = "cpu",
    threads: int = 1,
    span: Span = Span(),  # noqa: B008
) -> Iterator[Ended]:
    """Train classifiers on `dataset.train`; yield each with its number as it finishes.

    A finished design has responded on validation and, where there is one, on test. The weights that are
    kept are those of the last epoch (or the mean of the last epochs), whatever validation says of earlier
    ones; with `training.keep: best` those of the best epoch on validation. A design whose numbers run away
    ends at once, and its neighbours go on untouched. A training that goes on from the state of a `Rung` ends
    with the same bits as one that never paused.

    Args:
        dataset: spikes, windows, split.
        designs: they agree in what `Stack.shares` returns.
        shared: random generators of what the designs share ('batches', 'crops', 'input dropout', 'probe' and
            those of `Augmentation` and of `Teachers`).
        device: 'cpu' or 'cuda'.
        threads: of the CPU, over the samples of a batch.
        span: from where to where they train.

    Raises:
        ValueError: there is no training sample, or none that chooses the best epoch, the designs cannot train
            on the same batches, or they stand at different epochs.
        MissingExtra: the neurons have no kernel, and torch is not installed.
    """
    _check(dataset, designs)
    designs = [
        design._replace(
            model=design.model.placed(dataset.positions), training=design.model.schedule(design.training)
        )
        for design in designs
    ]
    cohort, clock = Cohort(dataset, designs[0], shared), _Clock()
    begun = [of_part(read(), "start") for read in span.states] or [{} for _ in designs]
    trainees = []
    for number, (design, start) in enumerate(zip(designs, begun, strict=True)):
        trainees.append(cohort.begin(number, design, start))
        trainees[-1].seconds += clock.lap()
    live = trainees
    if not span.states:  # a state holds what it learns from a teacher, and what its outputs have learnt
        live = yield from _taught(trainees, Teachers(dataset, shared, device, threads))
        live = yield from _prepared(cohort, live, designs, device, threads)
    if not live:
        return
    members = [trainee.member for trainee in trainees]
    engine = engines.start(members, cohort.batch_size, cohort.n_steps, device, threads)
    for trainee, read in zip(trainees, span.states, strict=bool(span.states)):
        state = read()
        trainee.restore(state)
        engine.restore(trainee.number, of_part(state, "engine"))
        for name, rng in cohort.draws.items():
            move_to(rng, state[f"shared/{name}"])
        del state  # before the next one takes memory
    yield from _epochs(cohort, live, engine, span)


def _check(dataset: Dataset, designs: Sequence[FitRequest[Stack]]) -> None:
    if not dataset.train.size:
        raise ValueError("training needs at least one training sample, got none")
    if not dataset.validation.size and any(design.training.keep == "best" for design in designs):
        raise ValueError("training.keep must be last where no sample validates, got best")
    if len({design.model.shares(design.training) for design in designs}) != 1:
        raise ValueError(
            "the designs of a cohort must agree in input_delays, steps_per_sample, batch_size, "
            "output_epochs, input_dropout and augmentation, and in whether their neurons have a kernel"
        )


def _taught(trainees: Sequence[Trainee], teachers: Teachers) -> Generator[Ended, None, list[Trainee]]:
    """Give each design what its teacher knows, if it has one; return those whose teacher has learnt."""
    live = []
    for trainee in trainees:
        try:
            taught = teachers.taught(trainee.training)
        except (TrainingDiverged, ValueError) as error:
            yield trainee.number, TrainingDiverged(f"teacher: {error}")
            continue
        if taught is not None:
            trainee.soft, trainee.seconds = taught.soft, trainee.seconds + taught.seconds
        live.append(trainee)
    return live


def _prepared(
    cohort: Cohort,
    trainees: Sequence[Trainee],
    designs: Sequence[FitRequest[Stack]],
    device: str,
    threads: int,
) -> Generator[Ended, None, list[Trainee]]:
    """Train outputs alone where that is asked for, and find whitened bases; return who goes on."""
    clock, data = _Clock(), cohort.dataset
    for trainee in trainees:
        if trainee.training.output_epochs:
            network = deployed(trainee, trainee.at_start, data)
            draws = designs[trainee.number].rngs("outputs")
            train_outputs(trainee, network, data, cohort.probe, draws, device, threads)
        missing = [d for d in trainee.model.whitened_layers if f"basis/{d}" not in trainee.begun]
        if missing and not trainee.has_ended:
            of_layers = counts_of_layers(deployed(trainee, trainee.at_start, data), data, cohort.counted)
            trainee.begun |= {f"basis/{d}": whiten.basis(of_layers[d - 1])[0] for d in missing}
            trainee.lay()
        trainee.seconds += clock.lap()
        yield from _ended(trainee, data)
        clock.lap()
    return [x for x in trainees if not x.has_ended]


def _epochs(cohort: Cohort, live: list[Trainee], engine: Engine, span: Span) -> Iterator[Ended]:
    """Train epoch by epoch, until all have ended, or stand at the rung."""
    data = cohort.dataset
    done = {len(trainee.history["loss"]) for trainee in live}
    if len(done) != 1:
        raise ValueError(f"the designs of a cohort must go on from the same epoch, got {sorted(done)}")
    (epoch,) = done

    def state_of(trainee: Trainee) -> dict[str, Array]:
        return trainee.state() | cohort.state() | as_part("engine", engine.state(trainee.number))

    while live:
        if span.until is not None and epoch >= span.until:
            for trainee in live:
                masters = trainee.best or engine.masters(trainee.number)
                yield trainee.number, Rung(span.until, state_of(trainee), outcome(trainee, masters, data))
            return
        live = yield from _epoch(cohort, live, engine, epoch)
        epoch += 1
        for trainee in live:
            yield from _ended(trainee, data)
        live = [x for x in live if not x.has_ended]
        if live and epoch != span.until and span.is_due():
            for trainee in live:
                yield trainee.number, Rung(epoch, state_of(trainee))


def _epoch(
    cohort: Cohort, live: list[Trainee], engine: Engine, epoch: int
) -> Generator[Ended, None, list[Trainee]]:
    """Train one epoch; return who has not diverged in a batch."""
    data, clock = cohort.dataset, _Clock()
    for trainee in live:
        if trainee.model.pruned and epoch == trainee.pruned_at:
            trainee.kept = masks(engine.masters(trainee.number), trainee.model.pruned)
            engine.prune(trainee.number, trainee.kept)
    for samples, rows, share in cohort.batches():
        turns = {x.number: x.turn(epoch + share, samples) for x in live}
        reports = engine.step(rows, output_labels(data, samples), turns)
        lap = clock.lap()
        for trainee in live:
            trainee.absorb(reports[trainee.number], samples.size, epoch)
            trainee.seconds += lap / len(live)
        for trainee in [x for x in live if x.diverged]:
            yield trainee.number, TrainingDiverged(trainee.diverged)
        live = [x for x in live if not x.diverged]
        clock.lap()
        if not live:
            return live
    for trainee in live:
        masters = engine.masters(trainee.number)
        trainee.end_epoch(masters, epoch, data.train.size)
        if trainee.training.keep == "best" and not trainee.diverged:
            trainee.consider(masters, *validated(deployed(trainee, masters, data), data))
        trainee.seconds += clock.lap()
    return live


def _ended(trainee: Trainee, dataset: Dataset) -> Iterator[Ended]:
    """Yield how a training has ended, if it has."""
    if trainee.diverged:
        yield trainee.number, TrainingDiverged(trainee.diverged)
    elif trainee.finished:
        yield trainee.number, outcome(trainee, trainee.result, dataset)


class _Clock:
    """Seconds between calls."""

    def __init__(self) -> None:
        self._last = time.perf_counter()

    def lap(self) -> float:
        """Return the seconds since the last lap."""
        before, self._last = self._last, time.perf_counter()
        return self._last - before
