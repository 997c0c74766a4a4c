"""`dse cost`: what an inference costs on hardware, from a workload file, without training."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import Answer, add_format
from dse.cli.costs import Asked, cost_notes, cost_row, cost_text, inference_text
from dse.cli.numbers import MOST_DRAWS, positive
from dse.config import ConfigError, Fault

if TYPE_CHECKING:
    from dse.hardware.inference import Inference
    from dse.hardware.profile import Profile

GROUP = "look up"
HELP = "compute energy, time and cores of an inference on hardware from a workload file, without training"
_DEFAULT = "loihi1_silicon"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "workload", metavar="WORKLOAD", help="a YAML or JSON file: layers, n_steps, spikes, ..."
    )
    parser.add_argument(
        "--hardware",
        action="append",
        metavar="NAME",
        help=f"a profile's name or file; repeatable (default: {_DEFAULT})",
    )
    parser.add_argument(
        "--contacts-per-hour", type=float, metavar="N", help="inferences per hour; adds mean power"
    )
    parser.add_argument(
        "--battery-mwh", type=float, metavar="M", help="battery capacity in mWh; adds battery life"
    )
    parser.add_argument(
        "--draws", type=positive, metavar="N", help="sample the profile's uncertain numbers N times"
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return a row per hardware.

    Raises:
        ConfigError: everything that is wrong with the workload, the profiles and the options.
    """
    faults = _option_faults(arguments)
    inference, profiles = _read(arguments.workload, arguments.hardware or [_DEFAULT], faults)
    if faults or inference is None:
        raise ConfigError(faults)
    asked = Asked(arguments.contacts_per_hour, arguments.battery_mwh, arguments.draws)
    rows = [cost_row(profile, inference, asked) for profile in profiles]
    notes = [note for row in rows for note in cost_notes(row)]
    tables = [cost_text(profile, row) for profile, row in zip(profiles, rows, strict=True)]
    return Answer(rows, notes, text="\n\n".join([inference_text(inference), *tables]) + "\n" * bool(notes))


def _option_faults(arguments: argparse.Namespace) -> list[Fault]:
    faults = []
    contacts, battery = arguments.contacts_per_hour, arguments.battery_mwh
    for name, number in (("--contacts-per-hour", contacts), ("--battery-mwh", battery)):
        if number is not None and not (math.isfinite(number) and number >= 0):
            faults.append(Fault(name, 0, f"must be a finite number >= 0, got {number:g}"))
    if arguments.draws is not None and arguments.draws > MOST_DRAWS:
        faults.append(Fault("--draws", 0, f"must be at most {MOST_DRAWS}, got {arguments.draws}"))
    if battery is not None and contacts is None:
        faults.append(Fault("--battery-mwh", 0, "needs --contacts-per-hour (0: always idle)"))
    return faults


def _read(path: str, names: list[str], faults: list[Fault]) -> tuple[Inference | None, tuple[Profile, ...]]:
    """Return the workload and the profiles; what is wrong with them joins the faults."""
    from dse.hardware.profile import load_all
    from dse.hardware.workload import load_inference

    inference: Inference | None = None
    profiles: tuple[Profile, ...] = ()
    try:
        inference = load_inference(path)
    except ConfigError as error:
        faults += error.faults
    try:
        profiles = load_all(names, Path())
    except ConfigError as error:
        faults += error.faults
    return inference, profiles
