"""Training: designs that share their data go through the same batches side by side.

Batch order, crops and the probe batch come from generators that the designs share; time constants, weights
and dropout from each design's own. A design's result is bitwise the same alone and in any cohort.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.engine import cpu
from dse.engine.events import Rows, gather
from dse.engine.member import Cohort, Masters, Member, Report, TrainedLayer, Turn
from dse.measure.heads import head_sizes, output_labels
from dse.models.snn import prune
from dse.models.snn.initialise import initialise, populations_of
from dse.models.snn.respond import respond_and_count
from dse.models.training import Design, Generators, Training, TrainingDiverged
from dse.neurons import cuba_lif
from dse.neurons.surrogate import exponential
from dse.records import Array, Dataset, Layer, Network, Outcome

if TYPE_CHECKING:
    from dse.models.snn.family import SNN

PROBE_SAMPLES = 64
_SATURATED = 0.95
# Beyond this, initial weights are forgotten and one spike overrules all others: no rate schedule comes back.
_LOST_GROWTH = 100.0


def _started(device: str, members: Sequence[Member], n_samples: int, n_steps: int, threads: int) -> Cohort:
    """Return a cohort on a device: 'cpu' or 'cuda'."""
    if device == "cuda":
        from dse.engine import gpu

        return gpu.start(members, n_samples, n_steps)
    return cpu.start(members, n_samples, n_steps, threads)


def train(
    dataset: Dataset,
    designs: Sequence[Design],
    shared: Generators,
    device: str = "cpu",
    threads: int = 1,
) -> Iterator[tuple[int, Outcome | TrainingDiverged]]:
    """Train classifiers on `dataset.train`; yield each with its number as it finishes.

    A finished design has responded on validation and, where there is one, on test. The weights that are
    kept are those of the last epoch (or the mean of the last epochs), whatever validation says of earlier
    ones. A design whose numbers run away ends at once, and its neighbours go on untouched.

    Args:
        dataset: spikes, windows, split.
        designs: they agree in what `SNN.shares` returns.
        shared: random generators of what the designs share ('batches', 'crops', 'probe').
        device: 'cpu' or 'cuda'.
        threads: of the CPU, over the samples of a batch.

    Raises:
        ValueError: there is no training sample, or the designs cannot train on the same batches.
    """
    if not dataset.train.size:
        raise ValueError("training needs at least one training sample, got none")
    if len({design.model.shares(design.training) for design in designs}) != 1:
        raise ValueError(
            "the designs of a cohort must agree in input_delays, steps_per_sample and batch_size"
        )
    model, training = designs[0].model, designs[0].training
    n_steps = dataset.n_steps * model.steps_per_sample
    delays = tuple(d * model.steps_per_sample for d in model.input_delays)

    def rows_of(samples: Array, start: Array) -> Rows:
        return gather(dataset.spikes, samples, start, dataset.n_steps, delays, model.steps_per_sample)

    chosen = shared("probe").permutation(dataset.train)[:PROBE_SAMPLES]
    probe = rows_of(chosen, dataset.start[chosen])
    clock = _Clock()
    trainees = []
    for number, design in enumerate(designs):
        trainees.append(_Trainee.start(number, design, probe, head_sizes(dataset)))
        trainees[-1].seconds += clock.lap()
    size = min(training.batch_size, dataset.train.size)
    cohort = _started(device, [trainee.member for trainee in trainees], size, n_steps, threads)
    batches, crops = shared("batches"), shared("crops")
    n_batches = -(-dataset.train.size // training.batch_size)
    live, epoch = trainees, 0
    while live:
        for trainee in live:
            if trainee.model.pruned and epoch == int(trainee.model.prune_epoch * trainee.training.epochs):
                trainee.kept = prune.masks(cohort.masters(trainee.number), trainee.model.pruned)
                cohort.prune(trainee.number, trainee.kept)
        order = batches.permutation(dataset.train)
        starts = crops.integers(dataset.start_low[order], dataset.start_high[order], endpoint=True)
        for batch in range(n_batches):
            part = slice(batch * training.batch_size, (batch + 1) * training.batch_size)
            turns = {x.number: x.turn(epoch + batch / n_batches, order[part].size) for x in live}
            labels = output_labels(dataset, order[part])
            reports = cohort.step(rows_of(order[part], starts[part]), labels, turns)
            lap = clock.lap()
            for trainee in live:
                trainee.absorb(reports[trainee.number], len(labels), epoch)
                trainee.seconds += lap / len(live)
            for trainee in [x for x in live if x.diverged]:
                yield trainee.number, TrainingDiverged(trainee.diverged)
            live = [x for x in live if not x.diverged]
            clock.lap()
            if not live:
                return
        for trainee in live:
            trainee.end_epoch(cohort.masters(trainee.number), epoch, order.size)
            trainee.seconds += clock.lap()
        epoch += 1
        for trainee in live:
            if trainee.diverged:
                yield trainee.number, TrainingDiverged(trainee.diverged)
            elif trainee.finished:
                yield trainee.number, _outcome(trainee, dataset, delays)
        live = [x for x in live if not (x.diverged or x.finished)]
        clock.lap()


class _Clock:
    """Seconds between calls."""

    def __init__(self) -> None:
        self._last = time.perf_counter()

    def lap(self) -> float:
        """Return the seconds since the last lap."""
        before, self._last = self._last, time.perf_counter()
        return self._last - before


def _units(weights: Array, unit: str) -> Array:
    """Return what a learning rate of 1 is: one weight, or each neuron's initial root mean square weight."""
    if unit == "weight":
        return np.ones(weights.shape[1], np.float32)
    return np.asarray(np.sqrt((weights**2).mean(axis=0)), np.float32)


@dataclass
class _Trainee:
    """A design on its way: what the engine needs to know of it, and what is known of it so far."""

    number: int
    model: SNN
    training: Training
    member: Member
    rates: list[tuple[float, float]]
    silenced: np.random.Generator
    history: dict[str, list[float]]
    mean: list[Array | None] = field(default_factory=list)
    seconds: float = 0.0
    loss: float = 0.0
    correct: int = 0
    fired: Array = field(default_factory=lambda: np.zeros(0))
    largest_norm: float = 0.0
    clipped_batches: int = 0
    quiet_epochs: int = 0
    stopped: str = ""
    diverged: str = ""
    learning_rate: float = 0.0
    kept: Masters | None = None

    @classmethod
    def start(cls, number: int, design: Design, probe: Rows, heads: tuple[int, ...]) -> _Trainee:
        """Draw a design's time constants and weights; `heads` are the classes of each."""
        model, training, rngs = design
        populations = populations_of(model, sum(heads), probe.n_steps, rngs("time constants"))
        began = initialise(probe, model, populations, rngs("initialisation"), len(heads))
        layers = []
        for depth, population in enumerate(populations):
            is_output = depth == len(model.hidden)
            tau = model.output_tau_grad if is_output else model.tau_grad
            weights, ring = began.feed_forward[depth], began.recurrent[depth]
            layers.append(
                TrainedLayer(
                    weights,
                    ring,
                    population.decay_current,
                    population.decay_voltage,
                    population.threshold,
                    exponential(population.threshold, tau, model.scale_grad, model.surrogate_cut),
                    _units(weights, training.step_unit),
                    None if ring is None else _units(ring, training.step_unit),
                )
            )
        member = Member(
            tuple(layers),
            model.true_rate,
            model.false_rate,
            model.arithmetic,
            training.clip_norm,
            heads if len(heads) > 1 else (),
        )
        curves: dict[str, list[float]] = {
            name: [] for name in ("loss", "accuracy_train", "learning_rate", "gradient_norm")
        }
        return cls(number, model, training, member, began.rates, rngs("dropout"), curves)

    @property
    def finished(self) -> bool:
        return bool(self.stopped) or len(self.history["loss"]) == self.training.epochs

    def turn(self, epoch: float, n_samples: int) -> Turn:
        """Return the learning rate and the dropout of the next batch: whole hidden neurons per sample."""
        self.learning_rate = self.training.rate(epoch)
        share = self.training.dropout
        gains: list[Array | None] = [None]
        for size in self.model.hidden:
            kept = self.silenced.random((n_samples, size)) >= share if share else None
            gains.append(None if kept is None else (kept / np.float32(1 - share)).astype(np.float32))
        return Turn(self.learning_rate, tuple(gains))

    def absorb(self, report: Report, n_samples: int, epoch: int) -> None:
        """Take in what a batch gave."""
        norm = report.gradient_norm
        if not (math.isfinite(report.loss) and math.isfinite(norm)):
            self.diverged = f"loss or gradient is not finite in epoch {epoch + 1}"
            return
        self.loss += report.loss
        self.correct += report.correct
        self.fired = n_samples * np.array(report.fired) + (self.fired if self.fired.size else 0.0)
        self.largest_norm = max(self.largest_norm, norm)
        limit = self.training.clip_norm
        self.clipped_batches += limit is not None and norm > limit

    def end_epoch(self, masters: Masters, epoch: int, n_samples: int) -> None:
        """Close an epoch: note its curves, add to the mean of the last epochs, look for dead ends."""
        weights = [*masters.feed_forward, *masters.recurrent]
        self.diverged = self._lost(weights, epoch)
        first = self.training.epochs - self.training.average_epochs
        self.history["loss"].append(self.loss / n_samples)
        self.history["accuracy_train"].append(self.correct / n_samples)
        self.history["learning_rate"].append(self.learning_rate)
        self.history["gradient_norm"].append(self.largest_norm)
        rates = self.fired / n_samples
        self.quiet_epochs = self.quiet_epochs + 1 if _is_stuck(rates) else 0
        if self.training.silent_epochs and self.quiet_epochs >= self.training.silent_epochs:
            layer = int(np.flatnonzero((rates == 0) | (rates >= _SATURATED))[0]) + 1
            how = "silent" if rates[layer - 1] == 0 else "saturated"
            self.stopped = f"layer {layer} was {how} for {self.quiet_epochs} epochs"
            self.mean = []  # the mean of the last epochs would mix in what was before
        if epoch >= first or self.stopped:
            n_summed = 1 if self.stopped else min(self.training.average_epochs, self.training.epochs)
            before = self.mean or [None if w is None else np.zeros(w.shape) for w in weights]
            self.mean = [
                None if w is None or b is None else b + w / n_summed
                for b, w in zip(before, weights, strict=True)
            ]
        self.loss, self.correct, self.fired, self.largest_norm = 0.0, 0, np.zeros(0), 0.0

    def _lost(self, weights: Sequence[Array | None], epoch: int) -> str:
        """Return why training cannot go on from these weights, or nothing."""
        layers = self.member.layers
        at_start = [*(x.feed_forward for x in layers), *(x.recurrent for x in layers)]
        for number, (w, before) in enumerate(zip(weights, at_start, strict=True)):
            if w is None or before is None:
                continue
            growth = _rms(w) / max(_rms(before), 2 / cuba_lif.WEIGHT_SCALE)
            if not math.isfinite(growth):
                return f"a weight is not finite after epoch {epoch + 1}"
            if growth > _LOST_GROWTH:
                layer = number % len(layers) + 1
                return f"the weights of layer {layer} have grown {growth:.0e} times after epoch {epoch + 1}"
        return ""


def _rms(weights: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt((weights.astype(np.float64) ** 2).mean())) if weights.size else 0.0


def _is_stuck(rates: Array) -> bool:
    """Return whether a layer fired in no step, or in nearly all."""
    return bool(((rates == 0) | (rates >= _SATURATED)).any())


def _outcome(trainee: _Trainee, dataset: Dataset, delays: tuple[int, ...]) -> Outcome:
    """Return a finished design's network and responses."""
    began = time.perf_counter()
    layers = trainee.member.layers
    n = len(layers)
    weights = [None if w is None else w.astype(np.float32) for w in trainee.mean]
    if trainee.kept is not None:
        kept = [*trainee.kept.feed_forward, *trainee.kept.recurrent]
        weights = [
            None if w is None or k is None else prune.remaining(w, k, trainee.model.arithmetic)
            for w, k in zip(weights, kept, strict=True)
        ]
    network = Network(
        tuple(
            Layer(
                np.ascontiguousarray(w.T),
                None if r is None else np.ascontiguousarray(r.T),
                layer.decay_current,
                layer.decay_voltage,
                layer.threshold,
            )
            for w, r, layer in zip(weights[:n], weights[n:], layers, strict=True)
            if w is not None
        ),
        dataset.spikes.n_channels,
        delays,
        trainee.model.steps_per_sample,
        trainee.model.arithmetic,
    )
    validation, fired = respond_and_count(network, dataset, dataset.validation)
    test = respond_and_count(network, dataset, dataset.test)[0] if dataset.test.size else None
    curves = {name: np.asarray(values) for name, values in trainee.history.items()}
    cells = validation.output.shape[0] * validation.output.shape[1]
    masters = [w for w in weights if w is not None] if trainee.model.arithmetic == "integer" else []
    health: dict[str, Any] = {
        "dead_neurons": int(sum((f == 0).sum() for f in fired[1:-1])),
        "saturated_neurons": int(sum((f >= _SATURATED * cells).sum() for f in fired[1:-1])) if cells else 0,
        "clipped_weights": sum(int((~cuba_lif.quantise_passes(w)).sum()) for w in masters),
        "peak_state": validation.peak_state,
        "overflows_24_bit": validation.peak_state > cuba_lif.STATE_LIMIT,
        "missed_initial_rates": sum(
            not 0.5 * wanted <= reached <= 2 * wanted for wanted, reached in trainee.rates
        ),
        "initial_rates": [reached for _, reached in trainee.rates],
        "gradient_norm_largest": max(trainee.history["gradient_norm"]),
        "gradient_norm_last": trainee.history["gradient_norm"][-1],
        "clipped_gradients": trainee.clipped_batches,
        "stopped_early": trainee.stopped,
        "epochs_trained": len(trainee.history["loss"]),
        "n_weights_dense": network.n_weights_dense,
    }
    seconds = trainee.seconds + time.perf_counter() - began
    return Outcome(network, validation, test, curves, health, seconds)
