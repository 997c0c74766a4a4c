"""Weights of fewer bits, and fewer weights, of a network that is trained already: nothing is learnt again.

With the 8-bit step of 1/32, a layer's weights become

    w = q * 2**e / 32,    q whole in [-2**(b-1), 2**(b-1) - 1],    0 <= e <= 8 - b

with b bits in two's complement, so that one more value lies below 0 than above (2 bits: -2, -1, 0, 1). A
layer has one exponent e, that of its recurrent weights too, as chips share one per layer. Every such weight
is an 8-bit weight as well: the same engine runs it with the same integer states, bit for bit.

Rounding alone removes no weight: a full matrix keeps a place for each, those that round to 0 included. A
matrix that was pruned is a list of weights, and what rounds to 0 leaves it (`remaining`).

Source: Davies et al. 2018, weights with a shared exponent; Han et al. 2015, pruning (REFERENCES.md).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Arithmetic, Array, Floats, Ints, Layer, Network
from dse.engine.member import Masters
from dse.engine.neurons import Population
from dse.engine.neurons.fixed_point import BITS, HIGHEST_WEIGHT, WEIGHT_SCALE, quantise
from dse.models.snn.whiten import inverse

FINEST = 8
"""Largest exponent of a layer's thresholds and weights."""

P = TypeVar("P", bound=Population[Any])

_GOLDEN = (math.sqrt(5) - 1) / 2
_STEPS = WEIGHT_SCALE // 2  # 8-bit steps in a weight of 1
_DAMPING = 0.001  # added to the power of every input, in the mean of the powers
_ROUNDS_TO_0 = np.float32(0.5 / _STEPS)  # the largest magnitude that 8 bits round to 0: half to even


def rounded(network: Network, weight_bits: int, pruned: float) -> Network:
    """Return a trained network with its largest weights only, rounded to so many bits per layer.

    Args:
        network: in integer arithmetic.
        weight_bits: 2 to 8; 8 and nothing pruned is the network itself, which is deployed with 8 bits.
        pruned: share of every matrix that is removed by magnitude, what is 0 already included, in [0, 1).

    Raises:
        ValueError: another arithmetic, a setting out of range, or a weight that is no finite number.
    """
    if network.arithmetic != "integer":
        raise ValueError(
            f"only networks with integer arithmetic can be rounded, got {network.arithmetic} arithmetic"
        )
    if weight_bits not in range(2, BITS + 1):
        raise ValueError(f"weight_bits must be an integer from 2 to {BITS}, got {weight_bits}")
    if not 0 <= pruned < 1:
        raise ValueError(f"pruned must be in [0, 1), got {pruned}")
    for number, layer in enumerate(network.layers, 1):
        for wrong in (w[~np.isfinite(w)] for w in layer.matrices):
            if wrong.size:
                raise ValueError(f"weights of layer {number} must be finite numbers, got {wrong[0]}")
    if weight_bits == BITS and pruned == 0:
        return network
    return dataclasses.replace(
        network, layers=tuple(_rounded_layer(layer, weight_bits, pruned) for layer in network.layers)
    )


def finer(population: P, exponent: int) -> P:
    """Return neurons with thresholds 2**exponent times as high: with such weights they spike alike."""
    if not exponent:
        return population
    of_integers: Any = population
    scaled: P = dataclasses.replace(of_integers, threshold=int(of_integers.threshold * 2.0**exponent))
    return scaled


def dithered(weights: Array, pool: Ints) -> Floats:
    """Return the 8-bit weights of every input, (input, neuron) float32, from those of their pools.

    Within a pool of n inputs, a weight is rounded up for some and down for the others, so that the sum over
    the pool is that of the weight, rounded once. Which ones is a low-discrepancy sequence: of any run of
    inputs, the right share is rounded up. What rounds to 0 keeps its sign and deploys as 0.

    Args:
        weights: (pool, neuron).
        pool: (input,) each input's pool.
    """
    steps = _in_steps(weights)
    turn = np.arange(weights.shape[1]) * _GOLDEN % 1  # neurons round different inputs up
    out = np.empty((pool.size, weights.shape[1]), np.float32)
    for k, of_pool in enumerate(steps):
        inputs = np.flatnonzero(pool == k)
        n = inputs.size
        rank = np.argsort(np.argsort(np.arange(n) * _GOLDEN % 1))
        up = (((rank[:, None] + np.floor(turn * n)) % n) + 0.5) / n
        out[inputs] = np.clip(np.floor(of_pool + up), -128, 127) / _STEPS
    small = np.clip(weights, -_ROUNDS_TO_0, _ROUNDS_TO_0)[pool]
    return np.where(out == 0, small, out)


def finest(weights: Array, most: int) -> int:
    """Return the largest exponent, 0 to `most`, with which 8 bits hold all of some weights; 0: none does."""
    largest_magnitude = np.abs(weights).max(initial=0)
    fits = [k for k in range(most + 1) if largest_magnitude * 2.0**k <= HIGHEST_WEIGHT]
    return max(fits, default=0)


def closest(weights: Array, squares: Floats, most: int = FINEST) -> int:
    """Return the exponent, 0 to `most`, whose 8-bit weights change what neurons receive least.

    Args:
        weights: (input, neuron), clipped where 8 bits do not hold them.
        squares: (input,) mean squared spikes of a sample.
        most: exponent that states leave room for.
    """
    errors = []
    for k in range(most + 1):
        stored = np.rint(_in_steps(weights * 2.0**k)) / _STEPS / 2.0**k
        errors.append((squares[:, None] * (stored - weights) ** 2).sum())
    return int(np.argmin(errors))


def compensated(weights: Array, moments: Floats) -> Floats:
    """Return 8-bit weights, (input, neuron) float32, whose errors cancel in what neurons receive.

    Inputs are rounded one after the other, first those whose weights 8 bits clip, then those of most power;
    the weights of the others take over what that changes in the drive, as far as they fire together.
    Source: Frantar et al. 2023, optimal brain quantisation of layers (REFERENCES.md).

    Args:
        weights: (input, neuron).
        moments: (input, input) mean products of the inputs' spikes in a short time.
    """
    power = np.diag(moments)
    damped = moments + _DAMPING * (power.mean() if power.any() else 1.0) * np.eye(len(power))
    steps = weights.astype(np.float64) * _STEPS
    clipped = np.abs(steps - np.clip(steps, -128, 127)).max(axis=1)
    _round_in_turn(steps, inverse(damped), np.lexsort((-power, -clipped)))
    return np.asarray(steps / _STEPS, np.float32)


@compiled()
def _round_in_turn(steps: Array, inverted: Array, order: Array) -> None:
    """Round weights in steps in place; `inverted` is consumed."""
    n, n_neurons = steps.shape
    left = np.ones(n, np.bool_)
    for j in order:
        left[j] = False
        missed = np.empty(n_neurons)
        for c in range(n_neurons):
            whole = min(max(np.rint(steps[j, c]), -128.0), 127.0)
            missed[c] = (steps[j, c] - whole) / inverted[j, j]
            steps[j, c] = whole
        row = inverted[j].copy()
        for i in range(n):
            if left[i]:
                for c in range(n_neurons):
                    steps[i, c] -= missed[c] * row[i]
                factor = row[i] / row[j]
                for k in range(n):
                    inverted[i, k] -= factor * row[k]


def exponent(matrices: Sequence[Array], weight_bits: int) -> int:
    """Return the e of a layer that leaves the least squared error, clipping included; the least on ties.

    The error is against the weights as 8 bits clip them: what no chip of 8 bits can hold counts as its limit.
    """
    steps = np.concatenate([_in_steps(w).ravel() for w in matrices])
    errors = [
        ((_whole(steps, weight_bits, e) * 2.0**e - steps) ** 2).sum() for e in range(BITS + 1 - weight_bits)
    ]
    return int(np.argmin(errors))


def _rounded_layer(layer: Layer, weight_bits: int, pruned: float) -> Layer:
    kept = [np.where(largest(w, pruned), w, np.float32(0)) for w in layer.matrices]
    shared = exponent(kept, weight_bits)
    weight, *recurrent = (stored(w, weight_bits, shared) for w in kept)
    return dataclasses.replace(layer, weight=weight, recurrent=recurrent[0] if recurrent else None)


def stored(weights: Array, weight_bits: int, shared: int) -> Array:
    """Return one matrix on the grid of so many bits and an exponent.

    A matrix without a 0 keeps what rounds to 0 as a number that deploys as 0.
    """
    on_grid = (_whole(_in_steps(weights), weight_bits, shared) * 2.0**shared / _STEPS).astype(np.float32)
    if (weights == 0).any():
        return on_grid
    return np.where(on_grid == 0, np.clip(weights, -_ROUNDS_TO_0, _ROUNDS_TO_0), on_grid)


def _in_steps(weights: Array) -> Array:
    """Return weights in steps of 8 bits, float64, clipped to what 8 bits hold."""
    return np.clip(np.asarray(weights, np.float64) * _STEPS, -128, 127)


def _whole(steps: Array, weight_bits: int, shared: int) -> Array:
    """Return the whole numbers q of some weights: half to even, clipped to so many bits."""
    end = 2 ** (weight_bits - 1)
    return np.asarray(np.clip(np.rint(steps / 2.0**shared), -end, end - 1))


def largest(weights: Array, pruned: float) -> Array:
    """Return the weights that stay, as booleans, where a share of a matrix is removed, smallest first.

    Of equal magnitudes the first in the matrix goes first; the number removed is rounded down.
    """
    removed = int(pruned * weights.size)
    kept = np.ones(weights.size, bool)
    kept[np.argsort(np.abs(weights), axis=None, kind="stable")[:removed]] = False
    return kept.reshape(weights.shape)


def masks(masters: Masters, pruned: float) -> Masters:
    """Return `largest` of every matrix, as booleans in place of its weights."""
    return Masters(
        tuple(largest(w, pruned) for w in masters.feed_forward),
        tuple(None if r is None else largest(r, pruned) for r in masters.recurrent),
    )


def remaining(weights: Array, kept: Array, arithmetic: Arithmetic) -> Array:
    """Return weights as they are stored after pruning: 0 where removed, or where 8 bits round them to 0."""
    stored = np.where(kept, weights, np.float32(0))
    if arithmetic == "integer":
        stored[quantise(stored) == 0] = 0
    return stored
