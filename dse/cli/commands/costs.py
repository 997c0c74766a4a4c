"""Costs of an inference on hardware, from a workload file, without training: what `dse cost` does."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from dse.base.registry import Rule
from dse.cli.answer import Answer, cell
from dse.cli.signature import Amount, Texts
from dse.config import ConfigError, Fault
from dse.study.question import MOST_DRAWS

if TYPE_CHECKING:
    from dse.measure.hardware.inference import Inference
    from dse.measure.hardware.profile import Profile
    from dse.measure.hardware.table import CostRow

_DEFAULT = "loihi1_silicon"


def cost(
    workload: str,
    *,
    hardware: Texts = (),
    contacts_per_hour: Amount = None,
    battery_mwh: Amount = None,
    draws: Annotated[int | None, Rule(low=1, high=MOST_DRAWS)] = None,
) -> Answer:
    """Compute energy, time and cores of an inference on hardware from a workload file, without training.

    Args:
        workload: a YAML or JSON file: layers, n_steps, spikes, ...
        hardware (NAME): a profile's name or file; repeatable (default: loihi1_silicon).
        contacts_per_hour: inferences per hour; adds mean power.
        battery_mwh: battery capacity in mWh; adds battery life.
        draws: sample the profile's uncertain numbers N times.
    """
    from dse.config.settings import Schedule
    from dse.measure.hardware.profile import load_all
    from dse.measure.hardware.table import cost_row
    from dse.measure.hardware.workload import load_inference

    faults = []
    if battery_mwh is not None and contacts_per_hour is None:
        faults.append(Fault("--battery-mwh", 0, "needs --contacts-per-hour (0: always idle)"))
    inference: Inference | None = None
    profiles: tuple[Profile, ...] = ()
    try:
        inference = load_inference(workload)
    except ConfigError as error:
        faults += error.faults
    try:
        profiles = load_all(hardware or (_DEFAULT,), Path())
    except ConfigError as error:
        faults += error.faults
    if faults or inference is None:
        raise ConfigError(faults)
    schedule = None
    if contacts_per_hour is not None:
        schedule = Schedule(contacts_per_hour=contacts_per_hour, battery_mwh=battery_mwh)
    rows = []
    for profile in profiles:
        try:
            rows.append(cost_row(profile, inference, schedule, draws))
        except ValueError as error:  # contacts overlap
            fault = Fault("--contacts-per-hour", 0, f"{error} (on {profile.name})")
            raise ConfigError([fault]) from None
    notes = [note for row in rows for note in _notes(row)]
    tables = [_text(profile, row) for profile, row in zip(profiles, rows, strict=True)]
    text = "\n\n".join([_inference_text(inference), *tables]) + "\n" * bool(notes)
    return Answer([row.columns() for row in rows], notes, text=text)


def _notes(row: CostRow) -> list[str]:
    """Return sentences about the missing numbers of a row."""
    name = row.hardware
    if row.not_applicable:
        return [f"{name}: not applicable, {row.not_applicable}"]
    notes = []
    priced = row.energy_uj.value is not None
    if not priced:
        notes.append(f"{name}: no numbers are published, so costs are intervals without a value")
    timed = row.n_cores.low is not None
    if priced and timed and row.power_mw is not None and row.power_mw.value is None:
        notes.append(f"{name}: its power between contacts is unknown, so mean power is an interval")
    if not timed:
        notes.append(f"{name}: dynamic energy only; the profile has no static power, time, cores or limits")
    if row.battery_h is not None and row.battery_h.value == math.inf:
        notes.append(f"{name}: draws no power, so a battery lasts for ever (null in JSON)")
    return notes


def _text(profile: Profile, row: CostRow) -> str:
    """Return a row as a table: terms and totals with their intervals, misfits, and the evidence."""
    head = f"{profile.name}: {profile.doc}"
    if row.not_applicable:
        return f"{head}\n  not applicable"
    lines = [("", "", ["value", "low", "high"]), *_lines(row)]
    lines = [line for line in lines if any(text != "-" for text in line[2])]
    label_width, unit_width = (max(len(line[i]) for line in lines) for i in (0, 1))
    widths = [max(len(line[2][i]) for line in lines) for i in range(3)]
    table = [
        f"  {label:<{label_width}} {unit:<{unit_width}}"
        + "".join(f"  {text:>{width}}" for text, width in zip(cells, widths, strict=True))
        for label, unit, cells in lines
    ]
    fits = {None: [], True: ["  fits"], False: ["  does not fit:"]}[row.fits]
    reasons = [f"    {misfit}" for misfit in row.misfits or ()]
    assumptions = [f"  assumption: {text}" for text in row.assumptions or ()]
    evidence = ", ".join(f"{n} {word}" for word, n in row.evidence.items())
    return "\n".join([head, *table, *fits, *reasons, *assumptions, f"  evidence: {evidence}"])


def _lines(row: CostRow) -> Iterator[tuple[str, str, list[str]]]:
    """Yield label, unit, and value, low and high, of every line of a table."""

    def cells(interval: Iterable[object] | None) -> list[str]:
        return ["-"] * 3 if interval is None else [cell(x) for x in interval]

    for cause, term in row.terms_uj.items():
        yield cause.replace("_", " "), "uJ", cells(term)
    yield "dynamic", "uJ", cells(row.energy_dynamic_uj)
    yield "static, flat out", "uJ", cells(row.energy_static_uj)
    yield "  of the cores in use", "uJ", cells(row.energy_static_share_uj)
    yield "energy, flat out", "uJ", cells(row.energy_uj)
    if row.energy_quantiles_uj is not None:
        yield "  5 to 95 % of draws", "uJ", cells(row.energy_quantiles_uj)
    yield "static, at the step period", "uJ", cells(row.energy_static_throttled_uj)
    yield "  of the cores in use", "uJ", cells(row.energy_static_throttled_share_uj)
    yield "energy, at the step period", "uJ", cells(row.energy_throttled_uj)
    if row.energy_throttled_quantiles_uj is not None:
        yield "  5 to 95 % of draws", "uJ", cells(row.energy_throttled_quantiles_uj)
    yield "time of a step", "us", cells(row.step_time_us)
    yield "computing time", "ms", cells(row.hardware_latency_ms)
    yield "through the layers", "ms", [cell(row.pipeline_ms), "-", "-"]
    yield "latency", "ms", cells(row.latency_ms)
    for label, power in (("power at rest", row.power_idle_w), ("power while computing", row.power_w)):
        most = max((x for x in power if x is not None), default=0.0)
        unit, scale = ("W", 1.0) if most >= 1 else ("mW", 1e3) if most >= 1e-3 else ("uW", 1e6)
        yield label, unit, cells(None if x is None else x * scale for x in power)
    yield "cores", "", cells(row.n_cores)
    yield "mean power", "mW", cells(row.power_mw)
    yield "battery life", "h", cells(row.battery_h)


def _inference_text(inference: Inference) -> str:
    """Return the workload in one line."""
    from dse.base.records import Workload

    load = inference.load
    if not isinstance(load, Workload):
        counts = f"{cell(float(load.macs))} multiply-accumulates, {cell(float(load.additions))} additions"
        return f"{counts}, W_t {inference.n_weights} numbers of {load.number_bits} bits"
    counts = "counts of each step" if inference.per_step else "mean counts"
    return (
        f"{'-'.join(map(str, load.sizes))}, W_t {inference.n_weights} weights of {load.weight_bits} bits, "
        f"{inference.n_steps} steps of {inference.step_ms:g} ms, {counts}"
    )
