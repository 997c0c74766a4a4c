"""Training: designs that share their data go through the same batches side by side.

Batch order, crops and the probe batch come from generators that the designs share; neurons, weights and
dropout from each design's own. A design's result is bitwise the same alone and in any cohort.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dse.engine import engines
from dse.engine.events import Rows, gather, without
from dse.engine.forward import prepare
from dse.engine.goal import is_label
from dse.engine.layers import weights as layer_weights
from dse.engine.member import Masters, as_part, of_part
from dse.engine.shared import distinct
from dse.measure.heads import head_answers, head_sizes, head_targets, output_labels
from dse.models.snn import contrasts, whiten
from dse.models.snn.augment import Augmentation
from dse.models.snn.outputs import train_outputs
from dse.models.snn.quantise import FINEST, dithered, finer, finest, masks, remaining
from dse.models.snn.respond import batches_of, counts_of_layers, layers_of, respond_and_count, validated
from dse.models.snn.settings import Stack
from dse.models.snn.trainee import SATURATED, Trainee
from dse.models.teacher import Teachers
from dse.models.training import FitRequest, Generators, Rung, Span, TrainingDiverged
from dse.neurons import Population, cuba_lif, name_of_population, parameters_of
from dse.neurons.fixed_point import HIGHEST_WEIGHT, LOWEST_WEIGHT, STATE_LIMIT, STATE_SCALE, quantise
from dse.records import Array, Bools, Dataset, Floats, Ints, Layer, Network, Outcome, Response, Spikes
from dse.seeds import move_to, position

PROBE_SAMPLES = 64
_FEW_DIRECTIONS = 0.5  # per output: what tells so many classes apart is then in small differences
COLLAPSED = 0.99
"""Share of the samples with one answer that counts as all."""


def train(
    dataset: Dataset,
    designs: Sequence[FitRequest[Stack]],
    shared: Generators,
    device: str = "cpu",
    threads: int = 1,
    span: Span = Span(),  # noqa: B008
) -> Iterator[tuple[int, Outcome | Rung | TrainingDiverged]]:
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
    if not dataset.train.size:
        raise ValueError("training needs at least one training sample, got none")
    if not dataset.validation.size and any(design.training.keep == "best" for design in designs):
        raise ValueError("training.keep must be last where no sample validates, got best")
    if len({design.model.shares(design.training) for design in designs}) != 1:
        raise ValueError(
            "the designs of a cohort must agree in input_delays, steps_per_sample, batch_size, "
            "output_epochs, input_dropout and augmentation, and in whether their neurons have a kernel"
        )
    designs = [
        design._replace(
            model=design.model.placed(dataset.positions), training=design.model.schedule(design.training)
        )
        for design in designs
    ]
    model, training = designs[0].model, designs[0].training
    n_steps = dataset.n_steps * model.steps_per_sample
    delays = tuple(d * model.steps_per_sample for d in model.input_delays)

    def rows_of(spikes: Spikes, samples: Ints, start: Ints, pool: Ints | None = None) -> Rows:
        return gather(spikes, samples, start, dataset.n_steps, delays, model.steps_per_sample, pool)

    shared_draws = {name: shared(name) for name in ("batches", "crops", "input dropout")}
    batches, crops, silenced = shared_draws.values()
    augmentation = Augmentation(dataset, training, shared) if training.augmentation else None
    if augmentation is not None:
        shared_draws |= augmentation.draws
    chosen = shared("probe").permutation(dataset.train)[:PROBE_SAMPLES]
    probe = rows_of(dataset.spikes, chosen, dataset.start[chosen])
    clock = _Clock()
    counted = shared("whitening").permutation(dataset.train)[: whiten.SAMPLES]
    heads = head_sizes(dataset)
    targets = is_label(output_labels(dataset, counted), sum(heads))
    trainees, begun = [], [of_part(read(), "start") for read in span.states] or [{} for _ in designs]
    for number, (design, start) in enumerate(zip(designs, begun, strict=True)):
        pool = design.model.pool(dataset.positions)

        def windows(n_samples: int, size: int, pool: Ints | None = pool) -> Iterator[Rows]:
            samples = counted[: n_samples or None]
            of_channels = None if pool is None else pool[: dataset.spikes.n_channels]
            for part in np.split(samples, range(size, samples.size, size)):
                yield rows_of(dataset.spikes, part, dataset.start[part], of_channels)

        def run(
            weights: Floats,
            population: Population[Any],
            model: Stack = design.model,
            windows: Callable[[int, int], Iterator[Rows]] = windows,
        ) -> tuple[Ints, Bools]:
            is_whole = model.arithmetic == "integer" and not model.is_dithered(0)
            matrix = quantise(weights) if is_whole else weights.astype(np.float32)
            layer = prepare(layer_weights(matrix, None, population), model.arithmetic)
            return contrasts.run_candidates(layer, population.to_threshold, windows, model.most_peak)

        choice = contrasts.Choice(
            run,
            targets,
            design.model.hidden_spike_penalty,
            start.get("chosen"),
            design.model.wiring(dataset),
        )
        trainees.append(Trainee.start(number, design, probe, dataset.spikes.step_ms, heads, pool, choice))
        trainees[-1].begun |= start
        trainees[-1].lay()
        trainees[-1].seconds += clock.lap()
    teachers, live = Teachers(dataset, shared, device, threads), []
    for trainee in trainees:
        if span.states:
            live.append(trainee)  # its state holds what it learns from a teacher
            continue
        try:
            taught = teachers.taught(trainee.training)
        except (TrainingDiverged, ValueError) as error:
            yield trainee.number, TrainingDiverged(f"teacher: {error}")
            continue
        if taught is not None:
            trainee.soft, trainee.seconds = taught.soft, trainee.seconds + taught.seconds
        live.append(trainee)
    if not live:
        return

    def deployed(trainee: Trainee, masters: Masters) -> Network:
        exponent = _exponent(trainee, masters, dataset, delays)
        return _network(trainee, masters, dataset.spikes.n_channels, delays, exponent)

    def ended(trainee: Trainee) -> Iterator[tuple[int, Outcome | TrainingDiverged]]:
        if trainee.diverged:
            yield trainee.number, TrainingDiverged(trainee.diverged)
        elif trainee.finished:
            yield trainee.number, _outcome(trainee, trainee.result, dataset, delays)

    clock.lap()
    for trainee in [] if span.states else live:
        if training.output_epochs:
            network, draws = deployed(trainee, trainee.at_start), designs[trainee.number].rngs("outputs")
            train_outputs(trainee, network, dataset, chosen, draws, device, threads)
        missing = [d for d in trainee.model.whitened_layers if f"basis/{d}" not in trainee.begun]
        if missing and not (trainee.diverged or trainee.finished):
            of_layers = counts_of_layers(deployed(trainee, trainee.at_start), dataset, counted)
            trainee.begun |= {f"basis/{d}": whiten.basis(of_layers[d - 1])[0] for d in missing}
            trainee.lay()
        trainee.seconds += clock.lap()
        yield from ended(trainee)
        clock.lap()
    live = [x for x in live if not (x.diverged or x.finished)]
    if not live:
        return
    size = min(training.batch_size, dataset.train.size)
    engine = engines.start([trainee.member for trainee in trainees], size, n_steps, device, threads)
    for trainee, read in zip(trainees, span.states, strict=bool(span.states)):
        state = read()
        trainee.restore(state)
        engine.restore(trainee.number, of_part(state, "engine"))
        for name, rng in shared_draws.items():
            move_to(rng, state[f"shared/{name}"])
        del state  # before the next one takes memory
    n_batches = -(-dataset.train.size // training.batch_size)

    def state_of(trainee: Trainee) -> dict[str, Array]:
        draws = {f"shared/{name}": position(rng) for name, rng in shared_draws.items()}
        return trainee.state() | draws | as_part("engine", engine.state(trainee.number))

    clock.lap()
    done = {len(trainee.history["loss"]) for trainee in live}
    if len(done) != 1:
        raise ValueError(f"the designs of a cohort must go on from the same epoch, got {sorted(done)}")
    (epoch,) = done
    while live:
        if span.until is not None and epoch >= span.until:
            for trainee in live:
                masters = trainee.best or engine.masters(trainee.number)
                outcome = _outcome(trainee, masters, dataset, delays)
                yield trainee.number, Rung(span.until, state_of(trainee), outcome)
            return
        for trainee in live:
            if trainee.model.pruned and epoch == trainee.pruned_at:
                trainee.kept = masks(engine.masters(trainee.number), trainee.model.pruned)
                engine.prune(trainee.number, trainee.kept)
        order = batches.permutation(dataset.train)
        starts = crops.integers(dataset.start_low[order], dataset.start_high[order], endpoint=True)
        for batch in range(n_batches):
            part = slice(batch * training.batch_size, (batch + 1) * training.batch_size)
            turns = {x.number: x.turn(epoch + batch / n_batches, order[part]) for x in live}
            labels = output_labels(dataset, order[part])
            if augmentation is None:
                rows = rows_of(dataset.spikes, order[part], starts[part])
            else:
                n, spikes = order[part].size, augmentation.batch(order[part], starts[part])
                rows = rows_of(spikes, np.arange(n), np.zeros(n, np.int64))
            if training.input_dropout:
                shape = rows.n_samples, dataset.spikes.n_channels
                rows = without(rows, silenced.random(shape) < training.input_dropout)
            reports = engine.step(rows, labels, turns)
            lap = clock.lap()
            for trainee in live:
                trainee.absorb(reports[trainee.number], len(labels), epoch)
                trainee.seconds += lap / len(live)
            for trainee in [x for x in live if x.diverged]:
                yield trainee.number, TrainingDiverged(trainee.diverged)
            live = [x for x in live if not x.diverged]
            clock.lap()
            if not live:
                return
        for trainee in live:
            masters = engine.masters(trainee.number)
            trainee.end_epoch(masters, epoch, order.size)
            if trainee.training.keep == "best" and not trainee.diverged:
                trainee.consider(masters, *validated(deployed(trainee, masters), dataset))
            trainee.seconds += clock.lap()
        epoch += 1
        for trainee in live:
            yield from ended(trainee)
        live = [x for x in live if not (x.diverged or x.finished)]
        if live and epoch != span.until and span.is_due():
            for trainee in live:
                yield trainee.number, Rung(epoch, state_of(trainee))
        clock.lap()


class _Clock:
    """Seconds between calls."""

    def __init__(self) -> None:
        self._last = time.perf_counter()

    def lap(self) -> float:
        """Return the seconds since the last lap."""
        before, self._last = self._last, time.perf_counter()
        return self._last - before


def _trained(trainee: Trainee, masters: Masters) -> list[Array | None]:
    """Return the weights as trained, feed-forward, then recurrent; 0 where pruning removed one."""
    weights = [
        None if w is None else w.astype(np.float32) for w in (*masters.feed_forward, *masters.recurrent)
    ]
    if trainee.kept is None:
        return weights
    kept = [*trainee.kept.feed_forward, *trainee.kept.recurrent]
    return [
        None if w is None or k is None else remaining(w, k, trainee.model.arithmetic)
        for w, k in zip(weights, kept, strict=True)
    ]


def _learnt(population: Population[Any], decays: Array | None) -> Population[Any]:
    """Return neurons with the decays of u and v that they learnt, if they did."""
    if decays is None:
        return population
    assert isinstance(population, cuba_lif.Population)  # no other learns them
    return replace(population, decay_current=decays[0], decay_voltage=decays[1])


def _outcome(trainee: Trainee, masters: Masters, dataset: Dataset, delays: tuple[int, ...]) -> Outcome:
    """Return a design's network of these weights, and its responses."""
    began = time.perf_counter()
    exponent = _exponent(trainee, masters, dataset, delays)
    model, network = trainee.model, _network(trainee, masters, dataset.spikes.n_channels, delays, exponent)
    validation, fired = respond_and_count(network, dataset, dataset.validation)
    test = respond_and_count(network, dataset, dataset.test)[0] if dataset.test.size else None
    totals = [x.sum(axis=0) for x in fired]
    curves = {name: np.asarray(values) for name, values in trainee.history.items()}
    cells = validation.output.shape[0] * validation.output.shape[1]
    layers = trainee.member.layers
    sharing = [*(layer.shared for layer in layers), *(None for _ in layers)]
    pairs = zip(_trained(trainee, masters), sharing, strict=True) if model.arithmetic == "integer" else ()
    weights = [distinct(w, shared) for w, shared in pairs if w is not None]
    weights[:1] = [w * 2.0 ** (exponent - model.exponent(0)) for w in weights[:1]]
    rank, n_outputs = whiten.effective_rank(fired[-2]), network.sizes[-1]
    health: dict[str, Any] = {
        "dead_neurons": int(sum((f == 0).sum() for f in totals[1:-1])),
        "saturated_neurons": int(sum((f >= SATURATED * cells).sum() for f in totals[1:-1])) if cells else 0,
        "saturated_outputs": int((totals[-1] >= SATURATED * cells).sum()) if cells else 0,
        "effective_rank": rank,
        "collinear_dropout": trainee.training.dropout > 0 and rank < _FEW_DIRECTIONS * n_outputs,
        "collapsed_outputs": _collapsed(dataset, validation),
        "clipped_weights": sum(
            int(np.isin(quantise(w), (LOWEST_WEIGHT, HIGHEST_WEIGHT)).sum()) for w in weights
        ),
        "peak_state": validation.peak_state,
        "peak_thresholds": validation.peak_state
        / (STATE_SCALE * max(float(np.max(layer.population.to_threshold)) for layer in layers)),
        "overflows_24_bit": "integer" in model.neuron.arithmetics and validation.peak_state > STATE_LIMIT,
        "missed_initial_rates": sum(
            not 0.5 * target <= reached <= 2 * target for target, reached in trainee.rates
        ),
        "initial_rates": [reached for _, reached in trainee.rates],
        "initial_rate_hidden": float(np.mean([reached for _, reached in trainee.rates[:-1]])),
        "initial_rate_output": float(trainee.rates[-1][1]),
        "gradient_norm_largest": max(trainee.history["gradient_norm"]),
        "gradient_norm_last": trainee.history["gradient_norm"][-1],
        "clipped_gradients": trainee.clipped_batches,
        "stopped_early": trainee.stopped,
        "epochs_trained": len(trainee.history["loss"]),
        "epoch_kept": trainee.epoch_kept,
        "n_weights_dense": network.n_weights_dense,
    }
    if any(layer.shared is not None for layer in layers):
        health["n_synapses"] = sum(network.stored)
    seconds = trainee.seconds + time.perf_counter() - began
    return Outcome(network, validation, test, curves, health, seconds)


def _exponent(trainee: Trainee, masters: Masters, dataset: Dataset, delays: tuple[int, ...]) -> int:
    """Return the exponent of the first layer's thresholds and weights as they run.

    Where it is free, it is the largest whose 8 bits hold the weights and whose states stay within half of
    24 bits on validation samples: others reach further.
    """
    model, first = trainee.model, _trained(trainee, masters)[0]
    if first is None or not model.is_free(0):
        return model.exponent(0)
    exponent = finest(first * 2.0**-FINEST, FINEST)
    network = _network(trainee, masters, dataset.spikes.n_channels, delays, exponent)
    layer, windows = layers_of(network)[0], batches_of(network, dataset, dataset.validation)
    peak = max(layer.forward(rows, count=True).peak for rows in windows) * STATE_SCALE
    over = math.ceil(math.log2(max(1.0, peak / (STATE_LIMIT / 2))))
    return max(0, exponent - over)


def _network(
    trainee: Trainee, masters: Masters, n_channels: int, delays: tuple[int, ...], exponent: int
) -> Network:
    """Return the network of trained weights, delays and decays; `exponent` is of the first layer."""
    model, layers, pool = trainee.model, trainee.member.layers, trainee.member.pool
    n, none = len(layers), (None,) * len(layers)
    matrices = _trained(trainee, masters)
    populations = [
        _learnt(layer.population, decays)
        for layer, decays in zip(layers, masters.decays or none, strict=True)
    ]
    first = matrices[0]
    if pool is not None and first is not None:
        coarser = model.exponent(0) - exponent
        first = first * np.float32(2.0**-coarser)
        populations[0] = finer(populations[0], -coarser)
        matrices[0] = dithered(first, pool) if model.is_dithered(0) else first[pool]
    of_layers = zip(matrices[:n], matrices[n:], populations, layers, masters.delay or none, strict=True)
    return Network(
        layers=tuple(
            Layer(
                weight=np.ascontiguousarray(w.T),
                recurrent=None if r is None else np.ascontiguousarray(r.T),
                parameters=parameters_of(population),
                neuron=name_of_population(population, model.neuron),
                shared=None if layer.shared is None else np.ascontiguousarray(layer.shared.T),
                delay=None if late is None else np.ascontiguousarray(late.T),
            )
            for w, r, population, layer, late in of_layers
            if w is not None
        ),
        n_channels=n_channels,
        delays=delays,
        steps_per_sample=model.steps_per_sample,
        arithmetic=model.arithmetic,
    )


def _collapsed(dataset: Dataset, validation: Response) -> int:
    """Return how many heads give one answer to nearly all validation samples, though their labels differ."""
    answers = head_answers(dataset, validation.output.sum(axis=1, dtype=np.int64))
    targets = head_targets(dataset, dataset.validation)
    return sum(
        _largest_share(target) < COLLAPSED <= _largest_share(answer)
        for answer, target in zip(answers.T, targets.T, strict=True)
    )


def _largest_share(classes: Ints) -> float:
    """Return the share of the most frequent class; 0 of none."""
    return float(np.bincount(classes).max() / len(classes)) if len(classes) else 0.0
