"""Kernels: Adam on master weights, and the weights that run.

Programs are blocks of WIDTH x WIDTH weights of a tile's panel (dse.engine.gpu.layout).
"""

from __future__ import annotations

import triton
import triton.language as tl

from dse.engine.gpu.numbers import GRID, HIGHEST, LOWEST, WIDTH, mantissa_of, store_parts


@triton.jit
def _block(tiles: tl.tensor, n_sources: tl.tensor, offset: tl.tensor) -> tl.tensor:
    """Return a program's tile, where its block of the panel lies, and the mask of weights that exist."""
    tile = tl.load(tiles + tl.program_id(0)).to(tl.int64)
    row = (tl.program_id(1) * WIDTH + tl.arange(0, WIDTH))[:, None]
    at = tl.load(offset + tile) + row * WIDTH + tl.arange(0, WIDTH)[None, :]
    return tile, at, row < tl.load(n_sources + tile) * WIDTH


@triton.jit
def _passing(gradient: tl.tensor, master: tl.tensor, INTEGER: tl.constexpr) -> tl.tensor:
    """Return the gradient by the master weights: 0 where they are clipped (fixed_point.quantise_passes)."""
    if INTEGER:
        mantissa = mantissa_of(master)
        return tl.where((mantissa >= LOWEST) & (mantissa <= HIGHEST), gradient, 0.0)
    else:
        return gradient


@triton.jit
def deploy(
    masters: tl.tensor,
    weights: tl.tensor,
    tiles: tl.tensor,
    n_sources: tl.tensor,
    offset: tl.tensor,
    size: tl.tensor,
    INTEGER: tl.constexpr,
    N_PARTS: tl.constexpr,
) -> None:
    """Set the weights that run from the master weights; programs are blocks of the tiles' panels.

    Args:
        masters: panels, float32.
        weights: panels, in parts `size` apart.
        tiles: tile numbers, one per program on axis 0; source tiles of the panel on axis 1.
        n_sources: (tile,) source tiles of a panel.
        offset: (tile,) where a panel begins.
        size: weights of all panels.
        INTEGER: round to 8 bits (fixed_point.quantise).
        N_PARTS: parts of the weights.
    """
    _, at, exists = _block(tiles, n_sources, offset)
    master = tl.load(masters + at, mask=exists, other=0.0)
    if INTEGER:
        master = tl.minimum(tl.maximum(mantissa_of(master), LOWEST), HIGHEST) * (1 / GRID)
    if weights.dtype.element_ty == tl.float64:
        master = master.to(tl.float64)
    store_parts(weights, at, size, master, exists, N_PARTS)


@triton.jit
def squared_norms(
    gradients: tl.tensor,
    masters: tl.tensor,
    out: tl.tensor,
    tiles: tl.tensor,
    n_sources: tl.tensor,
    offset: tl.tensor,
    n_most: tl.tensor,
    INTEGER: tl.constexpr,
) -> None:
    """Set out[tile, block] (float64) to the squared norm of a block's gradient; (tile, n_most) in all."""
    tile, at, exists = _block(tiles, n_sources, offset)
    gradient = tl.load(gradients + at, mask=exists, other=0.0)
    master = tl.load(masters + at, mask=exists, other=0.0)
    size = _passing(gradient, master, INTEGER).to(tl.float64)
    tl.store(out + tile * n_most + tl.program_id(1), tl.sum(tl.sum(size * size, axis=1), axis=0))


@triton.jit
def adam(
    masters: tl.tensor,
    gradients: tl.tensor,
    first: tl.tensor,
    second: tl.tensor,
    tiles: tl.tensor,
    n_sources: tl.tensor,
    offset: tl.tensor,
    unit: tl.tensor,
    pace: tl.tensor,
    n_tiles: tl.tensor,
    INTEGER: tl.constexpr,
    BETA_1: tl.constexpr,
    BETA_2: tl.constexpr,
    EPSILON: tl.constexpr,
) -> None:
    """Move master weights against their gradients, in place (dse.engine.adam.adam).

    Those that run rounded stay within the range of 8 bits (fixed_point.within_range).

    Args:
        masters: panels, float32.
        gradients: panels.
        first: Adam's first moments, like masters.
        second: Adam's second moments, like masters.
        tiles: tile numbers, one per program on axis 0; source tiles of the panel on axis 1.
        n_sources: (tile,) source tiles of a panel.
        offset: (tile,) where a panel begins.
        unit: (tile, WIDTH) float32 step of a learning rate of 1.
        pace: (3, n_tiles) float32: learning rate over 1 - beta_1 ** step, 1 / (1 - beta_2 ** step), and the
            factor of the gradient that clips its norm.
        n_tiles: of all arrays.
        INTEGER: weights run rounded to 8 bits.
        BETA_1: share of the first moment that is kept.
        BETA_2: share of the second moment that is kept.
        EPSILON: what is added to the root of the second moment.
    """
    tile, at, exists = _block(tiles, n_sources, offset)
    size = tl.load(unit + tile * WIDTH + tl.arange(0, WIDTH)[None, :]) * tl.load(pace + tile)
    correction = tl.load(pace + n_tiles + tile)
    master = tl.load(masters + at, mask=exists, other=0.0)
    gradient = tl.load(gradients + at, mask=exists, other=0.0).to(tl.float32)
    gradient = _passing(gradient * tl.load(pace + 2 * n_tiles + tile), master, INTEGER)
    m = tl.load(first + at, mask=exists, other=0.0)
    v = tl.load(second + at, mask=exists, other=0.0)
    m += (1 - BETA_1) * (gradient - m)
    v += (1 - BETA_2) * (gradient * gradient - v)
    tl.store(first + at, m, mask=exists)
    tl.store(second + at, v, mask=exists)
    master -= tl.div_rn(size * m, tl.sqrt_rn(v * correction) + EPSILON)
    if INTEGER:
        master = tl.minimum(tl.maximum(master, LOWEST / GRID), HIGHEST / GRID)
    tl.store(masters + at, master, mask=exists)
