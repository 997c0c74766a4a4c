"""The contract of a kind of hardware."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dse.base.records import Floats, Operations, Workload
from dse.measure.hardware.cost import NotApplicable, cost, drawn
from dse.measure.hardware.profile import Profile
from dse.testing.expect import expect, same

_GROWTH = 3.0


def check_chip_kind(profile: Profile) -> None:
    """Check the kind of a profile: costs linear in the counts, never below zero, never falling.

    Args:
        profile: numbers of a chip of the kind.

    Raises:
        AssertionError: what it violates.
    """
    name = type(profile).__name__
    is_frozen = getattr(profile, "__dataclass_params__").frozen  # noqa: B009
    expect(is_frozen, f"{name} must be a frozen dataclass")
    expect(profile.numbers(), f"{name} must declare its numbers with `figure`")
    for key, figure in profile.numbers().items():
        expect(figure.doc, f"number {name}.{key} must say what it means")
    n_run = 0
    for load in (_network(), _operations()):
        try:
            plan = profile.plan(load, profile.ends)
        except NotApplicable:
            continue
        n_run += 1
        n_counts = profile.counts(load).shape[-1]
        for cause, per_count in plan.energy_pj.items():
            expect(
                per_count.shape == (3, n_counts),
                f"{name}: energy of {cause} must be per count, (3, {n_counts}), got {per_count.shape}",
            )
            expect((per_count >= 0).all(), f"{name}: energy of {cause} must be >= 0 per count")
        expect((plan.time_ns >= 0).all(), f"{name}: time must be >= 0 per count")
        expect((plan.static_mw >= 0).all() and (plan.idle_mw >= 0).all(), f"{name}: power must be >= 0")
        _check_costs(name, profile, load)
    expect(n_run, f"{name} must run networks of spiking layers or counted operations")


def _check_costs(name: str, profile: Profile, load: Workload | Operations) -> None:
    once = cost(profile, load)
    expect(
        same(once.energy_uj.value, cost(profile, load).energy_uj.value), f"{name} must cost the same twice"
    )
    grown = _grown(load)
    more = cost(profile, grown)
    linear = np.allclose(more.dynamic_uj, _GROWTH * np.asarray(once.dynamic_uj), rtol=1e-9, equal_nan=True)
    expect(linear, f"{name}: dynamic energy must be linear in what happens")
    for what, less, larger in (
        ("energy_uj", once.energy_uj.high, more.energy_uj.high),
        ("hardware_latency_ms", once.hardware_latency_ms, more.hardware_latency_ms),
    ):
        expect(not _largest(less) < 0, f"{name}: {what} must be >= 0")
        expect(not _largest(larger) < _largest(less), f"{name}: {what} must not fall when more happens")
    expect(
        _largest(once.energy_uj.low) <= _largest(once.energy_uj.high),
        f"{name}: the low end must not exceed the high",
    )
    samples = drawn(profile, load, profile.drawn(8, np.random.default_rng(1))).energy_uj
    expect(
        samples.shape == (8, *np.shape(once.energy_uj.value)),
        f"{name} must cost every sample of its numbers, got {samples.shape}",
    )


def _largest(values: Floats | float) -> float:
    """Return the largest value; NaN, which a profile of intervals has, is neither below nor above."""
    return float(np.asarray(values, np.float64).max())


def _network() -> Workload:
    return Workload(
        sizes=(12, 8, 3),
        recurrent=(False, False),
        n_steps=np.array([20.0]),
        spikes=np.array([[40.0, 25.0, 6.0]]),
        updates=np.array([[100.0, 30.0]]),
        step_ms=5.0,
    )


def _operations() -> Operations:
    return Operations(
        macs=np.array([500.0]),
        additions=np.array([80.0]),
        updates=np.array([0.0]),
        n_weights=np.array([300.0]),
        duration_ms=np.array([100.0]),
    )


def _grown(load: Workload | Operations) -> Workload | Operations:
    """Return a multiple of everything that happens; what is stored, and the clock, stay."""
    more: Workload | Operations = load.mapped(lambda counts: counts * _GROWTH)
    if isinstance(load, Operations) and isinstance(more, Operations):
        return replace(more, n_weights=load.n_weights, duration_ms=load.duration_ms)
    return more
