"""Dense spiking classifiers: 1 to 3 hidden layers, trained with a surrogate gradient."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from dse.base.records import (
    Array,
    Dataset,
    Floats,
    Network,
    Operations,
    Outcome,
    Parameters,
    Response,
    Workload,
)
from dse.base.registry import register
from dse.config.contracts import LeastWork
from dse.engine.batch import DIFFERENTIATED_ROWS, chunk_samples
from dse.engine.layout import padded
from dse.engine.neurons import Neuron
from dse.models.snn import respond, train
from dse.models.snn.settings import Stack
from dse.models.snn.whiten import SAMPLES
from dse.models.training import FitRequest, Generators, Rung, Span, Training, TrainingDiverged

# Nanoseconds per summed weight, per neuron and step, per weight and batch, and per batch: measured on one
# core of a 2023 server CPU (benchmarks/train_step.py). Only their ratios matter.
_SUM_NS, _SCAN_NS, _UPDATE_NS, _CALL_NS = 0.04, 1.3, 1.2, 3e5
_DELAY_NS = 0.12  # per synapse with a delay and step
_BASIS_NS = 0.6  # per number of a basis and neuron
# Of automatic differentiation: per neuron and step, and per step of a layer and batch.
_TORCH_CELL_NS, _TORCH_STEP_NS = 150.0, 4e5
# Tensors of a layer's size that it keeps of every step, and what torch itself takes.
_TORCH_TENSORS, _TORCH_BYTES = 16, 250 * 2**20


@register("models", "snn")
@dataclass(frozen=True)
class SNN(Stack):
    """Feed-forward or recurrent spiking classifier; `neuron` names the kind of its neurons."""

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        """Train alone on `dataset.train`; respond on validation and, where there is one, on test.

        Raises:
            TrainingDiverged: loss, gradient or weights became NaN, infinite or hopelessly large.
            ValueError: there is no training sample.
        """
        ((_, outcome),) = train.train(dataset, [FitRequest(self, training, rngs)], rngs)
        if isinstance(outcome, TrainingDiverged):
            raise outcome
        assert isinstance(outcome, Outcome)  # nobody has asked for a pause
        return outcome

    def respond(self, fitted: Network, dataset: Dataset, samples: Array) -> Response:
        """Run a trained network on the evaluated windows of some samples."""
        return respond.respond(fitted, dataset, samples)

    def scores(self, fitted: Network | Parameters, dataset: Dataset, samples: Array) -> Floats:
        """Return output spikes times the loss's `count_scale`; without one, the logarithm of 1 + spikes."""
        assert isinstance(fitted, Network)
        counts = self.respond(fitted, dataset, samples).output.sum(axis=1, dtype=np.int64)
        scale: float | None = getattr(self.loss, "count_scale", None)
        return np.asarray(np.log1p(counts) if scale is None else scale * counts)

    @staticmethod
    def fit_cohort(
        dataset: Dataset,
        designs: Sequence[FitRequest[Stack]],
        shared: Generators,
        device: str = "cpu",
        threads: int = 1,
    ) -> Iterator[tuple[int, Outcome | TrainingDiverged]]:
        """Train designs on the same batches; see `dse.models.snn.train.train`."""
        for number, ended in train.train(dataset, designs, shared, device, threads):
            assert not isinstance(ended, Rung)  # nobody has asked for a pause
            yield number, ended

    @staticmethod
    def fit_span(
        dataset: Dataset,
        designs: Sequence[FitRequest[Stack]],
        shared: Generators,
        device: str = "cpu",
        threads: int = 1,
        span: Span = Span(),  # noqa: B008
    ) -> Iterator[tuple[int, Outcome | Rung | TrainingDiverged]]:
        """Train designs on the same batches from where they stand; see `dse.models.snn.train.train`."""
        return train.train(dataset, designs, shared, device, threads, span)

    def n_weights(self, n_channels: int, n_classes: int) -> int:
        """Return W_t before pruning: between layers (delayed copies included) and within recurrent ones."""
        return sum(a * b for a, b in self.matrices(n_channels, n_classes))

    def least_work(self, n_channels: int, n_outputs: int, step_ms: float, n_steps: int) -> LeastWork:
        """Return the trained network as hardware sees it, without a spike (`dse.config.contracts.LeastWork`).

        Args:
            n_channels: input channels, delayed copies not counted.
            n_outputs: outputs of all heads.
            step_ms: duration of an input step.
            n_steps: network steps of the shortest inference.
        """
        sizes = (n_channels * len(self.input_delays), *self.hidden, n_outputs)
        recurrent = (*(self.recurrent for _ in self.hidden), False)
        shared = self.sharing(n_outputs)
        stored = tuple(
            0
            if self.is_sparse
            else b * b * back + (a * b if number is None else int(np.count_nonzero(number >= 0)))
            for a, b, back, number in zip(sizes, sizes[1:], recurrent, shared, strict=False)
        )
        least = Workload(
            sizes=sizes,
            recurrent=recurrent,
            n_steps=np.asarray(float(n_steps)),
            spikes=np.zeros(len(sizes)),
            updates=np.zeros(len(sizes) - 1),
            step_ms=step_ms / self.steps_per_sample,
            stored=stored,
            delay_bits=1 if self.longest_delay else 0,
            delayed=tuple(map(self.has_delays, range(len(recurrent)))) if self.longest_delay else (),
            copies=len(self.input_delays),
            steps_per_sample=self.steps_per_sample,
            n_slots=max(self.input_delays) // self.steps_per_sample + 1,
        )
        # Pruning or kernels may leave any weight at 0, training any delay at 1, and resonators are drawn.
        draws = type(self.neuron).resonators.__func__ is not Neuron.resonators.__func__  # type: ignore[attr-defined]
        is_exact = not self.is_sparse and self.longest_delay <= 1 and not draws
        if self.neuron.on_chips:
            return LeastWork(least, is_exact)
        n_weights = 0 if self.is_sparse else self.n_weights(n_channels, n_outputs)
        counted = Operations(
            macs=np.zeros(()),
            additions=np.zeros(()),
            updates=np.zeros(()),
            n_weights=np.asarray(float(n_weights)),
            duration_ms=np.asarray(n_steps * least.step_ms),
            number_bits=least.weight_bits if self.arithmetic == "integer" else 32,
        )
        return LeastWork(counted, is_exact)

    def memory_bytes(self, n_channels: int, n_classes: int, n_steps: int, training: Training) -> int:
        """Return what a design holds at most while it trains in a cohort, without what its cohort shares.

        Args:
            n_channels: input channels, delayed copies not counted.
            n_classes: output neurons, of all heads.
            n_steps: window length in input steps.
            training: settings of its training.
        """
        real = 8 if self.arithmetic == "ideal" else 4
        # Master weights, two moments, initial weights, gradient, int8 weights; the mean of the last epochs.
        per_weight = 4 * 4 + real + 1 + 8 + (real + 1 if self.pruned else 0)  # which are kept, twice
        # Delays are rounded by a byte, and have the gradient in the workspace as well.
        per_delay = 4 * 3 + real + 1 + 4
        weights = sum(a * padded(b) * per_weight for a, b in self._learnt(n_channels, n_classes))
        delays = sum(a * padded(b) * per_delay for a, b in self._delayed(n_channels, n_classes))
        # Regions: the matrix of all channels, as it is stored and as it runs.
        stored = 13 * n_channels * len(self.input_delays) * padded(self.hidden[0]) if self.regions else 0
        if self.weight_norm:  # the weights beside the directions
            weights += sum(4 * a * padded(b) for a, b in self._learnt(n_channels, n_classes))
        # A basis and its transpose, and the counts that it is of.
        bases = sum(12 * a * a + 20 * SAMPLES * a for a, _ in self._whitened(n_channels, n_classes))
        return weights + delays + stored + bases

    def _whitened(self, n_channels: int, n_classes: int) -> list[tuple[int, int]]:
        """Return (inputs, neurons) of the matrices that are learnt in a whitened basis."""
        return [self.matrices(n_channels, n_classes)[depth] for depth in self.whitened_layers]

    def _learnt(self, n_channels: int, n_classes: int) -> list[tuple[int, int]]:
        """Return (inputs, neurons) of every weight matrix as it is learnt: channels of a region are one."""
        first, *deeper = self.matrices(n_channels, n_classes)
        n_pools = self.regions * len(self.input_delays) or first[0]
        return [(min(first[0], n_pools), first[1]), *deeper]

    def _delayed(self, n_channels: int, n_classes: int) -> list[tuple[int, int]]:
        """Return (inputs, neurons) of the matrices whose synapses have delays."""
        matrices = self.matrices(n_channels, n_classes)[: len(self.hidden) + 1]
        return [matrix for depth, matrix in enumerate(matrices) if self.has_delays(depth)]

    def workspace_bytes(
        self, n_channels: int, n_classes: int, n_steps: int, training: Training, threads: int = 1
    ) -> int:
        """Return what designs of a cohort hold one at a time (arguments as in `memory_bytes`).

        That is per thread one chunk's surrogates, spikes, spike lists and gradients, and the temporary arrays
        in which weights are drawn, copied and averaged.
        """
        steps = n_steps * self.steps_per_sample
        if not self.has_kernel:
            samples = min(training.batch_size, max(1, DIFFERENTIATED_ROWS // steps))
            cells = samples * steps * sum((*self.hidden, n_classes))
            weights = sum(a * b for a, b in self.matrices(n_channels, n_classes))
            return _TORCH_BYTES + 8 * _TORCH_TENSORS * cells + 48 * weights
        rows = chunk_samples(training.batch_size, steps) * steps
        real = 8 if self.arithmetic == "ideal" else 4
        columns = [padded(n) for n in (*self.hidden, n_classes)]
        chunk = sum(rows * (n * (real + 4) + n // 8 + 8) for n in columns) + rows * 4 * max(columns)
        learnt = self._learnt(n_channels, n_classes)
        weights = sum(a * padded(b) for a, b in learnt)
        deeper = weights - learnt[0][0] * padded(self.hidden[0])
        # Of layers with delays: dL/dz by neuron, twice, trains of bits, and the gradient by the delays.
        late = max(
            (
                2 * real * rows * padded(b)
                + 4 * a * (rows // 8 + 8 * training.batch_size)
                + real * a * padded(b)
                for a, b in self._delayed(n_channels, n_classes)
            ),
            default=0,
        )
        own = threads * (chunk + late + real * deeper) + (threads - 1) * real * (weights - deeper)
        return own + 48 * weights

    def cost(
        self, n_channels: int, n_classes: int, n_steps: int, n_events: float, n_train: int, training: Training
    ) -> float:
        """Return an estimate of the CPU seconds that training takes, good enough to balance work.

        Args:
            n_channels: input channels, delayed copies not counted.
            n_classes: output neurons, of all heads.
            n_steps: window length in input steps.
            n_events: mean input spikes of a window, delayed copies not counted.
            n_train: training samples.
            training: settings of the training.
        """
        steps = n_steps * self.steps_per_sample
        columns = [padded(n) for n in (*self.hidden, n_classes)]
        learnt = self._learnt(n_channels, n_classes)
        n_spikes = n_events * len(self.input_delays)
        if self.regions:
            n_spikes = min(n_spikes, steps * learnt[0][0])
        spikes = [n_spikes, *(self.initial_rate * steps * h for h in self.hidden)]
        summed = sum(a * b for a, b in zip(spikes, columns, strict=True))
        batches = -(-n_train // training.batch_size)
        if not self.has_kernel:
            layers = len(columns) * max(1, training.batch_size * steps // DIFFERENTIATED_ROWS)
            per_epoch = (
                _TORCH_CELL_NS * n_train * steps * sum(columns) + _TORCH_STEP_NS * batches * steps * layers
            )
            return 1e-9 * training.epochs * per_epoch
        weights = sum(a * padded(b) for a, b in learnt)
        per_sample = _SUM_NS * summed + _SCAN_NS * steps * sum(columns)
        per_sample += _DELAY_NS * steps * sum(a * b for a, b in self._delayed(n_channels, n_classes))
        per_batch = _UPDATE_NS * weights * (3 if self.weight_norm else 1) + _CALL_NS
        per_batch += _BASIS_NS * sum(a * a * padded(b) for a, b in self._whitened(n_channels, n_classes))
        return 1e-9 * training.epochs * (n_train * per_sample + batches * per_batch)


@dataclass(frozen=True)
class OwnFirstLayer(SNN):
    """A spiking classifier that makes its first layer by rules of its own: keys of a free one are fixed."""

    recurrent: ClassVar[bool] = False  # type: ignore[misc]
    weight_norm: ClassVar[bool] = False  # type: ignore[misc]
    pruned: ClassVar[float] = 0.0  # type: ignore[misc]
    prune_epoch: ClassVar[float] = 0.0  # type: ignore[misc]
    max_delay: ClassVar[int] = 0  # type: ignore[misc]
    max_axonal_delay: ClassVar[int] = 0  # type: ignore[misc]
    learnt_decays: ClassVar[str] = "no"  # type: ignore[misc]
    decay_learning_rate: ClassVar[float] = 0.0  # type: ignore[misc]
    delayed_layers: ClassVar[str] = "first"  # type: ignore[misc]
    delay_learning_rate: ClassVar[float] = 0.0  # type: ignore[misc]
    regions: ClassVar[int] = 0  # type: ignore[misc]
    start: ClassVar[Literal["uniform"]] = "uniform"  # type: ignore[misc]
    rounding: ClassVar[Literal["nearest"]] = "nearest"  # type: ignore[misc]
    weight_scale: ClassVar[float] = 1.0  # type: ignore[misc]
