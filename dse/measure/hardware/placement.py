"""Which cores a dense network occupies, how far its messages travel, and what would make it fit.

A dense layer of j neurons with i input axons goes to ceil(j / n) cores, n the most neurons whose axons a
core can hold: every input axon lists its targets there in blocks of `synapse_block`, each

    ceil((block (w + d) + header) / word) words    (w bits per weight, d per delay of a synapse)

the last block with the remaining targets only. Neurons are then spread evenly over the cores. A
recurrent layer has its own outputs among its input axons. Delayed copies of an input are axons of
their own. Cores are numbered layer by layer, tile by tile; inputs enter at tile 0 and take no core.
A layer that was pruned stores lists of the weights that are left, each with the index of its target;
in the mean field an axon has as many targets in a core as any other.

A compiler may take more cores than memory asks for. Where its logs are public, the range of cores in practice
stands beside the arithmetic; energies and times are those of the arithmetic's cores.

Source: NengoLoihi's allocator rule for Loihi 1; lava-dl's logs for Loihi 2 (REFERENCES.md).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from dse.base.records import Ints, Workload
from dse.measure.hardware.plan import Misfit, Placement, largest

_PRACTICE_BITS = 8  # per weight, in the logs that `practice` counts weights of


@dataclass(frozen=True)
class Rules:
    """What a core and a chip hold, by the names of `dse.measure.hardware.kinds.mesh.Mesh`.

    practice: fewest and most weights of 8 bits per core that a compiler was seen to reach; None: no range.
    state_bits: of a neuron's states, with their sign; None: not known.
    """

    cores: int
    cores_per_tile: int
    mesh_height: int
    neurons_per_core: int
    input_axons_per_core: int
    output_axons_per_core: int
    synapse_memory_bits: int
    synapse_block: int
    synapse_header_bits: int
    synapse_word_bits: int
    synapse_index_bits: int
    weight_bits_any: int
    weight_bits_most: int
    delay_bits_most: int
    skips_zero_weights: bool
    practice: tuple[float, float] | None = None
    state_bits: int | None = None

    @property
    def state_limit(self) -> float:
        """Largest magnitude that a state holds."""
        return math.inf if self.state_bits is None else 2 ** (self.state_bits - 1) - 1


@dataclass(frozen=True)
class Architecture:
    """The fields of `dse.base.records.Workload` that decide the placement of a network.

    stored: per layer after the input, weights into it that alone take memory; None: all.
    peak_state: largest magnitude of a state, where that is beyond the chip's; 0: it is not.
    """

    sizes: tuple[int, ...]
    recurrent: tuple[bool, ...]
    weight_bits: int = 8
    delay_bits: int = 0
    stored: tuple[int, ...] | None = None
    cores: tuple[int, ...] | None = None
    peak_state: int = 0
    delayed: tuple[bool, ...] = ()

    @functools.cached_property
    def axons(self) -> tuple[int, ...]:
        """Input axons of each layer after the input."""
        triples = zip(self.sizes, self.sizes[1:], self.recurrent, strict=False)
        return tuple(before + n * back for before, n, back in triples)

    @functools.cached_property
    def dense(self) -> tuple[int, ...]:
        """Weights into each layer after the input, those that are 0 included."""
        return tuple(n * axons for n, axons in zip(self.sizes[1:], self.axons, strict=True))


class _Broken(NamedTuple):
    """A limit that is broken, in a layer or (0) on the chip."""

    rule: str
    layer: int
    text: str


def architecture(load: Workload, rules: Rules) -> Architecture:
    """Return the fields of a load that decide its placement on a chip."""
    stored = load.stored if rules.skips_zero_weights else None
    beyond = load.peak_state if load.peak_state > rules.state_limit else 0
    bits = load.weight_bits, load.delay_bits
    return Architecture(load.sizes, load.recurrent, *bits, stored, load.cores, beyond, load.delayed or ())


@functools.lru_cache(maxsize=1 << 14)
def place(net: Architecture, rules: Rules) -> Placement:
    """Return the cores of every layer, the broken limits and the changes that mend them."""
    cores, broken = _placed(net, rules)
    low, high = _practice(net, rules, cores)
    misfits = tuple(Misfit(x.rule, x.text, _change(net, rules, x, broken)) for x in broken)
    return Placement(cores, misfits, low, high, _assumptions(net, rules, sum(cores), low, high))


def axon_bits(n_targets: int, width: int, rules: Rules) -> int:
    """Return the synapse memory that one input axon with so many targets of `width` bits on a core takes."""
    blocks, rest = divmod(n_targets, rules.synapse_block)
    words = blocks * _words(rules.synapse_block, width, rules) + (_words(rest, width, rules) if rest else 0)
    return rules.synapse_word_bits * words


def _words(n_targets: int, width: int, rules: Rules) -> int:
    return -(-(n_targets * width + rules.synapse_header_bits) // rules.synapse_word_bits)


def _format(bits: int, rules: Rules) -> int:
    """Return the bits that a weight takes: any number up to `weight_bits_any`, and then the widest only."""
    return bits if bits <= rules.weight_bits_any else max(bits, rules.weight_bits_most)


def _width(net: Architecture, rules: Rules, layer: int) -> int:
    """Return the bits per stored synapse of a layer, counted from 0 after the input."""
    is_delayed = not net.delayed or net.delayed[layer]
    width = _format(net.weight_bits, rules) + net.delay_bits * is_delayed
    return width + rules.synapse_index_bits if _is_pruned(net, layer) else width


def _is_pruned(net: Architecture, layer: int) -> bool:
    return net.stored is not None and net.stored[layer] < net.dense[layer]


def _most_neurons(net: Architecture, rules: Rules, layer: int) -> int:
    """Return the most neurons of a layer whose synapses a core can hold: 0 if not even one."""
    axons, width = net.axons[layer], _width(net, rules, layer)
    words = rules.synapse_memory_bits // (axons * rules.synapse_word_bits)
    blocks, rest = divmod(words, _words(rules.synapse_block, width, rules))
    in_rest = max(rest * rules.synapse_word_bits - rules.synapse_header_bits, 0) // width
    targets = blocks * rules.synapse_block + in_rest
    if net.stored is None or not _is_pruned(net, layer):
        return targets
    stored, dense = net.stored[layer], net.dense[layer]
    if stored == 0:
        return rules.neurons_per_core
    if targets:  # an axon has stored / dense of the neurons as targets, rounded up
        return targets * dense // stored
    # Less than one target per axon: so many axons have one.
    return rules.synapse_memory_bits * dense // (axons * stored * axon_bits(1, width, rules))


def _placed(net: Architecture, rules: Rules) -> tuple[tuple[int, ...], tuple[_Broken, ...]]:
    """Return the cores of every layer and the broken limits; what cannot fit is placed on larger cores."""
    broken: list[_Broken] = []
    for rule, bits, most in (
        ("weight_bits", net.weight_bits, rules.weight_bits_most),
        ("delay_bits", net.delay_bits, rules.delay_bits_most),
    ):
        if bits > most:
            broken.append(_Broken(rule, 0, f"{rule.split('_')[0]}s of {bits} bits, {most} at most"))
    if net.peak_state > rules.state_limit:
        times = net.peak_state / rules.state_limit
        text = f"a state reaches {times:.3g} times what {rules.state_bits} bits hold ({net.peak_state})"
        broken.append(_Broken("state_bits", 0, text))
    cores: list[int] = []
    next_cores = 0  # from the output backwards: a layer's output axons depend on the cores after it
    for layer in range(len(net.sizes) - 1, 0, -1):
        at, size, loops = layer - 1, net.sizes[layer], net.recurrent[layer - 1]
        axons = net.axons[at]
        if axons > rules.input_axons_per_core:
            text = f"layer {layer}: {axons} input axons, {rules.input_axons_per_core} per core"
            broken.append(_Broken("input_axons", layer, text))
        in_memory = _most_neurons(net, rules, at)
        if in_memory < 1:
            text = f"layer {layer}: the weights of one neuron exceed the synapse memory of a core"
            broken.append(_Broken("synapse_memory", layer, text))
        most = min(max(in_memory, 1), rules.neurons_per_core)
        if net.cores is None:
            n_cores = _fewest_cores(size, most, loops, next_cores, rules.output_axons_per_core)
        else:
            n_cores = net.cores[at]
            neurons = -(-size // n_cores)
            if neurons > most and in_memory >= 1:
                rule = "neurons" if neurons > rules.neurons_per_core else "synapse_memory"
                text = f"layer {layer}: {neurons} neurons on a core, which holds {most} of them"
                broken.append(_Broken(rule, layer, text))
        neurons, destinations = -(-size // n_cores), next_cores + loops * n_cores
        if neurons * destinations > rules.output_axons_per_core:
            text = (
                f"layer {layer}: {neurons} neurons on a core that send to {destinations} cores each, "
                f"{rules.output_axons_per_core} output axons per core"
            )
            broken.append(_Broken("output_axons", layer, text))
        cores.append(n_cores)
        next_cores = n_cores
    placed = tuple(reversed(cores))
    low, _ = _practice(net, rules, placed)
    if max(sum(placed), low or 0) > rules.cores:
        text = f"{sum(placed)} cores" if low is None else f"at least {low} cores in practice"
        broken.append(_Broken("cores", 0, f"{text}; the chip has {rules.cores}"))
    return placed, tuple(broken)


def _fewest_cores(size: int, most: int, is_recurrent: bool, next_cores: int, output_axons: int) -> int:
    """Return the fewest cores with so many neurons at most and no more output axons than a core has.

    More cores hold fewer neurons each, and so fewer output axons, but a recurrent layer also sends to all of
    its own. If nothing helps, the fewest cores for the neurons alone.
    """
    fewest = -(-size // most)
    # n neurons on each of ceil(size / n) cores send to size cores or more of their own.
    left = output_axons - size * is_recurrent
    if next_cores:
        most = min(most, left // next_cores)
    for neurons in range(most if left >= 0 else 0, 0, -1):
        n_cores = -(-size // neurons)
        if -(-size // n_cores) * (next_cores + is_recurrent * n_cores) <= output_axons:
            return n_cores
    return fewest


def _practice(net: Architecture, rules: Rules, cores: tuple[int, ...]) -> tuple[int | None, int | None]:
    """Return the fewest and most cores that a compiler may take, at least the arithmetic's."""
    if rules.practice is None or net.cores is not None:
        return None, None
    dense = net.dense if net.stored is None else net.stored
    low = high = 0
    for layer, n_cores in enumerate(cores):
        weights = dense[layer] * _width(net, rules, layer) / _PRACTICE_BITS
        low += max(n_cores, math.ceil(weights / rules.practice[1]))
        high += max(n_cores, math.ceil(weights / rules.practice[0]))
    return low, high


def _assumptions(
    net: Architecture, rules: Rules, n_cores: int, low: int | None, high: int | None
) -> tuple[str, ...]:
    assumptions = []
    if net.cores is not None:
        assumptions.append("the number of cores of each layer is set by the user")
    if net.delay_bits:
        assumptions.append(
            f"every synapse{'' if all(net.delayed or (True,)) else ' of a layer with delays'} stores an "
            f"individual delay, {net.delay_bits} bits beside the "
            f"{_format(net.weight_bits, rules)} of its weight"
        )
    if any(_is_pruned(net, layer) for layer in range(len(net.sizes) - 1)):
        assumptions.append(
            "the weights that remain after pruning are spread evenly, each stored with the "
            f"{rules.synapse_index_bits} bits of its target's index"
        )
    if rules.practice is not None and low is not None and high is not None:
        few, many = (f"{n / 1e3:g}" for n in rules.practice)
        if not net.delay_bits:
            assumptions.append("no synapse stores an individual delay")
        assumptions.append(
            f"{low} to {high} cores if a core holds {few} to {many} thousand 8-bit weights, as in compiler "
            f"logs, scaled by the bits per synapse; energies and times assume {n_cores}, with full core "
            "memories; input neurons may need a few more"
        )
        if low <= rules.cores < high:
            assumptions.append(f"it may not fit: up to {high} cores in practice; the chip has {rules.cores}")
    return tuple(assumptions)


class _Axis(NamedTuple):
    """One number that can be changed, from what it is towards `least`; the larger, the smaller the change."""

    present: int
    least: int
    changed: Callable[[int], Architecture]
    text: Callable[[int], str]


def _change(net: Architecture, rules: Rules, wrong: _Broken, broken: tuple[_Broken, ...]) -> str:
    """Return the smallest change of every number that alone mends what is wrong and breaks nothing else.

    Those that change least come first.
    """
    allowed = {x[:2] for x in broken} - {wrong[:2]}

    def mends(changed: Architecture) -> bool:
        return all(x[:2] in allowed for x in _placed(changed, rules)[1])

    changes = [_largest(axis, mends) for axis in _axes(net, rules)]
    if not any(changes):
        changes = [_largest(_size_axis(net, len(net.sizes) - 1), mends)]
    return " or ".join(text for _, text in sorted(x for x in changes if x)) or "more than one change"


def _largest(axis: _Axis, mends: Callable[[Architecture], bool]) -> tuple[float, str] | None:
    """Return how far an axis must change to mend, as a share of its value, and in words; None: cannot."""
    if axis.least >= axis.present or not mends(axis.changed(axis.least)):
        return None
    n = largest(axis.least, axis.present - 1, lambda n: mends(axis.changed(n)))
    return 1 - n / axis.present, axis.text(n)


def _axes(net: Architecture, rules: Rules) -> Iterator[_Axis]:
    """Yield what can be changed: not the size of the last layer, which the classes decide."""
    if net.cores is not None:
        for layer in range(1, len(net.sizes)):
            yield from _cores_axes(net, rules, layer)
    for layer in range(len(net.sizes) - 1):
        yield _size_axis(net, layer)
    yield _field_axis(net, "weight_bits", 1, "weights of at most {} bits")
    yield _field_axis(net, "delay_bits", 0, "delays of at most {} bits")
    if net.peak_state:
        yield _field_axis(net, "peak_state", 0, "states (peak_state) of at most {}")
    if rules.skips_zero_weights:
        yield _Axis(
            100,
            1,
            lambda percent: replace(
                net, stored=tuple(-(-n * percent // 100) for n in net.stored or net.dense)
            ),
            lambda percent: (
                f"at least {100 - percent} % of the weights {'left ' if net.stored else ''}pruned"
            ),
        )


def _field_axis(net: Architecture, name: str, least: int, text: str) -> _Axis:
    def changed(n: int) -> Architecture:
        return replace(net, **{name: n})  # type: ignore[arg-type]

    return _Axis(getattr(net, name), least, changed, text.format)


def _size_axis(net: Architecture, layer: int) -> _Axis:
    def changed(n: int) -> Architecture:
        smaller = replace(net, sizes=(*net.sizes[:layer], n, *net.sizes[layer + 1 :]))
        if net.cores is not None:
            fewer = tuple(min(pair) for pair in zip(net.cores, smaller.sizes[1:], strict=True))
            smaller = replace(smaller, cores=fewer)
        if net.stored is not None:  # the same share of the weights is left
            triples = zip(net.stored, smaller.dense, net.dense, strict=True)
            smaller = replace(smaller, stored=tuple(-(-n * after // before) for n, after, before in triples))
        return smaller

    name = f"at most {{}} neurons in layer {layer}" if layer else "at most {} inputs"
    return _Axis(net.sizes[layer], 1, changed, name.format)


def _cores_axes(net: Architecture, rules: Rules, layer: int) -> Iterator[_Axis]:
    """Yield fewer cores by hand for a layer, and more, counted as neurons without a core of their own."""
    size, cores = net.sizes[layer], net.cores or ()
    now = cores[layer - 1]
    others = sum(cores) - now
    fewest = _placed(replace(net, cores=None), rules)[0][layer - 1]

    def changed(n: int) -> Architecture:
        return replace(net, cores=(*cores[: layer - 1], n, *cores[layer:]))

    yield _Axis(now, fewest, changed, f"at most {{}} cores for layer {layer}".format)
    yield _Axis(
        size - now,
        max(size - (rules.cores - others), 0),
        lambda shared: changed(size - shared),
        lambda shared: f"at least {size - shared} cores for layer {layer}",
    )


def hops(net: Architecture, cores: tuple[int, ...], rules: Rules) -> tuple[tuple[float, float], ...]:
    """Return the mean tile hops along x and y that one spike's messages travel, per layer, input first.

    Tiles are numbered along y first. A message goes from the core of the neuron that fires to every
    core of the next layer, and of its own where that is recurrent.
    """
    n_layers = len(net.sizes)
    if sum(cores) <= rules.cores_per_tile:
        return ((0.0, 0.0),) * n_layers
    first = [0, *accumulate(cores)]
    tiles = [_tiles(a, b, rules.cores_per_tile) for a, b in pairwise(first)]
    of_layers = []
    for layer, size in enumerate(net.sizes):
        sending: Ints = np.zeros(1, np.int64)
        n_sent: Ints = np.full(1, size)
        if layer:
            sending, start, end = tiles[layer - 1]
            n_sent = _neurons(size, cores[layer - 1], start, end)
        loops = layer > 0 and net.recurrent[layer - 1]
        onward = [*tiles[layer : layer + 1], *tiles[layer - 1 : layer] * loops]
        x = y = 0.0
        for receiving, start, end in onward:
            x += _distance(sending // rules.mesh_height, n_sent, receiving // rules.mesh_height, end - start)
            y += _distance(sending % rules.mesh_height, n_sent, receiving % rules.mesh_height, end - start)
        of_layers.append((x / size, y / size))
    return tuple(of_layers)


def neurons_per_core(n: int, n_cores: int) -> Ints:
    """Return how many of n neurons each core holds: as even as can be, larger shares first."""
    return n // n_cores + (np.arange(n_cores) < n % n_cores).astype(np.int64)


def _tiles(first: int, end: int, cores_per_tile: int) -> tuple[Ints, Ints, Ints]:
    """Return the tiles of cores first..end - 1, and which of these lie on each: from, to, counted from 0."""
    tile = np.arange(first // cores_per_tile, (end - 1) // cores_per_tile + 1)
    start = np.maximum(tile * cores_per_tile, first) - first
    return tile, start, np.minimum((tile + 1) * cores_per_tile, end) - first


def _neurons(size: int, n_cores: int, start: Ints, end: Ints) -> Ints:
    """Return how many neurons cores start..end - 1 of a layer hold (`neurons_per_core`)."""
    share, more = divmod(size, n_cores)
    return share * (end - start) + np.minimum(end, more) - np.minimum(start, more)


def _distance(sending: Ints, n_sent: Ints, receiving: Ints, n_received: Ints) -> float:
    """Return the sum over senders and receivers (position, how many) of their distances."""
    n_positions = 1 + int(max(sending.max(), receiving.max()))
    left = np.cumsum(np.bincount(sending, n_sent, n_positions))
    right = np.cumsum(np.bincount(receiving, n_received, n_positions))
    # What is sent from one side of the gap behind a position to the other crosses it.
    return float((left * (right[-1] - right) + right * (left[-1] - left)).sum())
