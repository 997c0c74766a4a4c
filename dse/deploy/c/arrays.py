"""Declarations of C: variables and constant data, from which text, memory and what a reset clears follow.

A matrix lies in flash in rows of bytes, of packed words, or sparse: a row holds the weights from one input to
all neurons, so that a spike reads one row. Weights are q * 2^e in 8-bit steps, with the largest e and the
fewest bits b for q that hold all of a matrix.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np

from dse.base.records import Array, Ints
from dse.deploy.c.text import filled, wrapped
from dse.engine.neurons.fixed_point import common_exponent, needed_bits

_OTHERS = {"double": "float64", "float": "float32", "dse_level_t": "int32"}


def dtype_of(kind: str) -> np.dtype[Any]:
    """Return the type of an array that holds numbers of a type of C."""
    return np.dtype(_OTHERS.get(kind, kind.removesuffix("_t")))


@dataclass(frozen=True)
class Member:
    """A variable of the C: its type, name and lengths; `purpose` is its comment.

    is_cleared: whether it is 0 at the start of every window.
    """

    kind: str
    name: str
    lengths: tuple[int, ...] = ()
    purpose: str = ""
    is_cleared: bool = False

    @property
    def width(self) -> int:
        """Bytes of one number."""
        return dtype_of(self.kind).itemsize

    @property
    def is_array(self) -> bool:
        return bool(self.lengths)

    @property
    def text(self) -> str:
        """Its declaration."""
        purpose = f" /* {self.purpose} */" if self.purpose else ""
        return f"    {self.kind} {self.name}{''.join(f'[{n}]' for n in self.lengths)};{purpose}"

    @property
    def clear(self) -> str:
        """Name of the function that sets n numbers of its type to 0."""
        return f"dse_clear_{self.kind.removesuffix('_t')}"

    @property
    def n(self) -> int:
        """Numbers that it sets at a time."""
        return self.lengths[-1]

    @property
    def slots(self) -> int:
        """How many times; 0 for once."""
        return self.lengths[0] if len(self.lengths) > 1 and self.lengths[0] > 1 else 0

    @property
    def place(self) -> str:
        """Where."""
        slot = "" if len(self.lengths) == 1 else "[i]" if self.slots else "[0]"
        return f"net->{self.name}{slot}"


_DECLARED = re.compile(r"(0 )?(\w+) (\w+)((?:\[\d+\])*); ?(.*)\n")


def members_of(table: str | Path, *objects: object, **values: Any) -> list[Member]:
    """Return the variables that a template declares (arguments of `filled`).

    A line is `TYPE NAME[LENGTH]...; PURPOSE`, after a 0 where the variable is 0 at the start of a window.
    """
    out = []
    for cleared, kind, name, lengths, purpose in _DECLARED.findall(filled(table, *objects, **values)):
        sizes = tuple(int(n) for n in re.findall(r"\d+", lengths))
        out.append(Member(kind, name, sizes, purpose, bool(cleared)))
    return out


M = TypeVar("M", "Member", "Table")


def laid_out(members: Sequence[M]) -> list[M]:
    """Return variables, or tables, in the order of their declarations.

    Single ones come first, the shortest before: instructions reach what lies near the beginning. Then the
    widest arrays come first, so that nothing lies between.
    """
    return sorted(members, key=lambda m: (m.is_array, -m.width if m.is_array else m.width))


def struct_bytes(members: Sequence[Member], of_reals: bool = False) -> int:
    """Return the size of variables as declared: what the compiler reports as data and bss.

    Of real samples (`of_reals`) the levels of an encoder are double.
    """
    used = 0
    for m in laid_out(members):
        width = 8 if of_reals and m.kind == "dse_level_t" else m.width
        used = (-(-used // width) + math.prod(m.lengths)) * width
    has_reals = of_reals and any(m.kind == "dse_level_t" for m in members)
    widest = 8 if has_reals else max(m.width for m in members)
    return -(-used // widest) * widest


@dataclass(frozen=True)
class Table:
    """Constant data of the C."""

    kind: str
    name: str
    values: Array

    is_array: ClassVar[bool] = True

    @property
    def width(self) -> int:
        """Bytes of one number."""
        return dtype_of(self.kind).itemsize

    @property
    def n(self) -> int:
        """Numbers."""
        return int(self.values.size)

    @property
    def n_bytes(self) -> int:
        return self.width * self.n

    @property
    def text(self) -> str:
        """Its definition."""
        if self.kind in ("float", "double"):
            numbers = [_exact(x, self.kind) for x in self.values.ravel()]
        elif self.kind == "uint32_t" and int(self.values.max(initial=0)) > 2**16:
            numbers = [f"0x{x:x}u" for x in self.values.tolist()]
        else:
            numbers = [str(x) for x in self.values.tolist()]
        return f"static const {self.kind} {self.name}[{self.values.size}] = {{\n{wrapped(numbers)}}};\n"


def _exact(x: np.floating[Any], kind: str) -> str:
    """Return a constant of exactly this number; numpy's shortest decimals read back as it."""
    text = str(np.float32(x) if kind == "float" else np.float64(x))
    number = text if any(c in text for c in ".en") else f"{text}.0"
    return f"{number}f" if kind == "float" else number


def index(n: int) -> str:
    """Return the type that numbers n things."""
    return "uint8_t" if n <= 256 else "uint16_t"


Form = Literal["bytes", "words", "sparse"]
_MOST_PACKED = 4


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
    def kind(self) -> str:
        """Its form, and whether weights act later: all rows of a kind are added alike."""
        return self.form if self.delays is None else f"{self.form}_later"

    @property
    def n_columns(self) -> int:
        """Neurons that it reaches."""
        return int(self.weights.shape[1])

    @property
    def column_type(self) -> str:
        """Type of the number of a column."""
        return index(self.n_columns)

    @property
    def sign(self) -> int:
        """Bit of a packed weight that is its sign."""
        return 1 << (self.bits - 1)

    @property
    def mask(self) -> int:
        """Bits of a packed weight."""
        return (1 << self.bits) - 1

    @property
    def per_word(self) -> int:
        """Weights in a word of 32 bits."""
        return 32 // self.bits

    @property
    def words_per_row(self) -> int:
        return -(-self.n_columns // self.per_word)

    @property
    def row_length(self) -> int:
        """Neurons that a row reaches, those that fill its last word included."""
        return self.words_per_row * self.per_word if self.form == "words" else self.n_columns

    def tables(self, name: str) -> list[Table]:
        """Return it as constant data."""
        q: Ints = self.weights >> self.exponent
        n = self.n_columns
        if self.form == "words":
            fields = np.zeros((len(q), self.words_per_row * self.per_word), np.int64)
            fields[:, :n] = q & (2**self.bits - 1)
            of_words = fields.reshape(len(q), self.words_per_row, self.per_word)
            words = (of_words << (self.bits * np.arange(self.per_word))).sum(axis=2)
            return [Table("uint32_t", name, np.asarray(words).ravel())]
        if self.form == "bytes":
            rows, later = [], self.delays
        else:
            row, column = np.nonzero(q)
            begin = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(q)))])
            rows = [
                Table("uint16_t" if row.size < 2**16 else "uint32_t", f"{name}_begin", begin),
                Table(self.column_type, f"{name}_column", _not_empty(column)),
            ]
            q = _not_empty(q[row, column])
            later = None if self.delays is None else _not_empty(self.delays[row, column])
        delays = [] if later is None else [Table("uint8_t", f"{name}_delay", later.ravel())]
        return [*rows, Table("int8_t", name, q.ravel()), *delays]


def _not_empty(values: Ints) -> Ints:
    """Return values, or one 0: C has no empty arrays."""
    return values if values.size else np.zeros(1, np.int64)


def stored(weights: Ints, delays: Array | None = None, fixed: bool = False) -> Matrix:
    """Return the smallest form of a matrix, of equal ones the plainest; only up to 4 bits are packed.

    Args:
        weights: (input, neuron) whole numbers in [-128, 127].
        delays: (input, neuron) network steps, at most 255; None: none.
        fixed: whether the form is that of any weights: bytes, in 8-bit steps.
    """
    whole = np.asarray(weights, np.int64)
    exponent = 0 if fixed else common_exponent(whole)
    bits = max(2, needed_bits(whole))
    # Unpacking takes time, and more than 4 bits save little: the form follows from precision and pruning.
    forms: tuple[Form, ...] = ("bytes", "words", "sparse") if bits <= _MOST_PACKED else ("bytes", "sparse")
    later = None
    if delays is not None:
        forms = ("bytes", "sparse")
        later = np.where(whole != 0, delays, 0).astype(np.int64)
    if fixed:
        forms = ("bytes",)
    matrices = (Matrix(whole, form, bits, exponent, later) for form in forms)
    return min(matrices, key=lambda matrix: sum(table.n_bytes for table in matrix.tables("")))
