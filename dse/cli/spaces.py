"""The argument SPACE and `--set`, which several commands share."""

from __future__ import annotations

import argparse

from dse.config import ConfigError, Fault, SearchSpace, load_space


def add_space(parser: argparse.ArgumentParser) -> None:
    """Add SPACE and `--set`."""
    parser.add_argument(
        "space", metavar="SPACE", help="a YAML file, or the name of a search space of the package"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="replace a key, such as data.file=touch.npz or 'model.hidden={choice: [50, 100]}'; repeatable",
    )


def load(arguments: argparse.Namespace) -> SearchSpace:
    """Return the search space that the arguments name, its data files looked at.

    Raises:
        ConfigError: with every fault.
    """
    overrides, faults = {}, []
    for text in arguments.overrides:
        key, equals, value = text.partition("=")
        if not equals:
            faults.append(Fault(f"--set {text}", 0, "must be KEY=VALUE, such as execution.jobs=2"))
        overrides[key.strip()] = value
    if faults:
        raise ConfigError(faults)
    return load_space(arguments.space, overrides, check_data=True)
