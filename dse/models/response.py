"""What a trained network answers to samples, and what that costs it."""

from __future__ import annotations

import numpy as np

from dse.engine.events import gather
from dse.engine.layers import prepare
from dse.engine.network import Answer, answer
from dse.models.initialisation import deployed
from dse.neurons import cuba_lif
from dse.records import Array, Dataset, Network, Response

_BATCH = 128


def respond(network: Network, dataset: Dataset, samples: Array) -> Response:
    """Run a network on the evaluated windows of some samples.

    Args:
        network: a trained network; its weights are rounded to 8 bits here in integer arithmetic.
        dataset: spikes and windows.
        samples: (n,) sample numbers.
    """
    return respond_and_count(network, dataset, samples)[0]


def respond_and_count(network: Network, dataset: Dataset, samples: Array) -> tuple[Response, list[Array]]:
    """Respond, and count each layer's spikes per neuron."""
    layers = [
        prepare(weights, network.arithmetic)
        for weights in deployed(
            [x.weight.T for x in network.layers],
            [None if x.recurrent is None else x.recurrent.T for x in network.layers],
            network.layers,
            network.arithmetic,
        )
    ]
    answers: list[Answer] = []
    for first in range(0, max(1, samples.size), _BATCH):
        part = samples[first : first + _BATCH]
        rows = gather(
            dataset.spikes,
            part,
            dataset.start[part],
            dataset.n_steps,
            network.delays,
            network.steps_per_sample,
        )
        answers.append(answer(rows, layers))
    response = Response(
        np.concatenate([a.output for a in answers]),
        np.concatenate([a.spikes for a in answers]),
        np.concatenate([a.updates for a in answers]),
        dataset.spikes.step_ms / network.steps_per_sample,
        round(max(a.peak for a in answers) * cuba_lif.STATE_SCALE),
    )
    return response, [np.sum([a.fired[k] for a in answers], axis=0) for k in range(len(layers))]
