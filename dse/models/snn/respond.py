"""What a trained network answers to samples, and what that costs it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dse.base.records import Array, Dataset, Ints, Network, Response
from dse.engine.events import Rows, gather
from dse.engine.forward import Prepared, prepare
from dse.engine.network import Answer, answer, layer_spikes
from dse.engine.neurons import population_of
from dse.engine.neurons.fixed_point import STATE_SCALE
from dse.measure.heads import head_answers, head_targets
from dse.models.snn.initialise import deployed

_BATCH = 128


def respond(network: Network, dataset: Dataset, samples: Array) -> Response:
    """Run a network on the evaluated windows of some samples.

    Args:
        network: a trained network; its weights are rounded to 8 bits here in integer arithmetic.
        dataset: spikes and windows.
        samples: (n,) sample numbers.
    """
    return respond_and_count(network, dataset, samples)[0]


def respond_and_count(
    network: Network, dataset: Dataset, samples: Array, *, of_inputs: bool = False
) -> tuple[Response, list[Array]]:
    """Respond, and count each layer's spikes, (sample, neuron); first those of input copies, (1, copy).

    The latter are 0 unless they are asked for, or synapses are missing, which they are counted for.
    """
    layers = layers_of(network)
    answers: list[Answer] = []
    per_input, is_full = np.zeros(network.sizes[0], np.int64), network.is_full
    for rows in batches_of(network, dataset, samples):
        answers.append(answer(rows, layers))
        if of_inputs or not is_full:
            per_input += np.bincount(rows.index, minlength=per_input.size)
    counts = [per_input[None], *(np.concatenate([a.fired[k] for a in answers]) for k in range(len(layers)))]
    response = Response(
        np.concatenate([a.output for a in answers]),
        np.concatenate([a.spikes for a in answers]),
        np.concatenate([a.updates for a in answers]),
        dataset.spikes.step_ms / network.steps_per_sample,
        round(max(a.peak for a in answers) * STATE_SCALE),
        None if is_full else synapses(network, counts),
    )
    return response, counts


def validated(network: Network, dataset: Dataset) -> tuple[float, int]:
    """Return the share of validation samples answered rightly, in all heads, and the peak state."""
    response = respond(network, dataset, dataset.validation)
    counts = response.output.sum(axis=1, dtype=np.int64)
    right = head_answers(dataset, counts) == head_targets(dataset, dataset.validation)
    return float(right.all(axis=1).mean()), response.peak_state


def spikes_of_layers(network: Network, dataset: Dataset, samples: Array) -> list[Ints]:
    """Return every spike of each layer after the input, (n_spikes, 3) int32: sample, network step, neuron.

    Sample i is the i-th of `samples`. The step is that in which the neuron fires: the next layer, or who
    decides, receives the spike one step later.
    """
    layers = layers_of(network)
    parts: list[list[Ints]] = [[np.zeros((0, 3), np.int32)] for _ in layers]
    first = 0
    for rows in batches_of(network, dataset, samples):
        for spikes, part in zip(layer_spikes(rows, layers), parts, strict=True):
            part.append(spikes.listed(first))
        first += rows.n_samples
    return [np.concatenate(part) for part in parts]


def counts_of_layers(network: Network, dataset: Dataset, samples: Array) -> list[Ints]:
    """Return how often each neuron of every hidden layer fires in some samples, (sample, neuron) each."""
    layers = layers_of(network)[:-1]
    parts = [
        [x.per_input() for x in layer_spikes(rows, layers)] for rows in batches_of(network, dataset, samples)
    ]
    return [np.concatenate(of_layer) for of_layer in zip(*parts, strict=True)]


def layers_of(network: Network) -> list[Prepared]:
    """Return the layers of a trained network as they run, rounded to 8 bits in integer arithmetic."""
    return [
        prepare(weights, network.arithmetic)
        for weights in deployed(
            [x.weight.T for x in network.layers],
            [None if x.recurrent is None else x.recurrent.T for x in network.layers],
            [population_of(x.neuron, x.parameters) for x in network.layers],
            network.arithmetic,
            [None if x.delay is None else x.delay.T for x in network.layers],
        )
    ]


def batches_of(network: Network, dataset: Dataset, samples: Array) -> Iterator[Rows]:
    """Yield the input spikes of some samples' windows as the network sees them."""
    for first in range(0, max(1, samples.size), _BATCH):
        part = samples[first : first + _BATCH]
        yield gather(
            dataset.spikes,
            part,
            dataset.start[part],
            dataset.n_steps,
            network.delays,
            network.steps_per_sample,
        )


def synapses(network: Network, counts: Sequence[Array]) -> tuple[float, ...]:
    """Return how many weights other than 0 a spike of each layer reaches, in the mean over the spikes.

    Args:
        network: a trained network.
        counts: from `respond_and_count`; without any spike, the mean is over neurons.
    """
    means = []
    for reached, of_samples in zip(fan_outs(network), counts, strict=True):
        spikes = of_samples.sum(axis=0)
        total = spikes.sum()
        means.append(float(reached @ spikes / total if total else reached.mean()))
    return tuple(means)


def fan_outs(network: Network) -> list[Array]:
    """Return per layer, input copies first, (neuron,) weights other than 0 that a spike of it reaches."""
    forward = [np.count_nonzero(layer.weight, axis=0) for layer in network.layers]
    back = [0 if x.recurrent is None else np.count_nonzero(x.recurrent, axis=0) for x in network.layers]
    none = np.zeros(network.sizes[-1], np.int64)
    return [a + b for a, b in zip([*forward, none], [0, *back], strict=True)]
