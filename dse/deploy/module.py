"""A network as a torch module: the forward of the deployed one, differentiable, and back to a network.

In integer arithmetic the module fires the same spikes as the engine, bit for bit: states are whole numbers in
float64, and sums of 8-bit weights are exact in any order. Backward, rounding passes straight through and a
surrogate stands for ds/dv, as in training. The same weights also run in real arithmetic ("float32"): a float
twin, which forgets what rounding costs. The equations are those of dse.neurons, run on torch.

Pruned weights stay pruned, shared ones stay equal, and weights of fewer bits stay on their grid.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dse import store
from dse.deploy.classifier import BundleError, Classifier
from dse.deploy.reference import prepared
from dse.engine.autograd import (
    TorchCalculus,
    first_drive,
    later,
    layer_spikes,
    loss_of,
    on_torch,
    quantised,
)
from dse.engine.checks import check_network
from dse.engine.events import Rows, gather
from dse.engine.goal import Goal
from dse.engine.shared import copies_of, distinct
from dse.models.snn.quantise import stored
from dse.models.snn.settings import Stack
from dse.neurons import population_of
from dse.neurons.fixed_point import BITS
from dse.neurons.surrogate import Exponential
from dse.records import Arithmetic, Array, Head, Ints, Layer, Network, Spikes

SCHEMA = "dse/module/1"


@dataclass(frozen=True)
class Grid:
    """What the weights of a layer are rounded to: so many bits, times 2**exponent."""

    weight_bits: int = BITS
    exponent: int = 0


class LayerModule(torch.nn.Module):
    """A layer: weighted spikes in, spikes out, in the step in which they fire.

    weight: (neuron, input) as stored, before rounding; of shared weights (n_weights,), one copy of each.
    recurrent: (neuron, neuron), row = postsynaptic, or None.
    """

    def __init__(self, layer: Layer, arithmetic: Arithmetic, surrogate: Exponential, grid: Grid) -> None:
        super().__init__()
        self._layer, self._arithmetic, self._surrogate, self._grid = layer, arithmetic, surrogate, grid
        self._population = population_of(layer.neuron, layer.parameters)
        weights = layer.weight if layer.shared is None else distinct(layer.weight, layer.shared)
        self.weight = torch.nn.Parameter(torch.tensor(weights, dtype=torch.float32))
        self.recurrent: torch.nn.Parameter | None = None
        if layer.recurrent is not None:
            self.recurrent = torch.nn.Parameter(torch.tensor(layer.recurrent, dtype=torch.float32))
        # They are stored beside the weights, so that those of another network are told apart.
        for name, values in layer.parameters.items():
            self.register_buffer(f"neurons_{name}", torch.tensor(np.asarray(values)))
        if layer.delay is not None:
            self.register_buffer("delay", torch.tensor(layer.delay))
        if layer.shared is not None:
            number = copies_of(layer.shared).number.reshape(layer.shared.shape)
            self.register_buffer("_number", torch.tensor(number), persistent=False)

    def forward(self, arriving: Tensor | Rows, samples: slice = slice(None)) -> Tensor:
        """Return the spikes of the layer, (step, sample, neuron), in the step in which they fire.

        Args:
            arriving: spikes that reach it, (step, sample, input), or rows of input spikes.
            samples: of the rows.
        """

        def summed(w: Tensor) -> Tensor:
            return first_drive(arriving, samples, w.T) if isinstance(arriving, Rows) else arriving @ w.T

        drive = self._delayed(self._running(self._matrix()), summed)
        calculus = TorchCalculus(self._arithmetic, self._surrogate, self.weight.device)
        ring = None if self.recurrent is None else self._running(self._kept(self.recurrent, "recurrent")).T
        return layer_spikes(drive, on_torch(self._population, calculus), calculus, ring)

    def stored(self) -> Layer:
        """Return the layer with the weights that the module has now."""

        def on_grid(weights: Tensor) -> Array:
            values = weights.detach().cpu().numpy().copy()
            bits, exponent = self._grid.weight_bits, self._grid.exponent
            return stored(values, bits, exponent) if bits < BITS else values

        ring = None if self.recurrent is None else on_grid(self._kept(self.recurrent, "recurrent"))
        return dataclasses.replace(self._layer, weight=on_grid(self._matrix()), recurrent=ring)

    def _matrix(self) -> Tensor:
        """Return the weights of all synapses, (neuron, input)."""
        if self._layer.shared is None:
            return self._kept(self.weight, "weight")
        return self._kept(
            torch.cat([self.weight, self.weight.new_zeros(1)])[self.get_buffer("_number")], "weight"
        )

    def _kept(self, weights: Tensor, name: str) -> Tensor:
        """Return weights with a 0 where the stored matrix has one."""
        return weights * torch.as_tensor(getattr(self._layer, name) != 0, device=weights.device)

    def _running(self, weights: Tensor) -> Tensor:
        if self._arithmetic == "integer":
            weights = quantised(weights, self._grid.weight_bits, self._grid.exponent)
        return weights.to(TorchCalculus(self._arithmetic, self._surrogate).dtype)

    def _delayed(self, weight: Tensor, summed: Any) -> Tensor:
        """Return the weighted input; of synapses with delays a sum for each delay, that much later."""
        if self._layer.delay is None:
            return torch.as_tensor(summed(weight))
        delay, total = self.get_buffer("delay"), None
        for steps in torch.unique(delay).tolist():
            part = summed(weight * (delay == steps))
            moved = torch.cat([torch.zeros_like(part[:steps]), part[: max(0, len(part) - steps)]])[
                : len(part)
            ]
            total = moved if total is None else total + moved
        return torch.as_tensor(total)


class ClassifierModule(torch.nn.Module):
    """A spiking network: input spikes in, output spikes as its decision rule receives them out.

    layers: `LayerModule`s, input side first.
    surrogates, grids: of each layer.
    """

    def __init__(
        self,
        network: Network,
        surrogates: Sequence[Exponential],
        grids: Sequence[Grid],
        goal: Goal | None = None,
        heads: Sequence[Head] = (),
        arithmetic: Arithmetic | None = None,
    ) -> None:
        super().__init__()
        self._network, self._goal, self._heads = network, goal, tuple(heads)
        self.surrogates, self.grids = tuple(surrogates), tuple(grids)
        kind = arithmetic or network.arithmetic
        self.layers = torch.nn.ModuleList(
            LayerModule(layer, kind, surrogate, grid)
            for layer, surrogate, grid in zip(network.layers, surrogates, grids, strict=True)
        )
        self.register_buffer("delays", torch.tensor(network.delays))
        self.register_buffer("steps_per_sample", torch.tensor(network.steps_per_sample))

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

        Args:
            rows: input spikes with their delayed copies (dse.engine.events).
            samples: of the rows.
        """
        first, *others = self.layers
        fired = [first(rows, samples)]
        for layer in others:
            fired.append(layer(later(fired[-1])))
        return fired

    def loss(self, output: Tensor, label: Tensor) -> Tensor:
        """Return the loss that the network was trained with, summed over samples.

        Args:
            output: what the module returned.
            label: (sample,) numbers of classes of the bundle, of a joint target those of the joint classes.

        Raises:
            ValueError: the module is from a file, which holds no loss.
        """
        if self._goal is None:
            raise ValueError(
                "a module from a file has no loss: make it of the bundle, or use a loss of your own"
            )
        labels = label.detach().cpu().numpy()
        if self._heads:
            starts = np.cumsum([0, *(len(head.classes) for head in self._heads[:-1])])
            pairs = zip(self._heads, starts, strict=True)
            labels = np.stack([head.of_class[labels] + start for head, start in pairs], axis=1)
        return loss_of(output.transpose(0, 1), labels, self._goal)

    def network(self) -> Network:
        """Return the network with the weights that the module has now, in its own arithmetic."""
        layers = tuple(layer.stored() for layer in self.layers if isinstance(layer, LayerModule))
        return dataclasses.replace(self._network, layers=layers)

    def _rows(self, spikes: Tensor) -> tuple[Rows, slice]:
        """Return spikes (sample, input step, channel) as rows with delayed copies, and all samples."""
        network = self._network
        if spikes.ndim != 3 or spikes.shape[2] != network.n_channels:
            shape = tuple(spikes.shape)
            raise ValueError(f"spikes must be (sample, input step, {network.n_channels}), got {shape}")
        if not bool(((spikes == 0) | (spikes == 1)).all()):
            raise ValueError("spikes must be 0 or 1")
        n, n_steps, n_channels = spikes.shape
        row, channel = np.nonzero(spikes.detach().cpu().numpy().reshape(n * n_steps, n_channels))
        offsets = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=n * n_steps))])
        sparse = Spikes(offsets, channel.astype(np.int32), n_steps, n_channels, 1.0)
        delays, start = network.delays, np.zeros(n, np.int64)
        rows = gather(sparse, np.arange(n), start, n_steps, delays, network.steps_per_sample)
        return rows, slice(0, n)


def of_bundle(bundle: Classifier, arithmetic: Arithmetic | None = None) -> ClassifierModule:
    """Return a bundle as a module; None: in its own arithmetic.

    Raises:
        BundleError: it is no network, or its neurons do not run in such arithmetic.
    """
    network, model = bundle.fitted, bundle.sections.model
    if not isinstance(network, Network):
        kind = bundle.sections.kinds["model"]
        raise BundleError(f"only networks of neurons are torch modules, and family {kind} is none")
    settings = model if isinstance(model, Stack) else Stack()
    possible = settings.neuron.arithmetics
    if arithmetic not in (None, *possible):
        raise BundleError(f"arithmetic must be {' or '.join(possible)} for these neurons, got {arithmetic}")
    last = len(network.layers) - 1
    populations = [population_of(x.neuron, x.parameters) for x in network.layers]
    precision = bundle.evidence.get("precision") or {}
    exponents = precision.get("exponents") or [0] * (last + 1)
    return ClassifierModule(
        network,
        [settings.surrogate(x.to_threshold, is_output=k == last) for k, x in enumerate(populations)],
        [Grid(int(precision.get("weight_bits", BITS)), int(e)) for e in exponents],
        Goal(
            settings.loss,
            settings.true_rate,
            settings.false_rate,
            tuple(len(head.classes) for head in bundle.heads),
        ),
        bundle.heads,
        arithmetic,
    )


def save(module: ClassifierModule, file: Path) -> None:
    """Write a module so that `load` needs nothing else; `torch.load(file, weights_only=True)` reads it."""
    arrays = store.record_arrays(module.network())
    surrogates = [dataclasses.astuple(x) for x in module.surrogates]
    content = {
        "schema": SCHEMA,
        "network": {k: x.tolist() if x.dtype.kind == "U" else torch.tensor(x) for k, x in arrays.items()},
        "surrogates": [[torch.as_tensor(number) for number in numbers] for numbers in surrogates],
        "grids": [dataclasses.astuple(grid) for grid in module.grids],
    }
    torch.save(content, file)


def load(file: Path) -> ClassifierModule:
    """Return the module that `save` wrote; it has no loss.

    Raises:
        BundleError: the file is damaged or something else.
    """
    content = loaded(file)
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise BundleError(f"{file}: must be a module of {SCHEMA}")
    try:
        named = content["network"].items()
        network = store.fitted_of({k: x.numpy() if isinstance(x, Tensor) else np.array(x) for k, x in named})
        if not isinstance(network, Network):
            raise ValueError("it holds no network")
        check_network(network, network.sizes[-1])
        surrogates = [
            Exponential(*(number.item() if number.ndim == 0 else number.numpy() for number in numbers))
            for numbers in content["surrogates"]
        ]
        return ClassifierModule(network, surrogates, [Grid(*grid) for grid in content["grids"]])
    except (store.StoreError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BundleError(f"{file}: is damaged: {error}") from None


def loaded(file: Path) -> object:
    """Return what `torch.save` wrote to a file, if it is tensors and plain values; else None.

    Raises:
        BundleError: the file cannot be read.
    """
    try:
        return torch.load(file, map_location="cpu", weights_only=True)
    except OSError as error:
        raise BundleError(f"{file}: cannot be read: {error.strerror}") from None
    except Exception:  # whatever a damaged pickle makes of the reader
        return None


def listed(fired: Tensor, first: int = 0) -> Ints:
    """Return recording, step and neuron of every spike of a layer, (n_spikes, 3); recordings from `first`."""
    places = fired.nonzero()
    times = fired[tuple(places.T)].long()  # some neurons spike several times in a step
    spikes: Ints = torch.repeat_interleave(places, times, dim=0).numpy() + np.array([first, 0, 0])
    return spikes


class Examples(torch.utils.data.Dataset[tuple[Tensor, int]]):
    """Labelled recordings as a bundle sees them: spikes of the window (input step, channel), and the class.

    labels: numbers of classes of the bundle.
    """

    def __init__(self, bundle: Classifier, data_file: str | Path) -> None:
        data = prepared(bundle, data_file).dataset
        self._data, self._samples = data, data.test[data.target[data.test] >= 0]
        self.labels = data.target[self._samples]

    def __len__(self) -> int:
        return len(self._samples)

    def __getitem__(self, number: int) -> tuple[Tensor, int]:
        """Return recording `number` of those that are labelled."""
        data, sample = self._data, int(self._samples[number])
        row = sample * data.spikes.n_steps + int(data.start[sample])
        borders = np.asarray(data.spikes.row_offsets[row : row + data.n_steps + 1])
        step = np.repeat(np.arange(data.n_steps), np.diff(borders))
        spikes = np.zeros((data.n_steps, data.spikes.n_channels), np.float32)
        spikes[step, data.spikes.channel[borders[0] : borders[-1]]] = 1
        return torch.from_numpy(spikes), int(self.labels[number])
