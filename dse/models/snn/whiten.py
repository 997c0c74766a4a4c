"""The basis in which weights learn where the neurons below fire together.

Counts of neurons that follow one common rate are nearly collinear. Adam then moves all weights along the
common direction, and hardly along the differences that carry the classes. In the basis

    M = diag(c) Q diag((ev + 0.1)^-1/2) / s,    c = 1 / (sd + 5),    W = W0 + M A    (dse.engine.parameters)

counts are nearly white. sd are the standard deviations of the neurons' spike counts over samples; Q and ev
belong to the mean of x x' over samples, x = c * count, not centred. s is the root mean square length of the
rows of M whose neurons fire: a step of A moves weights as far as a step of W would.

Directions in which no sample differs (eigenvalues of rounding errors alone) have no column: Adam would take
full steps along the rounding errors of their gradients. Neurons that never fired have a column each, so that
one that wakes up can learn.

Every step has the same bits on all machines and for any number of threads: sums of whole numbers are exact,
and eigenvectors come from Jacobi rotations (`eigen`), not from a library that picks its kernels.
"""

from __future__ import annotations

import math

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array, Floats, Ints

SAMPLES = 2048
"""Training samples that the counts are of, at most."""
LEAST_SPREAD = 5.0
"""Spikes by which a neuron's count is scaled at least."""
LEAST_POWER = 0.1
"""Added to the eigenvalues."""
_RIGHT = 1e-13  # cosine of two rows that counts as a right angle
_MOST_SWEEPS = 60


def covariance(counts: Ints) -> tuple[Floats, Floats]:
    """Return the scales c of some neurons, and the mean of x x' with x = c * count, (neuron, neuron).

    Args:
        counts: (sample, neuron) spikes, at least one sample.
    """
    whole, n = counts.astype(np.float64), len(counts)
    products, totals = whole.T @ whole, whole.sum(axis=0)  # exact in any order
    scales = 1 / (np.sqrt(n * np.diag(products) - totals**2) / n + LEAST_SPREAD)
    return scales, products / n * scales[:, None] * scales


def basis(counts: Ints, least_power: float = LEAST_POWER) -> tuple[Floats, float]:
    """Return M, (neuron, rank) float32, and s.

    Args:
        counts: (sample, neuron) spikes, at least one sample.
        least_power: what is added to the eigenvalues.
    """
    scales, means = covariance(counts)
    fires = counts.any(axis=0)
    powers, vectors = eigen(means[np.ix_(fires, fires)])
    n_silent = int((~fires).sum())
    out = np.zeros((len(scales), powers.size + n_silent))
    of_firing = scales[fires, None] * vectors / np.sqrt(powers + least_power)
    of_silent = scales[~fires, None] * np.eye(n_silent) / np.sqrt(least_power)
    out[fires, : powers.size], out[~fires, powers.size :] = of_firing, of_silent
    rows = of_firing if fires.any() else of_silent
    length = float(np.sqrt((rows**2).sum() / len(rows)))
    return (out / length).astype(np.float32), length


def eigen(matrix: Floats) -> tuple[Floats, Floats]:
    """Return the eigenvalues above 0 of a symmetric positive semidefinite matrix, falling, and their vectors.

    Vectors are the columns of (n, rank); the largest component of each is positive. Left out are eigenvalues
    below n * 2.2e-16 of the largest: rounding errors.
    Source: Demmel and Veselic 1992, one-sided Jacobi (REFERENCES.md).
    """
    n, unit = len(matrix), np.abs(matrix).max(initial=0) or 1.0
    rows = np.zeros((n, n + -n % 4))
    rows[:, :n] = matrix / unit
    _orthogonalise(rows)
    values = np.sqrt(_squares(rows))
    order = np.argsort(-values, kind="stable")
    order = order[values[order] > n * np.finfo(float).eps * values.max(initial=0)]
    vectors = rows[order, :n] / values[order, None]
    largest = np.abs(vectors).argmax(axis=1) if n else np.zeros(0, np.int64)
    vectors *= np.sign(vectors[np.arange(order.size), largest])[:, None]
    return values[order] * unit, vectors.T


@compiled()
def dot(x: Array, y: Array) -> float:
    """Return the sum of x times y, as four sums side by side; what is left of the length joins the first."""
    a = b = c = d = 0.0
    whole = x.size - x.size % 4
    for k in range(0, whole, 4):
        a += x[k] * y[k]
        b += x[k + 1] * y[k + 1]
        c += x[k + 2] * y[k + 2]
        d += x[k + 3] * y[k + 3]
    for k in range(whole, x.size):
        a += x[k] * y[k]
    return (a + b) + (c + d)


@compiled()
def inverse(matrix: Array) -> Array:
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


@compiled()
def _squares(rows: Array) -> Array:
    out = np.empty(len(rows))
    for k in range(len(rows)):
        out[k] = dot(rows[k], rows[k])
    return out


@compiled()
def _orthogonalise(rows: Array) -> None:
    """Rotate rows pairwise until they stand at right angles; those of rounding errors alone stay."""
    n = len(rows)
    for _ in range(_MOST_SWEEPS):
        squares, turned = _squares(rows), False
        if n:
            least = squares.max() * (n * 2.2e-16) ** 2
        for p in range(n - 1):
            for q in range(p + 1, n):
                if min(squares[p], squares[q]) <= least:
                    continue
                along = dot(rows[p], rows[q])
                if abs(along) <= _RIGHT * np.sqrt(squares[p] * squares[q]):
                    continue
                turned = True
                slope = (squares[q] - squares[p]) / (2 * along)
                tangent = 1 / (abs(slope) + np.sqrt(1 + slope * slope))
                tangent = tangent if slope >= 0 else -tangent
                cosine = 1 / np.sqrt(1 + tangent * tangent)
                sine = cosine * tangent
                for k in range(rows.shape[1]):
                    x, y = rows[p, k], rows[q, k]
                    rows[p, k] = cosine * x - sine * y
                    rows[q, k] = sine * x + cosine * y
                squares[p] -= tangent * along
                squares[q] += tangent * along
        if not turned:
            return


def effective_rank(counts: Ints) -> float:
    """Return how many directions the neurons' counts differ in, from 1 to the neurons that differ at all.

    The participation ratio (sum of ev)^2 / sum of ev^2 over the eigenvalues of the correlations of the counts
    over samples, without a decomposition: n^2 / sum of correlation^2. 0 where no neuron differs.
    Source: Gao et al. 2017 (REFERENCES.md).
    """
    whole, n = counts.astype(np.float64), len(counts)
    totals = whole.sum(axis=0)
    spread = n * (whole.T @ whole) - totals[:, None] * totals  # exact in any order
    differ = np.diag(spread) > 0
    powers = np.diag(spread)[differ]
    squares = spread[np.ix_(differ, differ)] ** 2 / powers[:, None] / powers
    return float(powers.size**2 / squares.sum()) if powers.size else 0.0
