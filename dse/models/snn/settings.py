"""What the families of stacks of neurons have in common: the settings of a network, whatever its neurons."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Literal

from dse.engine.delays import MOST
from dse.engine.layers import has_kernel
from dse.engine.losses import Loss
from dse.models.training import Training
from dse.neurons import Neuron
from dse.neurons.surrogate import Exponential, exponential
from dse.records import Arithmetic, Floats, Ints
from dse.registry import name_of, param


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
    delay_learning_rate: float = param(
        0.1,
        low=0,
        unit="network steps",
        doc="step size of Adam for delays, on the schedule of the learning rate; 0: delays stay as drawn. "
        "They rest in the last `average_epochs` epochs",
    )
    steps_per_sample: int = param(1, low=1, high=16, doc="network steps per input step")
    recurrent: bool = param(False, doc="each hidden layer also receives its own spikes of the previous step")
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
        least, most = self.hidden_layers
        if not least <= len(self.hidden) <= most:
            raise ValueError(f"hidden must have {least} to {most} layers, got {len(self.hidden)}")
        if self.arithmetic not in self.neuron.arithmetics:
            raise ValueError(
                f"arithmetic must be {' or '.join(self.neuron.arithmetics)} for neuron "
                f"{name_of('neurons', self.neuron)}, got {self.arithmetic}"
            )
        if not self.input_delays or len(set(self.input_delays)) != len(self.input_delays):
            raise ValueError(
                f"input_delays must hold at least one delay and none twice, got {list(self.input_delays)}"
            )
        if self.max_delay and self.input_delays != (0,):
            raise ValueError(
                "input_delays must be [0] where synapses have delays of their own (max_delay), got "
                f"{list(self.input_delays)}"
            )
        if self.max_delay and not self.has_kernel:
            raise ValueError(
                f"max_delay must be 0 for neuron {name_of('neurons', self.neuron)}, which has no kernel, "
                f"got {self.max_delay}"
            )
        if self.max_delay and self.recurrent and self.delayed_layers == "all":
            raise ValueError("delayed_layers must be first where hidden layers are recurrent, got all")
        if self.whitened != "none" and self.pruned:
            raise ValueError(
                f"pruned must be 0 where weights are learnt in a whitened basis, got {self.pruned:g}"
            )
        if self.false_rate >= self.true_rate:
            raise ValueError(f"false_rate must be below true_rate ({self.true_rate}), got {self.false_rate}")

    @property
    def has_kernel(self) -> bool:
        """Whether kernels train it; if not, automatic differentiation of its neurons' definition does."""
        return has_kernel(self.neuron.Populations)

    @property
    def whitened_layers(self) -> range:
        """The layers, from 0, whose weights are learnt in a whitened basis."""
        last = len(self.hidden)
        return range({"none": last + 1, "output": last, "all": 1}[self.whitened], last + 1)

    @property
    def copies(self) -> int:
        """How many times the neurons of the first layer are repeated, with equal parameters."""
        return 1

    def placed(self, positions: Ints) -> Stack:
        """Return the stack that trains on channels at (n_channels, 3) x, y and plane: the same for all."""
        return self

    def sharing(self, n_outputs: int) -> list[Ints | None]:
        """Return the numbers of each layer's shared weights (`dse.engine.shared`), or None."""
        return [None] * (len(self.hidden) + 1)

    def has_delays(self, depth: int) -> bool:
        """Return whether synapses into a layer, from 0, have delays."""
        return self.max_delay > 0 and (depth == 0 or self.delayed_layers == "all")

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
        return (
            *(self.has_kernel, self.input_delays, self.steps_per_sample),
            *(training.batch_size, training.input_dropout, training.augmentation),
        )
