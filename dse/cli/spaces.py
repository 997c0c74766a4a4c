"""The argument SPACE, `--set` and `--repair`, which several commands share."""

from __future__ import annotations

import argparse

from dse.config import ConfigError, Fault, SearchSpace, load_space

REPAIR = "go on after faults in event files, with a warning for each"


def add_space(parser: argparse.ArgumentParser) -> None:
    """Add SPACE, `--set` and `--repair`."""
    parser.add_argument(
        "space", metavar="SPACE", help="a YAML file, or the name of a search space of the package"
    )
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
        help=f"replace a key, such as {example}; repeatable",
    )


def load(arguments: argparse.Namespace) -> SearchSpace:
    """Return the search space that the arguments name, its data files and hardware profiles looked at.

    Raises:
        ConfigError: with every fault.
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
        ConfigError: one of them is no KEY=VALUE.
    """
    overrides, faults = {}, []
    for text in arguments.overrides:
        key, equals, value = text.partition("=")
        if not equals:
            faults.append(Fault(f"--set {text}", 0, "must be KEY=VALUE, such as execution.jobs=2"))
        overrides[key.strip()] = value
    if faults:
        raise ConfigError(faults)
    return overrides
