"""The decision maker: when to answer, and what, from the output spikes so far.

    S_T[t] = sum_n S_n[t],  S_n[t] = output spikes of class n in steps 0..t
    c[t]   = max_n S_n[t] / S_T[t] where S_T[t] > phi, else 0
    The first step with S_T > phi and c >= theta decides argmax_n S_n, at time (t + 1) step_ms.

A tie goes to the lowest class. A sample that never gets there is undecided: it answers by argmax at
the last step T - 1. theta = 0 decides as soon as S_T exceeds phi (the printed equations would
decide before any spike). phi and theta are free axes: nothing is trained for them.

c is not monotone in t, but the decision is monotone in both parameters: a larger phi or theta only
removes admissible steps. So per sample one walk over the steps with spikes serves the whole grid.

c is the float64 quotient max / S_T, compared with theta as it is: 7 spikes of 20 reach theta = 0.35,
but not 0.2 + 3 * 0.05 = 0.35000000000000003. Grids should be rounded to the digits they mean.

Source: Brayshaw et al., real-time texture classification, Eqs. (1)-(6) (REFERENCES.md).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from dse.records import Array, Surface

_CHUNK = 256  # samples per call of the kernel: bounds the memory that `work` takes as float64

HUMAN_ACCURACY = 0.65  # the human baseline of the source


class Decisions(NamedTuple):
    """What one setting decides: label, step and whether theta was reached, each (n,)."""

    label: NDArray[np.int64]
    step: NDArray[np.int64]
    decided: NDArray[np.bool_]


class Setting(NamedTuple):
    """One point of a surface."""

    decision_latency_ms: float
    accuracy: float
    phi: float
    theta: float


def decide(output: ArrayLike, phi: float, theta: float) -> Decisions:
    """Return what every sample decides under one setting; the definition above in plain NumPy.

    Args:
        output: (n, T, class) uint8 output spikes.
        phi: spikes to wait for, >= 0; a decision needs strictly more.
        theta: confidence to reach, in [0, 1].

    Returns:
        Labels, zero-based steps (T - 1 where undecided) and whether theta was reached.

    Raises:
        ValueError: an empty or misshapen output, phi or theta out of range.
    """
    spikes = _spikes(output)
    _grid("phi", [phi], np.inf)
    _grid("theta", [theta], 1.0)
    counts = spikes.cumsum(axis=1, dtype=np.int64)
    total = counts.sum(axis=2)
    confidence = counts.max(axis=2) / np.maximum(total, 1)
    admissible = (total > phi) & (confidence >= theta)
    decided = admissible.any(axis=1)
    step = np.where(decided, admissible.argmax(axis=1), spikes.shape[1] - 1)
    return Decisions(counts[np.arange(len(spikes)), step].argmax(axis=1), step, decided)


def surface(
    output: ArrayLike,
    target: ArrayLike,
    phi: ArrayLike,
    theta: ArrayLike,
    step_ms: float,
    work: ArrayLike | None = None,
) -> Surface:
    """Return accuracy, decision time, undecided and tie fractions for every (phi, theta), exactly.

    O(T class + phi theta) per sample; memory does not grow with n, so `output` may be a memory map.

    Args:
        output: (n, T, class) uint8 output spikes.
        target: (n,) true class.
        phi: (phi,) spikes to wait for, >= 0, any order.
        theta: (theta,) confidences in [0, 1], any order.
        step_ms: duration of a step.
        work: (n, T, m) work done up to and including each step, such as spikes per layer.

    Raises:
        ValueError: no samples, shapes that do not belong together, or values out of range.
    """
    spikes = _spikes(output)
    n, n_steps, n_classes = spikes.shape
    labels = np.asarray(target)
    if labels.shape != (n,) or labels.dtype.kind not in "iu":
        raise ValueError(f"target must be ({n},) integers, got {labels.shape} of {labels.dtype}")
    if labels.min() < 0 or labels.max() >= n_classes:
        raise ValueError(f"target must be in 0..{n_classes - 1}, got {labels.min()}..{labels.max()}")
    if not step_ms > 0:
        raise ValueError(f"step_ms must be > 0, got {step_ms}")
    phis, thetas = _grid("phi", phi, np.inf), _grid("theta", theta, 1.0)
    done = np.empty((n, n_steps, 0)) if work is None else np.asanyarray(work)
    if done.ndim != 3 or done.shape[:2] != (n, n_steps):
        raise ValueError(f"work must be ({n}, {n_steps}, m), got {done.shape}")

    # The kernel walks ascending grids; the results go back to the caller's order.
    by_phi, by_theta = np.argsort(phis, kind="stable"), np.argsort(thetas, kind="stable")
    tally = np.zeros((len(phis), len(thetas), 5), dtype=np.int64)
    work_sum = np.zeros((len(phis), len(thetas), done.shape[2]))
    for start in range(0, n, _CHUNK):
        part = slice(start, start + _CHUNK)
        _tally(
            np.ascontiguousarray(spikes[part]),
            labels[part].astype(np.int64),
            phis[by_phi],
            thetas[by_theta],
            np.ascontiguousarray(done[part], dtype=np.float64),
            tally,
            work_sum,
        )
    correct, correct_decided, steps, undecided, ties = np.moveaxis(_unsorted(tally, by_phi, by_theta), -1, 0)
    return Surface(
        phi=phis,
        theta=thetas,
        accuracy=correct / n,
        accuracy_strict=correct_decided / n,
        decision_latency_ms=steps / n * step_ms,
        undecided=undecided / n,
        ties=ties / n,
        work=_unsorted(work_sum, by_phi, by_theta) / n if work is not None else np.empty(0),
    )


def t_p(surface: Surface) -> Setting:
    """Return the fastest setting (mean decision time) among those of the best accuracy.

    Equal times: the smallest phi, then the smallest theta. Source: Eq. (5).
    """
    return _fastest(surface, surface.accuracy == surface.accuracy.max())


def t_h(surface: Surface, accuracy: float = HUMAN_ACCURACY) -> Setting | None:
    """Return the fastest setting that reaches an accuracy, or None where no setting does.

    Equal times: the smallest phi, then the smallest theta. Source: Eq. (6).
    """
    reached = surface.accuracy >= accuracy
    return _fastest(surface, reached) if reached.any() else None


def _fastest(surface: Surface, among: NDArray[np.bool_]) -> Setting:
    phi, theta = np.nonzero(among)
    times = surface.decision_latency_ms[phi, theta]
    best = np.lexsort((surface.theta[theta], surface.phi[phi], times))[0]
    where = phi[best], theta[best]
    return Setting(
        float(times[best]),
        float(surface.accuracy[where]),
        float(surface.phi[where[0]]),
        float(surface.theta[where[1]]),
    )


def _spikes(output: ArrayLike) -> Array:
    array = np.asanyarray(output)
    if array.ndim != 3 or array.dtype != np.uint8:
        raise ValueError(f"output must be (n, T, class) uint8, got shape {array.shape} of {array.dtype}")
    if 0 in array.shape:
        raise ValueError(f"output must hold at least one sample, step and class, got shape {array.shape}")
    return array


def _grid(name: str, values: ArrayLike, high: float) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"{name} must be a non-empty list of numbers, got shape {array.shape}")
    wrong = ~(np.isfinite(array) & (array >= 0) & (array <= high))
    if wrong.any():
        limits = ">= 0 and finite" if np.isinf(high) else f"in [0, {high:g}]"
        raise ValueError(f"{name} must be {limits}, got {array[wrong][0]:g}")
    return array


def _unsorted(values: Array, by_phi: Array, by_theta: Array) -> Array:
    result = np.empty_like(values)
    result[np.ix_(by_phi, by_theta)] = values
    return result


@njit(cache=True)
def _tally(output: Any, target: Any, phi: Any, theta: Any, work: Any, tally: Any, work_sum: Any) -> None:
    """Add the samples' decisions to `tally` (phi, theta, 5) and their work to `work_sum` (phi, theta, m).

    Tallied: correct, correct and decided, steps taken, undecided, ties. phi and theta ascend.
    """
    n, n_steps, n_classes = output.shape
    counts = np.empty(n_classes, dtype=np.int64)
    when = np.empty(n_steps + 1, dtype=np.int64)  # only steps with spikes can decide
    total = np.empty(n_steps, dtype=np.int64)
    confidence = np.empty(n_steps, dtype=np.float64)
    winner = np.empty(n_steps + 1, dtype=np.int64)
    tie = np.empty(n_steps + 1, dtype=np.int64)
    reached = np.empty(theta.size, dtype=np.int64)  # decisive entry of the previous phi, per theta
    for i in range(n):
        counts[:] = 0
        spikes = 0
        n_active = 0
        for t in range(n_steps):
            before = spikes
            for k in range(n_classes):
                counts[k] += output[i, t, k]
                spikes += output[i, t, k]
            if spikes > before:
                best, equals = 0, 0
                for k in range(1, n_classes):
                    if counts[k] > counts[best]:
                        best, equals = k, 0
                    elif counts[k] == counts[best]:
                        equals = 1
                when[n_active], total[n_active] = t, spikes
                confidence[n_active] = counts[best] / spikes
                winner[n_active], tie[n_active] = best, equals
                n_active += 1
        # One entry more stands for "undecided": the last step's answer. Without spikes all classes tie at 0.
        when[n_active] = n_steps - 1
        winner[n_active] = winner[n_active - 1] if n_active > 0 else 0
        tie[n_active] = tie[n_active - 1] if n_active > 0 else int(n_classes > 1)

        enough = 0
        reached[:] = 0
        for p in range(phi.size):
            while enough < n_active and total[enough] <= phi[p]:
                enough += 1
            at = enough
            for q in range(theta.size):
                at = max(at, reached[q])
                while at < n_active and confidence[at] < theta[q]:
                    at += 1
                reached[q] = at
                correct = winner[at] == target[i]
                cell = tally[p, q]
                cell[0] += correct
                cell[1] += correct and at < n_active
                cell[2] += when[at] + 1
                cell[3] += at == n_active
                cell[4] += tie[at]
                for m in range(work.shape[2]):
                    work_sum[p, q, m] += work[i, when[at], m]
