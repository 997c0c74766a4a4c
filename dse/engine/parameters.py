"""A matrix as trained is a function of its parameters: Adam moves the parameters, the layer runs the matrix.

    free         W = A
    tied         W[i, j] = A[number[i, j]], 0 where that is -1 (dse.engine.shared)
    whitened     W = W0 + M A with a fixed M (dse.models.snn.whiten)
    weight norm  W[:, j] = g[j] v[:, j] / |v[:, j]|

Every engine goes from dL/dW to the gradient by the parameters, takes Adam's step, and computes W anew. The
definitions take arrays of numpy and tensors of torch; the torch engine differentiates them. The forms beside
them work in blocks (dse.engine.layout). Their sums have one order: results depend neither on the machine nor
on the number of threads.
Source: Salimans and Kingma 2016, weight normalization (REFERENCES.md), as in torch and in lava-dl's blocks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array
from dse.engine import kernels
from dse.engine.adam import BETA_1, BETA_2, EPSILON
from dse.engine.layout import WORD, aligned, blocks, packed, padded, width_at
from dse.engine.shared import Copies

_LEAST_SQUARE = 1e-30
"""Added to |v|^2: a neuron without weights keeps W = 0 and a finite gradient."""


def whitened(parameters: Any, start: Any, basis: Any) -> Any:
    """Return W0 + M A, (input, neuron); A is (rank, neuron), M (input, rank)."""
    return start + basis @ parameters


def lengths(directions: Any) -> Any:
    """Return |v| of each neuron, (1, neuron)."""
    return ((directions * directions).sum(0, keepdims=True) + _LEAST_SQUARE) ** 0.5


def normed(directions: Any, norms: Any) -> Any:
    """Return g v / |v|, (input, neuron); v are `directions`, g (1, neuron) `norms`."""
    return directions * (norms / lengths(directions))


@dataclass(frozen=True)
class Parameters:
    """Numbers that Adam moves, in blocks, their gradient, Adam's moments, and the numbers as they run.

    unit: (column,) what a learning rate of 1 moves a number by.
    table: int8, `rint(value * grid)` in [low, high], to which values are clipped; or the values themselves.
    kept: like the gradient, 0 where a number was removed, else 1; None: none was.
    """

    n_rows: int
    values: Array
    gradient: Array
    first: Array
    second: Array
    unit: Array
    table: Array
    grid: float = 0.0
    low: float = 0.0
    high: float = 0.0
    kept: Array | None = None

    @classmethod
    def of(
        cls,
        values: Array,
        unit: Array | float,
        gradient: Array | None,
        kind: Any,
        *rounding: float,
    ) -> Parameters:
        """Return parameters at their start, (row, column).

        Args:
            values: at the start.
            unit: (column,) or one for all.
            gradient: where theirs is written, in blocks; None: a place of its own.
            kind: precision of the gradient.
            rounding: grid, low and high of the numbers as they run; none: they run as they are.
        """
        n_rows, n_columns = values.shape
        numbers = packed(values, np.float32)
        units = aligned(padded(n_columns), np.float32)
        units[:n_columns] = unit
        table = numbers
        grid, low, high = rounding or (0.0, 0.0, 0.0)
        if rounding:
            table = packed(np.clip(np.rint(values * np.float32(grid)), low, high), np.int8)
        first, second = (aligned(numbers.size, np.float32) for _ in range(2))
        if gradient is None:
            gradient = aligned(numbers.size, kind)
        return cls(n_rows, numbers, gradient, first, second, units, table, grid, low, high)

    @property
    def _changed(self) -> dict[str, Array]:
        """What an update reads and writes, by the names of a state."""
        table = {} if self.table is self.values else {"table": self.table}
        return {"weights": self.values, "first": self.first, "second": self.second, **table}

    def without(self, kept: Array) -> Parameters:
        """Return the parameters with those that are not kept, (row, column), set to 0 for good."""
        before = 1 if self.kept is None else self.kept
        mask = packed(kept, self.gradient.dtype) * before
        for numbers in self._changed.values():
            numbers *= mask.astype(numbers.dtype)
        return replace(self, kept=mask)

    def state(self) -> dict[str, Array]:
        """Return a copy of what an update reads and writes."""
        kept = {} if self.kept is None else {"kept": self.kept.astype(bool)}
        return {name: x.copy() for name, x in self._changed.items()} | kept

    def restored(self, state: Mapping[str, Array]) -> Parameters:
        """Return the parameters with the numbers of a state; what reads the arrays sees them change."""
        for name, numbers in self._changed.items():
            np.copyto(numbers, state[name], casting="no")
        return replace(self, kept=state["kept"].astype(self.gradient.dtype)) if "kept" in state else self

    def keep_removed(self) -> None:
        """Clear the gradient of removed numbers; with their moments at 0 Adam leaves them at exactly 0."""
        if self.kept is not None:
            np.multiply(self.gradient, self.kept, out=self.gradient)

    def squared_norm(self, factor: float) -> float:
        """Return the squared norm of the gradient times a factor, where it passes the rounding."""
        rounding = self.grid, self.low, self.high
        return float(kernels.squared_norm(self.gradient, factor, self.values, *rounding))

    def update(self, factor: float, learning_rate: float, steps: int) -> float:
        """Take Adam's step `steps`, from 1; return the squared norm of the gradient times its factor."""
        return float(
            kernels.adam(
                self.values,
                self.gradient,
                self.first,
                self.second,
                self.n_rows,
                len(self.unit),
                self.unit,
                factor,
                learning_rate / (1 - BETA_1**steps),
                BETA_1,
                BETA_2,
                1 / (1 - BETA_2**steps),
                EPSILON,
                self.table,
                self.grid,
                self.low,
                self.high,
            )
        )


class Form(Protocol):
    """How a matrix in blocks follows from its parameters in blocks.

    are_weights: every parameter is a weight, and is clipped as such.
    """

    @property
    def are_weights(self) -> bool: ...

    def expand(self, parameters: Sequence[Array], out: Array) -> None:
        """Write the matrix."""
        ...

    def pull(self, parameters: Sequence[Array], gradient: Array, out: Sequence[Array]) -> None:
        """Write the gradient by each parameter, given that by the matrix, which may be overwritten."""
        ...


@dataclass(frozen=True)
class Tied:
    """W[i, j] = A[number[i, j]]; the parameters are a row, with a 0 behind the last."""

    copies: Copies
    are_weights: bool = True

    def expand(self, parameters: Sequence[Array], out: Array) -> None:
        """Write every weight to all its copies."""
        np.take(parameters[0], self.copies.number, out=out, mode="clip")

    def pull(self, parameters: Sequence[Array], gradient: Array, out: Sequence[Array]) -> None:
        """Sum the gradient over the copies."""
        n = self.copies.n_weights
        out[0][:n] = np.bincount(self.copies.number, gradient, n + 1)[:n]


@dataclass(frozen=True)
class Whitened:
    """W = W0 + M A; `start` in blocks, `basis` (input, rank) float32."""

    start: Array
    basis: Array
    n_columns: int
    are_weights: bool = False

    def expand(self, parameters: Sequence[Array], out: Array) -> None:
        """Write W0 + M A."""
        out[:] = self.start
        for of_a, of_w in self._blocks(parameters[0], out):
            _add_product(self.basis, of_a, of_w)

    def pull(self, parameters: Sequence[Array], gradient: Array, out: Sequence[Array]) -> None:
        """Write M' dL/dW."""
        turned = np.ascontiguousarray(self.basis.T)
        out[0][:] = 0
        for of_a, of_w in self._blocks(out[0], gradient):
            _add_product(turned, of_w, of_a)

    def _blocks(self, parameters: Array, matrix: Array) -> Iterator[tuple[Array, Array]]:
        n_inputs, rank = self.basis.shape
        yield from zip(
            blocks(parameters, rank, self.n_columns), blocks(matrix, n_inputs, self.n_columns), strict=True
        )


@dataclass(frozen=True)
class WeightNorm:
    """W = g v / |v|; the gradient by v may take the place of that by W."""

    n_rows: int
    n_columns: int
    are_weights: bool = False

    def expand(self, parameters: Sequence[Array], out: Array) -> None:
        """Write every neuron's direction times its norm."""
        _norm(*parameters, self.n_rows, padded(self.n_columns), out)

    def pull(self, parameters: Sequence[Array], gradient: Array, out: Sequence[Array]) -> None:
        """Write (g / |v|) (dL/dW - v (v . dL/dW) / |v|^2), and v . dL/dW / |v|."""
        _pull_norm(*parameters, self.n_rows, padded(self.n_columns), gradient, *out)


def product(left: Array, right: Array) -> Array:
    """Return the product of two float64 matrices, summed in one order on every machine."""
    out = np.zeros((left.shape[0], right.shape[1]))
    _add_product(np.ascontiguousarray(left), np.ascontiguousarray(right), out)
    return out


@compiled()
def _add_product(left: Array, right: Array, out: Array) -> None:
    """Add the product of two matrices, (i, k) and (k, j), to `out`, (i, j): one k after the other."""
    for i in range(left.shape[0]):
        for k in range(left.shape[1]):
            factor = left[i, k]
            for j in range(right.shape[1]):
                out[i, j] += factor * right[k, j]


@compiled()
def _sums(x: Array, y: Array, width: int, total: Array) -> None:
    """Write the sum over the rows of a block of x times y, in float64."""
    total[:] = 0
    for at in range(0, x.size, width):
        one, other = x[at : at + width], y[at : at + width]
        for c in range(width):
            total[c] += np.float64(one[c]) * np.float64(other[c])


@compiled()
def _norm(v: Array, g: Array, n_rows: int, n_columns: int, out: Array) -> None:
    column, squares = 0, np.empty(WORD)
    factor = np.empty(WORD, np.float32)
    while column < n_columns:
        width = width_at(column, n_columns)
        first, end = n_rows * column, n_rows * (column + width)
        _sums(v[first:end], v[first:end], width, squares)
        for c in range(width):
            factor[c] = g[column + c] / np.sqrt(squares[c] + _LEAST_SQUARE)
        for at in range(first, end, width):
            row, into = v[at : at + width], out[at : at + width]
            for c in range(width):
                into[c] = row[c] * factor[c]
        column += width


@compiled()
def _pull_norm(
    v: Array, g: Array, n_rows: int, n_columns: int, by_weight: Array, by_v: Array, by_g: Array
) -> None:
    column, squares, along = 0, np.empty(WORD), np.empty(WORD)
    factor, share = np.empty(WORD, by_v.dtype), np.empty(WORD, by_v.dtype)
    while column < n_columns:
        width = width_at(column, n_columns)
        first, end = n_rows * column, n_rows * (column + width)
        _sums(v[first:end], v[first:end], width, squares)
        _sums(by_weight[first:end], v[first:end], width, along)
        for c in range(width):
            square = squares[c] + _LEAST_SQUARE
            by_g[column + c] = along[c] / np.sqrt(square)
            factor[c] = g[column + c] / np.sqrt(square)
            share[c] = along[c] / square
        for at in range(first, end, width):
            row, gradient, into = v[at : at + width], by_weight[at : at + width], by_v[at : at + width]
            for c in range(width):
                into[c] = factor[c] * (gradient[c] - row[c] * share[c])
        column += width


@compiled()
def round_to(weights: Array, grid: float, low: float, high: float, table: Array) -> None:
    """Write int8 weights as they run: `rint(weight * grid)` in [low, high]."""
    for k in range(weights.size):
        q = np.rint(weights[k] * np.float32(grid))
        table[k] = np.int8(min(max(q, np.float32(low)), np.float32(high)))


@compiled()
def pass_rounding(weights: Array, grid: float, low: float, high: float, gradient: Array) -> None:
    """Set the gradient to 0 where a weight rounds to a number outside [low, high]."""
    for k in range(weights.size):
        q = np.rint(weights[k] * np.float32(grid))
        if q < np.float32(low) or q > np.float32(high):
            gradient[k] = 0
