"""The cost table of an inference: everything that hardware profiles say about it, a row each.

In a notebook:

    rows = [cost_row(load(name), load_inference("net.yaml")) for name in ("loihi1_silicon", "mcu_m4")]
    rows[0].energy_uj.low, rows[0].terms_uj["synaptic_event"].value
    pandas.DataFrame([row.columns() for row in rows])
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np

from dse.base.records import Floats, sum_of_products
from dse.config.settings import Schedule
from dse.measure.hardware.cost import Cost, drawn
from dse.measure.hardware.duty import battery_h, latency_ms, mean_power_mw
from dse.measure.hardware.inference import Inference
from dse.measure.hardware.interval import Interval
from dse.measure.hardware.plan import Misfit, NotApplicable, Plan
from dse.measure.hardware.profile import Evidence, Profile

Known = float | None
"""A number, or None where it is not known or has no meaning."""

UNKNOWN: Interval[Known] = Interval(None, None, None)

_DRAWN_AT_ONCE = 2**20  # draws times steps that are priced together
_QUANTILES = {"_q50": 0.5, "_q05": 0.05, "_q95": 0.95}


@dataclass(frozen=True, kw_only=True)
class CostRow:
    """Everything that a profile says about an inference; None where it says nothing.

    hardware, not_applicable: name of the profile, and why it cannot run the classifier.
    n_weights, decision_ms: W_t, and the time until the input is complete.
    evidence: how many numbers of the profile there are of each class of evidence, best first.
    terms_uj: dynamic energy by cause.
    energy_static_share_uj: static energy of the cores in use, where the chip has more.
    n_cores: in use, and what practice may take.
    fits, misfits, assumptions: as of `Cost`.
    energy_quantiles_uj, energy_throttled_quantiles_uj: median, 5 % and 95 % of samples of the chip's numbers.
    power_mw, battery_h: mean power and battery life of a `Schedule`.

    The others are as of `Cost`. Quantiles, power and battery life are None unless they are requested.
    """

    hardware: str
    not_applicable: str | None = None
    n_weights: int
    energy_uj: Interval[Known] = UNKNOWN
    energy_throttled_uj: Interval[Known] = UNKNOWN
    energy_dynamic_uj: Interval[Known] = UNKNOWN
    energy_static_uj: Interval[Known] = UNKNOWN
    energy_static_share_uj: Interval[Known] = UNKNOWN
    energy_static_throttled_uj: Interval[Known] = UNKNOWN
    energy_static_throttled_share_uj: Interval[Known] = UNKNOWN
    step_time_us: Interval[Known] = UNKNOWN
    hardware_latency_ms: Interval[Known] = UNKNOWN
    decision_ms: float
    pipeline_ms: Known = None
    latency_ms: Interval[Known] = UNKNOWN
    power_idle_w: Interval[Known] = UNKNOWN
    power_w: Interval[Known] = UNKNOWN
    n_cores: Interval[int | None] = field(default=Interval(None, None, None))
    fits: bool | None = None
    misfits: tuple[Misfit, ...] | None = None
    assumptions: tuple[str, ...] | None = None
    evidence: Mapping[str, int]
    energy_quantiles_uj: Interval[Known] | None = None
    energy_throttled_quantiles_uj: Interval[Known] | None = None
    power_mw: Interval[Known] | None = None
    battery_h: Interval[Known] | None = None
    terms_uj: Mapping[str, Interval[Known]] = field(default_factory=dict)

    def columns(self) -> dict[str, object]:
        """Return the row under the names of its table columns, in the order of the fields."""
        plain: dict[str, object] = {
            "misfits": None if self.misfits is None else [vars(misfit) for misfit in self.misfits],
            "assumptions": None if self.assumptions is None else list(self.assumptions),
            "evidence": list(self.evidence),
        }
        row: dict[str, object] = {}
        for name in (x.name for x in dataclasses.fields(self)):
            value = getattr(self, name)
            if name == "terms_uj":
                for cause, term in self.terms_uj.items():
                    row |= term.columns(f"energy_{cause}_uj")
            elif "_quantiles" in name:
                ends = (name.replace("_quantiles", "") + end for end in _QUANTILES)
                row |= {} if value is None else dict(zip(ends, value, strict=True))
            elif isinstance(value, Interval):
                row |= value.columns(name)
            elif name not in ("power_mw", "battery_h"):
                row[name] = plain.get(name, value)
        return row


def cost_row(
    profile: Profile, inference: Inference, schedule: Schedule | None = None, n_draws: int | None = None
) -> CostRow:
    """Return everything that a profile says about an inference.

    Args:
        profile: the hardware.
        inference: what is priced.
        schedule: adds mean power, and battery life where it has a battery.
        n_draws: adds quantiles of the energies under so many samples of the profile's numbers.

    Raises:
        ValueError: contacts overlap.
    """
    quantiles = None if n_draws is None else UNKNOWN
    counted = Counter(getattr(profile, name).evidence for name in profile.stated)
    row = CostRow(
        hardware=profile.name,
        n_weights=inference.n_weights,
        decision_ms=inference.decision_ms,
        evidence={word: counted[word] for word in get_args(Evidence) if word in counted},
        energy_quantiles_uj=quantiles,
        energy_throttled_quantiles_uj=quantiles,
        power_mw=None if schedule is None else UNKNOWN,
        battery_h=None if schedule is None or schedule.battery_mwh is None else UNKNOWN,
    )
    try:
        priced = inference.cost_on(profile)
    except NotApplicable as error:
        return replace(row, not_applicable=str(error))
    load = inference.on(profile)
    plan = profile.plan(load, profile.ends)
    row = replace(row, **_energies(plan, inference.counts_on(profile), priced))
    if priced.timed:
        row = replace(row, **_times(inference, plan, priced, getattr(load, "pipeline_steps", 0)))
    if profile.interval_only:
        row = replace(row, n_cores=replace(row.n_cores, value=None))
    if n_draws is not None:
        row = replace(row, **_quantiles(profile, inference, n_draws))
    if schedule is not None and priced.timed:
        row = _with_power(row, plan, schedule)
    return row


def _energies(plan: Plan, counts: Floats, priced: Cost) -> dict[str, Any]:
    """Return the terms of the dynamic energy, and the totals."""

    def term(per_count: Floats, value: Floats) -> Interval[Known]:
        _, low, high = (sum_of_products(counts, one) for one in per_count * 1e-6)
        return _known(Interval(value, low, high))

    terms = {cause: term(per_count, priced.breakdown[cause]) for cause, per_count in plan.energy_pj.items()}
    return {
        "energy_uj": _known(priced.energy_uj),
        "energy_throttled_uj": _known(priced.energy_throttled_uj),
        "energy_dynamic_uj": term(np.asarray(sum(plan.energy_pj.values())), priced.dynamic_uj),
        "terms_uj": terms,
    }


def _times(inference: Inference, plan: Plan, priced: Cost, pipeline_steps: int) -> dict[str, Any]:
    """Return static energies, times, powers, cores and limits."""

    def latency(step_us: Floats) -> Floats:
        pipeline_ms = pipeline_steps * np.maximum(inference.step_ms, step_us * 1e-3)
        return np.asarray(latency_ms(inference.decision_ms, inference.step_ms, step_us) + pipeline_ms)

    static = {"static": priced.static_uj, "static_throttled": priced.static_throttled_uj}
    shares = {} if plan.share >= 1 else {k: x.map(lambda uj: plan.share * uj) for k, x in static.items()}
    return {
        **{f"energy_{name}_uj": _known(uj) for name, uj in static.items()},
        **{f"energy_{name}_share_uj": _known(uj) for name, uj in shares.items()},
        "pipeline_ms": _number(priced.pipeline_ms),
        "step_time_us": _known(priced.step_time_us),
        "hardware_latency_ms": _known(priced.step_time_us.map(lambda us: us * 1e-3 * inference.n_steps)),
        "latency_ms": _known(priced.step_time_us.map(latency)),
        "power_idle_w": priced.power_idle_w.map(_number),
        "power_w": _known(priced.power_w),
        "n_cores": Interval(*priced.n_cores),
        **{name: getattr(priced, name) for name in ("fits", "misfits", "assumptions")},
    }


def _quantiles(profile: Profile, inference: Inference, n_draws: int) -> dict[str, Any]:
    """Return quantiles of the energies under draws of the profile's numbers."""
    load, figures = inference.on(profile), profile.draws(n_draws)
    at_once = max(1, _DRAWN_AT_ONCE // (inference.n_steps if inference.per_step else 1))
    over_steps = -1 if inference.per_step else ()
    energies, throttled = [], []
    for start in range(0, n_draws, at_once):
        part = drawn(profile, load, {key: x[start : start + at_once] for key, x in figures.items()})
        energies.append(part.energy_uj.sum(axis=over_steps))
        throttled.append(part.energy_throttled_uj.sum(axis=over_steps))

    def quantiles(parts: list[Floats]) -> Interval[Known]:
        among = np.concatenate(parts)
        interval = _known(Interval(*(np.quantile(among, q) for q in _QUANTILES.values())))
        return replace(interval, value=None) if profile.interval_only else interval

    return {
        "energy_quantiles_uj": quantiles(energies),
        "energy_throttled_quantiles_uj": quantiles(throttled),
    }


def _with_power(row: CostRow, plan: Plan, schedule: Schedule) -> CostRow:
    """Add the mean power and the battery life."""
    energy_uj = np.array([*row.energy_throttled_uj], np.float64)
    contact_ms = np.maximum(np.array([*row.hardware_latency_ms], np.float64), row.decision_ms)
    power_mw = mean_power_mw(schedule, energy_uj, contact_ms, plan.idle_mw)
    power = _known(Interval(*power_mw))
    battery = row.battery_h
    if schedule.battery_mwh is not None:
        value, at_low, at_high = battery_h(schedule.battery_mwh, power_mw)
        battery = _known(Interval(value, at_high, at_low))  # the least power lasts longest
    value_mw, _, high_mw = plan.idle_mw
    if value_mw == 0 < high_mw:  # what it draws between contacts is unknown, which is not nothing
        power = replace(power, value=None)
        battery = None if battery is None else replace(battery, value=None)
    return replace(row, power_mw=power, battery_h=battery)


def _known(interval: Interval[Floats]) -> Interval[Known]:
    return interval.map(_number)


def _number(value: Floats | float) -> Known:
    """Return a plain number: None where it is not known."""
    number = float(value)
    return None if math.isnan(number) else number
