"""The start `contrasts` of a first layer: neurons that compare two inputs, those that the labels need.

A candidate is excited by one input and inhibited by another, in units of the inputs' mean spikes:

    drive(t) = x_a(t) / <x_a> - s * x_b(t) / <x_b>,    s uniform in [0, 1)

Its weights are scaled so that the drive, averaged over as many steps as the neuron remembers, exceeds the
threshold for a share of the time. These shares are spread evenly on a logarithmic scale. Drives that follow
one common rate differ in what they are compared with, so that counts tell more than that rate.

Which candidates stay is found by the labels: a least-squares readout of the spike counts of all of them
loses one neuron after the other, each time that whose loss raises the squared error least, minus the price
of its spikes. Removing neuron j from a readout with weights W raises the error by |W_j|^2 / P_jj, where P is
the inverse of the second moments. Sums of counts are exact, and all others run in one order: the choice is
the same everywhere.

Source: Hassibi and Stork 1993, optimal brain surgeon, of a linear readout (REFERENCES.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from dse.engine.events import Rows
from dse.engine.forward import Prepared
from dse.models.snn.whiten import covariance, dot
from dse.native.compiled import compiled
from dse.neurons import Population
from dse.neurons.response import dc_gain, response_norm
from dse.records import Array, Bools, Floats, Ints

CANDIDATES = 1024
"""Neurons to choose among, at least; four times as many as are kept, if that is more."""
NO_DRIVE = 1e-35
"""Weight of an input that does not drive a neuron: 0 would be no weight. Its square is 0 in float32."""
_SHARES = 0.02, 0.95
"""Least and largest share of the time with a positive drive for which it exceeds the threshold."""
_RIDGE = 0.003  # added to the second moments of scaled counts
_PEAK_SAMPLES = 256  # whose potentials are kept, a few at a time


def candidates(
    rows: Rows, population: Population[Any], n_neurons: int, most_below: float, rng: np.random.Generator
) -> Floats:
    """Return the weights of candidates, (input, neuron), of inputs that fire in the rows.

    Args:
        rows: input spikes of a probe batch.
        population: the candidates.
        n_neurons: how many.
        most_below: thresholds by which their mean potentials may lie below rest, where no reset ends it; the
            weights of those that would lie lower are scaled down.
        rng: draws pairs and shares.
    """
    gain = dc_gain(population, n_neurons)
    memory = float(np.median((gain / response_norm(population, n_neurons, rows.n_steps)) ** 2))
    seen = mean_counts(rows, min(max(1, round(memory)), rows.n_steps))
    weights = np.full((rows.n_inputs, n_neurons), NO_DRIVE)
    active = np.flatnonzero(seen.any(axis=0))
    n_rounds = -(-n_neurons // max(1, active.size))
    means = seen.mean(axis=0)
    for j in range(n_neurons if active.size else 0):
        turn, place = divmod(j, active.size)
        a, b = active[place], active[(place + rng.integers(1, max(2, active.size))) % active.size]
        share = rng.random()
        drive = seen[:, a] / means[a] - (share if b != a else 0.0) * seen[:, b] / means[b]
        above = np.sort(drive)[::-1]
        low, high = np.log(_SHARES)
        of_time = math.exp(low + (turn + 0.5) / n_rounds * (high - low)) * np.count_nonzero(above > 0)
        least = above[min(int(of_time), above.size - 1)]
        unit = max(least if least > 0 else above[0], -drive.min() / most_below)
        weights[a, j] = 1 / (means[a] * unit)
        if b != a:
            weights[b, j] = -share / (means[b] * unit)
    return np.asarray(weights * (population.to_threshold / gain))


def mean_counts(rows: Rows, n_steps: int) -> Floats:
    """Return the mean spikes per step of every input over whole stretches of steps, (stretch, input)."""
    n_stretches = rows.n_steps // n_steps
    sample, step = np.divmod(np.repeat(np.arange(rows.offsets.size - 1), np.diff(rows.offsets)), rows.n_steps)
    stretch = np.minimum(step // n_steps, n_stretches)  # the last holds what is left over
    cell = (sample * (n_stretches + 1) + stretch) * rows.n_inputs + rows.index
    shape = rows.n_samples, n_stretches + 1, rows.n_inputs
    counts = np.bincount(cell, rows.times if rows.times.size else None, math.prod(shape)).reshape(shape)
    return np.asarray(counts[:, :-1].reshape(-1, rows.n_inputs) / n_steps)


def needed(
    layer: Prepared,
    to_threshold: Floats | float,
    windows: Callable[[int, int], Iterable[Rows]],
    targets: Floats,
    n_neurons: int,
    price: float,
    most_peak: float,
) -> Ints:
    """Return which candidates stay, (n_neurons,) increasing; first go those that leave the range of a state.

    Args:
        layer: the candidates as they run.
        to_threshold: of their potentials, weight units.
        windows: return the inputs of the first so many training samples (0: of all), so many at a time.
        targets: (sample, output) as in `chosen`.
        n_neurons: how many stay.
        price: as in `chosen`.
        most_peak: thresholds that potentials are to stay within, on some of the samples.
    """
    fired = [layer.forward(rows).fired.per_input() for rows in windows(0, 64)]
    peaks = np.zeros(layer.n_neurons)
    for rows in windows(_PEAK_SAMPLES, 8) if math.isfinite(most_peak) else ():
        reached = np.abs(layer.forward(rows, keep_voltage=True).voltage).max(axis=(0, 1))
        peaks = np.maximum(peaks, reached / to_threshold)
    return chosen(np.concatenate(fired), targets, n_neurons, price, peaks > most_peak)


def chosen(counts: Ints, targets: Floats, n_neurons: int, price: float, out: Bools) -> Ints:
    """Return which neurons stay, (n_neurons,) increasing.

    Args:
        counts: (sample, candidate) spikes.
        targets: (sample, output) 1 where an output stands for a label of the sample, else 0.
        n_neurons: how many stay.
        price: of a spike, in squared errors of a sample.
        out: (candidate,) bool, those that go first, whatever they tell.
    """
    whole, n = counts.astype(np.float64), len(counts)
    totals = whole.sum(axis=0)
    scales, powers = covariance(counts)
    powers[np.diag_indices_from(powers)] += _RIDGE
    share = targets.mean(axis=0)
    with_targets = (
        (whole.T @ targets - totals[:, None] * share) / n * scales[:, None]
    )  # sums of whole numbers
    left = np.ones(len(scales), np.bool_)
    prices = np.where(out, np.inf, price * totals / n)
    _remove(powers, with_targets, left, len(scales) - n_neurons, prices)
    return np.flatnonzero(left)


@compiled()
def _remove(powers: Array, with_targets: Array, left: Array, n_removed: int, prices: Array) -> None:
    """Clear `left` of the neurons that a least-squares readout misses least, one after the other."""
    inverse = _inverse(powers)
    n, n_outputs = with_targets.shape
    readout = np.zeros((n, n_outputs))
    for i in range(n):
        for k in range(n):
            for c in range(n_outputs):
                readout[i, c] += inverse[i, k] * with_targets[k, c]
    for _ in range(n_removed):
        least, worst = np.inf, -1
        for j in range(n):
            if left[j]:
                squared = 0.0
                for c in range(n_outputs):
                    squared += readout[j, c] ** 2
                missed = squared / inverse[j, j] - prices[j]
                if worst < 0 or missed < least:
                    least, worst = missed, j
        left[worst] = False
        row = inverse[worst].copy()
        for i in range(n):
            if left[i]:
                factor = row[i] / row[worst]
                for k in range(n):
                    inverse[i, k] -= factor * row[k]
                for c in range(n_outputs):
                    readout[i, c] -= factor * readout[worst, c]


@compiled()
def _inverse(matrix: Array) -> Array:
    """Return the inverse of a symmetric positive definite matrix, by Cholesky's factors."""
    n = len(matrix)
    lower, rows = np.zeros((n, n)), np.zeros((n, n))  # rows: those of the transposed inverse of `lower`
    for i in range(n):
        for j in range(i + 1):
            rest = matrix[i, j] - dot(lower[i, :j], lower[j, :j])
            lower[i, j] = math.sqrt(rest) if i == j else rest / lower[j, j]
    for j in range(n):
        rows[j, j] = 1 / lower[j, j]
        for i in range(j + 1, n):
            rows[j, i] = -dot(lower[i, j:i], rows[j, j:i]) / lower[i, i]
    out = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            out[i, j] = out[j, i] = dot(rows[i, i:], rows[j, i:])
    return out
