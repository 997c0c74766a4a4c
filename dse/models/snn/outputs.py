"""Training of spiking outputs alone, which come before all other epochs (`training.output_epochs`).

Hidden layers rest meanwhile, so that their spikes are computed once, as they would be deployed, and every
epoch reads them: its work grows with hidden spikes, whatever the inputs are.

Outputs begin as a softmax readout: weights with which the spike counts of the hidden neurons, times these
weights, are the log-odds of the classes. One factor then makes the most active output of each head fire at
the mean of the target rates. All outputs share a drive beside it that changes no difference of log-odds and
lifts them over what they leak: below, their counts would not follow the readout.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dse.base.records import Arithmetic, Array, Dataset, Floats, Ints, Layer, Network, Spikes
from dse.engine import engines
from dse.engine.adam import adam
from dse.engine.events import Rows, delayed, gather, without
from dse.engine.forward import prepare
from dse.engine.goal import is_label
from dse.engine.network import layer_spikes
from dse.engine.neurons import Population, parameters_of, population_of
from dse.engine.neurons.fixed_point import within_range
from dse.engine.neurons.response import constant_response, response_norm
from dse.engine.parameters import product
from dse.measure.heads import head_sizes, output_labels, softmax
from dse.models.snn.contrasts import mean_counts
from dse.models.snn.initialise import deployed, reach_rate
from dse.models.snn.quantise import FINEST, closest, compensated
from dse.models.snn.respond import batches_of, layers_of, validated
from dse.models.snn.trainee import Trainee
from dse.models.snn.whiten import basis, inverse

_BATCH = 1024  # samples whose hidden spikes are read at once
_PEAK_BATCH = 64  # samples whose potentials are held at once
_READOUT_EPOCHS = 30
_READOUT_BATCH = 32
_READOUT_STEP = 0.02  # of Adam, in log-odds per count that is white
_READOUT_POWER = 1.0  # a readout follows directions of less power, in scaled counts, the less
_COMMON = 1.0, 2.0, 4.0, 8.0  # mean drives to share, in those that would just make an output fire
_EVEN_RIDGE = 0.01  # added to the second moments of scaled mean counts where the drive is made even


def hidden_spikes(network: Network, dataset: Dataset) -> Dataset:
    """Return training and validation samples as outputs see them.

    These are the spikes of the last hidden layer, a step later.

    Args:
        network: its last layer does not run.
        dataset: its windows that are evaluated.
    """
    samples, layers = np.concatenate([dataset.train, dataset.validation]), layers_of(network)[:-1]
    counts, index = [np.zeros(0, np.int64)], [np.zeros(0, np.int32)]
    for rows in batches_of(network, dataset, samples):
        fired = delayed(layer_spikes(rows, layers)[-1])
        counts.append(np.diff(fired.offsets))
        index.append(fired.index)
    n_steps, zeros = dataset.n_steps * network.steps_per_sample, np.zeros(samples.size, np.int32)
    spikes = Spikes(
        np.concatenate([[0], np.cumsum(np.concatenate(counts))]),
        np.concatenate(index),
        n_steps,
        network.sizes[-2],
        dataset.spikes.step_ms / network.steps_per_sample,
    )
    return replace(
        dataset,
        spikes=spikes,
        target=dataset.target[samples],
        start=zeros,
        start_low=zeros,
        start_high=zeros,
        n_steps=n_steps,
        train=np.arange(dataset.train.size),
        validation=np.arange(dataset.train.size, samples.size),
        test=np.zeros(0, np.int64),
        positions=np.zeros((network.sizes[-2], 3), np.int32),
        room_low=None,
        room_high=None,
    )


def counts_of(hidden: Dataset, samples: Ints) -> Ints:
    """Return how often each hidden neuron fires in some samples, (sample, neuron)."""
    return np.concatenate([rows.per_input() for rows in _batches(hidden, samples)])


def _batches(hidden: Dataset, samples: Ints, size: int = _BATCH) -> Iterator[Rows]:
    for first in range(0, max(1, samples.size), size):
        part = samples[first : first + size]
        yield gather(hidden.spikes, part, np.zeros(part.size, np.int32), hidden.n_steps)


def readout(counts: Ints, targets: Floats, heads: Sequence[int], rng: np.random.Generator) -> Floats:
    """Return the weights of a softmax readout without bias, (neuron, output) float64.

    Args:
        counts: (sample, neuron) spikes.
        targets: (sample, output) probabilities of the classes.
        heads: classes of each head.
        rng: of the order of samples.
    """
    matrix, length = basis(counts, _READOUT_POWER)
    matrix = matrix.astype(np.float64) * length
    white = product(counts.astype(np.float64), matrix)
    weights = first = second = np.zeros((matrix.shape[1], targets.shape[1]))
    n, ends = len(counts), np.cumsum(heads)[:-1]
    n_batches, step = -(-n // _READOUT_BATCH), 0
    for epoch in range(_READOUT_EPOCHS):
        order = rng.permutation(n)
        rate = _READOUT_STEP * (1 + math.cos(math.pi * epoch / _READOUT_EPOCHS)) / 2
        for batch in range(n_batches):
            part, step = order[batch * _READOUT_BATCH : (batch + 1) * _READOUT_BATCH], step + 1
            odds = product(white[part], weights)
            shares = np.concatenate([softmax(x) for x in np.split(odds, ends, axis=1)], axis=1)
            gradient = product(white[part].T, shares - targets[part])
            weights, first, second = adam(weights, gradient, first, second, step, rate)
    return product(matrix, weights)


def spiking(
    weights: Floats, last: Layer, arithmetic: Arithmetic, rows: Rows, heads: Sequence[int], rate: float
) -> tuple[Floats, float]:
    """Return the weights of spiking outputs, (input, neuron): those of a readout times one factor.

    Args:
        weights: of the readout, (neuron, class), in log-odds per spike.
        last: the output neurons.
        arithmetic: of the network.
        rows: spikes of the layer below, as the outputs see them.
        heads: classes of each head.
        rate: spikes per step of the most active output of each head, in the mean.

    Returns:
        The weights, and the rate that they reach.
    """
    population = population_of(last.neuron, last.parameters)
    delay = None if last.delay is None else last.delay.T
    within = within_range if arithmetic == "integer" else np.asarray

    def most(of_outputs: Array) -> float:
        parts = np.split(of_outputs, np.cumsum(heads)[:-1], axis=1)
        return float(np.mean([x.max(axis=1).mean() for x in parts])) / rows.n_steps

    def reached(gain: float) -> float:
        matrix = (gain * weights).astype(np.float32)
        (one,) = deployed([matrix], [None], [population], arithmetic, [delay])
        return most(prepare(one, arithmetic).forward(rows).fired.per_input())

    drive = most(product(rows.per_input().astype(np.float64), weights))
    unit = population.to_threshold / response_norm(population, weights.shape[1], rows.n_steps)
    gain, found = reach_rate(reached, rate, float(np.mean(unit)) / drive if drive > 0 else 1.0)
    return within((gain * weights).astype(np.float32)), found


def lifted(
    weights: Floats, last: Layer, arithmetic: Arithmetic, rows: Rows, targets: Floats, heads: Sequence[int]
) -> Floats:
    """Return weights of spiking outputs with the common drive that answers most samples rightly, or none.

    Args:
        weights: (input, neuron).
        last: the output neurons.
        arithmetic: of the network.
        rows: spikes of the layer below, as the outputs see them.
        targets: (sample, output) probabilities of the classes.
        heads: classes of each head.
    """
    population = population_of(last.neuron, last.parameters)
    delay = None if last.delay is None else last.delay.T
    ends = np.cumsum(heads)[:-1]
    even, best = even_drive(population, len(targets.T), rows), (-1.0, weights)
    for common in (0.0, *_COMMON):
        matrix = (weights + common * even[:, None]).astype(np.float32)
        (one,) = deployed([matrix], [None], [population], arithmetic, [delay])
        counts = prepare(one, arithmetic).forward(rows).fired.per_input()
        parts = zip(np.split(counts, ends, axis=1), np.split(targets, ends, axis=1), strict=True)
        right = float(np.mean([c.argmax(axis=1) == t.argmax(axis=1) for c, t in parts]))
        best = max(best, (right, matrix), key=lambda x: x[0])
    return best[1]


def peak_of(weights: Floats, last: Layer, arithmetic: Arithmetic, parts: Iterable[Rows]) -> float:
    """Return the largest potential of spiking outputs, above or below rest, in thresholds.

    Args:
        weights: (input, neuron).
        last: the output neurons.
        arithmetic: of the network.
        parts: spikes of the layer below, as the outputs see them; potentials of one part are held at a time.
    """
    population = population_of(last.neuron, last.parameters)
    delay = None if last.delay is None else last.delay.T
    (one,) = deployed([weights.astype(np.float32)], [None], [population], arithmetic, [delay])
    layer, peak = prepare(one, arithmetic), 0.0
    for rows in parts:
        reached = np.abs(layer.forward(rows, keep_voltage=True).voltage).max(axis=(0, 1))
        peak = max(peak, float((reached / population.to_threshold).max(initial=0.0)))
    return peak


def even_drive(population: Population[Any], n_neurons: int, rows: Rows) -> Floats:
    """Return weights of the layer below, (neuron,), whose drive is as even in time as its spikes allow.

    Its mean is that which would just make the mean of some neurons fire; 0 where no drive does.
    """
    seen = short_counts(population, n_neurons, rows)
    scale = 1 / np.maximum(np.sqrt((seen**2).mean(axis=0)), np.finfo(np.float32).tiny)
    scaled = seen * scale
    powers = product(scaled.T, scaled) / len(seen)
    powers[np.diag_indices_from(powers)] += _EVEN_RIDGE
    even = scale * product(inverse(powers), scaled.mean(axis=0)[:, None])[:, 0]
    drive = float((seen @ even).mean())
    response = constant_response(population, n_neurons, rows.n_steps)
    can_fire = drive > 0 and bool((response > 0).all())
    return np.asarray(even * (np.mean(population.to_threshold / response) / drive if can_fire else 0.0))


def short_counts(population: Population[Any], n_neurons: int, rows: Rows) -> Floats:
    """Return mean spikes per step of a layer below, (stretch, neuron), in stretches that neurons remember."""
    response = constant_response(population, n_neurons, rows.n_steps)
    memory = float(np.median((response / response_norm(population, n_neurons, rows.n_steps)) ** 2))
    return mean_counts(rows, min(max(1, round(memory)), rows.n_steps))


def train_outputs(
    trainee: Trainee,
    network: Network,
    dataset: Dataset,
    probe: Ints,
    order: np.random.Generator,
    device: str = "cpu",
    threads: int = 1,
) -> None:
    """Train the outputs of a design for `training.output_epochs`; its other epochs begin with them.

    Training windows are those that are evaluated; delays and decays rest.

    Args:
        trainee: at its start.
        network: of its weights.
        dataset: of its training.
        probe: training samples, at most a batch, on which the rate of the outputs is reached.
        order: of the samples.
        device: 'cpu' or 'cuda'.
        threads: of the CPU.
    """
    model, training, heads = trainee.model, trainee.training, head_sizes(dataset)
    hidden, n = hidden_spikes(network, dataset), dataset.train.size
    labels, counts = output_labels(dataset, dataset.train), counts_of(hidden, hidden.train)
    targets = is_label(labels, sum(heads)) if trainee.soft is None else trainee.soft[dataset.train]
    last, (target, _) = replace(network.layers[-1], shared=None), trainee.rates[-1]
    shown = next(_batches(hidden, np.flatnonzero(np.isin(dataset.train, probe))))
    begun = readout(counts, targets, heads, order)
    arithmetic: Arithmetic = "float32" if model.has_free_outputs else network.arithmetic
    weights, reached = spiking(begun, last, arithmetic, shown, heads, target)
    some = order.permutation(n)[:_BATCH]
    seen = next(_batches(hidden, some))
    weights = lifted(weights, last, arithmetic, seen, targets[some], heads)
    short = short_counts(population_of(last.neuron, last.parameters), sum(heads), seen)
    moments = product(short.T, short) / len(short)
    if model.has_free_outputs:
        peak = peak_of(weights, last, arithmetic, _batches(hidden, some, _PEAK_BATCH))
        most = min(FINEST, model.most_exponent(peak))
        exponent = closest(weights, (counts.astype(np.float64) ** 2).mean(axis=0), most)
        trainee.begun["exponent"] = np.array(exponent)
        weights *= np.float32(2.0**exponent)
    trainee.rates[-1] = target, reached
    if len(model.hidden) in model.whitened_layers:
        trainee.begun[f"basis/{len(model.hidden)}"] = basis(counts)[0]
    trainee.begun["outputs"] = weights
    trainee.lay()
    (layer,) = trainee.member.layers[-1:]
    last = replace(last, parameters=parameters_of(layer.population))
    at_rest = replace(layer, learnt_decays="no")
    alone = replace(trainee.member, layers=(at_rest,), pool=None, hidden_spike_penalty=0.0)
    engine = engines.start([alone], min(training.batch_size, n), hidden.n_steps, device, threads)
    n_batches = -(-n // training.batch_size)
    resting = (counts.mean() / hidden.n_steps,) * len(model.hidden)
    for epoch in range(training.output_epochs):
        samples = order.permutation(n)
        for batch in range(n_batches):
            part = samples[batch * training.batch_size : (batch + 1) * training.batch_size]
            turn = trainee.turn(epoch + batch / n_batches, dataset.train[part])
            rows, gains = next(_batches(hidden, part)), turn.gains[-1]
            if gains is not None:  # of the first layer that learns: its rows lack what drops out
                rows = without(rows, gains == 0)
                gains = np.full((part.size, 1), 1 / (1 - training.dropout), np.float32)
            turn = replace(turn, gains=(gains,), delay_learning_rate=0.0, decay_learning_rate=0.0)
            report = engine.step(rows, labels[part], {0: turn})[0]
            trainee.absorb(replace(report, fired=(*resting, *report.fired)), part.size, epoch)
            if trainee.diverged:
                return
        weights = engine.masters(0).feed_forward[0]
        if network.arithmetic == "integer":
            weights = compensated(weights, moments)
        trainee.begun["outputs"] = weights
        at_start = trainee.at_start
        masters = replace(at_start, feed_forward=(*at_start.feed_forward[:-1], weights))
        trainee.end_epoch(masters, epoch, n)
        if training.keep == "best" and not trainee.diverged:
            trainee.consider(masters, *validated(_outputs_of(network, last, weights), hidden))
        if trainee.diverged or trainee.finished:
            break
    trainee.lay()


def _outputs_of(network: Network, last: Layer, weights: Floats) -> Network:
    """Return the outputs of a network alone, with other weights, (input, neuron)."""
    layer = replace(last, weight=np.ascontiguousarray(weights.T))
    return replace(network, layers=(layer,), n_channels=weights.shape[0], delays=(0,), steps_per_sample=1)
