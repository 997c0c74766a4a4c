"""The answer of a command, printed as a table, a JSON document, CSV or Parquet."""

from __future__ import annotations

import argparse
import io
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas

Row = Mapping[str, object]
FORMATS = ("table", "json", "csv", "parquet")
_MOST_ROWS = 24


@dataclass(frozen=True)
class Answer:
    """The result of a command.

    rows: one mapping per row, keyed by column name.
    notes: sentences about the rows.
    columns: the columns of a table on a terminal; all columns if empty. Other formats have every column.
    text: shown in place of a table.
    code: exit code.
    all_rows: whether a terminal shows every row, however many.
    is_printed: whether the command has printed its result, all but the notes.
    sections: further answers by title; CSV and Parquet hold the rows of the first alone.
    """

    rows: Sequence[Row]
    notes: Sequence[str] = ()
    columns: Sequence[str] = ()
    text: str = ""
    code: int = 0
    all_rows: bool = False
    is_printed: bool = False
    sections: Mapping[str, Answer] = field(default_factory=dict)


def add_format(parser: argparse.ArgumentParser, formats: Sequence[str] = ("table", "json")) -> None:
    """Add `--format` and its short form `--json`."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--format",
        choices=formats,
        help="output format (default: table on a terminal, otherwise text or CSV); json prints one document",
    )
    group.add_argument(
        "--json", action="store_const", const="json", dest="format", help="same as --format json"
    )


def show(answer: Answer, command: str, form: str | None) -> None:
    """Print an answer to stdout; notes follow a table, and go to stderr with other formats."""
    if answer.is_printed:
        for note in answer.notes:
            print(note, file=sys.stderr)
        return
    if form is None:
        form = "table" if answer.text or sys.stdout.isatty() else "csv"
    if form == "json":
        print(document(answer, command))
        return
    if form == "table":
        if answer.text:
            print(answer.text)
        elif answer.rows:
            _print_table(answer)
        for note in answer.notes:
            print(note)
        for title, section in answer.sections.items():
            print(f"\n{title}")
            show(section, command, form)
        return
    if form == "csv":
        _frame(answer).to_csv(sys.stdout, index=False)
    else:
        buffer = io.BytesIO()
        _frame(answer).to_parquet(buffer, index=False)
        sys.stdout.buffer.write(buffer.getvalue())
    for note in answer.notes:
        print(note, file=sys.stderr)


def document(answer: Answer, command: str) -> str:
    """Return the JSON document of an answer; numbers that JSON does not have become null."""
    content = {"schema": f"dse/{command}/1", **_content(answer)}
    return json.dumps(content, ensure_ascii=False, allow_nan=False)


def _content(answer: Answer) -> dict[str, object]:
    from dse.store import plain_cell

    rows = [{str(key): plain_cell(value) for key, value in row.items()} for row in answer.rows]
    sections = {title: _content(section) for title, section in answer.sections.items()}
    return {"rows": rows, "notes": list(answer.notes), **({"sections": sections} if sections else {})}


def _frame(answer: Answer) -> pandas.DataFrame:
    import pandas

    return pandas.DataFrame(list(answer.rows))


def _print_table(answer: Answer) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from dse.store import plain_cell

    columns = list(answer.columns) or list(dict.fromkeys(key for row in answer.rows for key in row))
    rows = list(answer.rows)
    shown = rows
    if len(rows) > _MOST_ROWS and not answer.all_rows:
        places = [round(i * (len(rows) - 1) / (_MOST_ROWS - 1)) for i in range(_MOST_ROWS)]
        shown = [rows[place] for place in places]
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        numeric = all(isinstance(plain_cell(row.get(column)), int | float | None) for row in shown)
        table.add_column(Text(column), justify="right" if numeric else "left", overflow="fold")
    for row in shown:
        table.add_row(*(Text(cell(row.get(column))) for column in columns))
    console = Console(width=None if sys.stdout.isatty() else 160, highlight=False)
    console.print(table)
    if len(shown) < len(rows):
        print(f"{len(shown)} of {len(rows)} rows, evenly spaced; --format csv prints all")


def cell(value: object) -> str:
    """Return a value as text for a table: four significant digits, '-' for a missing value."""
    from dse.store import plain_cell

    value = plain_cell(value)
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.0f}" if abs(value) >= 10_000 else f"{value:.4g}"
    return str(value)
