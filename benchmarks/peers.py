"""The classifier that is timed and swept, as plain torch loops and as other frameworks would write it.

Needs torch and the framework in question. Weights, decays, threshold, loss and Adam are the same for all. The
plain loops are those of dse itself, through the definition of the neuron. The frameworks' neurons are
their own: they differ in when they reset, in the reset's part in the gradient and in the surrogate, and they
hand spikes on without a step's delay.
"""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from benchmarks.cases import PERIOD, QUALITY, Variant
from dse.engine.neurons import resonator
from dse.engine.neurons.surrogate import Exponential


@dataclass(frozen=True)
class Population:
    """Neurons of a layer: (neuron,) factors from one step to the next, threshold in weight units, ds/dv."""

    keep_u: np.ndarray
    keep_v: np.ndarray
    threshold: float
    surrogate: Exponential

    def factors(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the factors as float32 tensors."""
        return torch.as_tensor(self.keep_u).float(), torch.as_tensor(self.keep_v).float()


class Peer:
    """A stack of layers with weights (input, neuron), in one framework."""

    def __init__(self, weights: Sequence[np.ndarray], populations: Sequence[Population]) -> None:
        self.weights = [torch.tensor(w, requires_grad=True) for w in weights]
        self.populations = populations

    def prepare(self, x: torch.Tensor) -> Any:
        """Return spikes (step, sample, input) float32 as `spikes` takes them."""
        return x

    @abstractmethod
    def spikes(self, inputs: Any) -> list[torch.Tensor]:
        """Return each layer's spikes, (step, sample, neuron)."""


class Loop(Peer):
    """Plain loop; the product with the weights is taken once over all steps."""

    def first(self, inputs: Any) -> torch.Tensor:
        """Return the first layer's weighted input, (step, sample, neuron)."""
        return inputs @ self.weights[0]

    def __init__(self, weights: Sequence[np.ndarray], populations: Sequence[Population]) -> None:
        from benchmarks.torch_loop import loops

        super().__init__(weights, populations)
        self._loops = loops(populations)

    def spikes(self, inputs: Any) -> list[torch.Tensor]:
        """Return each layer's spikes, the step's delay included."""
        drive, spikes = self.first(inputs), []
        for k, loop in enumerate(self._loops):
            spikes.append(loop(drive))
            if k + 1 < len(self.weights):
                drive = spikes[-1] @ self.weights[k + 1]
        return spikes


class CsrLoop(Loop):
    """Plain loop with the input spikes as a sparse matrix."""

    def prepare(self, x: torch.Tensor) -> Any:
        """Return the spikes and their transpose in CSR, and (step, sample)."""
        flat = x.reshape(-1, x.shape[2])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # sparse CSR is in beta
            return flat.to_sparse_csr(), flat.t().contiguous().to_sparse_csr(), x.shape[:2]

    def first(self, inputs: Any) -> torch.Tensor:
        """Return the first layer's weighted input, (step, sample, neuron)."""
        from benchmarks.torch_loop import CsrProduct

        spikes, transposed, shape = inputs
        return CsrProduct.apply(self.weights[0], spikes, transposed).reshape(*shape, -1)


class SnnTorch(Peer):
    """snnTorch's Synaptic neurons; the linear map hoisted, or in the loop as in its tutorials."""

    def __init__(
        self,
        weights: Sequence[np.ndarray],
        populations: Sequence[Population],
        *,
        hoisted: bool,
        own_surrogate: bool = True,
    ) -> None:
        import snntorch

        super().__init__(weights, populations)
        self._hoisted = hoisted
        self._neurons = []
        for p in populations:
            keep_u, keep_v = p.factors()
            self._neurons.append(
                snntorch.Synaptic(
                    alpha=keep_u,
                    beta=keep_v,
                    threshold=p.threshold,
                    reset_mechanism="zero",
                    spike_grad=snntorch.surrogate.fast_sigmoid() if own_surrogate else _Fires(p.surrogate),
                )
            )

    def spikes(self, inputs: Any) -> list[torch.Tensor]:
        """Return each layer's spikes."""
        states = [neuron.reset_mem() for neuron in self._neurons]
        found: list[list[torch.Tensor]] = [[] for _ in self._neurons]
        if not self._hoisted:
            for x in inputs.unbind(0):
                for k, (weight, neuron) in enumerate(zip(self.weights, self._neurons, strict=True)):
                    x, *states[k] = neuron(x @ weight, *states[k])
                    found[k].append(x)
            return [torch.stack(x) for x in found]
        layers = []
        for k, (weight, neuron) in enumerate(zip(self.weights, self._neurons, strict=True)):
            for z in (inputs @ weight).unbind(0):
                s, *states[k] = neuron(z, *states[k])
                found[k].append(s)
            inputs = torch.stack(found[k])
            layers.append(inputs)
        return layers


class _Fires(torch.nn.Module):
    """A spike function of the potential above the threshold, with dse's surrogate."""

    def __init__(self, surrogate: Exponential) -> None:
        super().__init__()
        self._surrogate = surrogate

    def forward(self, v: torch.Tensor) -> Any:
        """Return 1 where a potential is above the threshold."""
        from dse.engine.autograd import Fire

        return Fire.apply(v, self._surrogate)


class SpikingJelly(Peer):
    """SpikingJelly's CUBALIFNode in multi-step mode."""

    def __init__(self, weights: Sequence[np.ndarray], populations: Sequence[Population]) -> None:
        from spikingjelly.activation_based import neuron

        super().__init__(weights, populations)
        self._neurons = [
            neuron.CUBALIFNode(
                c_decay=float(p.keep_u[0]),
                v_decay=float(p.keep_v[0]),
                v_threshold=p.threshold,
                v_reset=0.0,
            )
            for p in populations
        ]
        for node in self._neurons:
            node.step_mode = "m"

    def spikes(self, inputs: Any) -> list[torch.Tensor]:
        """Return each layer's spikes."""
        found = []
        for weight, neuron in zip(self.weights, self._neurons, strict=True):
            neuron.reset()
            inputs = neuron(inputs @ weight)
            found.append(inputs)
        return found


class Norse(Peer):
    """Norse's LIF with current synapses, over the whole sequence."""

    def __init__(self, weights: Sequence[np.ndarray], populations: Sequence[Population]) -> None:
        import norse.torch as norse

        super().__init__(weights, populations)
        step_s = 1e-3
        self._neurons = [
            norse.LIF(
                norse.LIFParameters(
                    tau_syn_inv=torch.tensor((1 - p.keep_u[0]) / step_s),
                    tau_mem_inv=torch.tensor((1 - p.keep_v[0]) / step_s),
                    # Norse integrates v += dv (i - v): its potential is smaller by dv.
                    v_th=torch.tensor(p.threshold * (1 - p.keep_v[0])),
                    method="super",
                ),
                dt=step_s,
            )
            for p in populations
        ]

    def spikes(self, inputs: Any) -> list[torch.Tensor]:
        """Return each layer's spikes."""
        found = []
        for weight, neuron in zip(self.weights, self._neurons, strict=True):
            inputs, _ = neuron(inputs @ weight)
            found.append(inputs)
        return found


class ResonatorLoop(Loop):
    """Plain loop; the hidden neurons are resonators."""

    def __init__(self, weights: Sequence[np.ndarray], populations: Sequence[Population]) -> None:
        from benchmarks.ours import population
        from benchmarks.torch_loop import resonating

        super().__init__(weights, populations)
        hidden = population(weights[0].shape[1], Variant("float32", 1.0), is_output=False)
        assert isinstance(hidden, resonator.Population)
        self._loops[0] = resonating(populations[0], hidden)


class SpikingJellyResonators(SpikingJelly):
    """SpikingJelly's RAFNode (resonate and fire) in multi-step mode, before its CUBALIFNode.

    With dse's surrogate. Its equations are dse's with `reset`; its gradient stops where a neuron has spiked.
    """

    def __init__(self, weights: Sequence[np.ndarray], populations: Sequence[Population]) -> None:
        from spikingjelly.activation_based import neuron

        super().__init__(weights, populations)
        p, (c, s) = populations[0], resonator.factors(PERIOD, QUALITY)
        # The factors as they are rounded, so that the neurons are the same.
        c, s = float(c) / 4096, float(s) / 4096
        self._neurons[0] = neuron.RAFNode(
            b=math.log(math.hypot(c, s)),
            omega=math.atan2(s, c),
            v_threshold=p.threshold,
            v_reset=0.0,
            surrogate_function=_Fires(p.surrogate),
            detach_reset=True,
        )
        self._neurons[0].step_mode = "m"
        self._neurons[1].surrogate_function = _Fires(populations[1].surrogate)


_MV = 20.0
"""Of a weight unit, where neurons are driven in mV."""


class NorseResonators(Norse):
    """Norse's Izhikevich neurons with its parameters of a resonator, step by step, before its LIF."""

    def spikes(self, inputs: Any) -> list[torch.Tensor]:
        """Return each layer's spikes."""
        from norse.torch.functional import izhikevich

        behaviour, of_steps = izhikevich.resonator, []
        drive = inputs @ (_MV * self.weights[0])
        state = izhikevich.IzhikevichState(*(x.detach() + torch.zeros_like(drive[0]) for x in behaviour.s))
        for z in drive.unbind(0):
            fired, state = izhikevich.izhikevich_feed_forward_step(z, state, behaviour.p)
            of_steps.append(fired)
        hidden = torch.stack(of_steps)
        output, _ = self._neurons[1](hidden @ self.weights[1])
        return [hidden, output]


def peer(name: str, weights: Sequence[np.ndarray], populations: Sequence[Population]) -> Peer:
    """Return a network by the name of its row.

    Raises:
        ImportError: its framework is not installed.
        KeyError: there is no such row.
    """
    makers: dict[str, Any] = {
        "loop": Loop,
        "csr loop": CsrLoop,
        "snntorch": lambda *a: SnnTorch(*a, hoisted=True),
        "snntorch in loop": lambda *a: SnnTorch(*a, hoisted=False),
        "snntorch, our surrogate": lambda *a: SnnTorch(*a, hoisted=True, own_surrogate=False),
        "spikingjelly": SpikingJelly,
        "norse": Norse,
        "loop, resonators": ResonatorLoop,
        "spikingjelly, resonators": SpikingJellyResonators,
        "norse, resonators": NorseResonators,
    }
    found: Peer = makers[name](weights, populations)
    return found
