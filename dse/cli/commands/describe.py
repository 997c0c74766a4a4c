"""`dse describe`: the components and keys of search spaces, pages and scenes, with units and ranges."""

from __future__ import annotations

import argparse

from dse.cli.answer import Answer, add_format, listing
from dse.cli.reference import keys, names, remarks, sections
from dse.config import ConfigError, Fault, known_names
from dse.config.bounds import BOUNDS
from dse.config.locate import is_hardware_file

GROUP = "look up"
_BOUNDS = "bounds"
HELP = "document the sections, components and keys of search spaces, pages and scenes, with units and ranges"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("section", nargs="?", metavar="SECTION", help="e.g. model")
    parser.add_argument(
        "name",
        nargs="?",
        metavar="NAME",
        help="a component of the section, e.g. snn; of hardware also a YAML file",
    )
    parser.add_argument(
        "--schema", action="store_true", help="print the JSON Schema of search spaces, for editors"
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the sections, the components of one, or the keys of one component.

    Raises:
        ConfigError: the section or component is unknown, or a hardware file has faults.
    """
    if arguments.schema:
        from dse.config.schema import schema_text

        return Answer([], text=schema_text())
    if arguments.section is None:
        rows = [*sections(), {"section": _BOUNDS, "doc": "How much work and memory a file may ask for."}]
        return Answer(rows, text=listing([(str(row["section"]), str(row["doc"])) for row in rows]))
    if arguments.section == _BOUNDS:
        return Answer([{"name": name, "most": most, "of": of} for name, (most, of) in BOUNDS.items()])
    _expect("section", arguments.section, [*(row["section"] for row in sections()), _BOUNDS])
    known = names(arguments.section)
    if arguments.name is None and known:
        return Answer(known, text=listing([(row["name"], row["doc"]) for row in known]))
    is_file = arguments.section == "hardware" and is_hardware_file(arguments.name)
    if known and not is_file:
        _expect(arguments.section, arguments.name, [row["name"] for row in known])
    remarks_of_section = remarks(arguments.section, arguments.name)
    return Answer(keys(arguments.section, arguments.name), remarks_of_section, all_rows=True)


def _expect(what: str, name: str, known: list[str]) -> None:
    if name not in known:
        raise ConfigError([Fault("dse describe", 0, f"unknown {what} '{name}'; {known_names(name, known)}")])
