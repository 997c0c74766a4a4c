"""How arrays lie in memory: columns in blocks of at most 64, each block's rows one after another.

A layer of n neurons is padded to whole vectors of 16 columns and cut into blocks of 64, the last ones 32 and
16 wide. The block that starts at column c of an array of r rows begins at r * c, row i of it at
r * c + i * width. A block of weights stays in the second-level cache while a batch goes through it, its rows
start on cache lines, and no stride maps them all onto the same few sets.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array

LANES = 16
WORD = 64
_LINE_BYTES = 64


def padded(n: int) -> int:
    """Return n rounded up to whole vectors."""
    return -(-n // LANES) * LANES


@compiled()
def width_at(column: int, n_columns: int) -> int:
    """Return the width of the block that starts at a column of a padded number of columns."""
    left = n_columns - column
    return WORD if left >= WORD else 32 if left >= 32 else LANES


def aligned(n: int, kind: Any, *, zeroed: bool = True) -> Array:
    """Return n numbers that start on a cache line: zeros, or whatever the memory held."""
    dtype = np.dtype(kind)
    raw = (np.zeros if zeroed else np.empty)(n * dtype.itemsize + _LINE_BYTES, np.uint8)
    first = -raw.ctypes.data % _LINE_BYTES
    return raw[first : first + n * dtype.itemsize].view(dtype)


def blocks(flat: Array, rows: int, columns: int) -> list[Array]:
    """Return the blocks of a matrix as (row, width) views, padding included."""
    out, column = [], 0
    while column < padded(columns):
        width = int(width_at(column, padded(columns)))
        out.append(flat[rows * column : rows * (column + width)].reshape(rows, width))
        column += width
    return out


def packed(matrix: Array, kind: Any) -> Array:
    """Return a (row, column) matrix in blocks, flat; columns that pad hold 0."""
    rows, columns = matrix.shape
    out, column = aligned(rows * padded(columns), kind), 0
    for block in blocks(out, rows, columns):
        part = matrix[:, column : column + block.shape[1]]
        block[:, : part.shape[1]] = part
        column += part.shape[1]
    return out


def unpacked(flat: Array, rows: int, columns: int) -> Array:
    """Return blocks as a (row, column) matrix again."""
    out, column = np.empty((rows, columns), flat.dtype), 0
    for block in blocks(flat, rows, columns):
        part = out[:, column : column + block.shape[1]]
        part[:] = block[:, : part.shape[1]]
        column += part.shape[1]
    return out
