"""Commands that look up or compute without a study."""

from __future__ import annotations

from collections.abc import Iterable

from dse.cli.answer import Answer, listing
from dse.config import ConfigError, Fault, known_names


def describe(
    section: str | None = None, name: str | None = None, *, schema: bool = False, markdown: bool = False
) -> Answer:
    """Document the sections, components and keys of search spaces, pages and scenes, with units and ranges.

    Args:
        section: e.g. model.
        name: a component of the section, e.g. snn; of hardware also a YAML file.
        schema: print the JSON Schema of search spaces, for editors.
        markdown: print all of it as one page of Markdown: docs/reference.md.

    Raises:
        ConfigError: the section or component is unknown, or a hardware file has faults.
    """
    from dse.cli import reference

    if schema:
        from dse.config.schema import schema_text

        return Answer([], text=schema_text())
    if markdown:
        from dse.cli.handbook import markdown as page

        return Answer([], text=page().rstrip("\n"))
    if section is None:
        rows = reference.sections()
        return Answer(rows, text=listing([(str(row["section"]), str(row["doc"])) for row in rows]))
    _expect("section", section, (row["section"] for row in reference.sections()))
    known = reference.names(section)
    if name is None and known:
        units = [f" [{row['unit']}]" if section == "columns" and row["unit"] else "" for row in known]
        texts = [(row["name"], row["doc"] + unit) for row, unit in zip(known, units, strict=True)]
        return Answer(known, text=listing(texts))
    if known and not reference.is_file(section, name):
        what = "column" if section == "columns" else section
        _expect(what, str(name), (row["name"] for row in known))
    return Answer(reference.keys(section, name), reference.remarks(section, name), all_rows=True)


def _expect(what: str, name: str, names: Iterable[str]) -> None:
    known = list(names)
    if name not in known:
        raise ConfigError([Fault("dse describe", 0, f"unknown {what} '{name}'; {known_names(name, known)}")])
