"""What designs share that train side by side: their data, what is drawn from it, and the batches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from dse.base.records import Array, Bools, Dataset, Floats, Ints, Spikes
from dse.base.seeds import position
from dse.engine.events import Rows, gather, without
from dse.engine.forward import prepare
from dse.engine.goal import is_label
from dse.engine.layers import weights as layer_weights
from dse.engine.member import State
from dse.engine.neurons import Population
from dse.engine.neurons.fixed_point import quantise
from dse.measure.heads import head_sizes, output_labels
from dse.models.snn import contrasts, whiten
from dse.models.snn.augment import Augmentation
from dse.models.snn.settings import Stack
from dse.models.snn.trainee import Trainee
from dse.models.training import FitRequest, Generators

PROBE_SAMPLES = 64


class Batch(NamedTuple):
    """Samples, their input spikes, and which share of the epoch was over before."""

    samples: Ints
    rows: Rows
    share: float


class Cohort:
    """Designs that go through the same batches.

    dataset: of all. probe: samples on which initial rates are reached, and `probed` their input spikes.
    counted: samples on which layers are looked at before they train. draws: generators by purpose.
    """

    def __init__(self, dataset: Dataset, first: FitRequest[Stack], shared: Generators) -> None:
        """Take what the designs share.

        Args:
            dataset: spikes, windows, split.
            first: one of the designs, which agree in what is read of it here (`Stack.shares`).
            shared: random generators of what the designs share.
        """
        self.dataset, self._model, self._training = dataset, first.model, first.training
        self.draws = {name: shared(name) for name in ("batches", "crops", "input dropout")}
        self._augmentation = None
        if first.training.augmentation:
            self._augmentation = Augmentation(dataset, first.training, shared)
            self.draws |= self._augmentation.draws
        self.probe = shared("probe").permutation(dataset.train)[:PROBE_SAMPLES]
        self.probed = self._rows(dataset.spikes, self.probe, dataset.start[self.probe])
        self.counted = shared("whitening").permutation(dataset.train)[: whiten.SAMPLES]

    @property
    def n_steps(self) -> int:
        """Network steps of a window."""
        return self.dataset.n_steps * self._model.steps_per_sample

    @property
    def batch_size(self) -> int:
        """Samples of the largest batch."""
        return min(self._training.batch_size, self.dataset.train.size)

    def begin(self, number: int, design: FitRequest[Stack], start: State) -> Trainee:
        """Draw a design's neurons and weights; `start` holds what of its beginning is known already."""
        data, model = self.dataset, design.model
        pool, heads = model.pool(data.positions), head_sizes(data)

        def windows(n_samples: int, size: int) -> Iterator[Rows]:
            samples = self.counted[: n_samples or None]
            of_channels = None if pool is None else pool[: data.spikes.n_channels]
            for part in np.split(samples, range(size, samples.size, size)):
                yield self._rows(data.spikes, part, data.start[part], of_channels)

        def run(weights: Floats, population: Population[Any]) -> tuple[Ints, Bools]:
            is_whole = model.arithmetic == "integer" and not model.is_dithered(0)
            matrix = quantise(weights) if is_whole else weights.astype(np.float32)
            layer = prepare(layer_weights(matrix, None, population), model.arithmetic)
            return contrasts.run_candidates(layer, population.to_threshold, windows, model.most_peak)

        choice = contrasts.Choice(
            run,
            is_label(output_labels(data, self.counted), sum(heads)),
            model.hidden_spike_penalty,
            start.get("chosen"),
            model.wiring(data),
        )
        trainee = Trainee.start(number, design, self.probed, data.spikes.step_ms, heads, pool, choice)
        trainee.begun |= start
        trainee.lay()
        return trainee

    def batches(self) -> Iterator[Batch]:
        """Draw the batches of an epoch: the order of the samples, and the window of each."""
        data, size = self.dataset, self._training.batch_size
        order = self.draws["batches"].permutation(data.train)
        starts = self.draws["crops"].integers(data.start_low[order], data.start_high[order], endpoint=True)
        for first in range(0, order.size, size):
            samples, start = order[first : first + size], starts[first : first + size]
            yield Batch(samples, self._of_batch(samples, start), first // size / -(-order.size // size))

    def state(self) -> dict[str, Array]:
        """Return where its draws are, by name."""
        return {f"shared/{name}": position(rng) for name, rng in self.draws.items()}

    def _of_batch(self, samples: Ints, start: Ints) -> Rows:
        """Return the input spikes of a batch, as training is to see them."""
        spikes = self.dataset.spikes
        if self._augmentation is not None:
            spikes = self._augmentation.batch(samples, start)
            samples, start = np.arange(samples.size), np.zeros(samples.size, np.int64)
        rows = self._rows(spikes, samples, start)
        if share := self._training.input_dropout:
            shape = rows.n_samples, self.dataset.spikes.n_channels
            rows = without(rows, self.draws["input dropout"].random(shape) < share)
        return rows

    def _rows(self, spikes: Spikes, samples: Ints, start: Ints, pool: Ints | None = None) -> Rows:
        per_sample = self._model.steps_per_sample
        return gather(spikes, samples, start, self.dataset.n_steps, self._model.delays, per_sample, pool)
