"""Layers of integer matrices: what a classifier of counts computes where its weights have 8 bits.

    y[k] = b[k] + x[k] W[k]                              W int8, b and y int32
    x[k+1] = min(max(y[k], 0) >> shift[k], 255)          hidden units, 8 bits

The answer is the class of the largest output; of two classes, one output > 0 says the second. Every operation
is one of integers, so that C computes the same numbers.

They are rounded from layers that were trained in floating point. A layer has one scale a: W = rint(a w),
held at 127, and b = rint(a v). At the least scale that is tried the largest weight is 127, and others are
up to 2^10 times that: the one is taken whose outputs are nearest to the trained ones in the mean over
training samples. So a few large weights, as inputs have that are seldom not 0, do not round all others to
nothing. No sum reaches 32 bits, whatever a recording holds: `largest_sum` < 2^31. shift[k] is the least at
which no hidden unit exceeds 255 in training; units that other recordings drive further stay at 255.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dse.base.records import Array, Floats, Ints

MOST_WEIGHT, MOST_UNIT, MOST_SUM = 127, 255, 2**31 - 1
_SAMPLES = 1000
"""Of training, by which a scale is chosen."""


@dataclass(frozen=True)
class IntegerLayers:
    """A readout in integers.

    weights: (input, unit) int8 of each layer. biases: (unit,) int32 of each.
    shifts: of each hidden layer.
    scale: output per unit of what was trained, such as log-odds.
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    shifts: tuple[int, ...]
    scale: float

    @classmethod
    def of(cls, arrays: Mapping[str, Array], j: int) -> IntegerLayers:
        """Return readout j of stored arrays (`stored`)."""
        shifts = tuple(arrays[f"{j}/shift"].tolist())
        depth = range(len(shifts) + 1)
        weights, biases = (tuple(arrays[f"{j}/{k}/{name}"] for k in depth) for name in ("weight", "bias"))
        return cls(weights, biases, shifts, float(arrays[f"{j}/scale"]))

    def stored(self, j: int) -> dict[str, Array]:
        """Return it as named arrays, readout j of several."""
        arrays = {f"{j}/shift": np.array(self.shifts, np.uint8), f"{j}/scale": np.array(self.scale)}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"{j}/{k}/weight": weight, f"{j}/{k}/bias": bias}
        return arrays

    def inputs(self, x: Ints) -> list[Ints]:
        """Return the inputs of every layer, and last the outputs, each (n, unit) int64.

        Args:
            x: (n, input) integers >= 0.
        """
        passed_on: list[Ints] = [np.asarray(x, np.int64)]
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            # Sums of integers below 2^53 are exact in double, in any order.
            y = (passed_on[-1].astype(np.float64) @ weight.astype(np.float64)).astype(np.int64) + bias
            if k < len(self.shifts):
                y = np.minimum(np.maximum(y, 0) >> self.shifts[k], MOST_UNIT)
            passed_on.append(y)
        return passed_on


def largest_sum(layers: IntegerLayers, most: int) -> int:
    """Return the largest magnitude that any sum of any layer reaches, in any order of its terms."""
    reached = 0
    for k, (weight, bias) in enumerate(zip(layers.weights, layers.biases, strict=True)):
        of_inputs = np.abs(weight.astype(np.int64)).sum(axis=0)
        of_units = [(most if k == 0 else MOST_UNIT) * n for n in of_inputs.tolist()]  # Python's integers
        pairs = zip(of_units, np.abs(bias.astype(np.int64)).tolist(), strict=True)
        reached = max(reached, *(n + b for n, b in pairs))
    return reached


def rounded(layers: Sequence[tuple[Floats, Floats]], x: Ints, most: int) -> IntegerLayers:
    """Return trained layers in integers.

    Args:
        layers: weight (input, unit) and bias (unit,) of each, of integer inputs; hidden units are max(0, .).
        x: (n, input) training samples.
        most: the largest input of any recording.
    """
    weights: tuple[Array, ...] = ()
    biases: tuple[Array, ...] = ()
    shifts: tuple[int, ...] = ()
    given, unit, scale = np.asarray(x, np.int64), 1.0, 1.0  # an input stands for `unit`
    for k, (trained, bias) in enumerate(layers):
        w, v = unit * np.asarray(trained, np.float64), np.asarray(bias, np.float64)
        limit, is_hidden = most if k == 0 else MOST_UNIT, k < len(layers) - 1
        layer = _nearest(w, v, given[:: max(1, len(given) // _SAMPLES)], limit, is_hidden)
        scale = layer.scale
        weights, biases = weights + layer.weights, biases + layer.biases
        if is_hidden:
            y = np.maximum(layer.inputs(given)[1], 0)
            shift = max(int(y.max(initial=0)).bit_length() - MOST_UNIT.bit_length(), 0)
            given, unit = np.minimum(y >> shift, MOST_UNIT), 2.0**shift / scale
            shifts = (*shifts, shift)
    return IntegerLayers(weights, biases, shifts, scale)


def _nearest(w: Floats, v: Floats, x: Ints, most: int, is_hidden: bool) -> IntegerLayers:
    """Return the layer in integers whose outputs for samples x are nearest to x w + v.

    Args:
        w: (input, unit) weights that were trained, of integer inputs.
        v: (unit,) biases.
        x: (n, input) samples; without any, the least scale is taken.
        most: the largest input of any recording.
        is_hidden: whether outputs below 0 are passed on as 0.
    """
    sums = (float(most) * np.abs(w).sum(axis=0) + np.abs(v)).max()
    largest = _over(MOST_SUM, sums)
    least = min(_over(MOST_WEIGHT, np.abs(w).max(initial=0)), largest)
    floor = 0.0 if is_hidden else -np.inf
    exact = np.maximum(x @ w + v, floor)
    tried: list[tuple[float, IntegerLayers]] = []
    for scale in least * 2.0 ** np.arange(0, 10.5, 0.5):
        if tried and scale > largest:
            break
        while True:
            weight = np.clip(np.rint(scale * w), -MOST_WEIGHT, MOST_WEIGHT)
            parts = (weight.astype(np.int8),), (np.rint(scale * v).astype(np.int32),)
            layer = IntegerLayers(*parts, (), float(scale))
            if largest_sum(layer, most) <= MOST_SUM:  # rounding up may have passed it
                break
            scale /= 2
        given = np.maximum(layer.inputs(x)[1] / scale, floor)
        tried.append((float(np.abs(given - exact).sum()), layer))
    return min(tried, key=lambda each: each[0])[1]


def _over(most: int, value: float) -> float:
    """Return most / value, of 0 a number that leaves the limit to others."""
    return most / value if value > 0 else float(most)
