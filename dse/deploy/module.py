"""A network as a torch module: the spikes of the deployed one, bit for bit, on any device that runs torch.

In integer arithmetic states are whole numbers in float64, and sums of 8-bit weights are exact in any order.
The equations are those of dse.engine.neurons, run on torch; a surrogate stands for ds/dv, as in training.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dse import store
from dse.base.records import Ints, Layer, Network, Spikes
from dse.deploy.classifier import BundleError
from dse.engine.autograd import TorchCalculus, first_drive, later, layer_spikes, on_torch, quantised
from dse.engine.checks import check_network
from dse.engine.events import Rows, gather
from dse.engine.neurons import population_of
from dse.engine.neurons.surrogate import exponential

SCHEMA = "dse/module/1"


class NetworkModule(torch.nn.Module):
    """A spiking network: input spikes in, output spikes as its decision rule receives them out.

    network: what it runs.
    weights: (neuron, input) of every layer, before rounding.
    recurrent: (neuron, neuron) of every layer, row = postsynaptic; of one without, empty.
    """

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network
        rings = (np.zeros((0, 0)) if x.recurrent is None else x.recurrent for x in network.layers)
        self.weights, self.recurrent = (
            torch.nn.ParameterList(torch.tensor(x, dtype=torch.float32) for x in matrices)
            for matrices in ((layer.weight for layer in network.layers), rings)
        )

    def forward(self, spikes: Tensor) -> Tensor:
        """Return the output spikes of samples, (sample, network step, output), one step after they fire.

        Args:
            spikes: (sample, input step, channel) of 0 and 1, any type.

        Raises:
            ValueError: spikes of another shape, or other values.
        """
        return later(self.run(*self._rows(spikes))[-1]).transpose(0, 1)

    def fired(self, spikes: Tensor) -> list[Tensor]:
        """Return the spikes of every layer in the step in which they fire, (sample, network step, neuron)."""
        return [x.transpose(0, 1) for x in self.run(*self._rows(spikes))]

    def run(self, rows: Rows, samples: slice) -> list[Tensor]:
        """Return the spikes of every layer, (step, sample, neuron) each, in the step in which they fire.

        Rows of input spikes have their delayed copies (dse.engine.events).
        """
        fired: list[Tensor] = []
        for k, layer in enumerate(self.network.layers):
            population = population_of(layer.neuron, layer.parameters)
            surrogate = exponential(population.to_threshold, tau_grad=0.03, scale_grad=3.0)
            calculus = TorchCalculus(self.network.arithmetic, surrogate, self.weights[k].device)
            ring = None if layer.recurrent is None else self._running(self.recurrent[k], calculus).T
            drive = self._drive(layer, self._running(self.weights[k], calculus), rows, samples, fired)
            fired.append(layer_spikes(drive, on_torch(population, calculus), calculus, ring))
        return fired

    def _running(self, weights: Tensor, calculus: TorchCalculus) -> Tensor:
        is_rounded = self.network.arithmetic == "integer"
        return (quantised(weights) if is_rounded else weights).to(calculus.dtype)

    @staticmethod
    def _drive(layer: Layer, weight: Tensor, rows: Rows, samples: slice, fired: list[Tensor]) -> Tensor:
        """Return the weighted input of a layer: with delays a sum for each delay, that much later."""

        def summed(w: Tensor) -> Tensor:
            return later(fired[-1]) @ w.T if fired else first_drive(rows, samples, w.T)

        if layer.delay is None:
            return summed(weight)
        delay, parts = torch.tensor(layer.delay, device=weight.device), []
        for steps in torch.unique(delay).tolist():
            part = summed(weight * (delay == steps))
            parts.append(torch.cat([torch.zeros_like(part[:steps]), part[: max(0, len(part) - steps)]]))
        return torch.stack([part[: rows.n_steps] for part in parts]).sum(0)

    def _rows(self, spikes: Tensor) -> tuple[Rows, slice]:
        """Return spikes (sample, input step, channel) as rows with delayed copies, and all samples."""
        network = self.network
        if spikes.ndim != 3 or spikes.shape[2] != network.n_channels:
            shape = tuple(spikes.shape)
            raise ValueError(f"spikes must be (sample, input step, {network.n_channels}), got {shape}")
        if not bool(((spikes == 0) | (spikes == 1)).all()):
            raise ValueError("spikes must be 0 or 1")
        n, n_steps, _ = spikes.shape
        sparse = Spikes.of_dense(spikes.detach().cpu().numpy() != 0, 1.0)
        delays, start = network.delays, np.zeros(n, np.int64)
        rows = gather(sparse, np.arange(n), start, n_steps, delays, network.steps_per_sample)
        return rows, slice(0, n)


def save(network: Network, file: Path) -> None:
    """Write a network so that `load` needs nothing else; `torch.load(file, weights_only=True)` reads it."""
    arrays = store.record_arrays(network)
    named = {k: x.tolist() if x.dtype.kind == "U" else torch.tensor(x) for k, x in arrays.items()}
    torch.save({"schema": SCHEMA, "network": named}, file)


def load(file: Path) -> NetworkModule:
    """Return the module of the network that `save` wrote.

    Raises:
        BundleError: the file cannot be read, is damaged or something else.
    """
    try:
        content = torch.load(file, map_location="cpu", weights_only=True)
    except OSError as error:
        raise BundleError(f"{file}: cannot be read: {error.strerror}") from None
    except Exception:  # whatever a damaged pickle makes of the reader
        content = None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise BundleError(f"{file}: must be a module of {SCHEMA}")
    try:
        named = content["network"].items()
        network = store.fitted_of({k: x.numpy() if isinstance(x, Tensor) else np.array(x) for k, x in named})
        if not isinstance(network, Network):
            raise ValueError("it holds no network")
        check_network(network, network.sizes[-1])
        return NetworkModule(network)
    except (store.StoreError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BundleError(f"{file}: is damaged: {error}") from None


def listed(fired: Tensor, first: int = 0) -> Ints:
    """Return recording, step and neuron of every spike of a layer, (n_spikes, 3); recordings from `first`."""
    places = fired.nonzero()
    times = fired[tuple(places.T)].long()  # some neurons spike several times in a step
    spikes: Ints = torch.repeat_interleave(places, times, dim=0).numpy() + np.array([first, 0, 0])
    return spikes
