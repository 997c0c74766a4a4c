"""Spiking networks whose first layer is random kernels, those that the labels need; its outputs alone learn.

A candidate adds up what the spikes of some places stand for, now and as delayed (`input_delays`):

    drive(t) = sum over places p and delays d of s[p] w[d] rise[p](t - d),    s = 1 or -1, the sum of w is 0

where a spike of a channel of p raises p by what `dse.models.counts.levels.wiring` says. Up to four places,
their signs, two or more delays and their weights w are drawn; all other weights are 0, and a neuron costs the
few that it has. Which candidates stay is found as in `dse.models.snn.contrasts`.

Neurons whose current decays slowly and whose voltage decays at once (`voltage_decay` 1) hold the level that
rises add up to, and a reset forgets nothing: their spikes count the steps with a level above a threshold, as
features of random kernels do. Few recordings may teach a readout of such counts more than weights of a layer.
Source: [Dempster et al., MiniRocket in REFERENCES.md], of the signal itself and without spikes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from dse.base.records import Array, Dataset, Floats, Ints
from dse.base.registry import param, register
from dse.models.counts import levels
from dse.models.snn.contrasts import SHARES, Candidates, Drives
from dse.models.snn.family import OwnFirstLayer
from dse.models.training import Training

_PLACES = 4
_LARGEST_SEED = 2**31


@dataclass(frozen=True)
class Kernels(Candidates):
    """Random kernels, (neuron,) each.

    seed: what places, signs, delays and weights are drawn by.
    time: share of the time with a positive drive for which it exceeds the threshold.
    neuron: which of the layer's neurons it is: they can differ.
    """

    seed: Ints
    time: Floats
    neuron: Ints

    ridge: ClassVar[float] = 0.4
    absent: ClassVar[float] = 0.0

    @classmethod
    def drawn(cls, n_inputs: int, n: int, n_neurons: int, rng: np.random.Generator) -> Self:
        """Draw kernels, times on a logarithmic scale."""
        low, high = np.log(SHARES)
        time = np.exp(rng.uniform(low, high, n))
        return cls(rng.integers(_LARGEST_SEED, size=n), time, np.arange(n) % n_neurons)

    def near(self, n_inputs: int, n: int, rng: np.random.Generator) -> Self:
        """Draw others: none is close to another."""
        return self.drawn(n_inputs, n, int(self.neuron.max()) + 1, rng)

    def drive(self, j: int, drives: Drives) -> tuple[Ints, Floats]:
        """Return the inputs of a kernel and its weights of them, in units of their means."""
        rng = np.random.default_rng(int(self.seed[j]))
        place, rise = drives.wiring["place"], drives.wiring["sign"]
        delay, channel = np.divmod(drives.active, len(place))
        of_place, of_delay = np.zeros(int(place.max()) + 1), np.zeros(drives.n_inputs // len(place))
        places = rng.permutation(of_place.size)[: rng.integers(1, _PLACES + 1)]
        of_place[places] = rng.choice([-1.0, 1.0], places.size)
        delays = rng.permutation(of_delay.size)[: rng.integers(min(2, of_delay.size), of_delay.size + 1)]
        drawn = rng.uniform(-1, 1, delays.size)
        of_delay[delays] = drawn - drawn.mean() if delays.size > 1 else 1.0
        weights = of_place[place[channel]] * rise[channel] * of_delay[delay] * drives.means
        inputs = np.flatnonzero(weights)
        return inputs, weights[inputs]


@register("models", "kernel_snn")
@dataclass(frozen=True)
class KernelSNN(OwnFirstLayer):
    """Spiking network of random kernels, those that the labels need; its outputs alone learn."""

    hidden_layers: ClassVar[tuple[int, int]] = (1, 1)
    initial_rate: ClassVar[float] = 0.1  # type: ignore[misc]
    candidates: ClassVar[type[Candidates]] = Kernels
    hidden_spike_penalty: ClassVar[float] = 0.0  # type: ignore[misc]
    tau_grad: ClassVar[float] = 0.03  # type: ignore[misc]
    is_sparse: ClassVar[bool] = True

    # Its epochs cost little, and begin with a choice that costs most: a pause would save nothing.
    fit_span: ClassVar[None] = None  # type: ignore[assignment]

    hidden: tuple[int, ...] = param((100,), low=1, doc="kernels, one layer of them")
    dropout: float = param(
        0.3,
        low=0,
        high=1,
        high_open=True,
        doc="fraction of hidden neurons silenced per sample, in place of training.dropout",
    )

    def wiring(self, dataset: Dataset) -> Mapping[str, Array]:
        """Return the place of each channel, and what its spike adds to the level there."""
        return levels.wiring(dataset)

    def schedule(self, training: Training) -> Training:
        """Return how it trains: the outputs alone, in every epoch."""
        return replace(training, output_epochs=training.epochs, dropout=self.dropout)
