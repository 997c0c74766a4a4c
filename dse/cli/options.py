"""Arguments and options that several commands share: SPACE, --set, --repair, --hardware, the duty cycle."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from dse.cli.numbers import amount
from dse.config import ConfigError, Fault, SearchSpace, load_space

if TYPE_CHECKING:
    from dse.door.question import Question

REPAIR = "repair damaged event files or leave them out, with a warning for each, instead of stopping"
_ASKED = ("oversize", "contacts_per_hour", "battery_mwh", "repeats", "confidence", "draws")


def add_space(parser: argparse.ArgumentParser) -> None:
    """Add SPACE, `--set` and `--repair`."""
    parser.add_argument("space", metavar="SPACE", help="a YAML file, or the name of a shipped search space")
    add_set(parser, "data.file=touch.npz or 'model.hidden={choice: [50, 100]}'")
    parser.add_argument("--repair", action="store_true", help=f"{REPAIR}; short for --set data.repair=true")


def add_set(parser: argparse.ArgumentParser, example: str) -> None:
    """Add `--set`."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help=f"replace the value of a key, e.g. {example}; repeatable",
    )


def add_hardware(parser: argparse.ArgumentParser) -> None:
    """Declare `--hardware`."""
    parser.add_argument(
        "--hardware",
        action="append",
        default=[],
        metavar="NAME",
        help="compute costs on this hardware profile (name or YAML file); nothing is retrained; repeatable",
    )


def add_duty(parser: argparse.ArgumentParser) -> None:
    """Declare `--contacts-per-hour` and `--battery-mwh`."""
    parser.add_argument(
        "--contacts-per-hour",
        type=amount,
        metavar="N",
        help="inferences per hour; adds the column power_mw, mean power at the sensor's step period, idle "
        "time included",
    )
    parser.add_argument(
        "--battery-mwh",
        type=amount,
        metavar="M",
        help="battery capacity in mWh; adds the column battery_h, battery life in hours "
        "(needs --contacts-per-hour)",
    )


def add_question(parser: argparse.ArgumentParser) -> None:
    """Declare the options that `question_of` reads, without --draws and --confidence."""
    add_hardware(parser)
    parser.add_argument(
        "--oversize",
        action="store_true",
        help="admit designs that do not fit their hardware, priced as if it were larger",
    )
    add_duty(parser)
    add_repeats(parser)


def question_of(arguments: argparse.Namespace) -> Question:
    """Return what is asked beside objectives and budgets."""
    from dse.door.question import Question

    given = vars(arguments)
    return Question(
        targets=tuple(given.get("target") or ()),
        hardware=tuple(arguments.hardware),
        **{name: given[name] for name in _ASKED},
    )


def add_repeats(parser: argparse.ArgumentParser) -> None:
    """Declare `--repeats`."""
    from dse.study.repeats import CHOICES

    parser.add_argument(
        "--repeats",
        choices=CHOICES,
        default="mean",
        help="of a design that was trained several times (seeds, folds): means of all its runs (default), or "
        "every number of its last run, or of the one with the least accuracy",
    )


def add_targets(parser: argparse.ArgumentParser, required: bool = False) -> None:
    """Declare `--target` and `--verify`."""
    parser.add_argument(
        "--target",
        action="append",
        default=None if required else [],
        required=required,
        metavar="NAME",
        help="target to write (`dse describe targets`); repeatable",
    )
    parser.add_argument(
        "--verify",
        metavar="RECORDINGS",
        help="run each target on these recordings, in the format of the training data, and compare all "
        "decisions and spikes; a target that shows less than its verdict of before gives exit code 4",
    )


def load(arguments: argparse.Namespace) -> SearchSpace:
    """Return the search space that the arguments name; its data files and hardware profiles are checked too.

    Raises:
        ConfigError: every fault.
    """
    from dse.hardware.profile import load_all

    overrides = overrides_of(arguments)
    if arguments.repair:
        overrides["data.repair"] = "true"
    space = load_space(arguments.space, overrides, check_data=True)
    load_all(space.hardware, space.source.parent)
    return space


def overrides_of(arguments: argparse.Namespace) -> dict[str, str]:
    """Return key -> value of each `--set`.

    Raises:
        ConfigError: every `--set` that is not KEY=VALUE.
    """
    overrides, faults = {}, []
    for text in arguments.overrides:
        key, equals, value = text.partition("=")
        if not equals:
            faults.append(Fault(f"--set {text}", 0, "must be KEY=VALUE"))
        overrides[key.strip()] = value
    if faults:
        raise ConfigError(faults)
    return overrides
