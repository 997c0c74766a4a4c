"""What a training ends with: the network of its masters, what it answers, and how healthy it is."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from dse.base.records import Array, Dataset, Ints, Layer, Network, Outcome, Response
from dse.engine.member import Masters
from dse.engine.neurons import Population, cuba_lif, name_of_population, parameters_of
from dse.engine.neurons.fixed_point import HIGHEST_WEIGHT, LOWEST_WEIGHT, STATE_LIMIT, STATE_SCALE, quantise
from dse.engine.shared import distinct
from dse.measure.heads import head_answers, head_targets
from dse.models.snn import whiten
from dse.models.snn.quantise import FINEST, dithered, finer, finest, remaining
from dse.models.snn.respond import batches_of, layers_of, respond_and_count
from dse.models.snn.trainee import SATURATED, Trainee

_FEW_DIRECTIONS = 0.5  # per output: what tells so many classes apart is then in small differences
COLLAPSED = 0.99
"""Share of the samples with one answer that counts as all."""


def deployed(trainee: Trainee, masters: Masters, dataset: Dataset) -> Network:
    """Return the network of trained weights, delays and decays."""
    return _network(trainee, masters, dataset.spikes.n_channels, _exponent(trainee, masters, dataset))


def outcome(trainee: Trainee, masters: Masters, dataset: Dataset) -> Outcome:
    """Return a design's network of these weights, and its responses."""
    began = time.perf_counter()
    exponent = _exponent(trainee, masters, dataset)
    model, network = trainee.model, _network(trainee, masters, dataset.spikes.n_channels, exponent)
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


def _exponent(trainee: Trainee, masters: Masters, dataset: Dataset) -> int:
    """Return the exponent of the first layer's thresholds and weights as they run.

    Where it is free, it is the largest whose 8 bits hold the weights and whose states stay within half of
    24 bits on validation samples: others reach further.
    """
    model, first = trainee.model, _trained(trainee, masters)[0]
    if first is None or not model.is_free(0):
        return model.exponent(0)
    exponent = finest(first * 2.0**-FINEST, FINEST)
    network = _network(trainee, masters, dataset.spikes.n_channels, exponent)
    layer, windows = layers_of(network)[0], batches_of(network, dataset, dataset.validation)
    peak = max(layer.forward(rows, count=True).peak for rows in windows) * STATE_SCALE
    over = math.ceil(math.log2(max(1.0, peak / (STATE_LIMIT / 2))))
    return max(0, exponent - over)


def _network(trainee: Trainee, masters: Masters, n_channels: int, exponent: int) -> Network:
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
        delays=model.delays,
        steps_per_sample=model.steps_per_sample,
        arithmetic=model.arithmetic,
    )


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
