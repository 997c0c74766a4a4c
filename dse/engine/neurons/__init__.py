"""Neurons: a file each, with the parameters, the equations and one step of them.

A neuron is defined once, over the array API: the same lines run on numpy (float64, or exact integers) when a
network answers, and on torch when it learns. Automatic differentiation goes through them there, and a
surrogate stands for ds/dv. A neuron needs nothing more to be trained, stored, evaluated and explored. A
neuron that also has a kernel (dse.engine.kernels) trains at full speed; its definition is the kernel's
witness.

To add a neuron, here or in a module of your own, write a file with

    class State(NamedTuple): ...                            the arrays that one step hands to the next
    @dataclass(frozen=True)
    class Population: ...                                   the parameters of a layer's neurons, and `step`
    @register("neurons", "my_neuron")
    @dataclass(frozen=True)
    class MyNeuron(Neuron): ...                             its YAML keys, and how a layer is made of them

`dse.testing.check_neuron` says what it lacks. `dse.engine.neurons.lif` is the shortest example.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from dse.base import registry
from dse.base.records import Arithmetic, Array, Floats, Ints
from dse.engine.neurons.calculus import Calculus

S = TypeVar("S", bound=tuple[Array, ...])
P = TypeVar("P", bound="Population[Any]")


class Step(NamedTuple, Generic[S]):
    """What one time step gives.

    state: after the step, resets included; a new one, the old one is untouched.
    potential: (..., neuron) membrane potential before a reset, in weight units.
    spikes: (..., neuron) how often a neuron spiked, 0 or 1 of most kinds, of the potential's type: what
        leaves the layer.
    """

    state: S
    potential: Array
    spikes: Array


class Population(Protocol[S]):
    """The neurons of one layer: a frozen dataclass whose fields are its parameters.

    Every field is an array (neuron,) or one number for all neurons; they are stored with the weights, under
    their names, and the population is built from them again. In training they are torch tensors.

    Neuron updates are counted where the potential is away from rest, or input arrives. A population whose
    neurons must be updated elsewhere as well says where by a method `awake(state)`, (..., neuron) bool.
    """

    @property
    def to_threshold(self) -> Floats | float:
        """From the resting potential to the threshold, > 0, in weight units: a number or (neuron,).

        It scales the initial weights and the width of the surrogate.
        """
        ...

    def initial_state(self, shape: tuple[int, ...], calculus: Calculus) -> S:
        """Return the resting state of neurons, (..., neuron)."""
        ...

    def step(self, state: S, drive: Array, calculus: Calculus) -> Step[S]:
        """Advance by one time step; nothing is mutated, and nothing but the arguments matters.

        Args:
            state: before the step.
            drive: weighted input spikes of the step, (..., neuron): any leading axes.
            calculus: what the array API lacks: `calculus.fire` makes the spikes.
        """
        ...


@dataclasses.dataclass(frozen=True)
class LayerSpec:
    """What a neuron is told of the layer that it is to fill.

    n_neurons: its size.
    is_output: whether it is the last one.
    steps_per_sample: network steps per input step.
    step_ms: duration of a network step.
    """

    n_neurons: int
    is_output: bool
    steps_per_sample: int
    step_ms: float


class Neuron(Protocol):
    """A kind of neuron: a frozen dataclass whose fields are its YAML keys, declared with `registry.param`.

    One whose parameters need short input steps has a method `check_step(step_ms)` that raises a ValueError,
    whose sentence begins with the key that it is about.

    Populations: class of its populations; outputs may be of the class of another kind.
    label: what such neurons are called in a sentence, such as 'leaky integrate-and-fire'.
    arithmetics: in which its definition runs; 'integer' only where it holds states as whole numbers.
    exports: what a bundle with it can be exported as, such as fixed_point (8-bit weights as well).
    units: of its parameters, where they are not plain numbers: name -> unit.
    limits: of its parameters: name -> least and largest value; what lies outside is refused where it is read.
    on_chips: whether profiles of neuromorphic chips can be asked what it costs; if not, its work is counted
        as operations, which processors can be asked for.
    programmed: whether only processors and chips with programmable neurons run it.
    state_updates: numbers that are updated per neuron and step, where work is counted as operations.
    most_spikes: of a hidden neuron in a step; an output spikes once at most.
    """

    Populations: ClassVar[type[Any]]
    label: ClassVar[str]
    arithmetics: ClassVar[tuple[Arithmetic, ...]] = ("float32", "ideal")
    exports: ClassVar[tuple[str, ...]] = ()
    units: ClassVar[Mapping[str, str]] = {}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {}
    on_chips: ClassVar[bool] = False
    programmed: ClassVar[bool] = False
    state_updates: ClassVar[int] = 1
    most_spikes: ClassVar[int] = 1

    @classmethod
    def resonators(cls, parameters: Mapping[str, Array]) -> int:
        """Return how many neurons of a layer resonate, given its parameters (`dse.base.records.Workload`)."""
        return 0

    def population(self, layer: LayerSpec, rng: np.random.Generator) -> Population[Any]:
        """Return the neurons of a layer; `rng` draws what differs between them."""
        ...


def neuron_of(name: str) -> type[Neuron]:
    """Return the kind of neuron of a name.

    Raises:
        ValueError: it is not known.
    """
    known = registry.known("neurons")
    if name not in known:
        raise ValueError(
            f"neuron '{name}' is unknown, known are {', '.join(known)}: a neuron of your own needs its plugin"
        )
    return known[name]


def name_of_population(population: Population[Any], neuron: Neuron) -> str:
    """Return the name of the kind of neuron that a population of `neuron` is stored as.

    That is its own, or that of the kind with populations of this class: resonators have CUBA-LIF outputs.
    """
    if type(population) is neuron.Populations:
        return registry.name_of("neurons", neuron)
    kinds: dict[str, Any] = registry.known("neurons")
    return next(name for name, cls in kinds.items() if cls.Populations is type(population))


def parameters_of(population: Population[Any]) -> dict[str, Array]:
    """Return the parameters of a population by name, as arrays: what is stored."""
    return {f.name: np.asarray(getattr(population, f.name)) for f in dataclasses.fields(population)}  # type: ignore[arg-type]


def tiled(population: P, copies: int) -> P:
    """Return the neurons of a population as many times, one copy after the other."""
    if copies == 1:
        return population
    arrays = {
        f.name: np.tile(value, copies)
        for f in dataclasses.fields(population)  # type: ignore[arg-type]
        if np.ndim(value := getattr(population, f.name))
    }
    return dataclasses.replace(population, **arrays)  # type: ignore[type-var]


def taken(population: P, neurons: Ints) -> P:
    """Return some neurons of a population, by number."""
    arrays = {
        f.name: value[neurons]
        for f in dataclasses.fields(population)  # type: ignore[arg-type]
        if np.ndim(value := getattr(population, f.name))
    }
    return dataclasses.replace(population, **arrays)  # type: ignore[type-var]


def population_of(name: str, parameters: Mapping[str, Array]) -> Population[Any]:
    """Return the population of `parameters_of`, given the name of its kind of neuron.

    Raises:
        ValueError: the neuron is unknown, or a parameter is missing or is none of its own.
    """
    cls = neuron_of(name).Populations
    names = {field.name for field in dataclasses.fields(cls)}
    if names != set(parameters):
        raise ValueError(
            f"a layer of neuron '{name}' must have the parameters {', '.join(sorted(names))}, "
            f"got {', '.join(sorted(parameters)) or 'none'}"
        )
    built: Population[Any] = cls(**{key: x.item() if x.ndim == 0 else x for key, x in parameters.items()})
    return built
