"""Which cores a dense network occupies on Loihi 1, and how far its messages travel.

A dense layer of j neurons with i input axons goes to ceil(j / n) cores, n the most neurons whose
axons a core can hold: every input axon lists its targets there in blocks of 64, each

    ceil((64 w + 10) / 64) words of 64 bit    (w bits per weight, 4 index and 6 count bits per block)

the last block with the remaining targets only. Neurons are then spread evenly over the cores. A
recurrent layer has its own outputs among its input axons. Delayed copies of an input are axons of
their own. Cores are numbered layer by layer, tile by tile; inputs enter at tile 0 and take no core.
A layer that was pruned stores lists of the weights that are left, each with the index of its target
(10 bits); in the mean field an axon has as many targets in a core as any other.

Source: NengoLoihi's allocator rule; limits per core in the profile (REFERENCES.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

_BLOCK, _WORD, _BLOCK_HEADER, _INDEX = 64, 64, 10, 10
WEIGHT_FORMATS = (1, 2, 3, 4, 5, 6, 8)  # bits per weight that a core can store


@dataclass(frozen=True)
class Placement:
    """Cores per layer after the input, and every limit that is broken (empty: the network fits).

    A network that does not fit is still placed, as if the chip went on, so that its cost can be named.
    """

    cores: tuple[int, ...]
    misfits: tuple[str, ...]

    @property
    def n_cores(self) -> int:
        return sum(self.cores)


def axon_bits(n_targets: int, weight_bits: int) -> int:
    """Return the synapse memory that one input axon with so many targets on a core takes."""
    blocks, rest = divmod(n_targets, _BLOCK)
    return _WORD * (blocks * _words(_BLOCK, weight_bits) + (_words(rest, weight_bits) if rest else 0))


def _words(n_targets: int, weight_bits: int) -> int:
    return -(-(n_targets * weight_bits + _BLOCK_HEADER) // _WORD)


def place(
    sizes: tuple[int, ...],
    recurrent: tuple[bool, ...],
    weight_bits: int,
    limits: Mapping[str, float],
    stored: tuple[int, ...] | None = None,
) -> Placement:
    """Return the cores of every layer.

    Args:
        sizes: neurons per layer, input first.
        recurrent: per layer after the input, whether it feeds itself.
        weight_bits: bits per weight; stored in the next format that holds them.
        limits: `Profile.at("value")`.
        stored: per layer after the input, weights into it that are not 0 and alone take memory; None: all.
    """
    misfits = []
    bits = min((x for x in WEIGHT_FORMATS if x >= weight_bits), default=weight_bits)
    if bits not in WEIGHT_FORMATS:
        misfits.append(f"weights of {weight_bits} bits, {WEIGHT_FORMATS[-1]} at most")
    cores: list[int] = []
    next_cores = 0  # from the output backwards: a layer's output axons depend on the cores after it
    for layer in range(len(sizes) - 1, 0, -1):
        axons = sizes[layer - 1] + (sizes[layer] if recurrent[layer - 1] else 0)
        if axons > limits["input_axons_per_core"]:
            misfits.append(
                f"layer {layer}: {axons} input axons, {limits['input_axons_per_core']:.0f} per core"
            )
        share = 1.0
        if stored is not None and stored[layer - 1] < sizes[layer] * axons:
            share, width = stored[layer - 1] / (sizes[layer] * axons), bits + _INDEX
        else:
            width = bits
        if _core_bits(1, axons, width, share) > limits["synapse_memory_bits"]:
            misfits.append(f"layer {layer}: the weights of one neuron exceed the synapse memory of a core")
        most = _most_neurons(axons, width, share, limits)
        n_cores = -(-sizes[layer] // most)
        while True:  # more cores hold fewer neurons each, and so fewer output axons
            per_core = -(-sizes[layer] // n_cores)
            destinations = next_cores + (n_cores if recurrent[layer - 1] else 0)
            if per_core * destinations <= limits["output_axons_per_core"]:
                break
            if per_core == 1:
                misfits.append(f"layer {layer}: {destinations} output axons of one neuron")
                break
            n_cores += 1
        cores.append(n_cores)
        next_cores = n_cores
    if sum(cores) > limits["cores"]:
        misfits.append(f"{sum(cores)} cores, the chip has {limits['cores']:.0f}")
    return Placement(tuple(reversed(cores)), tuple(misfits))


def _core_bits(neurons: int, axons: int, bits: int, share: float) -> float:
    """Return the memory of a core's synapses, where each axon has a share of the neurons as targets.

    With less than one target per axon, so many axons have one; more are rounded up to whole targets.
    """
    targets = share * neurons
    return axons * min(targets, 1.0) * axon_bits(max(1, math.ceil(targets)), bits)


def _most_neurons(axons: int, bits: int, share: float, limits: Mapping[str, float]) -> int:
    """Return the most neurons that a core can hold, at least 1: `_core_bits` grows with them."""
    low, high = 1, int(limits["neurons_per_core"])
    while low < high:
        middle = (low + high + 1) // 2
        if _core_bits(middle, axons, bits, share) <= limits["synapse_memory_bits"]:
            low = middle
        else:
            high = middle - 1
    return low


def hops(
    placement: Placement, sizes: tuple[int, ...], recurrent: tuple[bool, ...], limits: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return the mean tile hops (layer, 2) along x and y that one spike's messages travel, input first.

    Tiles are numbered along y first. A message goes from the core of the neuron that fires to every
    core of the next layer, and of its own where that is recurrent.
    """
    ends = np.cumsum((0, *placement.cores))
    tiles = [np.arange(a, b) // int(limits["cores_per_tile"]) for a, b in pairwise(ends)]
    sources = [np.zeros(1, dtype=np.int64), *tiles]
    result = np.zeros((len(sizes), 2))
    for layer, source in enumerate(sources):
        onward = tiles[layer : layer + 1] + ([source] if layer > 0 and recurrent[layer - 1] else [])
        if onward:
            share = neurons_per_core(sizes[layer], len(source)) / sizes[layer]
            destination = np.concatenate(onward)
            for axis, position in enumerate((np.floor_divide, np.remainder)):
                height = int(limits["mesh_height"])
                distance = np.abs(np.subtract.outer(position(source, height), position(destination, height)))
                result[layer, axis] = share @ distance.sum(axis=1)
    return result


def neurons_per_core(n: int, n_cores: int) -> NDArray[np.int64]:
    """Return how many of n neurons each core holds: as even as can be, larger shares first."""
    return n // n_cores + (np.arange(n_cores) < n % n_cores).astype(np.int64)
