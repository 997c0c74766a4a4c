"""`dse describe`: what a search space, a page and a scene hold: components, keys, units and ranges."""

from __future__ import annotations

import argparse
import json

from dse.cli.answer import Answer, add_format
from dse.cli.reference import keys, names, remarks, sections
from dse.config import ConfigError, Fault, known_names
from dse.config.locate import is_hardware_file

HELP = "print what a search space, a page or a scene may hold: sections, components, keys, units, ranges"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("section", nargs="?", metavar="SECTION", help="such as model")
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="a component of it, such as snn, or a hardware file"
    )
    parser.add_argument(
        "--schema", action="store_true", help="print the JSON Schema of a search space, for editors"
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the sections, the components of one, or the keys of one component.

    Raises:
        ConfigError: there is no such section or component; what is wrong with a hardware file.
    """
    if arguments.schema:
        from dse.config.schema import json_schema

        return Answer([], text=json.dumps(json_schema(), indent=2))
    if arguments.section is None:
        rows = sections()
        return Answer(rows, text=_listing(rows, "section", "doc"))
    _expect("section", arguments.section, [row["section"] for row in sections()])
    known = names(arguments.section)
    if arguments.name is None and known:
        return Answer(known, text=_listing(known, "name", "doc"))
    own_file = arguments.section == "hardware" and is_hardware_file(arguments.name)
    if known and not own_file:
        _expect(arguments.section, arguments.name, [row["name"] for row in known])
    rows = keys(arguments.section, arguments.name)
    return Answer(rows, remarks(arguments.section, arguments.name), all_rows=True)


def _expect(what: str, name: str, known: list[str]) -> None:
    if name not in known:
        raise ConfigError([Fault("dse describe", 0, f"unknown {what} '{name}'; {known_names(name, known)}")])


def _listing(rows: list[dict[str, str]], name: str, doc: str) -> str:
    width = max(len(row[name]) for row in rows) + 2
    return "\n".join(f"{row[name]:<{width}}{row[doc]}" for row in rows)
