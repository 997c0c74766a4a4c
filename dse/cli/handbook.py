"""The reference of `dse describe` as one page of Markdown: docs/reference.md."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from dse.cli.reference import LISTED, Row, keys, names, remarks, sections

_TITLE = """# Reference

`dse describe --markdown` writes this page from the declarations that the code itself reads.
`dse describe SECTION NAME` prints a part of it.
"""
_MARKS = str.maketrans({mark: f"\\{mark}" for mark in "\\|*_[]#~$"} | {"<": "&lt;", ">": "&gt;"})


def markdown() -> str:
    """Return every section with its components, their keys and numbers, the bounds and all columns."""
    return "\n".join(_lines()).rstrip() + "\n"


def _lines() -> Iterator[str]:
    yield _TITLE
    for section, doc in (row.values() for row in sections()):
        yield from (f"## {section}", "", _text(doc), "")
        known = names(section)
        if section in LISTED:
            yield from _table(known)
        elif known:
            for row in known:
                yield from _component(section, row["name"], row["doc"])
        else:
            yield from _table(keys(section, None))


def _component(section: str, name: str, doc: str) -> Iterator[str]:
    yield from (f"### {section}: {name}", "", _text(doc), "")
    yield from (f"- {_text(remark)}" for remark in remarks(section, name)[1:])
    yield ""
    yield from _table(keys(section, name))


def _table(rows: Iterable[Row]) -> Iterator[str]:
    """Return a table of the columns that are not empty everywhere."""
    rows = list(rows)
    heads: Sequence[str] = [
        head for head in dict.fromkeys(head for row in rows for head in row) if any(row[head] for row in rows)
    ]
    if not heads:
        yield from ("No keys.", "")
        return
    yield f"| {' | '.join(head.replace('_', ' ') for head in heads)} |"
    yield f"|{'---|' * len(heads)}"
    for row in rows:
        first = f"`{row[heads[0]]}`"
        yield f"| {' | '.join([first, *(_text(row.get(head, '')) for head in heads[1:])])} |"
    yield ""


def _text(value: object) -> str:
    """Return a text that Markdown shows as it is."""
    text = " ".join(str(value).split())
    return text.translate(_MARKS)
