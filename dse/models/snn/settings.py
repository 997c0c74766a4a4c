"""What the families of stacks of neurons have in common: the settings of a network, whatever its neurons."""

from __future__ import annotations

import functools
import math
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise, product
from typing import ClassVar, Literal

import numpy as np

from dse.base.records import Arithmetic, Array, Dataset, Floats, Ints
from dse.base.registry import name_of, param
from dse.config.parts import KeyFault, Part, Written
from dse.engine.delays import MOST
from dse.engine.layers import has_kernel
from dse.engine.losses import Loss
from dse.engine.neurons import LayerSpec, Neuron, cuba_lif
from dse.engine.neurons.fixed_point import STATE_LIMIT, STATE_SCALE
from dse.engine.neurons.response import dc_gain
from dse.engine.neurons.surrogate import Exponential, exponential
from dse.models.snn.contrasts import Candidates, Contrasts
from dse.models.snn.quantise import FINEST
from dse.models.snn.regions import RINGS, regions_of
from dse.models.training import Training

_USUAL = 3  # that of dithered layers for which it is chosen after the training


@functools.lru_cache(1000)
def _check_potential(neuron: Neuron, layer: LayerSpec) -> None:
    """Check that the potential of a neuron has a limit: once, as every reading of a search space asks."""
    dc_gain(neuron.population(layer, np.random.default_rng(0)), layer.n_neurons)


@dataclass(frozen=True)
class Stack:
    """Settings of a stack of layers; its neurons have settings of their own."""

    draws_crops: ClassVar[bool] = True
    hidden_layers: ClassVar[tuple[int, int]] = (1, 3)
    """Least and largest number of `hidden`."""

    hidden: tuple[int, ...] = param((100,), low=1, doc="neurons of each hidden layer, 1 to 3 layers")
    true_rate: float = param(0.8, low=0, high=1, doc="target spike rate of the label's output neuron")
    false_rate: float = param(0.02, low=0, high=1, doc="target spike rate of the other output neurons")
    neuron: Neuron = param(  # noqa: RUF009
        "cuba_lif", component="neurons", doc="kind of the neurons; their own keys stand beside it"
    )
    loss: Loss = param(  # noqa: RUF009
        "spike_rate", component="losses", doc="loss over the output spikes; its own keys stand beside it"
    )
    hidden_spike_penalty: float = param(
        0.0,
        low=0,
        doc="activity regularisation: each spike of a hidden neuron adds this much to its sample's loss; "
        "1e-6 to 1e-4 leave fewer spikes, more than 1e-3 may leave none",
    )
    tau_grad: float = param(
        0.03, low=0, low_open=True, doc="width of the hidden surrogate gradient, in units of 100 thresholds"
    )
    output_tau_grad: float = param(
        0.03, low=0, low_open=True, doc="width of the output surrogate gradient, in units of 100 thresholds"
    )
    scale_grad: float = param(
        3.0, low=0, low_open=True, doc="height of the surrogate gradients (Adam cancels it)"
    )
    input_delays: tuple[int, ...] = param(
        (0,),
        low=0,
        unit="input steps",
        doc="delays of the inputs; each gets its own copy of the input channels",
    )
    max_delay: int = param(
        0,
        low=0,
        high=MOST,
        unit="network steps",
        doc="longest delay of a synapse: each has one of its own, which is learnt; 0: synapses have none",
    )
    delayed_layers: str = param(
        "first",
        choices=("first", "all"),
        doc="layers whose synapses have delays, recurrent ones never: the first, or the outputs too",
    )
    max_axonal_delay: int = param(
        0,
        low=0,
        high=MOST,
        unit="network steps",
        doc="longest delay of a hidden neuron's axon: each has one of its own, which is learnt from below 1 "
        "on and holds for all that the neuron feeds (lava-dl: 62); 0: axons have none",
    )
    delay_learning_rate: float = param(
        0.1,
        low=0,
        unit="network steps",
        doc="step size of Adam for delays, on the schedule of the learning rate; 0: delays stay as drawn. "
        "They rest in the last `average_epochs` epochs",
    )
    learnt_decays: str = param(
        "no",
        choices=("no", "layer", "neuron"),
        doc="current and voltage decays that CUBA-LIF neurons learn, outputs too: none, a pair per layer or "
        "a pair per neuron",
    )
    decay_learning_rate: float = param(
        0.001,
        low=0,
        doc="step size of Adam for decays per network step, on the schedule of the learning rate; they run "
        "rounded to 1/4096, stay inside (0, 1), and rest in the last `average_epochs` epochs",
    )
    steps_per_sample: int = param(1, low=1, high=16, doc="network steps per input step")
    recurrent: bool = param(False, doc="each hidden layer also receives its own spikes of the previous step")
    regions: int = param(
        0,
        low=0,
        doc="regions of the sensor, 3 rings by regions / 3 sectors around its middle (runs where channels "
        "lie on a line), whose channels share one weight to each neuron of the first layer; planes "
        "(polarities, thresholds) and delayed copies have weights of their own; 0: every channel has",
    )
    start: Literal["uniform", "contrasts", "fan_in"] = param(
        "uniform",
        choices=("uniform", "contrasts", "fan_in"),
        doc="initial weights. uniform: drawn, scaled to `initial_rate`; fan_in: drawn up to `weight_scale` "
        "over the root of a layer's inputs, whatever rate that gives, as torch and lava-dl do; contrasts, of "
        "the first layer: one channel (or region) excites a neuron and another inhibits it, and of at least "
        "four times as many such neurons those stay that a linear readout of their spike counts misses most, "
        "less hidden_spike_penalty times their spikes",
    )
    weight_scale: float = param(
        1.0,
        low=0,
        low_open=True,
        doc="of a start by fan_in; 8-bit weights below 1/64 are 0, as are all of more than 4096 inputs at 1",
    )
    initial_rate: float = param(
        0.1,
        low=0,
        low_open=True,
        high=1,
        doc="initial weights are scaled to this many spikes per hidden neuron and step",
    )
    surrogate_cut: float = param(
        0.0, low=0, high=1, high_open=True, doc="a surrogate gradient below this fraction of its height is 0"
    )
    arithmetic: Arithmetic = param(  # noqa: RUF009
        "integer",
        choices=("integer", "float32", "ideal"),
        doc="integer: what deployed networks compute; ideal: real numbers in float64",
    )
    threshold_exponents: tuple[int, ...] = param(
        (),
        low=-1,
        high=FINEST,
        doc="of each layer, k: its thresholds and weights are 2**k times as large, which is the same network "
        "on a finer grid of 8-bit weights (1/32 of 2**-k). -1 (dithered layers): the largest k with which "
        "8 bits hold the weights that were learnt, and 24 bits the states; -1 (outputs that learn alone "
        "first): that with which what 8 bits lose of the weights they begin with changes the drive least. "
        "Default: -1 if dithered, else 0",
    )
    rounding: Literal["nearest", "dithered"] = param(
        "nearest",
        choices=("nearest", "dithered"),
        doc="of weights to 8 bits. nearest: in every step of the training; dithered (needs `regions`): those "
        "of the first layer after the training, up or down by channel so that the sum over a region is right",
    )
    weight_norm: bool = param(
        False,
        doc="each neuron's weights from the layer below are g v / |v|, and g and v are learnt, as in lava-dl",
    )
    whitened: Literal["none", "output", "all"] = param(
        "none",
        choices=("none", "output", "all"),
        doc="layers whose weights are learnt in the basis in which the spike counts of the neurons below are "
        "white, which counts that rise and fall together need: the outputs, or all layers but the first. "
        "They are stored as any others. weight_norm leaves them out",
    )
    pruned: float = param(
        0.0,
        low=0,
        high=1,
        high_open=True,
        doc="fraction of the weights of each matrix to prune, smallest first",
    )
    prune_epoch: float = param(
        0.5, low=0, high=1, high_open=True, doc="fraction of the training after which weights are pruned"
    )

    def __post_init__(self) -> None:
        """Check what one key alone cannot say."""
        for broken, text in self._rules():
            if broken:
                raise ValueError(text)

    def _rules(self) -> Iterator[tuple[object, str]]:
        """Yield what may not be, and how the sentence says so."""
        least, most = self.hidden_layers
        n, delays, neuron = len(self.hidden), self.input_delays, name_of("neurons", self.neuron)
        yield not least <= n <= most, f"hidden must have {least} to {most} layers, got {n}"
        arithmetics = self.neuron.arithmetics
        text = f"arithmetic must be {' or '.join(arithmetics)} for neuron {neuron}"
        yield self.arithmetic not in arithmetics, f"{text}, got {self.arithmetic}"
        text = "input_delays must hold at least one delay and none twice"
        yield not delays or len(set(delays)) != len(delays), f"{text}, got {list(delays)}"
        own = "where synapses have delays of their own (max_delay)"
        text = f"max_axonal_delay must be 0 {own}, got {self.max_axonal_delay}"
        yield self.max_delay and self.max_axonal_delay, text
        yield self.max_delay and delays != (0,), f"input_delays must be [0] {own}, got {list(delays)}"
        for key in ("max_delay", "max_axonal_delay"):
            longest = getattr(self, key)
            text = f"{key} must be 0 for neuron {neuron}, which has no kernel, got {longest}"
            yield longest and not self.has_kernel, text
        text = f"max_axonal_delay must be 0 where hidden layers are recurrent, got {self.max_axonal_delay}"
        yield self.max_axonal_delay and self.recurrent, text
        is_cuba = self.neuron.Populations is cuba_lif.Population
        text = f"learnt_decays must be no for neuron {neuron}, which is no cuba_lif, got {self.learnt_decays}"
        yield self.learnt_decays != "no" and not is_cuba, text
        text = "delayed_layers must be first where hidden layers are recurrent, got all"
        yield self.max_delay and self.recurrent and self.delayed_layers == "all", text
        yield self.regions % RINGS, f"regions must be a multiple of {RINGS} rings, got {self.regions}"
        shared = "where channels share weights (regions)"
        yield self.regions and self.max_delay, f"max_delay must be 0 {shared}, got {self.max_delay}"
        yield self.weight_norm and self.regions, f"weight_norm must be false {shared}, got true"
        text = f"start must be uniform or contrasts {shared}, got fan_in"
        yield self.start == "fan_in" and self.regions, text
        text = "rounding must be nearest without regions or integer arithmetic"
        can_dither = self.regions and self.arithmetic == "integer"
        got = f"got dithered with {self.regions} regions in {self.arithmetic} arithmetic"
        yield self.rounding == "dithered" and not can_dither, f"{text}, {got}"
        if self.threshold_exponents or self.rounding != "nearest":
            yield from self._rules_of_exponents(neuron)
        text = f"pruned must be 0 where weights are learnt in a whitened basis, got {self.pruned:g}"
        yield self.whitened != "none" and self.pruned, text
        text = f"false_rate must be below true_rate ({self.true_rate}), got {self.false_rate}"
        yield self.false_rate >= self.true_rate, text

    def _rules_of_exponents(self, neuron: str) -> Iterator[tuple[object, str]]:
        """Yield where thresholds have no integer mantissa or leave the states' 24 bits, as `_rules`."""
        n_layers, exponents = len(self.hidden) + 1, self.threshold_exponents
        text = f"threshold_exponents and rounding need neurons with a kernel, got {neuron}"
        yield not self.has_kernel, text
        text = f"threshold_exponents must have one exponent for each of the {n_layers} layers"
        yield exponents and len(exponents) != n_layers, f"{text}, got {list(exponents)}"
        text = (
            "threshold_exponents must be 0 or more for layers that are neither dithered (the first one, with "
            f"rounding dithered) nor outputs, got {list(exponents)}"
        )
        yield -1 in exponents[self.rounding == "dithered" : -1], text
        text = (
            "threshold_exponents must be 0 or more where a recurrent layer is dithered, whose recurrent "
            f"weights are rounded as they are learnt, got {list(exponents)}"
        )
        yield self.recurrent and self.is_free(0), text
        threshold: float = getattr(self.neuron, "threshold", math.inf)
        highest, most = max(exponents, default=0), int(math.log2(STATE_LIMIT / STATE_SCALE / threshold))
        text = (
            f"threshold_exponents must be at most {most}, beyond which the threshold leaves the 24 bits of a "
            f"state, got {highest}"
        )
        yield highest > most, text

    def exponent(self, depth: int) -> int:
        """Return the power of two by which a layer's thresholds and weights are scaled as it trains."""
        if self.is_free(depth):
            return FINEST
        return max(0, self.threshold_exponents[depth]) if self.threshold_exponents else 0

    def is_dithered(self, depth: int) -> bool:
        """Return whether a layer trains without rounding, and is dithered afterwards."""
        return depth == 0 and self.rounding == "dithered"

    def is_free(self, depth: int) -> bool:
        """Return whether a layer's exponent is chosen after the training."""
        return self.is_dithered(depth) and (self.threshold_exponents or (-1,))[0] == -1

    @property
    def has_free_outputs(self) -> bool:
        """Whether the exponent of the outputs is chosen before they learn alone."""
        return self.threshold_exponents[-1:] == (-1,) and self.arithmetic == "integer"

    @property
    def candidates(self) -> type[Candidates] | None:
        """What the first layer is chosen from; None: it is not chosen."""
        return Contrasts if self.start == "contrasts" else None

    @property
    def is_sparse(self) -> bool:
        """Whether some weights are 0 in the end, as many as training shows."""
        return bool(self.pruned)

    def wiring(self, dataset: Dataset) -> Mapping[str, Array]:
        """Return what candidates know of the channels."""
        return {}

    def schedule(self, training: Training) -> Training:
        """Return how this network trains where all train so."""
        return training

    @property
    def most_peak(self) -> float:
        """Thresholds that potentials of a chosen layer are to stay within: half of a state's range."""
        exponent = _USUAL if self.is_free(0) else self.exponent(0)
        return max(1.0, self._range / 2.0**exponent)

    @property
    def _range(self) -> float:
        """Half the range of a state, in thresholds of exponent 0: other samples reach further."""
        threshold: float = getattr(self.neuron, "threshold", 1.0)
        return STATE_LIMIT / STATE_SCALE / threshold * 0.5 if self.arithmetic == "integer" else math.inf

    def most_exponent(self, peak: float) -> int:
        """Return the largest exponent, at least 0, with which so many thresholds stay in half its range."""
        return max(0, math.floor(math.log2(self._range / peak))) if peak > 0 else FINEST

    @property
    def has_kernel(self) -> bool:
        """Whether kernels train it; if not, automatic differentiation of its neurons' definition does."""
        return has_kernel(self.neuron.Populations)

    @property
    def whitened_layers(self) -> range:
        """The layers, from 0, whose weights are learnt in a whitened basis."""
        last = len(self.hidden)
        return range({"none": last + 1, "output": last, "all": 1}[self.whitened], last + 1)

    def check_step(self, step_ms: float) -> None:
        """Check that candidates can be set for neurons in input steps of this length."""
        if self.candidates is not None:
            one = LayerSpec(1, False, self.steps_per_sample, step_ms / self.steps_per_sample)
            _check_potential(self.neuron, one)  # type: ignore[arg-type]  # components are frozen

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield delays beyond the window, what a device cannot train, and steps that neurons cannot have."""
        if not part.good:
            return
        (device,) = space.range("execution", "device") or ("cpu",)
        lengths = space.range("window", "n_steps")
        known = [n for n in lengths if n is not None]
        of_inputs = [x for value in part.range("input_delays") for x in np.atleast_1d(value).tolist()]
        if known and len(known) == len(lengths) and max(of_inputs, default=0) >= max(known):
            text = f"must be below the steps of the window, {max(known)}: later spikes are lost"
            yield part.fault("input_delays", f"{text}, got {max(of_inputs)}")
        steps = [n * min(part.range("steps_per_sample"), default=1) for n in known]
        for key in ("max_delay", "max_axonal_delay"):
            longest = max(part.range(key), default=0)
            if longest and steps and longest >= min(steps):
                text = f"must be below the network steps of the window, {min(steps)}: later spikes are lost"
                yield part.fault(key, f"{text}, got {longest}")
            if longest and device != "cpu":
                yield part.fault(key, f"must be 0 on execution.device {device}, got {longest}")
        learnt = [x for x in part.range("learnt_decays") if x != "no"]
        if learnt and device != "cpu":
            yield part.fault("learnt_decays", f"must be no on execution.device {device}, got {learnt[0]}")
        alone = min(space.range("training", "output_epochs"), default=0)
        if not alone and any(-1 in x[-1:] for x in part.range("threshold_exponents")):
            text = "must be 0 or more for outputs that do not learn alone first (training.output_epochs 0)"
            yield part.fault("threshold_exponents", f"{text}, got -1")
        messages: dict[str, None] = {}
        recordings = space.parts.get("preprocessing", space.parts.get("data"))
        periods = (
            {getattr(x, "step_ms", None) for x in recordings.at_ends()}
            if recordings is not None and recordings.good
            else ()
        )
        for stack, step_ms in product(part.at_ends(), filter(None, periods)):
            for one in (stack, stack.neuron):
                try:
                    getattr(one, "check_step", lambda _: None)(step_ms)
                except ValueError as error:
                    messages.setdefault(str(error))
        yield from (part.blamed(message) for message in messages)

    def check_channels(self, positions: Ints) -> None:
        """Check that there is a region for channels at (n_channels, 3) x, y and plane."""
        self.pool(positions)

    @property
    def copies(self) -> int:
        """How many times the neurons of the first layer are repeated, with equal parameters."""
        return 1

    def placed(self, positions: Ints) -> Stack:
        """Return the stack that trains on channels at (n_channels, 3) x, y and plane: the same for all."""
        return self

    def pool(self, positions: Ints) -> Ints | None:
        """Return which pool of inputs with equal weights each input belongs to, (input,); None: its own.

        Args:
            positions: (n_channels, 3) x, y and plane.

        Raises:
            ValueError: there are fewer places than regions.
        """
        if not self.regions:
            return None
        region = regions_of(positions, self.regions)
        n_pools = region.max() + 1
        return np.concatenate([region + d * n_pools for d in range(len(self.input_delays))])

    def sharing(self, n_outputs: int) -> list[Ints | None]:
        """Return the numbers of each layer's shared weights (`dse.engine.shared`), or None."""
        return [None] * (len(self.hidden) + 1)

    def has_delays(self, depth: int) -> bool:
        """Return whether synapses into a layer, from 0, have delays, their own or those of axons."""
        if self.max_axonal_delay:
            return depth > 0
        return self.max_delay > 0 and (depth == 0 or self.delayed_layers == "all")

    @property
    def delays(self) -> tuple[int, ...]:
        """Delays of the input copies in network steps."""
        return tuple(d * self.steps_per_sample for d in self.input_delays)

    @property
    def longest_delay(self) -> int:
        """Most steps by which a synapse or an axon delays; 0: none does."""
        return self.max_delay or self.max_axonal_delay

    def matrices(self, n_channels: int, n_outputs: int) -> list[tuple[int, int]]:
        """Return (inputs, neurons) of every weight matrix, recurrent ones included."""
        sizes = (n_channels * len(self.input_delays), *self.hidden, n_outputs)
        return [*pairwise(sizes), *((h, h) for h in self.hidden if self.recurrent)]

    def surrogate(self, to_threshold: Floats | float, *, is_output: bool) -> Exponential:
        """Return ds/dv of a layer whose threshold lies so far above rest."""
        tau_grad = self.output_tau_grad if is_output else self.tau_grad
        return exponential(to_threshold, tau_grad, self.scale_grad, self.surrogate_cut)

    def shares(self, training: Training) -> tuple[Hashable, ...]:
        """Return what designs must have in common to train on the same batches."""
        training = self.schedule(training)
        return (
            *(self.has_kernel, self.input_delays, self.steps_per_sample),
            *(training.batch_size, training.output_epochs, training.input_dropout, training.augmentation),
        )
