"""Stages of a training: what each begins with.

A training with `linear_epochs` has two. In the first no output neuron runs: the log-odds of the classes are
the spike counts of the last hidden layer times the output weights. These begin at 0, have no bias, and are
not rounded. The second trains the spiking outputs. They begin with the weights of the first, times the one
factor with which the most active output of each head fires at the mean of the target rates.

Either stage computes the basis of whitened matrices anew (dse.models.snn.whiten), begins Adam's moments and
the schedule of the learning rate anew, and takes the weights of all other layers over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dse.engine.events import delayed
from dse.engine.forward import prepare
from dse.engine.member import Stage
from dse.engine.network import layer_spikes
from dse.engine.parameters import product
from dse.models.snn.initialise import deployed, reach_rate
from dse.models.snn.respond import batches_of, counts_of_layers, layers_of
from dse.models.snn.trainee import Trainee, norm_units, units
from dse.models.snn.whiten import basis, covariance
from dse.neurons import population_of
from dse.neurons.fixed_point import within_range
from dse.neurons.response import response_norm
from dse.records import Array, Dataset, Floats, Ints, Network


def stage_of(trainee: Trainee, epoch: int, network: Network, dataset: Dataset, samples: Ints) -> Stage:
    """Return what a stage of a design's training begins with.

    Args:
        trainee: the design.
        epoch: 0, or the first with spiking outputs.
        network: of its weights; in the second stage with outputs as they are to begin.
        dataset: of its training.
        samples: training samples whose spikes are counted.
    """
    model, training = trainee.model, trainee.training
    layer, is_linear = trainee.member.layers[-1], epoch < training.linear_epochs
    counts = counts_of_layers(network, dataset, samples)
    bases = {depth: basis(counts[depth - 1]) for depth in model.whitened_layers}
    output = None
    if is_linear:
        scales, _ = covariance(counts[-1])
        length = bases[len(counts)][1] if len(counts) in bases else np.sqrt((scales**2).mean())
        unit = np.full_like(layer.unit, length)  # of log-odds
        output = replace(layer, feed_forward=np.zeros_like(layer.feed_forward), unit=unit, norm_unit=None)
    elif training.linear_epochs:
        weights = np.ascontiguousarray(network.layers[-1].weight.T)
        step = training.step_unit, 2.0 ** model.exponent(len(model.hidden))
        norms = None if layer.norm_unit is None else norm_units(weights, *step)
        unit = units(weights, *step, layer.shared)
        output = replace(layer, feed_forward=weights, unit=unit, norm_unit=norms)
    return Stage({depth: matrix for depth, (matrix, _) in bases.items()}, is_linear, output)


def spiking_outputs(
    network: Network, dataset: Dataset, probe: Ints, heads: Sequence[int], rate: float
) -> tuple[Floats, float]:
    """Return the weights of spiking outputs, (input, neuron), those of a linear readout times one factor.

    Args:
        network: with the readout as its outputs' weights.
        dataset: of its training.
        probe: at most a batch of samples, on which the rate is reached.
        heads: classes of each head.
        rate: spikes per step of the most active output of each head, in the mean.

    Returns:
        The weights, and the rate that they reach.
    """
    *before, _ = layers_of(network)
    rows = delayed(layer_spikes(next(batches_of(network, dataset, probe)), before)[-1])
    last = network.layers[-1]
    population = population_of(last.neuron, last.parameters)
    readout, delay = last.weight.T.astype(np.float64), None if last.delay is None else last.delay.T

    def most(of_outputs: Array) -> float:
        parts = np.split(of_outputs, np.cumsum(heads)[:-1], axis=1)
        return float(np.mean([x.max(axis=1).mean() for x in parts])) / rows.n_steps

    def reached(gain: float) -> float:
        weights = (gain * readout).astype(np.float32)
        (one,) = deployed([weights], [None], [population], network.arithmetic, [delay])
        return most(prepare(one, network.arithmetic).forward(rows).fired.per_input())

    drive = most(product(rows.per_input().astype(np.float64), readout))
    unit = population.to_threshold / response_norm(population, readout.shape[1], rows.n_steps)
    gain, found = reach_rate(reached, rate, float(np.mean(unit)) / drive if drive > 0 else 1.0)
    within = within_range if network.arithmetic == "integer" else np.asarray
    return within((gain * readout).astype(np.float32)), found
