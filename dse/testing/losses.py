"""The contract of a loss."""

from __future__ import annotations

import numpy as np

from dse.base.records import Floats, Ints
from dse.engine.goal import Goal
from dse.engine.losses import Loss
from dse.testing.expect import expect, expect_component, pure

_STEP = 1e-5


def check_loss(loss: Loss) -> None:
    """Check a loss: lengths that end with the input, a gradient that is its slope, samples that add up.

    Raises:
        AssertionError: what it violates.
    """
    name = expect_component(loss)
    expect(hash(loss) is not None, f"{name} must be hashable")
    for n_steps in (1, 2, 40):
        lengths = loss.lengths(n_steps)
        expect(
            lengths and list(lengths) == sorted(set(lengths)) and lengths[0] >= 1 and lengths[-1] == n_steps,
            f"{name}.lengths({n_steps}) must rise from at least 1 to {n_steps}, got {lengths}",
        )
    rng = np.random.default_rng(5)
    for heads in ((4,), (3, 2)):
        labels = np.stack([sum(heads[:k]) + rng.integers(0, n, 3) for k, n in enumerate(heads)], axis=1)
        goal = Goal(loss, 0.7, 0.1, heads)
        counts = np.cumsum(rng.integers(0, 9, (3, len(loss.lengths(40)), sum(heads))), axis=1)
        _check_gradient(name, goal, counts.astype(np.float64), labels)
        for extreme in (0, 10**6):
            value, by_count = loss.gradient(
                np.full_like(counts, extreme), goal.outputs(labels, 40, sum(heads))
            )
            finite = np.isfinite(value) and np.isfinite(by_count).all()
            expect(finite, f"{name} must be finite where every output has fired {extreme} times")


def _check_gradient(name: str, goal: Goal, counts: Floats, labels: Ints) -> None:
    loss, outputs = goal.loss, goal.outputs(labels, 40, counts.shape[-1])
    value, by_count = pure(f"{name}.gradient", loss.gradient, counts, outputs)
    expect(by_count.shape == counts.shape, f"{name}.gradient must have the shape of the counts")
    defined = float(loss.value(counts, outputs))
    is_first = np.isclose(float(value), defined, rtol=1e-9, atol=1e-12)
    expect(is_first, f"{name}.gradient must return its value first")
    slopes = np.zeros_like(counts)
    for at in np.ndindex(*counts.shape):
        ends = []
        for step in (_STEP, -_STEP):
            moved = counts.copy()
            moved[at] += step
            ends.append(float(loss.value(moved, outputs)))
        slopes[at] = (ends[0] - ends[1]) / (2 * _STEP)
    error = np.abs(slopes - by_count).max()
    expect(
        error <= 1e-5 * max(1.0, np.abs(slopes).max()),
        f"{name}.gradient must be the slope of its value, differs by {error:.1e}",
    )
    alone = sum(
        float(loss.value(counts[n : n + 1], goal.outputs(labels[n : n + 1], 40, counts.shape[-1])))
        for n in range(len(counts))
    )
    expect(np.isclose(alone, defined, rtol=1e-9), f"{name} must be a sum over samples")
