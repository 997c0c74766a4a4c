"""Where a cohort's neurons and weights lie on the device.

Every matrix is stored as tiles of WIDTH columns, each tile a contiguous (row, WIDTH) block. The layers
of several members at one depth stand side by side in a `Stage`, each member padded to whole tiles, so
that a program works on one tile of one member and never sees another member's numbers. A tile's weights
are a panel: one row of WIDTH weights per source neuron, the source padded to whole tiles as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dse.engine.layers import kernel_population
from dse.engine.member import Member
from dse.neurons import cuba_lif, resonator
from dse.neurons.fixed_point import DECAY_SCALE
from dse.records import Array, Ints

WIDTH = 64
"""Columns per tile: a tensor-core product's natural width."""


def tiles_for(n: int) -> int:
    """Return how many tiles hold n columns."""
    return -(-n // WIDTH)


@dataclass(frozen=True)
class Panels:
    """Weights into the tiles of a stage.

    source: (tile,) int32 first tile of the source neurons.
    n_sources: (tile,) int32 tiles of source neurons; 0 where the tile has no such weights.
    offset: (tile,) int64 position of the tile's panel of n_sources * WIDTH rows.
    size: weights of all panels.
    """

    source: Array
    n_sources: Array
    offset: Array
    size: int


@dataclass(frozen=True)
class Stage:
    """The layers of one depth, side by side.

    owner: (tile,) int32 number of the member within the slab.
    first, count: (tile,) int32 the owner's first tile and number of tiles.
    is_output: (tile,) the tile belongs to its owner's last layer.
    ahead_first, ahead_count: (tile,) int32 the owner's tiles in the next stage; 0 where there are none.
    feed_forward, recurrent: the panels of either kind of weights.
    keep_u, keep_v: (tile, WIDTH) int32 factors of either state in 1/4096: 4096 - decay, or c of a resonator.
    cross: (4, tile, WIDTH) int32 dse.neurons.resonator.Cross, the first two in 1/4096; (4, 0, WIDTH): no
        layer has resonators.
    threshold: (tile,) int32 mantissa.
    surrogate: (4, tile) float64 of Exponential.exponents.
    unit, recurrent_unit: (tile, WIDTH) float32.
    """

    owner: Array
    first: Array
    count: Array
    is_output: Array
    ahead_first: Array
    ahead_count: Array
    feed_forward: Panels
    recurrent: Panels
    keep_u: Ints
    keep_v: Ints
    cross: Ints
    threshold: Array
    surrogate: Array
    unit: Array
    recurrent_unit: Array

    @property
    def n_tiles(self) -> int:
        return len(self.owner)


def columns(values: Array) -> Array:
    """Return (row, neuron) values as (tile, row, WIDTH), padded with zeros."""
    n_rows, n = values.shape
    padded = np.zeros((n_rows, tiles_for(n) * WIDTH), values.dtype)
    padded[:, :n] = values
    return np.ascontiguousarray(padded.reshape(n_rows, -1, WIDTH).swapaxes(0, 1))


def panel(matrix: Array) -> Array:
    """Return a (source, neuron) matrix as (tile, padded source, WIDTH), padded with zeros."""
    return columns(np.pad(matrix, ((0, -len(matrix) % WIDTH), (0, 0))))


def matrix(panels: Array, n_in: int, n_out: int) -> Array:
    """Return the (source, neuron) matrix that `panel` laid out."""
    return panels.swapaxes(0, 1).reshape(panels.shape[1], -1)[:n_in, :n_out].copy()


def _panels(source: Array, n_sources: Array) -> Panels:
    sizes = n_sources.astype(np.int64) * WIDTH * WIDTH
    ends = np.cumsum(sizes)
    return Panels(source, n_sources.astype(np.int32), ends - sizes, int(ends[-1]))


def stages(members: Sequence[Member]) -> tuple[Stage, ...]:
    """Return the stages of members with the same inputs, input side first."""
    depths = max(len(m.layers) for m in members)
    count = np.zeros((depths + 1, len(members)), np.int32)
    for number, member in enumerate(members):
        count[: len(member.layers), number] = [tiles_for(x.feed_forward.shape[1]) for x in member.layers]
    first = np.cumsum(count, axis=1, dtype=np.int32) - count
    inputs = np.full(len(members), tiles_for(members[0].layers[0].feed_forward.shape[0]), np.int32)
    return tuple(
        _stage(
            members,
            d,
            (first[d - 1] if d else np.zeros_like(inputs), count[d - 1] if d else inputs),
            (first[d], count[d]),
            (first[d + 1], count[d + 1]),
        )
        for d in range(depths)
    )


def _cross(population: cuba_lif.Population | resonator.Population) -> tuple[Array, ...]:
    """Return what one state gives to the other, in 1/4096 where it is of the step before."""
    if isinstance(population, cuba_lif.Population):
        return np.zeros(()), np.zeros(()), np.ones(()), np.zeros(())
    y_to_x, x_to_y, now_to_y, hold = population.cross
    return np.rint(DECAY_SCALE * y_to_x), np.rint(DECAY_SCALE * x_to_y), now_to_y, hold


def _stage(
    members: Sequence[Member],
    depth: int,
    before: tuple[Array, Array],
    here: tuple[Array, Array],
    ahead: tuple[Array, Array],
) -> Stage:
    """Return one stage, given every member's first tile and number of tiles in it and beside it."""
    owner = np.repeat(np.arange(len(members), dtype=np.int32), here[1])
    layers = [m.layers[depth] for m in members if depth < len(m.layers)]
    populations = [kernel_population(x.population) for x in layers]
    tiles = here[1][here[1] > 0]
    has_ring = np.asarray([depth < len(m.layers) and m.layers[depth].recurrent is not None for m in members])

    def per_neuron(values: list[Array], kind: type) -> Array:
        sizes = [(1, x.feed_forward.shape[1]) for x in layers]
        rows = [columns(np.broadcast_to(v, n).astype(kind)) for v, n in zip(values, sizes, strict=True)]
        return np.concatenate([row[:, 0] for row in rows])

    crosses = [_cross(p) for p in populations]
    surrogates = [x.surrogate.exponents(p.to_threshold) for x, p in zip(layers, populations, strict=True)]
    ring_units = [x.unit if x.recurrent_unit is None else x.recurrent_unit for x in layers]
    return Stage(
        owner,
        here[0][owner],
        here[1][owner],
        np.asarray([depth == len(m.layers) - 1 for m in members])[owner],
        ahead[0][owner],
        ahead[1][owner],
        _panels(before[0][owner], before[1][owner]),
        _panels(here[0][owner], np.where(has_ring, here[1], 0)[owner]),
        per_neuron([np.rint(DECAY_SCALE * p.keep[0]) for p in populations], np.int32),
        per_neuron([np.rint(DECAY_SCALE * p.keep[1]) for p in populations], np.int32),
        np.stack([per_neuron([cross[k] for cross in crosses], np.int32) for k in range(4)])
        if any(isinstance(p, resonator.Population) for p in populations)
        else np.zeros((4, 0, WIDTH), np.int32),
        np.repeat(np.asarray([p.threshold for p in populations], np.int32), tiles),
        np.repeat(np.asarray(surrogates), tiles, axis=0).T.copy(),
        per_neuron([x.unit for x in layers], np.float32),
        per_neuron(ring_units, np.float32),
    )
