"""Where the weights of a matrix lie in flash: rows of bytes, rows of packed words, or sparse rows.

A row holds the weights from one input to all neurons, so that a spike reads one row. Weights are q * 2^e in
8-bit steps, with the largest e and the fewest bits b for q that hold all of a matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dse.records import Ints

Form = Literal["bytes", "words", "sparse"]


@dataclass(frozen=True)
class Matrix:
    """A stored matrix.

    weights: (input, neuron) int64 in 8-bit steps.
    form: bytes: q as int8; words: as many q of `bits` bits as fit in 32, lowest bits first; sparse: of each
        row the columns and the q (int8) of the weights other than 0.
    bits, exponent: b and e.
    delays: (input, neuron) network steps that each weight acts later, 0 where there is none; None: none does.
    """

    weights: Ints
    form: Form
    bits: int
    exponent: int
    delays: Ints | None = None

    @property
    def q(self) -> Ints:
        """The stored numbers, (input, neuron)."""
        return np.asarray(self.weights >> self.exponent)

    @property
    def per_word(self) -> int:
        """Weights in a word of 32 bits."""
        return 32 // self.bits

    @property
    def words_per_row(self) -> int:
        return -(-int(self.weights.shape[1]) // self.per_word)

    @property
    def row_length(self) -> int:
        """Neurons that a row reaches, those that fill its last word included."""
        n = int(self.weights.shape[1])
        return self.words_per_row * self.per_word if self.form == "words" else n

    @property
    def column_bytes(self) -> int:
        """Bytes of a column's number in sparse rows."""
        return 1 if self.weights.shape[1] <= 256 else 2

    @property
    def offset_bytes(self) -> int:
        """Bytes of the place of a sparse row."""
        return 2 if self.n_stored < 2**16 else 4

    @property
    def n_stored(self) -> int:
        """Weights other than 0."""
        return int(np.count_nonzero(self.weights))

    @property
    def table_bytes(self) -> int:
        """Constant data."""
        n_inputs, n = map(int, self.weights.shape)
        if self.form == "bytes":
            return n_inputs * n * (1 if self.delays is None else 2)
        if self.form == "words":
            return n_inputs * self.words_per_row * 4
        # C has no empty arrays.
        of_weight = 1 + self.column_bytes + (0 if self.delays is None else 1)
        return (n_inputs + 1) * self.offset_bytes + max(1, self.n_stored) * of_weight


_MOST_PACKED = 4


def stored(weights: Ints, delays: Ints | None = None) -> Matrix:
    """Return the smallest form of a matrix, of equal ones the plainest; only up to 4 bits are packed.

    Args:
        weights: (input, neuron) whole numbers in [-128, 127].
        delays: (input, neuron) network steps, at most 255; None: none.
    """
    whole = np.asarray(weights, np.int64)
    nonzero = whole[whole != 0]
    exponent = 0
    while nonzero.size and not (nonzero & ((2 << exponent) - 1)).any():
        exponent += 1
    q = whole >> exponent
    low, high = int(q.min(initial=0)), int(q.max(initial=0))
    bits = next(b for b in range(2, 9) if -(2 ** (b - 1)) <= low and high < 2 ** (b - 1))
    # Unpacking takes time, and more than 4 bits save little: the form follows from precision and pruning.
    forms: tuple[Form, ...] = ("bytes", "words", "sparse") if bits <= _MOST_PACKED else ("bytes", "sparse")
    later = None
    if delays is not None:
        forms = ("bytes", "sparse")
        later = np.where(whole != 0, delays, 0).astype(np.int64)
    return min((Matrix(whole, form, bits, exponent, later) for form in forms), key=lambda m: m.table_bytes)
