"""Dense CUBA-LIF classifiers: 1 to 3 hidden layers, trained by SpikeRate with a surrogate gradient."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from dse.engine.batch import chunk_samples
from dse.engine.layout import padded
from dse.models import cohort
from dse.models.training import Design, Generators, Training, TrainingDiverged
from dse.records import Arithmetic, Dataset, Outcome
from dse.registry import param, register

# Nanoseconds per summed weight, per neuron and step, per weight and batch, and per batch: measured on one
# core of a 2023 server CPU (benchmarks/train_step.py). Only their ratios matter.
_SUM_NS, _SCAN_NS, _UPDATE_NS, _CALL_NS = 0.04, 1.3, 1.2, 3e5


@register("models", "snn")
@dataclass(frozen=True)
class SNN:
    """Feed-forward or recurrent CUBA-LIF classifier (equations: dse.neurons.cuba_lif)."""

    hidden: tuple[int, ...] = param((100,), low=1, doc="neurons of each hidden layer, 1 to 3 layers")
    true_rate: float = param(0.8, low=0, high=1, doc="target spike rate of the label's output neuron")
    false_rate: float = param(0.02, low=0, high=1, doc="target spike rate of the other output neurons")
    threshold: float = param(1.25, low=1 / 64, unit="weight", doc="firing threshold; weights lie in -4..3.97")
    current_decay: tuple[float, ...] = param(
        (0.25,),
        low=0,
        high=1,
        doc="current decay per input step; two bounds spread it over neurons",
    )
    voltage_decay: tuple[float, ...] = param(
        (0.03,),
        low=0,
        high=1,
        doc="voltage decay per input step; two bounds spread it over neurons",
    )
    output_current_decay: float = param(0.25, low=0, high=1, doc="current decay of output neurons")
    output_voltage_decay: float = param(0.03, low=0, high=1, doc="voltage decay of output neurons")
    tau_grad: float = param(0.03, low=0, low_open=True, doc="hidden surrogate width / (100 thresholds)")
    output_tau_grad: float = param(
        0.03, low=0, low_open=True, doc="output surrogate width / (100 thresholds)"
    )
    scale_grad: float = param(3.0, low=0, low_open=True, doc="height of the surrogates (Adam cancels it)")
    input_delays: tuple[int, ...] = param((0,), low=0, unit="input steps", doc="one input copy per delay")
    steps_per_sample: int = param(1, low=1, high=16, doc="network steps per input step")
    recurrent: bool = param(False, doc="each hidden layer also feeds itself one step later")
    initial_rate: float = param(
        0.1, low=0, low_open=True, high=1, doc="spikes per hidden neuron and step at start"
    )
    surrogate_cut: float = param(
        0.0, low=0, high=1, high_open=True, doc="below this share of its height a surrogate is 0"
    )
    arithmetic: Arithmetic = param(  # noqa: RUF009
        "integer",
        choices=("integer", "float32", "ideal"),
        doc="integer is what deploys; ideal: real numbers in float64",
    )

    def __post_init__(self) -> None:
        """Check what one key alone cannot say."""
        if not 1 <= len(self.hidden) <= 3:
            raise ValueError(f"hidden must name 1 to 3 layers, got {len(self.hidden)}")
        for name in ("current_decay", "voltage_decay"):
            if not 1 <= len(getattr(self, name)) <= 2:
                raise ValueError(
                    f"{name} must be one decay or two bounds, got {len(getattr(self, name))} numbers"
                )
        if not self.input_delays or len(set(self.input_delays)) != len(self.input_delays):
            raise ValueError(f"input_delays must be distinct and at least one, got {list(self.input_delays)}")
        if self.false_rate >= self.true_rate:
            raise ValueError(f"false_rate must be below true_rate ({self.true_rate}), got {self.false_rate}")

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        """Train alone on `dataset.train`; respond on validation and, where there is one, on test.

        Raises:
            TrainingDiverged: loss, gradient or weights became NaN, infinite or hopelessly large.
            ValueError: there are no training samples.
        """
        ((_, outcome),) = cohort.train(dataset, [Design(self, training, rngs)], rngs)
        if isinstance(outcome, TrainingDiverged):
            raise outcome
        return outcome

    @staticmethod
    def fit_cohort(
        dataset: Dataset,
        designs: Sequence[Design],
        shared: Generators,
        device: str = "cpu",
        threads: int = 1,
    ) -> Iterator[tuple[int, Outcome | TrainingDiverged]]:
        """Train designs on the same batches; see `dse.models.cohort.train`."""
        return cohort.train(dataset, designs, shared, device, threads)

    def shares(self, training: Training) -> tuple[Hashable, ...]:
        """Return what designs must have in common to train on the same batches."""
        return self.input_delays, self.steps_per_sample, training.batch_size

    def n_weights(self, n_channels: int, n_classes: int) -> int:
        """Return W_t: weights between layers (delayed input copies included) and recurrent weights."""
        return sum(a * b for a, b in self._matrices(n_channels, n_classes))

    def memory_bytes(self, n_channels: int, n_classes: int, n_steps: int, training: Training) -> int:
        """Return what a design holds at most while it trains in a cohort, without what its cohort shares.

        Args:
            n_channels: input channels, delayed copies not counted.
            n_classes: output neurons.
            n_steps: window length in input steps.
            training: settings of its training.
        """
        real = 8 if self.arithmetic == "ideal" else 4
        # Master weights, two moments, initial weights, gradient, int8 weights; the mean of the last epochs.
        return sum(a * padded(b) * (4 * 4 + real + 1 + 8) for a, b in self._matrices(n_channels, n_classes))

    def workspace_bytes(
        self, n_channels: int, n_classes: int, n_steps: int, training: Training, threads: int = 1
    ) -> int:
        """Return what designs of a cohort hold one at a time (arguments as in `memory_bytes`).

        That is per thread one chunk's surrogates, spikes, spike lists and gradients, and the temporary arrays
        in which weights are drawn, copied and averaged.
        """
        steps = n_steps * self.steps_per_sample
        rows = chunk_samples(training.batch_size, steps) * steps
        real = 8 if self.arithmetic == "ideal" else 4
        columns = [padded(n) for n in (*self.hidden, n_classes)]
        chunk = sum(rows * (n * (real + 4) + n // 8 + 8) for n in columns) + rows * 4 * max(columns)
        weights = sum(a * padded(b) for a, b in self._matrices(n_channels, n_classes))
        deeper = weights - self._matrices(n_channels, n_classes)[0][0] * padded(self.hidden[0])
        own = threads * (chunk + real * deeper) + (threads - 1) * real * (weights - deeper)
        return own + 48 * weights

    def cost(
        self, n_channels: int, n_classes: int, n_steps: int, n_events: float, n_train: int, training: Training
    ) -> float:
        """Return an estimate of the CPU seconds that training takes, good enough to balance work.

        Args:
            n_channels: input channels, delayed copies not counted.
            n_classes: output neurons.
            n_steps: window length in input steps.
            n_events: mean input spikes of a window, delayed copies not counted.
            n_train: training samples.
            training: settings of the training.
        """
        steps = n_steps * self.steps_per_sample
        columns = [padded(n) for n in (*self.hidden, n_classes)]
        spikes = [n_events * len(self.input_delays), *(self.initial_rate * steps * h for h in self.hidden)]
        summed = sum(a * b for a, b in zip(spikes, columns, strict=True))
        batches = -(-n_train // training.batch_size)
        weights = sum(a * padded(b) for a, b in self._matrices(n_channels, n_classes))
        per_sample = _SUM_NS * summed + _SCAN_NS * steps * sum(columns)
        per_batch = _UPDATE_NS * weights + _CALL_NS
        return 1e-9 * training.epochs * (n_train * per_sample + batches * per_batch)

    def _matrices(self, n_channels: int, n_classes: int) -> list[tuple[int, int]]:
        """Return (inputs, neurons) of every weight matrix, recurrent ones included."""
        sizes = (n_channels * len(self.input_delays), *self.hidden, n_classes)
        return [*pairwise(sizes), *((h, h) for h in self.hidden if self.recurrent)]
