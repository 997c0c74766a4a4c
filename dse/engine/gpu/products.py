"""Kernels: products of spikes, weights and gradients on the tensor cores.

Arrays lie in tiles of WIDTH columns (dse.engine.gpu.layout). A program works on one tile of one member, sums
in an order that follows from that member and the batch alone, and writes where no other program does: a
member's numbers are the same in any cohort, bit for bit.
"""

from __future__ import annotations

import triton
import triton.language as tl

from dse.engine.gpu.numbers import WIDTH

ROWS = tl.constexpr(128)
"""Rows (sample and step) per program."""
_DEPTH = tl.constexpr(64)  # rows per tensor-core product of a weight gradient
_CHUNK = tl.constexpr(1024)  # rows summed on the tensor cores, which truncate, before a rounded float32 sum


@triton.jit(do_not_specialize=["first_row"])
def product(
    spikes: tl.tensor,
    weights: tl.tensor,
    z: tl.tensor,
    tiles: tl.tensor,
    source: tl.tensor,
    n_sources: tl.tensor,
    offset: tl.tensor,
    factor: tl.tensor,
    n_rows: tl.tensor,
    first_row: tl.tensor,
    row_step: tl.tensor,
    n_stored: tl.tensor,
    weights_size: tl.tensor,
    N_PARTS: tl.constexpr,
    ADD: tl.constexpr,
) -> None:
    """Set (or add to) z of some rows and tiles: factor * spikes @ weights.

    Args:
        spikes: (source tile, n_stored, WIDTH) 0 or 1.
        weights: panels, in parts `weights_size` apart.
        z: (tile, n_stored, WIDTH).
        tiles: tile numbers, one per program on axis 0.
        source: (tile,) first source tile of a panel.
        n_sources: (tile,) source tiles of a panel.
        offset: (tile,) where a panel begins.
        factor: (tile,) float32, the members' gains.
        n_rows: how many rows; blocks of them on axis 1.
        first_row: the first of them.
        row_step: from each of them to the next.
        n_stored: rows per tile.
        weights_size: numbers per part.
        N_PARTS: parts of the weights.
        ADD: add to z.
    """
    tile = tl.load(tiles + tl.program_id(0)).to(tl.int64)
    row = tl.program_id(1) * ROWS + tl.arange(0, ROWS)
    inside = (row < n_rows)[:, None]
    column = tl.arange(0, WIDTH)
    at = (first_row + row * row_step).to(tl.int64)[:, None] * WIDTH + column[None, :]
    of = spikes + tl.load(source + tile).to(tl.int64) * n_stored * WIDTH + at
    by = weights + tl.load(offset + tile) + column[:, None] * WIDTH + column[None, :]
    total = tl.zeros((ROWS, WIDTH), z.dtype.element_ty)
    for _ in range(tl.load(n_sources + tile)):
        fired = tl.load(of, mask=inside, other=0.0)
        for part in tl.static_range(N_PARTS):
            weight = tl.load(by + part * weights_size)
            total = tl.dot(fired.to(weight.dtype), weight, total, out_dtype=total.dtype)
        of += n_stored * WIDTH
        by += WIDTH * WIDTH
    total = total * tl.load(factor + tile)
    to = z + tile * n_stored * WIDTH + at
    if ADD:
        total += tl.load(to, mask=inside, other=0.0)
    tl.store(to, total, mask=inside)


@triton.jit(do_not_specialize=["first_row"])
def by_input(
    by_z: tl.tensor,
    weights: tl.tensor,
    out: tl.tensor,
    tiles: tl.tensor,
    own_first: tl.tensor,
    first: tl.tensor,
    count: tl.tensor,
    offset: tl.tensor,
    n_rows: tl.tensor,
    first_row: tl.tensor,
    row_step: tl.tensor,
    n_stored: tl.tensor,
    by_z_size: tl.tensor,
    weights_size: tl.tensor,
    N_PARTS: tl.constexpr,
    N_WEIGHT_PARTS: tl.constexpr,
) -> None:
    """Set dL/d(input spike) of some source tiles: dL/dz @ weights.T over the tiles that read them.

    Args:
        by_z: (tile, n_stored, WIDTH) dL/dz, in parts `by_z_size` apart.
        weights: panels of those tiles, in parts `weights_size` apart.
        out: (source tile, n_rows, WIDTH), row i from row first_row + i * row_step of by_z.
        tiles: source tile numbers, one per program on axis 0.
        own_first: (source tile,) first tile of the owner among the source tiles.
        first: (source tile,) first of the owner's tiles that read it.
        count: (source tile,) number of them.
        offset: (tile,) where a panel begins.
        n_rows: how many rows; blocks of them on axis 1.
        first_row: the first of them.
        row_step: from each of them to the next.
        n_stored: rows per tile of by_z.
        by_z_size: numbers per part of by_z.
        weights_size: numbers per part of the weights.
        N_PARTS: parts of by_z.
        N_WEIGHT_PARTS: parts of the weights; products of two parts below float32's last bit are left out.
    """
    tile = tl.load(tiles + tl.program_id(0)).to(tl.int64)
    row = tl.program_id(1) * ROWS + tl.arange(0, ROWS)
    inside = (row < n_rows)[:, None]
    column = tl.arange(0, WIDTH)
    at = (first_row + row * row_step).to(tl.int64)[:, None] * WIDTH + column[None, :]
    panel_row = (tile - tl.load(own_first + tile)) * WIDTH
    begin = tl.load(first + tile).to(tl.int64)
    total = tl.zeros((ROWS, WIDTH), out.dtype.element_ty)
    for step in range(tl.load(count + tile)):
        reader = begin + step
        by = weights + tl.load(offset + reader) + (panel_row + column[None, :]) * WIDTH + column[:, None]
        of = by_z + reader * n_stored * WIDTH + at
        for part in tl.static_range(N_PARTS):
            gradient = tl.load(of + part * by_z_size, mask=inside, other=0.0)
            for weight_part in tl.static_range(N_WEIGHT_PARTS):
                if part + weight_part < max(N_PARTS, N_WEIGHT_PARTS):
                    weight = tl.load(by + weight_part * weights_size)
                    total = tl.dot(gradient, weight, total, out_dtype=total.dtype)
    to = out + tile * n_rows * WIDTH + row.to(tl.int64)[:, None] * WIDTH + column[None, :]
    tl.store(to, total, mask=inside)


@triton.jit
def by_weight(
    spikes: tl.tensor,
    by_z: tl.tensor,
    out: tl.tensor,
    tiles: tl.tensor,
    source: tl.tensor,
    n_sources: tl.tensor,
    offset: tl.tensor,
    factor: tl.tensor,
    n_rows: tl.tensor,
    by_z_size: tl.tensor,
    N_PARTS: tl.constexpr,
    ADD: tl.constexpr,
) -> None:
    """Set (or add to) dL/d(weight) of some panels: factor * spikes.T @ dL/dz.

    Args:
        spikes: (source tile, n_rows, WIDTH) 0 or 1.
        by_z: (tile, n_rows, WIDTH), in parts `by_z_size` apart.
        out: panels.
        tiles: tile numbers, one per program on axis 0; source tiles of the panel on axis 1.
        source: (tile,) first source tile of a panel.
        n_sources: (tile,) source tiles of a panel.
        offset: (tile,) where a panel begins.
        factor: (tile,) float32, the members' gains.
        n_rows: rows summed over.
        by_z_size: numbers per part.
        N_PARTS: parts of by_z.
        ADD: add to what is there.
    """
    tile = tl.load(tiles + tl.program_id(0)).to(tl.int64)
    panel_tile = tl.program_id(1)
    if panel_tile >= tl.load(n_sources + tile):
        return
    column = tl.arange(0, WIDTH)
    row = tl.arange(0, _DEPTH)
    of = spikes + (tl.load(source + tile) + panel_tile).to(tl.int64) * n_rows * WIDTH
    by = by_z + tile * n_rows * WIDTH
    total = tl.zeros((WIDTH, WIDTH), out.dtype.element_ty)
    for chunk in range(0, n_rows, _CHUNK):
        partial = tl.zeros((WIDTH, WIDTH), out.dtype.element_ty)
        for begin in range(chunk, min(chunk + _CHUNK, n_rows), _DEPTH):
            at = (begin + row).to(tl.int64)
            inside = at < n_rows
            fired = tl.load(of + at[None, :] * WIDTH + column[:, None], mask=inside[None, :], other=0.0)
            for part in tl.static_range(N_PARTS):
                gradient = tl.load(
                    by + part * by_z_size + at[:, None] * WIDTH + column[None, :],
                    mask=inside[:, None],
                    other=0.0,
                )
                partial = tl.dot(fired.to(gradient.dtype), gradient, partial, out_dtype=partial.dtype)
        total += partial
    total = total * tl.load(factor + tile)
    to = out + tl.load(offset + tile) + (panel_tile * WIDTH + column[:, None]) * WIDTH + column[None, :]
    if ADD:
        total += tl.load(to)
    tl.store(to, total)
