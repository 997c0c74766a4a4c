"""Dense CUBA-LIF classifiers: 1 to 3 hidden layers, trained by SpikeRate with a surrogate gradient."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dse.engine.events import Rows, gather
from dse.engine.network import Answer, answer, gradients
from dse.models.initialisation import deployed, initialise, populations_of
from dse.models.training import Adam, Generators, Training, TrainingDiverged
from dse.neurons import cuba_lif
from dse.neurons.surrogate import exponential
from dse.records import Array, Dataset, Layer, Network, Outcome, Response
from dse.registry import param, register

_PROBE_SAMPLES = 64
_RESPOND_BATCH = 128


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
    arithmetic: str = param("integer", choices=("integer", "ideal"), doc="integer is what deploys")

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
        """Train on `dataset.train` and respond on validation and test (see `fit`)."""
        return fit(dataset, self, training, rngs)

    def n_weights(self, n_channels: int, n_classes: int) -> int:
        """Return W_t: weights between layers (delayed input copies included) and recurrent weights."""
        sizes = (n_channels * len(self.input_delays), *self.hidden, n_classes)
        dense = sum(a * b for a, b in pairwise(sizes))
        return dense + (sum(h * h for h in self.hidden) if self.recurrent else 0)


def _step_units(masters: Sequence[Array], unit: str) -> list[Array]:
    """Return what a learning rate of 1 is for each array: one weight, or each neuron's initial rms weight."""
    if unit == "weight":
        return [np.ones(w.shape[1], np.float32) for w in masters]
    return [np.sqrt((w**2).mean(axis=0)) for w in masters]


def _silencing(
    training: Training, hidden: Sequence[int], n: int, rng: np.random.Generator
) -> list[Array | None]:
    """Return per layer the factors of its inputs' spikes: dropout of whole hidden neurons per sample."""
    gains: list[Array | None] = [None]
    for size in hidden:
        kept = rng.random((n, size)) >= training.dropout if training.dropout else None
        gains.append(None if kept is None else (kept / np.float32(1 - training.dropout)).astype(np.float32))
    return gains


def fit(dataset: Dataset, model: SNN, training: Training, rngs: Generators) -> Outcome:
    """Train a classifier on `dataset.train`; respond on validation and, where there is one, on test.

    The weights that are kept are those of the last epoch (or the mean of the last epochs), whatever
    validation says of earlier ones.

    Args:
        dataset: spikes, windows, split.
        model: settings of the family.
        training: settings of Adam and its schedule.
        rngs: random generators by purpose ('time constants', 'initialisation', 'batches', ...).

    Raises:
        TrainingDiverged: loss, gradient or weights became NaN or infinite.
        ValueError: there are no training samples.
    """
    if not dataset.train.size:
        raise ValueError("training needs at least one training sample, got none")
    began = time.perf_counter()
    integer = model.arithmetic == "integer"
    n_steps = dataset.n_steps * model.steps_per_sample
    delays = tuple(d * model.steps_per_sample for d in model.input_delays)
    populations = populations_of(model, len(dataset.classes), n_steps, rngs("time constants"))
    surrogates = [exponential(p.threshold, model.tau_grad, model.scale_grad) for p in populations[:-1]]
    surrogates.append(exponential(populations[-1].threshold, model.output_tau_grad, model.scale_grad))

    def rows_of(samples: Array, start: Array) -> Rows:
        return gather(dataset.spikes, samples, start, dataset.n_steps, delays, model.steps_per_sample)

    probe = rngs("probe").permutation(dataset.train)[:_PROBE_SAMPLES]
    start = initialise(rows_of(probe, dataset.start[probe]), model, populations, rngs("initialisation"))
    rings = [r for r in start.recurrent if r is not None]
    masters = [*start.feed_forward, *rings]
    units = _step_units(masters, training.step_unit)
    adam = Adam.start(masters)
    mean = [np.zeros(w.shape) for w in masters]
    batches, crops, silenced = rngs("batches"), rngs("crops"), rngs("dropout")
    history: dict[str, list[float]] = {"loss": [], "accuracy_train": [], "learning_rate": []}
    n_batches = -(-dataset.train.size // training.batch_size)
    for epoch in range(training.epochs):
        order = batches.permutation(dataset.train)
        starts = crops.integers(dataset.start_low[order], dataset.start_high[order], endpoint=True)
        total, correct = 0.0, 0
        for batch in range(n_batches):
            part = slice(batch * training.batch_size, (batch + 1) * training.batch_size)
            found = gradients(
                rows_of(order[part], starts[part]),
                deployed(start.feed_forward, start.recurrent, populations, integer),
                surrogates,
                dataset.target[order[part]],
                true_rate=model.true_rate,
                false_rate=model.false_rate,
                integer=integer,
                gains=_silencing(training, model.hidden, order[part].size, silenced),
            )
            steps = [*found.feed_forward, *(g for g in found.recurrent if g.size)]
            if integer:
                steps = [g * cuba_lif.quantise_passes(w) for g, w in zip(steps, masters, strict=True)]
            if not (math.isfinite(found.loss) and all(np.isfinite(g).all() for g in steps)):
                raise TrainingDiverged(f"loss or gradient is not finite in epoch {epoch + 1}")
            learning_rate = training.rate(epoch + batch / n_batches)
            with np.errstate(over="ignore", invalid="ignore"):  # what overflows is raised below
                adam.update(masters, steps, [learning_rate * unit for unit in units])
            total += found.loss
            correct += found.correct
        if not all(np.isfinite(w).all() for w in masters):
            raise TrainingDiverged(f"a weight is not finite after epoch {epoch + 1}")
        if epoch >= training.epochs - training.average_epochs:
            for m, w in zip(mean, masters, strict=True):
                m += w / min(training.average_epochs, training.epochs)
        history["loss"].append(total / order.size)
        history["accuracy_train"].append(correct / order.size)
        history["learning_rate"].append(learning_rate)
    for m, w in zip(mean, masters, strict=True):
        w[:] = m
    network = Network(
        tuple(
            Layer(
                w.T.copy(), None if r is None else r.T.copy(), p.decay_current, p.decay_voltage, p.threshold
            )
            for w, r, p in zip(start.feed_forward, start.recurrent, populations, strict=True)
        ),
        dataset.spikes.n_channels,
        delays,
        model.steps_per_sample,
        model.arithmetic,
    )
    validation, fired = _respond(network, dataset, dataset.validation)
    test = _respond(network, dataset, dataset.test)[0] if dataset.test.size else None
    health = _health(masters if integer else [], start.rates, validation, fired)
    curves = {name: np.asarray(values) for name, values in history.items()}
    return Outcome(network, validation, test, curves, health, time.perf_counter() - began)


def _health(
    masters: Sequence[Array], rates: Sequence[tuple[float, float]], response: Response, fired: Sequence[Array]
) -> dict[str, Any]:
    """Return what went less than well: silent or saturated units, clipped weights, overflow, missed rates."""
    cells = response.output.shape[0] * response.output.shape[1]
    return {
        "dead_neurons": int(sum((f == 0).sum() for f in fired[:-1])),
        "saturated_neurons": int(sum((f >= 0.95 * cells).sum() for f in fired[:-1])) if cells else 0,
        "clipped_weights": sum(int((~cuba_lif.quantise_passes(w)).sum()) for w in masters),
        "peak_state": response.peak_state,
        "overflows_24_bit": response.peak_state > cuba_lif.STATE_LIMIT,
        "missed_initial_rates": sum(not 0.5 * wanted <= reached <= 2 * wanted for wanted, reached in rates),
        "initial_rates": [reached for _, reached in rates],
    }


def respond(network: Network, dataset: Dataset, samples: Array) -> Response:
    """Run a network on the evaluated windows of some samples.

    Args:
        network: a trained network; its weights are rounded to 8 bits here in integer arithmetic.
        dataset: spikes and windows.
        samples: (n,) sample numbers.
    """
    return _respond(network, dataset, samples)[0]


def _respond(network: Network, dataset: Dataset, samples: Array) -> tuple[Response, list[Array]]:
    """Respond, and count each layer's spikes per neuron."""
    integer = network.arithmetic == "integer"
    layers = deployed(
        [x.weight.T for x in network.layers],
        [None if x.recurrent is None else x.recurrent.T for x in network.layers],
        network.layers,
        integer,
    )
    answers: list[Answer] = []
    for first in range(0, max(1, samples.size), _RESPOND_BATCH):
        part = samples[first : first + _RESPOND_BATCH]
        rows = gather(
            dataset.spikes,
            part,
            dataset.start[part],
            dataset.n_steps,
            network.delays,
            network.steps_per_sample,
        )
        answers.append(answer(rows, layers, integer=integer))
    response = Response(
        np.concatenate([a.output for a in answers]),
        np.concatenate([a.spikes for a in answers]),
        np.concatenate([a.updates for a in answers]),
        dataset.spikes.step_ms / network.steps_per_sample,
        round(max(a.peak for a in answers) * cuba_lif.STATE_SCALE),
    )
    return response, [np.sum([a.fired[k] for a in answers], axis=0) for k in range(len(layers))]
