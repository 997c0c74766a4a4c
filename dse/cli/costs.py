"""What an inference costs on one hardware: as a row of an answer, and as text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from dse.cli.answer import cell
from dse.config import ConfigError, Fault

if TYPE_CHECKING:
    from dse.hardware.cost import Cost
    from dse.hardware.inference import Inference
    from dse.hardware.plan import Plan, Values
    from dse.hardware.profile import Profile

Row = dict[str, Any]
_ENDS = ("", "_low", "_high")
_QUANTILES = {"_q50": 0.5, "_q05": 0.05, "_q95": 0.95}


def _with_ends(*names: str) -> list[str]:
    return [name + end for name in names for end in _ENDS]


# What every row has, whatever the hardware; terms of the dynamic energy differ.
_COLUMNS = (
    *("hardware", "not_applicable", "n_weights"),
    *_with_ends("energy_uj", "energy_throttled_uj", "energy_dynamic_uj"),
    *_with_ends("energy_static_uj", "energy_static_share_uj"),
    *_with_ends("energy_static_throttled_uj", "energy_static_throttled_share_uj"),
    *_with_ends("step_time_us", "hardware_latency_ms"),
    *("decision_ms", "pipeline_ms"),
    *_with_ends("latency_ms", "n_cores"),
    *("fits", "misfits", "assumptions", "evidence"),
)
# What a table shows below the terms of the dynamic energy, and what it calls it.
_SHOWN = {
    "energy_dynamic_uj": "dynamic",
    "energy_static_uj": "static, flat out",
    "energy_static_share_uj": "  of the cores in use",
    "energy_uj": "energy, flat out",
    "energy_static_throttled_uj": "static, at the step period",
    "energy_static_throttled_share_uj": "  of the cores in use",
    "energy_throttled_uj": "energy, at the step period",
    "step_time_us": "time of a step",
    "hardware_latency_ms": "computing time",
    "pipeline_ms": "through the layers",
    "latency_ms": "latency",
    "n_cores": "cores",
    "power_mw": "mean power",
    "battery_h": "battery life",
}
_DRAWN_AT_ONCE = 2**20  # draws times steps that are priced together
_UNITS = {"uj": "uJ", "us": "us", "ms": "ms", "mw": "mW", "h": "h"}


@dataclass(frozen=True)
class Asked:
    """What else a row shall say; None: nothing of it.

    contacts_per_hour: inferences, for the mean power.
    battery_mwh: capacity, for the battery life.
    n_draws: of the profile's numbers, for quantiles of the energies.
    """

    contacts_per_hour: float | None = None
    battery_mwh: float | None = None
    n_draws: int | None = None


def cost_row(profile: Profile, inference: Inference, asked: Asked) -> Row:
    """Return everything that a profile says of an inference; None where it says nothing.

    Raises:
        ConfigError: contacts overlap.
    """
    from dse.hardware.plan import NotApplicable

    row: Row = dict.fromkeys((*_COLUMNS, *_asked_columns(asked)))
    row |= {
        "hardware": profile.name,
        "n_weights": inference.n_weights,
        "decision_ms": inference.decision_ms,
        "evidence": list(_evidence(profile)),
    }
    try:
        found = inference.cost_on(profile)
    except NotApplicable as error:
        return row | {"not_applicable": str(error)}
    load = inference.on(profile)
    plan = profile.plan(load, profile.ends)
    row |= _energies(plan, inference, found)
    if found.timed:
        row |= _times(inference, found, getattr(load, "pipeline_steps", 0)) | {
            "n_cores": None if profile.interval_only else found.n_cores,
            "n_cores_low": found.n_cores_low,
            "n_cores_high": found.n_cores_high,
            "fits": found.fits,
            "misfits": [vars(misfit) for misfit in found.misfits],
            "assumptions": list(found.assumptions),
        }
    if asked.n_draws is not None:
        row |= _quantiles(profile, inference, asked.n_draws)
    if asked.contacts_per_hour is not None and found.timed:
        row |= _duty(plan, row, asked.contacts_per_hour, asked.battery_mwh)
    return {name: _known(value) for name, value in row.items()}


def cost_notes(row: Row) -> list[str]:
    """Return sentences about what a row does not have."""
    name = row["hardware"]
    if row["not_applicable"]:
        return [f"{name}: not applicable, {row['not_applicable']}"]
    notes = []
    if row["energy_uj"] is None:
        notes.append(f"{name}: nobody has published numbers, so costs are intervals without a value")
    if row.get("power_mw", 0) is None and row["energy_uj"] is not None and row["n_cores_low"] is not None:
        notes.append(f"{name}: what it draws between contacts is not known, so mean power is an interval")
    if row["n_cores_low"] is None:
        notes.append(f"{name}: dynamic energy alone; no static power, time, cores or limits are meant")
    if row.get("battery_h") is not None and math.isinf(row["battery_h"]):
        notes.append(f"{name}: draws nothing, so a battery lasts for ever (null in JSON)")
    return notes


def cost_text(profile: Profile, row: Row) -> str:
    """Return a row as a table: terms and totals with their intervals, what fits, and the evidence."""
    head = f"{profile.name}: {profile.doc}"
    if row["not_applicable"]:
        return f"{head}\n  not applicable"
    terms = [
        name for name in row if name.startswith("energy_") and name.endswith("_uj") and name not in _COLUMNS
    ]
    labels = {
        name: name.removeprefix("energy_").removesuffix("_uj").replace("_", " ") for name in terms
    } | _SHOWN
    lines = [["", "", "value", "low", "high"]]
    for name, label in labels.items():
        unit = _UNITS.get(name.rsplit("_", 1)[1], "")
        lines.append([label, unit, *(cell(row.get(name + end)) for end in _ENDS)])
        if name + "_q50" in row:
            lines.append(["  5 to 95 % of draws", unit, *(cell(row[name + end]) for end in _QUANTILES)])
    lines = [line for line in lines if any(text != "-" for text in line[2:])]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    table = [
        f"  {label:<{widths[0]}} {unit:<{widths[1]}}"
        + "".join(f"  {text:>{width}}" for text, width in zip(values, widths[2:], strict=True))
        for label, unit, *values in lines
    ]
    fits = {None: [], True: ["  fits"], False: ["  does not fit:"]}[row["fits"]]
    reasons = [f"    {misfit['text']}; fits with {misfit['change']}" for misfit in row["misfits"] or []]
    assumed = [f"  assumed: {text}" for text in row["assumptions"] or []]
    evidence = ", ".join(f"{n} {word}" for word, n in _evidence(profile).items())
    return "\n".join([head, *table, *fits, *reasons, *assumed, f"  evidence: {evidence}"])


def inference_text(inference: Inference) -> str:
    """Return what is priced, in one line."""
    from dse.records import Workload

    load = inference.load
    if not isinstance(load, Workload):
        counted = f"{cell(float(load.macs))} multiply-accumulates, {cell(float(load.additions))} additions"
        return f"{counted}, W_t {inference.n_weights} numbers of {load.number_bits} bits"
    counts = "counts of each step" if inference.per_step else "mean counts"
    return (
        f"{'-'.join(map(str, load.sizes))}, W_t {inference.n_weights} weights of {load.weight_bits} bits, "
        f"{inference.n_steps} steps of {inference.step_ms:g} ms, {counts}"
    )


def _asked_columns(asked: Asked) -> list[str]:
    found = []
    if asked.n_draws is not None:
        found += [name + end for name in ("energy_uj", "energy_throttled_uj") for end in _QUANTILES]
    if asked.contacts_per_hour is not None:
        found += _with_ends("power_mw")
    if asked.battery_mwh is not None:
        found += _with_ends("battery_h")
    return found


def _energies(plan: Plan, inference: Inference, found: Cost) -> Row:
    """Return the terms of the dynamic energy, the static energies and the totals, each with its interval."""
    row = {name: getattr(found, name) for name in _with_ends("energy_uj", "energy_throttled_uj")}
    whole: Values = np.asarray(sum(plan.energy_pj.values()))
    for cause, per_count in {"dynamic": whole, **plan.energy_pj}.items():
        _, low, high = (inference.counts @ one for one in per_count * 1e-6)
        value = found.dynamic_uj if cause == "dynamic" else found.breakdown[cause]
        row |= zip(_with_ends(f"energy_{cause}_uj"), (value, low, high), strict=True)
    if found.timed:
        for static in ("static", "static_throttled"):
            for end in _ENDS:
                energy = getattr(found, f"{static}_uj{end}")
                share = plan.share * energy if plan.share < 1 else None
                row |= {f"energy_{static}_uj{end}": energy, f"energy_{static}_share_uj{end}": share}
    return row


def _times(inference: Inference, found: Cost, pipeline_steps: int) -> Row:
    """Return times, each with its interval."""
    from dse.measure.objectives.latency import latency_ms

    row: Row = {"pipeline_ms": found.pipeline_ms}
    for end in _ENDS:
        step_us = getattr(found, f"step_time_us{end}")
        pipeline_ms = pipeline_steps * np.maximum(inference.step_ms, step_us * 1e-3)
        row |= {
            f"step_time_us{end}": step_us,
            f"hardware_latency_ms{end}": step_us * 1e-3 * inference.n_steps,
            f"latency_ms{end}": latency_ms(inference.decision_ms, inference.step_ms, step_us) + pipeline_ms,
        }
    return row


def _quantiles(profile: Profile, inference: Inference, n_draws: int) -> Row:
    """Return quantiles of the energies under draws of the profile's numbers."""
    from dse.hardware.cost import drawn
    from dse.study.pricing import figures

    load, chip = inference.on(profile), figures(profile, n_draws)
    at_once = max(1, _DRAWN_AT_ONCE // (inference.n_steps if inference.per_step else 1))
    steps = -1 if inference.per_step else ()
    found: dict[str, list[Values]] = {"energy_uj": [], "energy_throttled_uj": []}
    for start in range(0, n_draws, at_once):
        part = drawn(profile, load, {key: values[start : start + at_once] for key, values in chip.items()})
        for name, energies in found.items():
            energies.append(getattr(part, name).sum(axis=steps))
    row: Row = {}
    for name, energies in found.items():
        row |= {name + end: np.quantile(np.concatenate(energies), q) for end, q in _QUANTILES.items()}
        if profile.interval_only:
            row[f"{name}_q50"] = None
    return row


def _duty(plan: Plan, row: Row, contacts_per_hour: float, battery_mwh: float | None) -> Row:
    """Return the mean power and the battery life, each with its interval.

    Raises:
        ConfigError: contacts overlap.
    """
    from dse.hardware.duty import battery_h, mean_power_mw

    energy_uj, computing_ms = (
        np.array([row[name] for name in _with_ends(column)], np.float64)
        for column in ("energy_throttled_uj", "hardware_latency_ms")
    )
    contact_ms = np.maximum(computing_ms, row["decision_ms"])
    try:
        power = mean_power_mw(contacts_per_hour, energy_uj, contact_ms, plan.idle_mw)
    except ValueError as error:
        text = f"{error} (on {row['hardware']})"
        raise ConfigError([Fault("--contacts-per-hour", 0, text)]) from None
    found: Row = dict(zip(_with_ends("power_mw"), power, strict=True))
    if battery_mwh is not None:
        lasts = battery_h(battery_mwh, power)[[0, 2, 1]]  # the least power lasts longest
        found |= zip(_with_ends("battery_h"), lasts, strict=True)
    value, _, high = plan.idle_mw
    if value == 0 < high:  # what it draws between contacts is unknown, which is not nothing
        found |= dict.fromkeys(("power_mw", *(["battery_h"] if battery_mwh is not None else [])))
    return found


def _evidence(profile: Profile) -> Mapping[str, int]:
    """Return how many numbers of a profile there are of each class of evidence, best first."""
    from dse.hardware.profile import Evidence

    found = Counter(getattr(profile, name).evidence for name in profile.numbers())
    return {word: found[word] for word in get_args(Evidence) if word in found}


def _known(value: Any) -> Any:
    """Return a plain value: None for what is not known."""
    value = value.item() if isinstance(value, np.ndarray | np.generic) else value
    return None if isinstance(value, float) and math.isnan(value) else value
