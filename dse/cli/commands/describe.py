"""`dse describe`: the components and keys of search spaces, pages and scenes, with units and ranges."""

from __future__ import annotations

from dataclasses import dataclass

from dse.cli.answer import Answer, listing
from dse.cli.fields import argument, flag, formats
from dse.cli.glossary import columns
from dse.cli.reference import keys, names, remarks, sections
from dse.config import ConfigError, Fault, known_names
from dse.config.bounds import BOUNDS
from dse.config.locate import is_hardware_file

GROUP = "look up"
_BOUNDS = "bounds"
_COLUMNS = "columns"
HELP = "document the sections, components and keys of search spaces, pages and scenes, with units and ranges"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    section: str | None = argument("SECTION", "e.g. model", None)
    name: str | None = argument(
        "NAME", "a component of the section, e.g. snn; of hardware also a YAML file", None
    )
    schema: bool = flag("print the JSON Schema of search spaces, for editors")
    markdown: bool = flag("print all of it as one page of Markdown: docs/reference.md")
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Return the sections, the components of one, or the keys of one component.

    Raises:
        ConfigError: the section or component is unknown, or a hardware file has faults.
    """
    if arguments.schema:
        from dse.config.schema import schema_text

        return Answer([], text=schema_text())
    if arguments.markdown:
        from dse.cli.handbook import markdown

        return Answer([], text=markdown().rstrip("\n"))
    if arguments.section is None:
        rows = [
            *sections(),
            {"section": _BOUNDS, "doc": "How much work and memory a file may ask for."},
            {"section": _COLUMNS, "doc": "The columns of a study's tables: meaning, unit, better direction."},
        ]
        return Answer(rows, text=listing([(str(row["section"]), str(row["doc"])) for row in rows]))
    if arguments.section == _BOUNDS:
        return Answer([{"name": name, "most": most, "of": of} for name, (most, of) in BOUNDS.items()])
    if arguments.section == _COLUMNS:
        return _of_columns(arguments.name)
    others = (_BOUNDS, _COLUMNS)
    _expect("section", arguments.section, [*(row["section"] for row in sections()), *others])
    known = names(arguments.section)
    if arguments.name is None and known:
        return Answer(known, text=listing([(row["name"], row["doc"]) for row in known]))
    is_file = arguments.section == "hardware" and is_hardware_file(arguments.name or "")
    if known and not is_file:
        _expect(arguments.section, str(arguments.name), [row["name"] for row in known])
    remarks_of_section = remarks(arguments.section, arguments.name)
    return Answer(keys(arguments.section, arguments.name), remarks_of_section, all_rows=True)


def _of_columns(name: str | None) -> Answer:
    """Return all columns, or one."""
    rows: list[dict[str, str]] = columns()
    if name is not None:
        _expect("column", name, [row["name"] for row in rows])
        return Answer([row for row in rows if row["name"] == name])
    units = [f" [{row['unit']}]" if row["unit"] else "" for row in rows]
    texts = [(row["name"], row["doc"] + unit) for row, unit in zip(rows, units, strict=True)]
    return Answer(rows, text=listing(texts))


def _expect(what: str, name: str, known: list[str]) -> None:
    if name not in known:
        raise ConfigError([Fault("dse describe", 0, f"unknown {what} '{name}'; {known_names(name, known)}")])
