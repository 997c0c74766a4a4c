"""Energy, time and cores of an inference: a profile's plan of the architecture times the counts.

Every figure has a range; the interval of a cost is the cost at all low ends to that at all high ends (costs
grow with each figure), so it is wider than independent errors would give. `drawn` draws the figures.

    energy, flat out      = dynamic + static power x computing time
    energy, throttled     = dynamic + static power x computing time + idle power x waiting time
    waiting time          = steps x step period - computing time, where that is positive

Computing flat out needs all input at once; throttled is what a sensor that delivers a step per period costs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dse.hardware.plan import Misfit, NotApplicable, Placement, Plan, Values, features
from dse.hardware.profile import Figures, Profile
from dse.records import Operations, Workload

__all__ = ["Cost", "Drawn", "NotApplicable", "cost", "cost_of_steps", "drawn"]


_BLOCK = 2**19
"""Times that are held at once: a million points times their candidates would not fit a cache."""


@dataclass(frozen=True)
class Cost:
    """Cost per inference; arrays have the leading axes of the load.

    dynamic_uj: energy of what happens.
    static_uj: static energy of the whole chip, computing flat out, with its interval.
    static_throttled_uj: the same at the sensor's step period (or the computing time, if longer); what
        computes slower waits less, so the ends of its interval need not be those of the sum's.
    energy_uj: dynamic_uj + static_uj, with its interval; NaN where the profile gives intervals only.
    energy_throttled_uj: dynamic_uj + static_throttled_uj, in the same way.
    step_time_us: mean time to compute a step, with its interval; of other classifiers, the time of an answer.
    hardware_latency_ms: time to compute all steps flat out.
    pipeline_ms: time that the last answer still takes through the layers, at the step period.
    idle_mw: power while nothing is to be done.
    n_cores, n_cores_low, n_cores_high: cores in use, and what practice may take.
    fits, misfits: whether every limit is met, and which are not.
    assumptions: what the cores rest on.
    breakdown: dynamic energy by cause, in uJ; adds up to dynamic_uj.
    timed: False of counted operations: energies only.
    """

    dynamic_uj: Values
    static_uj: Values
    static_uj_low: Values
    static_uj_high: Values
    static_throttled_uj: Values
    static_throttled_uj_low: Values
    static_throttled_uj_high: Values
    energy_uj: Values
    energy_uj_low: Values
    energy_uj_high: Values
    energy_throttled_uj: Values
    energy_throttled_uj_low: Values
    energy_throttled_uj_high: Values
    step_time_us: Values
    step_time_us_low: Values
    step_time_us_high: Values
    hardware_latency_ms: Values
    pipeline_ms: Values
    idle_mw: float
    n_cores: int
    n_cores_low: int
    n_cores_high: int
    fits: bool
    misfits: tuple[Misfit, ...]
    assumptions: tuple[str, ...]
    breakdown: Mapping[str, Values]
    timed: bool


def cost(profile: Profile, load: Workload | Operations) -> Cost:
    """Return what an inference costs.

    Raises:
        NotApplicable: the chip cannot run such a classifier.
        ValueError: counts that are negative or not finite, or shapes that do not belong together.
    """
    counts = features(_checked(load))
    plan = profile.plan(load, profile.ends)
    time_us = _time_us(plan, counts, load)
    return _cost(profile, plan, load, counts, time_us, _waiting_us(load, time_us))


def cost_of_steps(profile: Profile, load: Workload) -> Cost:
    """Return what an inference costs, from counts of each of its steps.

    A step takes as long as its slowest core, so the mean over steps of the slowest is exact where `cost` has
    the slowest of the means.

    Args:
        profile: the chip.
        load: spikes (..., step, layer), updates (..., step, layer - 1) and n_steps (..., step), all 1.
    """
    counts = features(_checked(load))
    plan = profile.plan(load, profile.ends)
    time_us = _time_us(plan, counts, load)
    waiting_us = _waiting_us(load, time_us)
    whole = replace(
        load,
        n_steps=np.asarray(load.n_steps).sum(axis=-1),
        spikes=np.asarray(load.spikes).sum(axis=-2),
        updates=None if load.updates is None else np.asarray(load.updates).sum(axis=-2),
    )
    return _cost(profile, plan, whole, counts.sum(axis=-2), time_us.sum(axis=-1), waiting_us.sum(axis=-1))


@dataclass(frozen=True)
class Drawn:
    """Costs per inference under D draws of a chip's figures, (D, ...) each; named as in `Cost`."""

    energy_uj: Values
    energy_throttled_uj: Values
    step_time_us: Values
    hardware_latency_ms: Values


def drawn(profile: Profile, load: Workload | Operations, figures: Figures) -> Drawn:
    """Return what an inference costs under draws of the profile's figures.

    Args:
        profile: the chip.
        load: counts (...).
        figures: `profile.drawn`, the same for all loads that are to be compared.

    Raises:
        NotApplicable, ValueError: as `cost`.
    """
    counts = features(_checked(load))
    plan = profile.plan(load, figures)
    time_us = _time_us(plan, counts, load)
    static, waiting = _static_uj(plan, time_us, _waiting_us(load, time_us))
    energy = _energy_uj(plan, counts) + static
    return Drawn(energy, energy + waiting, _step_us(load, time_us), time_us * 1e-3)


def _cost(
    profile: Profile,
    plan: Plan,
    load: Workload | Operations,
    counts: Values,
    time_us: Values,
    waiting_us: Values,
) -> Cost:
    """Return the cost from a plan at the ends of all figures, and the times at each, (3, ...)."""
    dynamic = _energy_uj(plan, counts)
    static, waiting = _static_uj(plan, time_us, waiting_us)
    flat_out = dynamic + static
    at_period = flat_out + waiting
    throttled_low, throttled_high = _throttled_range_uj(plan, time_us, waiting_us)
    step_us = _step_us(load, time_us)
    pipeline_us = np.zeros_like(step_us[0])
    if isinstance(load, Workload):
        pipeline_us = load.pipeline_steps * np.maximum(load.step_ms * 1e3, step_us[0])
    placement = plan.placement
    n_cores = placement.n_cores if placement else 0
    causes = [np.asarray(counts @ per_count[0] * 1e-6) for per_count in plan.energy_pj.values()]

    def value(x: Values) -> Values:
        return np.full_like(x, np.nan) if profile.interval_only else np.asarray(x)

    return Cost(
        dynamic_uj=value(dynamic[0]),
        static_uj=value(static[0]),
        static_uj_low=static[1],
        static_uj_high=static[2],
        static_throttled_uj=value(static[0] + waiting[0]),
        static_throttled_uj_low=throttled_low,
        static_throttled_uj_high=throttled_high,
        energy_uj=value(flat_out[0]),
        energy_uj_low=flat_out[1],
        energy_uj_high=flat_out[2],
        energy_throttled_uj=value(at_period[0]),
        energy_throttled_uj_low=at_period[1],
        energy_throttled_uj_high=at_period[2],
        step_time_us=value(step_us[0]),
        step_time_us_low=step_us[1],
        step_time_us_high=step_us[2],
        hardware_latency_ms=value(time_us[0] * 1e-3),
        pipeline_ms=value(pipeline_us * 1e-3),
        idle_mw=float(plan.idle_mw[0]),
        n_cores=n_cores,
        n_cores_low=(placement.low if placement else None) or n_cores,
        n_cores_high=(placement.high if placement else None) or n_cores,
        fits=not (placement and placement.misfits),
        misfits=placement.misfits if placement else (),
        assumptions=_assumptions(placement, load),
        breakdown={name: value(cause) for name, cause in zip(plan.energy_pj, causes, strict=True)},
        timed=placement is not None,
    )


def _assumptions(placement: Placement | None, load: Workload | Operations) -> tuple[str, ...]:
    if placement is None:
        return ()
    if isinstance(load, Operations) or load.cores in (None, placement.cores):
        return placement.assumptions
    return (*placement.assumptions, "the number of cores set by the user does not matter on such a chip")


def _energy_uj(plan: Plan, counts: Values) -> Values:
    """Return the dynamic energy (D, ...)."""
    total = np.asarray(sum(plan.energy_pj.values())) * 1e-6
    flat = counts.reshape(-1, counts.shape[-1])
    return (total @ flat.T).reshape(len(total), *counts.shape[:-1])


def _time_us(plan: Plan, counts: Values, load: Workload | Operations) -> Values:
    """Return the time to compute (D, ...): what is slowest, and queues where the network is congested."""
    n_draws, n_candidates, n_features = plan.time_ns.shape
    flat = counts.reshape(-1, n_features)
    per_count = plan.time_ns.reshape(-1, n_features) * 1e-3
    slowest = np.empty((n_draws, len(flat)))
    block = max(1, _BLOCK // (n_draws * n_candidates))
    for start in range(0, len(flat), block):
        candidates = (per_count @ flat[start : start + block].T).reshape(n_draws, n_candidates, -1)
        slowest[:, start : start + block] = candidates.max(axis=1)
    time_us = slowest.reshape(n_draws, *counts.shape[:-1])
    if plan.congestion is not None and isinstance(load, Workload) and plan.congestion.layers.any():
        spikes = counts[..., 1 : 1 + len(load.sizes)][..., plan.congestion.layers]
        crowded = (spikes > plan.congestion.spikes * counts[..., :1]).any(axis=-1)
        for draw, factor in enumerate(plan.congestion.factor):
            time_us[draw] *= np.where(crowded, factor, 1.0)
    return time_us


def _step_us(load: Workload | Operations, time_us: Values) -> Values:
    """Return the mean time of a step, (D, ...): 0 without steps; other classifiers compute all at once."""
    if isinstance(load, Operations):
        return time_us
    steps = np.asarray(load.n_steps, np.float64)
    return np.divide(time_us, steps, out=np.zeros_like(time_us), where=steps > 0)


def _waiting_us(load: Workload | Operations, time_us: Values) -> Values:
    """Return how long hardware waits for the sensor to deliver the input, (D, ...)."""
    period_ms = load.duration_ms if isinstance(load, Operations) else np.asarray(load.n_steps) * load.step_ms
    return np.maximum(np.asarray(period_ms, np.float64) * 1e3 - time_us, 0.0)


def _static_uj(plan: Plan, time_us: Values, waiting_us: Values) -> tuple[Values, Values]:
    """Return the static energy of computing and of waiting, (D, ...) each; mW x us = nJ."""
    lead = (slice(None), *[None] * (time_us.ndim - 1))
    return plan.static_mw[lead] * time_us * 1e-3, plan.idle_mw[lead] * waiting_us * 1e-3


def _throttled_range_uj(plan: Plan, time_us: Values, waiting_us: Values) -> tuple[Values, Values]:
    """Return the least and the most static energy at the step period, from powers and times at their ends."""
    powers = list(zip(plan.static_mw * 1e-3, plan.idle_mw * 1e-3, strict=True))
    times = list(zip(time_us, waiting_us, strict=True))
    # Where waiting is no dearer than computing, the ends belong together; else any time may go with an end.
    ordered = (plan.idle_mw <= plan.static_mw).all()
    least, most = (
        [computing * busy + idle * waits for busy, waits in (times[end : end + 1] if ordered else times)]
        for end, (computing, idle) in enumerate(powers)
        if end
    )
    return np.minimum.reduce(least), np.maximum.reduce(most)


def _checked(load: Workload | Operations) -> Workload | Operations:
    """Return the load.

    Raises:
        ValueError: what is wrong with it.
    """
    if isinstance(load, Operations):
        for name in ("macs", "additions", "updates", "n_weights", "duration_ms"):
            _check_counts(name, np.asarray(getattr(load, name), np.float64))
        if not load.number_bits >= 1:
            raise ValueError(f"number_bits must be >= 1, got {load.number_bits}")
        return load
    sizes, n_layers = load.sizes, len(load.sizes)
    if n_layers < 2 or min(sizes) < 1 or len(load.recurrent) != n_layers - 1:
        raise ValueError(
            "sizes must hold an input and at least one layer, and recurrent one value less, "
            f"got {sizes} and {load.recurrent}"
        )
    for name, given, most in (
        ("synapses", load.synapses, load.fan_out),
        ("stored", load.stored, load.dense),
    ):
        if given is not None and (
            len(given) != len(most) or not all(0 <= a <= b for a, b in zip(given, most, strict=True))
        ):
            raise ValueError(f"{name} must be between 0 and {most} layer by layer, got {given}")
    if load.cores is not None and (
        len(load.cores) != n_layers - 1
        or not all(1 <= n <= size for n, size in zip(load.cores, sizes[1:], strict=True))
    ):
        raise ValueError(f"cores must be between 1 and {sizes[1:]} layer by layer, got {load.cores}")
    n_steps = np.asarray(load.n_steps, np.float64)
    _check_counts("n_steps", n_steps)
    for name, values, shape in (
        ("spikes", load.spikes, (*n_steps.shape, n_layers)),
        ("updates", load.updates, (*n_steps.shape, n_layers - 1)),
    ):
        if values is None:
            continue
        values = np.asarray(values, np.float64)
        if values.shape != shape:
            raise ValueError(f"{name} must be {shape} like n_steps and sizes, got {values.shape}")
        _check_counts(name, values)
        if (values[n_steps == 0] > 0).any():
            raise ValueError(f"{name} must be 0 where n_steps is 0")
    if not (load.step_ms > 0 and np.isfinite(load.step_ms)):
        raise ValueError(f"step_ms must be > 0, got {load.step_ms}")
    for name in ("weight_bits", "delay_bits", "pipeline_steps"):
        least = 1 if name == "weight_bits" else 0
        if getattr(load, name) < least:
            raise ValueError(f"{name} must be >= {least}, got {getattr(load, name)}")
    return load


def _check_counts(name: str, values: NDArray[np.float64]) -> None:
    if not (np.isfinite(values) & (values >= 0)).all():
        raise ValueError(f"{name} must be finite and >= 0")
