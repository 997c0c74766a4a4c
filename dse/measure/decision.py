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

A net that was trained on long samples may answer after a shorter input: then the sample ends there. Whether
it had decided by then follows from the walk over the whole sample: one walk serves all lengths (`early`).

Source: Brayshaw et al., real-time texture classification, Eqs. (1)-(6) (REFERENCES.md).
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dse.base.native.compiled import compiled
from dse.base.records import Array, DecisionSurface

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
    counts, total, confidence = _so_far(spikes)
    admissible = (total > phi) & (confidence >= theta)
    decided = np.asarray(admissible.any(axis=1))
    step = np.where(decided, admissible.argmax(axis=1), spikes.shape[1] - 1)
    return Decisions(counts[np.arange(len(spikes)), step].argmax(axis=1), step, decided)


def surface(
    output: ArrayLike,
    target: ArrayLike,
    phi: ArrayLike,
    theta: ArrayLike,
    step_ms: float,
    work: ArrayLike | None = None,
) -> DecisionSurface:
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
    n, n_steps, _ = spikes.shape
    done = np.empty((n, n_steps, 0)) if work is None else np.asanyarray(work)
    if done.ndim != 3 or done.shape[:2] != (n, n_steps):
        raise ValueError(f"work must have shape ({n}, {n_steps}, m), got {done.shape}")
    [decisions], _ = _surfaces(spikes, target, np.array([n_steps]), phi, theta, step_ms, done)
    return decisions if work is not None else dataclasses.replace(decisions, work=np.empty(0))


def early(
    output: ArrayLike,
    target: ArrayLike,
    lengths: ArrayLike,
    phi: ArrayLike,
    theta: ArrayLike,
    step_ms: float,
) -> dict[str, NDArray[np.float64]]:
    """Return what one net is worth when its input ends after each of several lengths, (k,) per column.

    The same as `surface(output[:, :length])` for every length, exactly, in one pass over the spikes.

        time_ms                 input length
        accuracy                by argmax of the spikes so far, at its end
        accuracy_best           the highest over the grid of phi and theta
        t_p_ms, phi_p, theta_p  fastest setting of that accuracy
        t_h_ms, phi_h, theta_h  fastest that reaches the human baseline, NaN where none does
        accuracy_best_strict, t_p_strict_ms, t_h_strict_ms: where undecided samples count as wrong

    Args:
        output: (n, T, class) uint8 output spikes.
        target: (n,) true class.
        lengths: (k,) steps in 1..T, any order.
        phi: (phi,) spikes to wait for, >= 0, any order.
        theta: (theta,) confidences in [0, 1], any order.
        step_ms: duration of a step.

    Raises:
        ValueError: no samples, shapes that do not belong together, or values out of range.
    """
    spikes = _spikes(output)
    n, n_steps, _ = spikes.shape
    steps = _lengths(lengths, n_steps)
    of_lengths, accuracy = _surfaces(spikes, target, steps, phi, theta, step_ms, np.empty((n, n_steps, 0)))
    never = Setting(np.nan, np.nan, np.nan, np.nan)
    columns = {"time_ms": steps * float(step_ms), "accuracy": accuracy}
    for strict, end in ((False, ""), (True, "_strict")):
        peak = np.array([t_p(one, strict=strict) for one in of_lengths])
        human = np.array([t_h(one, strict=strict) or never for one in of_lengths])
        columns |= {
            f"accuracy_best{end}": peak[:, 1],
            f"t_p{end}_ms": peak[:, 0],
            f"t_h{end}_ms": human[:, 0],
        }
        if not strict:
            columns |= {"phi_p": peak[:, 2], "theta_p": peak[:, 3]}
            columns |= {"phi_h": human[:, 2], "theta_h": human[:, 3]}
    return columns


def early_at(
    output: ArrayLike, target: ArrayLike, lengths: ArrayLike, step_ms: float, settings: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean decision time and accuracy after each of several input lengths, at a setting of each, (k,).

    Only the settings themselves are evaluated, not the grid that they were chosen from.

    Args:
        output: (n, T, class) uint8 output spikes of other samples than chose the settings.
        target: (n,) their true class.
        lengths: (k,) steps in 1..T, any order.
        step_ms: duration of a step.
        settings: (k, 2) phi and theta of each length; NaN where there is none, and then in the result.
    """
    spikes, chosen = _spikes(output), np.asarray(settings, np.float64)
    steps = _lengths(lengths, spikes.shape[1])
    times_ms, accuracies = np.full((2, len(steps)), np.nan)
    there = np.flatnonzero(~np.isnan(chosen).any(axis=1))
    if there.size:
        phi, theta = (np.unique(values) for values in chosen[there].T)
        no_work = np.empty((*spikes.shape[:2], 0))
        of_lengths, _ = _surfaces(spikes, target, steps[there], phi, theta, step_ms, no_work)
        for k, one in zip(there, of_lengths, strict=True):
            times_ms[k], accuracies[k], *_ = at(one, Setting(np.nan, np.nan, *chosen[k]))
    return times_ms, accuracies


def t_p(surface: DecisionSurface, *, strict: bool = False) -> Setting:
    """Return the fastest setting (mean decision time) among those of the best accuracy.

    Equal times: the smallest phi, then the smallest theta. `strict`: undecided samples count as wrong; their
    time is that of the last step all the same. Source: Eq. (5).
    """
    accuracy = surface.accuracy_strict if strict else surface.accuracy
    return _fastest(surface, accuracy, accuracy == accuracy.max())


def t_h(
    surface: DecisionSurface, accuracy: float = HUMAN_ACCURACY, *, strict: bool = False
) -> Setting | None:
    """Return the fastest setting that reaches an accuracy, or None where no setting does.

    Equal times: the smallest phi, then the smallest theta. `strict` as in `t_p`. Source: Eq. (6).
    """
    accuracies = surface.accuracy_strict if strict else surface.accuracy
    reached = accuracies >= accuracy
    return _fastest(surface, accuracies, reached) if reached.any() else None


def at(surface: DecisionSurface, setting: Setting) -> Setting:
    """Return the decision time and the accuracy of a surface at the phi and theta of a setting.

    Args:
        surface: of the same grid as the setting, such as that of the test set.
        setting: chosen on another set, such as validation.
    """
    return _setting(surface, surface.accuracy, _place(surface, setting))


def on_border(surface: DecisionSurface, setting: Setting, n_classes: int) -> bool:
    """Return whether a setting lies on an end of the grid, beyond which samples would decide otherwise.

    A larger phi or theta decides otherwise if some sample is decided at the largest one; a smaller theta only
    down to 1 / classes, which every sample reaches. A grid of one value has no ends.
    """
    decides = bool(surface.undecided[_place(surface, setting)] < 1)
    phi, theta = surface.phi, surface.theta
    phi_low, phi_high = setting.phi == phi.min() > 0, setting.phi == phi.max() and decides
    theta_low = setting.theta == theta.min() > 1 / n_classes
    theta_high = setting.theta == theta.max() < 1 and decides
    return bool((len(phi) > 1 and (phi_low or phi_high)) or (len(theta) > 1 and (theta_low or theta_high)))


def t_c(time_ms: ArrayLike, accuracy: ArrayLike, within: float = 0.1) -> float:
    """Return the shortest input length whose accuracy is within a share of the peak: >= (1 - within) peak.

    The share is of the peak, not points of accuracy: the source says "within 10% of its peak value". Accuracy
    need not rise with length, and may fall below again after t_c. NaN accuracies count as not reached;
    without any number t_c is NaN. Accuracies that equal the bound but for rounding reach it.

    Source: Brayshaw et al., temporal and spatio-temporal domains, t_C (REFERENCES.md).

    Args:
        time_ms: (k,) input lengths, any order.
        accuracy: (k,) accuracy after each.
        within: share of the peak that may be missing, in [0, 1).

    Raises:
        ValueError: different lengths, or `within` out of range.
    """
    times, accuracies = np.asarray(time_ms, dtype=np.float64), np.asarray(accuracy, dtype=np.float64)
    if times.ndim != 1 or times.shape != accuracies.shape:
        raise ValueError(f"time_ms and accuracy must both be (k,), got {times.shape} and {accuracies.shape}")
    if not 0 <= within < 1:
        raise ValueError(f"within must be in [0, 1), got {within:g}")
    known = ~np.isnan(accuracies)
    if not known.any():
        return float("nan")
    bound = (1 - within) * accuracies[known].max()
    return float(times[known][accuracies[known] >= bound - 1e-12].min())


def _fastest(surface: DecisionSurface, accuracy: Array, among: NDArray[np.bool_]) -> Setting:
    phi, theta = np.nonzero(among)
    times = surface.decision_latency_ms[phi, theta]
    best = np.lexsort((surface.theta[theta], surface.phi[phi], times))[0]
    return _setting(surface, accuracy, (int(phi[best]), int(theta[best])))


def _setting(surface: DecisionSurface, accuracy: Array, place: tuple[int, int]) -> Setting:
    return Setting(
        float(surface.decision_latency_ms[place]),
        float(accuracy[place]),
        float(surface.phi[place[0]]),
        float(surface.theta[place[1]]),
    )


def _place(surface: DecisionSurface, setting: Setting) -> tuple[int, int]:
    """Return where a setting stands in the grid of a surface."""
    [phi], [theta] = np.nonzero(surface.phi == setting.phi), np.nonzero(surface.theta == setting.theta)
    return int(phi[0]), int(theta[0])


def _surfaces(
    spikes: Array,
    target: ArrayLike,
    lengths: Array,
    phi: ArrayLike,
    theta: ArrayLike,
    step_ms: float,
    work: Array,
) -> tuple[list[DecisionSurface], NDArray[np.float64]]:
    """Return the surface of every input length, and its accuracy by argmax at the end, (k,)."""
    n, _, n_classes = spikes.shape
    labels = np.asarray(target)
    if labels.shape != (n,) or labels.dtype.kind not in "iu":
        raise ValueError(f"target must be ({n},) integers, got {labels.shape} of {labels.dtype}")
    if labels.min() < 0 or labels.max() >= n_classes:
        raise ValueError(f"target must be in 0..{n_classes - 1}, got {labels.min()}..{labels.max()}")
    if not step_ms > 0:
        raise ValueError(f"step_ms must be > 0, got {step_ms}")
    phis, thetas = _grid("phi", phi, np.inf), _grid("theta", theta, 1.0)

    # The kernel walks ascending grids; the results go back to the caller's order.
    by_length, by_phi, by_theta = (np.argsort(x, kind="stable") for x in (lengths, phis, thetas))
    shape = (len(lengths), len(phis), len(thetas))
    tally = np.zeros((*shape, 5), dtype=np.int64)
    work_sum = np.zeros((*shape, work.shape[2]))
    at_end = np.zeros(len(lengths), dtype=np.int64)
    for start in range(0, n, _CHUNK):
        part = slice(start, start + _CHUNK)
        _tally(
            np.ascontiguousarray(spikes[part]),
            labels[part].astype(np.int64),
            lengths[by_length].astype(np.int64),
            phis[by_phi],
            thetas[by_theta],
            np.ascontiguousarray(work[part], dtype=np.float64),
            tally,
            work_sum,
            at_end,
        )
    sorted_axes = np.ix_(by_length, by_phi, by_theta)
    tallied, worked, ends = np.empty_like(tally), np.empty_like(work_sum), np.empty_like(at_end)
    tallied[sorted_axes], worked[sorted_axes], ends[by_length] = tally, work_sum, at_end
    surfaces = []
    for counts, done in zip(tallied, worked, strict=True):
        correct, correct_decided, steps, undecided, ties = np.moveaxis(counts, -1, 0)
        surfaces.append(
            DecisionSurface(
                phi=phis,
                theta=thetas,
                accuracy=correct / n,
                accuracy_strict=correct_decided / n,
                decision_latency_ms=steps / n * step_ms,
                undecided=undecided / n,
                ties=ties / n,
                work=done / n,
            )
        )
    return surfaces, ends / n


def _so_far(spikes: Array) -> tuple[Array, Array, Array]:
    """Return S_n (n, T, class), S_T and c (n, T) after each step."""
    counts = spikes.cumsum(axis=1, dtype=np.int64)
    total = counts.sum(axis=2)
    return counts, total, counts.max(axis=2) / np.maximum(total, 1)


def _spikes(output: ArrayLike) -> Array:
    array = np.asanyarray(output)
    if array.ndim != 3 or array.dtype != np.uint8:
        raise ValueError(f"output must be (n, T, class) uint8, got shape {array.shape} of {array.dtype}")
    if 0 in array.shape:
        raise ValueError(f"output must hold at least one sample, step and class, got shape {array.shape}")
    return array


def _lengths(lengths: ArrayLike, n_steps: int) -> Array:
    steps = np.asarray(lengths)
    if steps.ndim != 1 or steps.size == 0 or steps.dtype.kind not in "iu":
        raise ValueError(f"lengths must be a non-empty list of integers, got {steps.shape} of {steps.dtype}")
    wrong = (steps < 1) | (steps > n_steps)
    if wrong.any():
        raise ValueError(f"lengths must be in 1..{n_steps}, got {steps[wrong][0]}")
    return steps


def _grid(name: str, values: ArrayLike, high: float) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"{name} must be a non-empty list of numbers, got shape {array.shape}")
    wrong = ~(np.isfinite(array) & (array >= 0) & (array <= high))
    if wrong.any():
        limits = ">= 0 and finite" if np.isinf(high) else f"in [0, {high:g}]"
        raise ValueError(f"{name} must be {limits}, got {array[wrong][0]:g}")
    return array


@compiled()
def _tally(
    output: Any,
    target: Any,
    lengths: Any,
    phi: Any,
    theta: Any,
    work: Any,
    tally: Any,
    work_sum: Any,
    at_end: Any,
) -> None:
    """Add the decisions to `tally` (k, phi, theta, 5) and their work to `work_sum` (k, phi, theta, m).

    Tallied: correct, correct and decided, steps taken, undecided, ties. `at_end` (k,): correct at the end of
    each length. lengths, phi and theta ascend.
    """
    n, n_steps, n_classes = output.shape
    counts = np.empty(n_classes, dtype=np.int64)
    when = np.empty(n_steps, dtype=np.int64)  # only steps with spikes can decide
    total = np.empty(n_steps, dtype=np.int64)
    confidence = np.empty(n_steps, dtype=np.float64)
    winner = np.empty(n_steps, dtype=np.int64)
    tie = np.empty(n_steps, dtype=np.int64)
    seen = np.empty(lengths.size, dtype=np.int64)  # entries of `when` within each length
    end_winner = np.empty(lengths.size, dtype=np.int64)
    end_tie = np.empty(lengths.size, dtype=np.int64)
    reached = np.empty(theta.size, dtype=np.int64)  # decisive entry of the previous phi, per theta
    for i in range(n):
        counts[:] = 0
        spikes = 0
        n_active = 0
        for t in range(lengths[-1]):
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

        # What an undecided sample answers at the end of each length. Without spikes all classes tie at 0.
        entry = 0
        for j in range(lengths.size):
            while entry < n_active and when[entry] < lengths[j]:
                entry += 1
            seen[j] = entry
            end_winner[j] = winner[entry - 1] if entry > 0 else 0
            end_tie[j] = tie[entry - 1] if entry > 0 else int(n_classes > 1)
            at_end[j] += end_winner[j] == target[i]

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
                for j in range(lengths.size):
                    cell = tally[j, p, q]
                    if at < seen[j]:
                        step = when[at]
                        cell[0] += winner[at] == target[i]
                        cell[1] += winner[at] == target[i]
                        cell[4] += tie[at]
                    else:
                        step = lengths[j] - 1
                        cell[0] += end_winner[j] == target[i]
                        cell[3] += 1
                        cell[4] += end_tie[j]
                    cell[2] += step + 1
                    for m in range(work.shape[2]):
                        work_sum[j, p, q, m] += work[i, step, m]


def right_at(output: ArrayLike, target: ArrayLike, phi: ArrayLike, theta: ArrayLike) -> NDArray[np.bool_]:
    """Return whether each sample is answered correctly at each phi and theta, (n, phi, theta).

    Their means over samples are the accuracies of `surface`.

    Args:
        output: (n, T, class) uint8 output spikes.
        target: (n,) true class.
        phi: (phi,) spikes to wait for, >= 0, any order.
        theta: (theta,) confidences in [0, 1], any order.

    Raises:
        ValueError: as of `surface`.
    """
    spikes, labels = _spikes(output), np.asarray(target)
    phis, thetas = _grid("phi", phi, np.inf), _grid("theta", theta, 1.0)
    right = np.empty((len(spikes), len(phis), len(thetas)), dtype=np.bool_)
    for first in range(0, len(spikes), _CHUNK):
        part = slice(first, first + _CHUNK)
        right[part] = _right_at(spikes[part], labels[part], phis, thetas)
    return right


def _right_at(spikes: Array, target: Array, phi: Array, theta: Array) -> NDArray[np.bool_]:
    """Return `right_at` of some samples: O((phi + theta) T class) of each, in plain NumPy."""
    n, n_steps, _ = spikes.shape
    counts, total, confidence = _so_far(spikes)
    # Whether an answer at each step is right; step T stands for undecided samples, which answer at the last.
    answered = np.pad(counts.argmax(axis=2) == target[:, None], ((0, 0), (0, 1)), mode="edge")
    enough = np.stack([(total <= value).sum(axis=1) for value in phi], axis=1)  # the first step, or T
    right = np.empty((n, len(phi), len(theta)), dtype=np.bool_)
    for q, value in enumerate(theta):
        sure = np.full((n, n_steps + 1), n_steps)
        sure[:, :-1][confidence >= value] = np.nonzero(confidence >= value)[1]
        sure = np.minimum.accumulate(sure[:, ::-1], axis=1)[:, ::-1]  # the next sure step from each on
        step = np.take_along_axis(sure, enough, axis=1)
        right[:, :, q] = np.take_along_axis(answered, step, axis=1)
    return right
