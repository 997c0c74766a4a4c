"""A design in training: what its engine trains, and what is known of it after each batch and each epoch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dse.base.records import Array, Floats, Ints
from dse.base.seeds import move_to, position
from dse.engine.delays import running
from dse.engine.events import Rows, pooled
from dse.engine.member import Masters, Member, Report, State, TrainedLayer, Turn, as_part, of_part
from dse.engine.neurons.fixed_point import STATE_LIMIT, WEIGHT_SCALE
from dse.engine.parameters import lengths
from dse.engine.shared import copies_of, distinct
from dse.models.snn.contrasts import Choice
from dse.models.snn.initialise import initialise, populations_of
from dse.models.snn.quantise import finer
from dse.models.snn.settings import Stack
from dse.models.training import FitRequest, Training

SATURATED = 0.95
"""Share of the steps in which a neuron fires that counts as always."""
# Beyond this, initial weights are forgotten and one spike overrules all others: no rate schedule comes back.
_LOST_GROWTH = 100.0


@dataclass
class Trainee:
    """A design in training.

    number: its place in the cohort.
    rates: per layer, the target spike rate at the start (of spiking) and the one reached.
    silenced: draws which neurons drop out.
    history: curves by name, a number per epoch.
    mean: sum of the weights over the last epochs, over their number.
    seconds: spent on it so far.
    loss, correct, fired, largest_norm: of the epoch so far; `fired` is per layer, times the samples.
    stopped: why it ended before the last epoch; diverged: why it has no result. Empty: neither.
    kept: weights that pruning left; None: no weight was pruned.
    last: masters of the last epoch, whose delays and decays belong to `mean`.
    best: masters of the epoch that is kept, where it is the best on validation; None: none yet, or the last.
    soft: (sample, output) targets of the training samples, from a teacher; None: the labels.
    begun: what its layers began with that takes long to find: `chosen`, what neurons of a start by contrasts
        compare; `outputs`, their weights after the epochs in which they learn alone; `exponent`, that of
        their thresholds where it is free; `basis/<layer>`.
    output_exponent: by which their thresholds are scaled now, beyond that of the model.
    """

    number: int
    model: Stack
    training: Training
    member: Member
    rates: list[tuple[float, float]]
    silenced: np.random.Generator
    history: dict[str, list[float]]
    mean: list[Array | None] = field(default_factory=list)
    seconds: float = 0.0
    loss: float = 0.0
    correct: int = 0
    fired: Floats = field(default_factory=lambda: np.zeros(0))
    largest_norm: float = 0.0
    clipped_batches: int = 0
    quiet_epochs: int = 0
    stopped: str = ""
    diverged: str = ""
    learning_rate: float = 0.0
    kept: Masters | None = None
    last: Masters | None = None
    best: Masters | None = None
    soft: Floats | None = None
    begun: dict[str, Array] = field(default_factory=dict)
    output_exponent: int = 0

    @classmethod
    def start(
        cls,
        number: int,
        design: FitRequest[Stack],
        probe: Rows,
        step_ms: float,
        heads: tuple[int, ...],
        pool: Ints | None,
        choice: Choice,
    ) -> Trainee:
        """Draw a design's neurons and weights.

        Args:
            number: its place in the cohort.
            design: settings and random generators.
            probe: input spikes on which initial rates are reached.
            step_ms: duration of an input step.
            heads: classes of each head.
            pool: of each input (`Stack.pool`).
            choice: of the neurons of a start by contrasts.
        """
        model, training, rngs = design
        populations = populations_of(model, sum(heads), step_ms, rngs("time constants"))
        of_delays = rngs("delays") if model.longest_delay else None
        began = initialise(
            pooled(probe, pool),
            model,
            populations,
            sum(heads),
            rngs("initialisation"),
            len(heads),
            of_delays,
            choice,
        )

        def slower(depth: int) -> np.float32:
            return np.float32(training.hidden_lr_factor if depth < len(model.hidden) else 1)

        steps = [_step(model, training, depth) for depth in range(len(model.hidden) + 1)]
        layers = [
            TrainedLayer(
                feed_forward=weights,
                recurrent=ring,
                population=population,
                surrogate=model.surrogate(population.to_threshold, is_output=depth == len(model.hidden)),
                unit=slower(depth) * units(weights, *steps[depth], shared, 1 if depth else model.copies),
                recurrent_unit=None if ring is None else slower(depth) * units(ring, *steps[depth]),
                shared=shared,
                delay=late,
                longest_delay=model.longest_delay,
                axonal=model.max_axonal_delay > 0,
                learnt_decays=model.learnt_decays,
                is_rounded=not model.is_dithered(depth),
                norm_unit=slower(depth) * norm_units(weights, *steps[depth])
                if model.weight_norm and depth not in model.whitened_layers
                else None,
            )
            for depth, (population, weights, ring, shared, late) in enumerate(
                zip(
                    began.populations,
                    began.feed_forward,
                    began.recurrent,
                    model.sharing(sum(heads)),
                    began.delays,
                    strict=True,
                )
            )
        ]
        member = Member(
            layers=tuple(layers),
            true_rate=model.true_rate,
            false_rate=model.false_rate,
            arithmetic=model.arithmetic,
            clip_norm=training.clip_norm,
            heads=heads if len(heads) > 1 else (),
            loss=model.loss,
            hidden_spike_penalty=model.hidden_spike_penalty,
            pool=pool,
        )
        of_best = ["accuracy_validation", "peak_state"] if training.keep == "best" else []
        curves: dict[str, list[float]] = {
            name: [] for name in ("loss", "accuracy_train", "learning_rate", "gradient_norm", *of_best)
        }
        chosen = {} if began.chosen is None else {"chosen": began.chosen}
        return cls(number, model, training, member, began.rates, rngs("dropout"), curves, begun=chosen)

    def lay(self) -> None:
        """Put what was found for its start into its layers."""
        *before, last = self.member.layers
        finer_by = int(self.begun.get("exponent", 0)) - self.output_exponent
        if finer_by:
            population = finer(last.population, finer_by)
            surrogate = self.model.surrogate(population.to_threshold, is_output=True)
            last = replace(last, population=population, surrogate=surrogate)
            self.output_exponent += finer_by
        if "outputs" in self.begun:
            weights = self.begun["outputs"]
            unit, scale = _step(self.model, self.training, len(before))
            step = unit, scale * 2.0**self.output_exponent
            norms = None if last.norm_unit is None else norm_units(weights, *step)
            of_weights = units(weights, *step, last.shared)
            last = replace(last, feed_forward=weights, unit=of_weights, norm_unit=norms)
        bases = (self.begun.get(f"basis/{depth}") for depth in range(len(before) + 1))
        layers = (replace(x, basis=basis) for x, basis in zip([*before, last], bases, strict=True))
        self.member = replace(self.member, layers=tuple(layers))

    @property
    def at_start(self) -> Masters:
        """The masters with which the training of all layers begins."""
        layers = self.member.layers
        return Masters(
            tuple(x.feed_forward for x in layers),
            tuple(x.recurrent for x in layers),
            tuple(None if x.delay is None else running(x.delay, x.axonal) for x in layers),
        )

    @property
    def first_averaged(self) -> int:
        """The first epoch whose weights count in the mean."""
        return max(self.training.epochs - self.training.average_epochs, self.training.output_epochs)

    @property
    def finished(self) -> bool:
        return bool(self.stopped) or len(self.history["loss"]) == self.training.epochs

    @property
    def has_ended(self) -> bool:
        """Whether it is finished or has diverged."""
        return self.finished or bool(self.diverged)

    def state(self) -> dict[str, Array]:
        """Return what is known of the training after an epoch, by name; `restore` takes it over."""
        counts = np.array([self.clipped_batches, self.quiet_epochs])
        arrays = {"seconds": np.array(self.seconds), "counts": counts, "dropout": position(self.silenced)}
        arrays |= {f"history/{name}": np.array(curve) for name, curve in self.history.items()}
        arrays |= {f"mean/{k}": mean for k, mean in enumerate(self.mean) if mean is not None}
        arrays |= {} if self.soft is None else {"soft": self.soft}
        arrays |= as_part("start", self.begun)
        arrays |= {"rates": np.array(self.rates)} if self.training.output_epochs else {}
        if self.kept is not None:
            matrices = (*self.kept.feed_forward, *self.kept.recurrent)
            arrays |= {f"kept/{k}": kept for k, kept in enumerate(matrices) if kept is not None}
        if self.best is not None:
            arrays |= as_part("best", self.best.arrays())
        return arrays

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self.seconds = float(state["seconds"])
        self.clipped_batches, self.quiet_epochs = (int(n) for n in state["counts"])
        move_to(self.silenced, state["dropout"])
        self.history = {name: curve.tolist() for name, curve in of_part(state, "history").items()}
        self.soft = state.get("soft")
        if "rates" in state:
            self.rates = [(target, reached) for target, reached in state["rates"].tolist()]
        n, means, kept = len(self.member.layers), of_part(state, "mean"), of_part(state, "kept")
        self.mean = [means.get(str(k)) for k in range(2 * n)] if means else []
        if kept:
            masks = [kept.get(str(k)) for k in range(2 * n)]
            self.kept = Masters(tuple(x for x in masks[:n] if x is not None), tuple(masks[n:]))
        if best := of_part(state, "best"):
            self.best = Masters.of_arrays(best, n)

    def turn(self, epoch: float, samples: Ints) -> Turn:
        """Return learning rate, dropout and targets of a batch of samples; whole neurons drop out per sample.

        Inputs are silenced in the rows, for a whole cohort; the gain here is that of those that are left.
        """
        self.learning_rate = self.training.rate(epoch)
        n_samples = samples.size
        share, of_inputs = self.training.dropout, self.training.input_dropout
        gains: list[Floats | None] = [
            np.full((n_samples, 1), 1 / (1 - of_inputs), np.float32) if of_inputs else None
        ]
        for size in self.model.hidden:
            kept = self.silenced.random((n_samples, size)) >= share if share else None
            gains.append(None if kept is None else (kept / np.float32(1 - share)).astype(np.float32))
        soft = None if self.soft is None else self.soft[samples]
        model = self.model
        of_delays = self._rate_of(model.delay_learning_rate if model.longest_delay else 0.0, epoch)
        of_decays = self._rate_of(0.0 if model.learnt_decays == "no" else model.decay_learning_rate, epoch)
        return Turn(self.learning_rate, tuple(gains), of_delays, soft, of_decays)

    def _rate_of(self, step_size: float, epoch: float) -> float:
        """Return the rate of delays or decays: none while the weights are averaged, which belong to them."""
        if epoch >= self.first_averaged:
            return 0.0
        return step_size * self.training.rate(epoch) / self.training.learning_rate

    def absorb(self, report: Report, n_samples: int, epoch: int) -> None:
        """Add a batch's report to the epoch."""
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
        self.last = masters
        self.diverged = self._lost(weights, epoch)
        self.history["loss"].append(self.loss / n_samples)
        self.history["accuracy_train"].append(self.correct / n_samples)
        self.history["learning_rate"].append(self.learning_rate)
        self.history["gradient_norm"].append(self.largest_norm)
        rates = self.fired / n_samples
        self.quiet_epochs = self.quiet_epochs + 1 if _is_stuck(rates) else 0
        if self.training.silent_epochs and self.quiet_epochs >= self.training.silent_epochs:
            layer = int(np.flatnonzero((rates == 0) | (rates >= SATURATED))[0]) + 1
            how = "silent" if rates[layer - 1] == 0 else "saturated"
            self.stopped = f"layer {layer} was {how} for {self.quiet_epochs} epochs"
            self.mean = []  # the mean of the last epochs would mix in what was before
        first = self.first_averaged
        if epoch >= first or self.stopped:
            n_summed = 1 if self.stopped else self.training.epochs - max(0, first)
            before = self.mean or [None if w is None else np.zeros(w.shape) for w in weights]
            self.mean = [
                None if w is None or b is None else b + w / n_summed
                for b, w in zip(before, weights, strict=True)
            ]
        self.loss, self.correct, self.fired, self.largest_norm = 0.0, 0, np.zeros(0), 0.0

    @property
    def pruned_at(self) -> int:
        """The epoch before which weights are pruned."""
        return max(self.training.output_epochs, int(self.model.prune_epoch * self.training.epochs))

    @property
    def _first_to_keep(self) -> int:
        """Epochs that are not kept, whatever their accuracy: before pruning."""
        return self.pruned_at if self.model.pruned else 0

    def consider(self, masters: Masters, accuracy: float, peak_state: int) -> None:
        """Keep an epoch's masters where none was better on validation; states beyond 24 bits are worse."""
        self.history["accuracy_validation"].append(accuracy)
        self.history["peak_state"].append(peak_state)
        n = len(self.history["peak_state"])
        if n > self._first_to_keep and self._best_epoch == n - 1:
            self.best = masters

    @property
    def _best_epoch(self) -> int:
        accuracy, peak = self.history["accuracy_validation"], self.history["peak_state"]
        most = STATE_LIMIT if "integer" in self.model.neuron.arithmetics else math.inf
        epochs = range(self._first_to_keep, len(peak))
        return max(epochs, key=lambda k: (peak[k] <= most, accuracy[k], k))

    @property
    def epoch_kept(self) -> int:
        """The epoch, from 1, whose weights are the result: the best one, or the last."""
        if self.best is None:
            return len(self.history["loss"])
        return self._best_epoch + 1

    @property
    def result(self) -> Masters:
        """What training ends with: the best epoch, or the mean of the last ones."""
        assert self.last is not None  # an epoch is over
        if self.best is not None:
            return self.best
        if not self.mean:
            return self.last
        n = len(self.member.layers)
        forward = tuple(w for w in self.mean[:n] if w is not None)
        return replace(self.last, feed_forward=forward, recurrent=tuple(self.mean[n:]))

    def _lost(self, weights: Sequence[Array | None], epoch: int) -> str:
        """Return why training cannot go on from these weights, or nothing."""
        layers = self.member.layers
        at_start = [*(x.feed_forward for x in layers), *(x.recurrent for x in layers)]
        sharing = [*(x.shared for x in layers), *(None for _ in layers)]
        for number, (every, every_before, shared) in enumerate(zip(weights, at_start, sharing, strict=True)):
            if every is None or every_before is None:
                continue
            w, before = distinct(every, shared), distinct(every_before, shared)
            growth = _rms(w) / max(_rms(before), 2 / WEIGHT_SCALE)
            if not math.isfinite(growth):
                return f"a weight is not finite after epoch {epoch + 1}"
            layer = number % len(layers) + 1
            if self.model.arithmetic != "integer" and growth > _LOST_GROWTH:
                return f"the weights of layer {layer} have grown {growth:.0e} times after epoch {epoch + 1}"
        return ""


def _step(model: Stack, training: Training, depth: int) -> tuple[str, float]:
    """Return in what units the weights of a layer are learnt, and the scale of its weights."""
    return training.step_unit, 2.0 ** model.exponent(depth)


def units(weights: Floats, unit: str, scale: float, shared: Ints | None = None, copies: int = 1) -> Floats:
    """Return what a learning rate of 1 is: one weight, or each neuron's root mean square of initial ones.

    Args:
        weights: (input, neuron).
        unit: `training.step_unit`.
        scale: of the layer's weights (`Stack.exponent`).
        shared: numbers of the weights, of which each then counts once.
        copies: how many times the neurons are repeated.
    """
    n = weights.shape[1]
    if unit == "weight":
        return np.full(n, scale, np.float32)
    if shared is not None:
        first = copies_of(shared).first
        kind = first % n % (n // copies)
        squares = np.bincount(kind, weights.ravel()[first].astype(np.float64) ** 2)
        return np.tile(np.sqrt(squares / np.bincount(kind)), copies).astype(np.float32)
    powers = weights**2
    counted = np.count_nonzero(powers, axis=0)
    mean = powers.mean(axis=0)
    if (counted < len(weights)).any():  # contrasts: most begin at next to 0; kernels: most are 0
        mean = powers.sum(axis=0) / np.maximum(counted, 1)
    return np.asarray(np.sqrt(mean), np.float32)


def norm_units(weights: Floats, unit: str, scale: float) -> Floats:
    """Return the same of the norm of each neuron's weights: that of one weight, or its initial value."""
    return np.full(weights.shape[1], scale, np.float32) if unit == "weight" else lengths(weights)[0]


def _rms(weights: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt((weights.astype(np.float64) ** 2).mean())) if weights.size else 0.0


def _is_stuck(rates: Floats) -> bool:
    """Return whether a layer fired in no step, or in nearly all."""
    return bool(((rates == 0) | (rates >= SATURATED)).any())
