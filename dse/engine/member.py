"""What an engine trains: networks at their start, one turn of training, and what it reports.

An engine trains the networks of a cohort: dse.engine.cpu runs kernels, dse.engine.autograd
the definition of a neuron on any device of torch. Each module has a `start(members, n_samples, n_steps)` that
returns an `Engine`, ready for batches of at most `n_samples` samples of `n_steps` steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol

from dse.base.records import Arithmetic, Array, Floats, Ints
from dse.engine.events import Rows
from dse.engine.goal import SPIKE_RATE, Goal
from dse.engine.losses import Loss
from dse.engine.neurons import Population
from dse.engine.neurons.surrogate import Exponential


@dataclass(frozen=True)
class TrainedLayer:
    """A layer as its training starts.

    feed_forward: (input, neuron) float32 master weights.
    recurrent: (neuron, neuron) float32, row = presynaptic, or None.
    population: its neurons.
    surrogate: ds/dv.
    unit, recurrent_unit: (neuron,) float32, what a learning rate of 1 moves a weight into each neuron by.
    shared: (input, neuron) number of each weight (dse.engine.shared), whose copies are equal and move alike;
        None: each weight is alone.
    delay: (input, neuron) float32 master delays of the feed-forward synapses, network steps; they run
        rounded. None: no synapse has one.
    longest_delay: training keeps delays between 0 and this.
    is_rounded: whether feed-forward weights run rounded to 8 bits in integer arithmetic; if not, as they are.
    axonal: whether all synapses of an input share its axon's delay, which runs rounded down.
    learnt_decays: no, or a pair of decays that CUBA-LIF neurons learn per layer or per neuron.
    norm_unit: (neuron,) what a learning rate of 1 moves the norm of each neuron's weights by, where these are
        g v / |v| (dse.engine.parameters); None: they are no such product.
    basis: (input, rank) float32 M of weights that are W0 + M A, with W0 these (dse.engine.parameters), in
        place of the norm; None: they are themselves.
    """

    feed_forward: Floats
    recurrent: Floats | None
    population: Population[Any]
    surrogate: Exponential
    unit: Floats
    recurrent_unit: Floats | None = None
    shared: Ints | None = None
    delay: Floats | None = None
    longest_delay: int = 0
    is_rounded: bool = True
    axonal: bool = False
    learnt_decays: str = "no"
    norm_unit: Floats | None = None
    basis: Floats | None = None


@dataclass(frozen=True)
class Member:
    """A design's network in a cohort.

    layers: input side first.
    true_rate, false_rate: target spike rates of the label's output and of the others.
    arithmetic: of the forward pass.
    clip_norm: gradients of a larger Euclidean norm over all parameters are scaled down to it; None: never.
    heads: classes of each head, which share the output neurons in this order; empty: one head.
    loss: over the output spikes.
    hidden_spike_penalty: what each spike of a hidden neuron adds to the loss of its sample.
    pool: (input,) input of the first layer that each input of the rows counts for (dse.engine.events.pooled);
        None: its own.
    """

    layers: tuple[TrainedLayer, ...]
    true_rate: float
    false_rate: float
    arithmetic: Arithmetic = "integer"
    clip_norm: float | None = None
    heads: tuple[int, ...] = ()
    loss: Loss = SPIKE_RATE
    hidden_spike_penalty: float = 0.0
    pool: Ints | None = None

    @property
    def goal(self) -> Goal:
        """What its training minimises."""
        return Goal(self.loss, self.true_rate, self.false_rate, self.heads, self.hidden_spike_penalty)


State = Mapping[str, Array]
"""Named arrays from which a training goes on."""


def of_part(state: State, part: str) -> dict[str, Array]:
    """Return the arrays of a state below `<part>/`, without that in their names."""
    return {name.removeprefix(f"{part}/"): x for name, x in state.items() if name.startswith(f"{part}/")}


def as_part(part: str, state: State) -> dict[str, Array]:
    """Return arrays with their names below `<part>/`."""
    return {f"{part}/{name}": x for name, x in state.items()}


@dataclass(frozen=True)
class Turn:
    """What one member does with a batch.

    learning_rate: Adam's step size in each layer's units.
    gains: per layer, (sample, input) float32 factors of its inputs' spikes, or None. Within a layer they
        are 0 or one common value (dropout). Those of the first layer are (sample, 1): its rows lack what is
        silenced.
    delay_learning_rate: Adam's step size of delays, network steps; 0: they stay as they are.
    soft: (sample, output) probabilities that it learns in place of the labels; None: the labels.
    decay_learning_rate: Adam's step size of decays; 0: they stay as they are.
    """

    learning_rate: float
    gains: tuple[Floats | None, ...]
    delay_learning_rate: float = 0.0
    soft: Floats | None = None
    decay_learning_rate: float = 0.0


@dataclass(frozen=True)
class Report:
    """What one member's turn gave.

    loss: with what hidden spikes add to it, summed over the batch.
    correct: samples whose most active output (lowest number on ties) is the label, in every head.
    fired: per layer, mean spikes per neuron and step.
    gradient_norm: Euclidean norm over all parameters, before clipping; NaN or infinite where a gradient is.
    """

    loss: float
    correct: int
    fired: tuple[float, ...]
    gradient_norm: float


@dataclass(frozen=True)
class Masters:
    """Master weights, float32, input side first: feed_forward (input, neuron), recurrent or None.

    delay: (input, neuron) int8 delays as they run, or None; empty where no engine gave any.
    decays: (2, neuron) int32 decays of u and v in 1/4096 that were learnt, or None; likewise.
    """

    feed_forward: tuple[Array, ...]
    recurrent: tuple[Array | None, ...]
    delay: tuple[Array | None, ...] = ()
    decays: tuple[Array | None, ...] = ()

    def arrays(self) -> dict[str, Array]:
        """Return all arrays by name and layer; `of_arrays` takes them."""
        return {
            f"{part.name}/{depth}": array
            for part in fields(self)
            for depth, array in enumerate(getattr(self, part.name))
            if array is not None
        }

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Array], n_layers: int) -> Masters:
        """Return the masters of a number of layers from `arrays`."""
        of_parts: Any = (tuple(arrays.get(f"{x.name}/{k}") for k in range(n_layers)) for x in fields(cls))
        return cls(*of_parts)


class Engine(Protocol):
    """Networks that train on the same batches; each one's result is the same alone and in any cohort."""

    def step(self, rows: Rows, labels: Ints, turns: Mapping[int, Turn]) -> dict[int, Report]:
        """Train the members named in `turns` (by number) on a batch; the others do not move.

        Labels are output neurons: (sample,), or (sample, head) of members with several heads.
        """
        ...

    def prune(self, member: int, kept: Masters) -> None:
        """Set the weights of a member that are not kept, by booleans like its masters, to 0 for good."""
        ...

    def masters(self, member: int) -> Masters:
        """Return a copy of a member's master weights."""
        ...

    def state(self, member: int) -> State:
        """Return a copy of what a member's training goes on from, between two batches.

        It fits an engine of the same kind. It holds weights, moments, what pruning left, and updates so far.
        """
        ...

    def restore(self, member: int, state: State) -> None:
        """Go on from where `state` was taken of the same member, whatever trained beside it."""
        ...
