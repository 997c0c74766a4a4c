"""The numbers that the GPU engine computes with, and how they are rounded.

The tensor cores multiply bfloat16 (8 significant bits) and add in float32. Spikes and 8-bit weights are
exact in it, and so are their sums. A float32 number goes in as a sum of `parts`, each the nearest bfloat16
of what the others left: 2 parts hold at least 16 of its 24 bits, 3 parts all of them. A float64 number is
one part and is multiplied as it is. The parts of an array lie one whole array after another.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import triton
import triton.language as tl

from dse.engine.gpu import layout
from dse.neurons import fixed_point
from dse.records import Arithmetic

INTERPRETED: bool = triton.knobs.runtime.interpret
"""The kernels run in Triton's interpreter, on CPU tensors; decided when triton is first imported."""

SPIKE_TYPE = torch.float32 if INTERPRETED else torch.bfloat16
"""Storage of bfloat16 numbers; the interpreter cannot multiply them and stores them as float32."""

UNFUSED = {"enable_fp_fusion": False}
"""A kernel's option: it rounds after every multiplication, on the device as in the interpreter."""

WIDTH = tl.constexpr(layout.WIDTH)
GRID = tl.constexpr(fixed_point.WEIGHT_SCALE // 2)
LOWEST = tl.constexpr(-128)
HIGHEST = tl.constexpr(127)
"""8-bit weights are whole numbers from LOWEST to HIGHEST over GRID."""
_ROUNDING = tl.constexpr(1.5 * 2**23)  # added and taken away again, it rounds a small float32 half to even


@dataclass(frozen=True)
class Numbers:
    """What an arithmetic computes with.

    integer: integer states and 8-bit weights.
    real: type of weighted inputs, slopes and gradients, and of states that are not integer.
    part: type in which parts are stored.
    n_weight_parts, n_parts: parts of a weight, and of a gradient by a weighted input.
    n_stages: tiles that a product has in flight; as many as the shared memory of small devices holds.
    """

    integer: bool
    real: torch.dtype
    part: torch.dtype
    n_weight_parts: int
    n_parts: int
    n_stages: int

    @property
    def cell_bytes(self) -> int:
        """What a neuron holds per row: input or slope, spikes twice, what arrives, and its gradient."""
        return 2 * self.real.itemsize + 2 * SPIKE_TYPE.itemsize + self.n_parts * self.part.itemsize


NUMBERS: dict[Arithmetic, Numbers] = {
    "integer": Numbers(True, torch.float32, SPIKE_TYPE, 1, 2, 3),
    "float32": Numbers(False, torch.float32, SPIKE_TYPE, 3, 3, 2),
    "ideal": Numbers(False, torch.float64, torch.float64, 1, 1, 1),
}


@triton.jit
def store_parts(
    parts: tl.tensor, at: tl.tensor, size: tl.tensor, x: tl.tensor, mask: tl.tensor, n_parts: tl.constexpr
) -> None:
    """Store x as the sum of parts that lie `size` numbers apart."""
    rest = x
    for part in tl.static_range(n_parts):
        nearest = rest
        if rest.dtype == tl.float32:  # round half to even to 16 bits; adding to a NaN could make it a number
            bits = rest.to(tl.uint32, bitcast=True)
            bits = ((bits + 0x7FFF + ((bits >> 16) & 1)) >> 16) << 16
            nearest = tl.where(rest == rest, bits.to(tl.float32, bitcast=True), rest)
        tl.store(parts + part * size + at, nearest, mask=mask)
        rest = rest - nearest


@triton.jit
def mantissa_of(weight: tl.tensor) -> tl.tensor:
    """Return weights on the 8-bit grid before the clip, half to even, far ones cut; NaN becomes 0."""
    cut = tl.minimum(tl.maximum(weight * GRID, 4.0 * LOWEST), 4.0 * HIGHEST)
    return tl.where(weight == weight, (cut + _ROUNDING) - _ROUNDING, 0.0)
