"""Energy, time and cores of an inference: a profile's plan of the architecture times the counts.

Every figure has a range; the interval of a cost is the cost at all low ends to that at all high ends (costs
grow with each figure), so it is wider than independent errors would give. `drawn` samples the figures.

    energy, flat out      = dynamic + static power x computing time
    energy, throttled     = dynamic + static power x computing time + idle power x waiting time
    waiting time          = steps x step period - computing time, where that is positive

Computing flat out needs all input at once; throttled is what a sensor that delivers a step per period costs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats, Operations, Workload, sum_of_products
from dse.measure.hardware.interval import Interval
from dse.measure.hardware.plan import Misfit, NotApplicable, Placement, Plan
from dse.measure.hardware.profile import Figures, Profile

__all__ = ["Cost", "Drawn", "NotApplicable", "cost", "cost_of_steps", "drawn"]


_BLOCK = 2**19
"""Times that are held at once: a million points times their candidates would not fit a cache."""


@dataclass(frozen=True)
class Cost:
    """Cost per inference; arrays have the leading axes of the load.

    Of an interval, the value is NaN where the profile gives intervals only.

    dynamic_uj: energy of what happens, a value alone as its terms are.
    static_uj: static energy of the whole chip, computing flat out.
    static_throttled_uj: the same at the sensor's step period (or the computing time, if longer); what
        computes slower waits less, so the ends of its interval need not be those of the sum's.
    energy_uj: dynamic + static energy.
    energy_throttled_uj: dynamic + throttled static energy.
    step_time_us: mean time to compute a step; of other classifiers, the time of an answer.
    hardware_latency_ms: time to compute all steps flat out.
    pipeline_ms: time that the last answer still takes through the layers, at the step period.
    idle_mw: power while nothing is to be done.
    power_idle_w: the same with its range; the value is NaN where it is unknown.
    power_w: mean power while computing flat out; NaN where nothing is computed.
    n_cores: cores in use, and what practice may take.
    misfits: every limit that is broken.
    assumptions: what the cores rest on.
    breakdown: dynamic energy by cause, in uJ; adds up to dynamic_uj.
    timed: False of counted operations: energies only.
    """

    dynamic_uj: Floats
    static_uj: Interval[Floats]
    static_throttled_uj: Interval[Floats]
    energy_uj: Interval[Floats]
    energy_throttled_uj: Interval[Floats]
    step_time_us: Interval[Floats]
    hardware_latency_ms: Floats
    pipeline_ms: Floats
    idle_mw: float
    power_idle_w: Interval[float]
    power_w: Interval[Floats]
    n_cores: Interval[int]
    misfits: tuple[Misfit, ...]
    assumptions: tuple[str, ...]
    breakdown: Mapping[str, Floats]
    timed: bool

    @property
    def fits(self) -> bool:
        """Whether every limit is met."""
        return not self.misfits


def cost(profile: Profile, load: Workload | Operations) -> Cost:
    """Return what an inference costs.

    Raises:
        NotApplicable: the chip cannot run such a classifier.
        ValueError: counts that are negative or not finite, or shapes that do not belong together.
    """
    plan, counts, time_us, waiting_us = _timed(profile, load, profile.ends)
    return _cost(profile, plan, load, counts, time_us, waiting_us)


def cost_of_steps(profile: Profile, load: Workload) -> Cost:
    """Return what an inference costs, from counts of each of its steps.

    A step takes as long as its slowest core, so the mean over steps of the slowest is exact where `cost` has
    the slowest of the means.

    Args:
        profile: the chip.
        load: spikes (..., step, layer), updates (..., step, layer - 1) and n_steps (..., step), all 1.
    """
    plan, counts, *of_steps = _timed(profile, load, profile.ends)
    time_us, waiting_us = (us.sum(axis=-1) for us in of_steps)
    return _cost(profile, plan, load.over_steps(), counts.sum(axis=-2), time_us, waiting_us)


@dataclass(frozen=True)
class Drawn:
    """Costs per inference under D draws of a chip's figures, (D, ...) each; named as in `Cost`."""

    energy_uj: Floats
    energy_throttled_uj: Floats
    step_time_us: Floats
    hardware_latency_ms: Floats


def drawn(profile: Profile, load: Workload | Operations, figures: Figures) -> Drawn:
    """Return what an inference costs under draws of the profile's figures.

    Args:
        profile: the chip.
        load: counts (...).
        figures: `profile.drawn`, the same for all loads that are to be compared.

    Raises:
        NotApplicable, ValueError: as `cost`.
    """
    plan, counts, time_us, waiting_us = _timed(profile, load, figures)
    static, waiting = _static_uj(plan, time_us, waiting_us)
    energy = _energy_uj(plan, counts) + static
    return Drawn(energy, energy + waiting, load.step_us(time_us), time_us * 1e-3)


def _timed(
    profile: Profile, load: Workload | Operations, figures: Figures
) -> tuple[Plan, Floats, Floats, Floats]:
    """Return the plan of a load, its counts, and the times to compute and to wait for input, (D, ...)."""
    load.check()
    plan, counts = profile.plan(load, figures), profile.counts(load)
    time_us = _time_us(plan, counts)
    return plan, counts, time_us, np.maximum(np.asarray(load.input_ms, np.float64) * 1e3 - time_us, 0.0)


def _cost(
    profile: Profile,
    plan: Plan,
    load: Workload | Operations,
    counts: Floats,
    time_us: Floats,
    waiting_us: Floats,
) -> Cost:
    """Return the cost from a plan at the ends of all figures, and the times at each, (3, ...)."""
    dynamic = _energy_uj(plan, counts)
    static, waiting = _static_uj(plan, time_us, waiting_us)
    flat_out = dynamic + static
    throttled_low, throttled_high = _throttled_range_uj(plan, time_us, waiting_us)
    step_us = load.step_us(time_us)
    placement, idle_w = plan.placement, plan.idle_mw * 1e-3
    causes = [sum_of_products(counts, per_count[0]) * 1e-6 for per_count in plan.energy_pj.values()]

    def value(x: Floats) -> Floats:
        return np.full_like(x, np.nan) if profile.interval_only else np.asarray(x)

    def interval(at_ends: Floats) -> Interval[Floats]:
        return Interval(value(at_ends[0]), at_ends[1], at_ends[2])

    return Cost(
        dynamic_uj=value(dynamic[0]),
        static_uj=interval(static),
        static_throttled_uj=Interval(value(static[0] + waiting[0]), throttled_low, throttled_high),
        energy_uj=interval(flat_out),
        energy_throttled_uj=interval(flat_out + waiting),
        step_time_us=interval(step_us),
        hardware_latency_ms=value(time_us[0] * 1e-3),
        pipeline_ms=value(load.pipeline_us(step_us[0]) * 1e-3),
        idle_mw=float(plan.idle_mw[0]),
        # A value of 0 stands for one that nobody has published.
        power_idle_w=Interval(float(idle_w[0]) or math.nan, float(idle_w[1]), float(idle_w[2])),
        power_w=_power_w(plan, dynamic, time_us, profile.interval_only),
        n_cores=placement.core_range if placement else Interval(0, 0, 0),
        misfits=placement.misfits if placement else (),
        assumptions=_assumptions(placement, load),
        breakdown={name: value(cause) for name, cause in zip(plan.energy_pj, causes, strict=True)},
        timed=placement is not None,
    )


def _assumptions(placement: Placement | None, load: Workload | Operations) -> tuple[str, ...]:
    if placement is None:
        return ()
    if load.cores is None or load.cores == placement.cores:
        return placement.assumptions
    return (*placement.assumptions, "the number of cores set by the user does not matter on such a chip")


def _energy_uj(plan: Plan, counts: Floats) -> Floats:
    """Return the dynamic energy (D, ...)."""
    total = np.asarray(sum(plan.energy_pj.values())) * 1e-6
    return sum_of_products(counts, total.reshape(len(total), *[1] * (counts.ndim - 1), -1))


def _time_us(plan: Plan, counts: Floats) -> Floats:
    """Return the time to compute (D, ...): what is slowest, and queues where the network is congested."""
    n_draws, n_candidates, n_features = plan.time_ns.shape
    flat = np.asfortranarray(counts.reshape(-1, n_features))
    per_count = plan.time_ns.reshape(-1, n_features) * 1e-3
    slowest = np.empty((n_draws, len(flat)))
    block = max(1, _BLOCK // (n_draws * n_candidates))
    for start in range(0, len(flat), block):
        candidates = sum_of_products(per_count[:, None], flat[start : start + block])
        slowest[:, start : start + block] = candidates.reshape(n_draws, n_candidates, -1).max(axis=1)
    time_us = slowest.reshape(n_draws, *counts.shape[:-1])
    congestion = plan.congestion
    if congestion is not None and congestion.layers.any():
        spikes = counts[..., 1 : 1 + len(congestion.layers)][..., congestion.layers]
        crowded = (spikes > congestion.spikes * counts[..., :1]).any(axis=-1)
        for draw, factor in enumerate(congestion.factor):
            time_us[draw] *= np.where(crowded, factor, 1.0)
    return time_us


def _static_uj(plan: Plan, time_us: Floats, waiting_us: Floats) -> tuple[Floats, Floats]:
    """Return the static energy of computing and of waiting, (D, ...) each; mW x us = nJ."""
    lead = (slice(None), *[None] * (time_us.ndim - 1))
    return plan.static_mw[lead] * time_us * 1e-3, plan.idle_mw[lead] * waiting_us * 1e-3


def _power_w(plan: Plan, dynamic_uj: Floats, time_us: Floats, interval_only: bool) -> Interval[Floats]:
    """Return the mean power of computing, with the least and the most within the ranges, (...)."""
    if plan.running_mw is None:
        energy, time = dynamic_uj, time_us[[0, 2, 1]]  # least power: least energy in the longest time
        power = np.divide(energy, time, out=np.full_like(energy, np.nan), where=time > 0)
        power += plan.static_mw.reshape(-1, *[1] * (energy.ndim - 1)) * 1e-3
    else:
        running = plan.running_mw.reshape(-1, *[1] * (time_us.ndim - 1)) * 1e-3
        power = np.where(time_us > 0, running, np.nan)
    return Interval(np.full_like(power[0], np.nan) if interval_only else power[0], power[1], power[2])


def _throttled_range_uj(plan: Plan, time_us: Floats, waiting_us: Floats) -> tuple[Floats, Floats]:
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
