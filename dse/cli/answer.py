"""The answer of a command, printed as a table, a JSON document, CSV or Parquet."""

from __future__ import annotations

import argparse
import io
import itertools
import json
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from dse.base.text import json_line, lines, one_line
from dse.config import ConfigError, Fault
from dse.config.faults import did_you_mean, known_names

if TYPE_CHECKING:
    import pandas

    from dse.study.audit import Audit

Row = Mapping[str, object]
FORMATS = ("table", "json", "csv", "parquet")
MOST_ROWS = 24
"""Rows of a table on a terminal, unless all are asked for."""

_FEW_ROWS = 4  # fewer keep columns of one value, where these fit
_PIPED = 160  # characters of a table that goes to no terminal
_PROSE = 20  # texts that are longer may be wrapped between words, to no less than this
_GAP = 2  # spaces between columns
_OPTION = re.compile(r'--[\w-]+ "[^"]*"')  # is copied: a line break would spoil it
_KEPT = "\0"
_OF_AUDIT = (
    *("task", "probe", "reader", "accuracy", "se", "chance", "without", "test"),
    *("shortcut", "verdict", "remedy"),
)


@dataclass(frozen=True)
class Answer:
    """The result of a command.

    rows: one mapping per row, keyed by column name.
    lead: sentences that come first.
    notes: sentences about the rows.
    columns: the default view: the columns of a table and of CSV; all columns if empty. JSON and Parquet have
        every column.
    text: shown in place of a table.
    code: exit code.
    essential: columns that a narrow terminal shows too; it leaves out others, the last first. Empty: it
        leaves out none, and lists a row's values below each other where they do not fit side by side.
    telling: columns that it leaves out after all others: what rows are told apart by.
    groups: columns whose values head the rows of a table that have them, in place of a column.
    table: the rows of a table on a terminal, if these are fewer (equal ones as one row); other formats have
        all rows.
    best: returns places of rows of the table, which a terminal shows if it cannot show all; None: evenly
        spaced.
    all_rows: whether a terminal shows every row, however many.
    is_printed: whether the command has printed its result, all but the notes.
    sections: further answers by title; CSV and Parquet hold the rows of the first alone.
    """

    rows: Sequence[Row]
    notes: Sequence[str] = ()
    columns: Sequence[str] = ()
    essential: Sequence[str] = ()
    telling: Sequence[str] = ()
    groups: Sequence[str] = ()
    table: Sequence[Row] | None = None
    lead: Sequence[str] = ()
    best: Callable[[], Sequence[int]] | None = None
    text: str = ""
    code: int = 0
    all_rows: bool = False
    is_printed: bool = False
    sections: Mapping[str, Answer] = field(default_factory=dict)


def add_format(parser: argparse.ArgumentParser) -> None:
    """Add `--columns`, `--format` and its short form `--json`."""
    parser.add_argument(
        "--columns",
        metavar="NAMES",
        help="print these columns, separated by commas, or all (default: those that designs are chosen by; "
        "json and parquet have every column)",
    )
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--format",
        choices=FORMATS,
        help="output format (default: table on a terminal, otherwise text or csv)",
    )
    group.add_argument(
        "--json", action="store_const", const="json", dest="format", help="same as --format json"
    )


def show(answer: Answer, command: str, form: str | None, columns: str | None = None) -> None:
    """Print an answer to stdout; notes follow a table, and go to stderr with other formats.

    form: one of `FORMATS`; None: a table or text on a terminal, else CSV.
    columns: names, separated by commas, or 'all'; None: those of the format.
    """
    if answer.is_printed:
        for note in answer.notes:
            print(one_line(note), file=sys.stderr)
        return
    if columns is not None:
        answer = with_columns(answer, columns)
    if form is None:
        form = "table" if answer.text or sys.stdout.isatty() else "csv"
    if form == "json":
        print(json_line(document(answer, command)))
        return
    if form == "table":
        for sentence in answer.lead:
            print(wrapped(sentence))
        if answer.text:
            print(lines(answer.text))
        elif answer.rows:
            _print_table(answer)
        for note in answer.notes:
            print(wrapped(note))
        for title, section in answer.sections.items():
            print(f"\n{one_line(title)}")
            show(section, command, form)
        return
    if form == "csv":
        if answer.rows or answer.columns:
            frame = _frame(answer)
            shown = frame[[name for name in answer.columns or frame if name in frame]]
            content = shown.to_csv(index=False)
            sys.stdout.write(lines(content) if sys.stdout.isatty() else content)
    else:
        buffer = io.BytesIO()
        _frame(answer).to_parquet(buffer, index=False)
        sys.stdout.buffer.write(buffer.getvalue())
    words = [line for section in answer.sections.values() for line in section.text.splitlines()]
    for note in [*answer.lead, *answer.notes, *words]:
        print(one_line(note), file=sys.stderr)


def with_columns(answer: Answer, columns: str) -> Answer:
    """Return an answer of some columns alone, in every format; terminals leave out none of them."""
    known = list(dict.fromkeys(key for row in answer.rows for key in row))
    names = [name.strip() for name in columns.split(",")]
    if names == ["all"]:
        names = known or list(answer.columns)
    if known and (unknown := [name for name in names if name not in known]):
        near = did_you_mean(unknown[0], known) or known_names("", known)  # tables have many columns
        raise ConfigError([Fault("--columns", 0, f"unknown column '{unknown[0]}'. {near}")])
    rows = [{name: row.get(name) for name in names} for row in answer.rows]
    return replace(answer, rows=rows, columns=names, essential=(), text="")


def audit_answer(audit: Audit) -> Answer:
    """Return the rows of an audit; a terminal shows the task where there are several."""
    several = len({row.task for row in audit.rows}) > 1
    shown = [name for name in _OF_AUDIT if name != "task" or several]
    return Answer([row.columns for row in audit.rows], audit.notes, shown, all_rows=True)


def document(answer: Answer, command: str) -> str:
    """Return the JSON document of an answer; numbers that JSON does not have become null."""
    content = {"schema": f"dse/{command}/1", **_content(answer)}
    return json.dumps(content, ensure_ascii=False, allow_nan=False)


def _content(answer: Answer) -> dict[str, object]:
    from dse.store import plain_cell

    rows = [{str(key): plain_cell(value) for key, value in row.items()} for row in answer.rows]
    sections = {title: _content(section) for title, section in answer.sections.items()}
    return {
        "rows": rows,
        "notes": [*answer.lead, *answer.notes],
        **({"sections": sections} if sections else {}),
    }


def _frame(answer: Answer) -> pandas.DataFrame:
    import pandas

    if not answer.rows:
        return pandas.DataFrame(columns=list(answer.columns))
    return pandas.DataFrame(list(answer.rows))


def _print_table(answer: Answer) -> None:
    """Print a table that fits the terminal: no header and no number is broken."""
    columns = list(answer.columns) or list(dict.fromkeys(key for row in answer.rows for key in row))
    rows = list(answer.rows if answer.table is None else answer.table)
    for name in columns:
        low, high = f"{name}_low", f"{name}_high"
        if any(low in row for row in rows):
            rows = [with_interval(row, name, row.get(low), row.get(high)) for row in rows]
    ends = {f"{name}{end}" for name in columns for end in ("_low", "_high")}
    columns = [name for name in columns if name not in ends]
    width = _width() or _PIPED
    if len(rows) > 1:
        columns = [name for name in columns if any(_text(row, name) not in ("", "-") for row in rows)]
    fits = _total(_least_width(name, rows) for name in columns) <= width
    same = [] if fits and len(rows) < _FEW_ROWS else _same(rows, columns)
    columns = [name for name in columns if name not in same]
    if same:
        texts = [f"{name} {_text(rows[0], name)}" for name in same]
        print("\n".join(_wrap(f"in all rows: {' · '.join(texts)}", width)))
    shown = rows
    if len(rows) > MOST_ROWS and not answer.all_rows:
        spaced = [round(i * (len(rows) - 1) / (MOST_ROWS - 1)) for i in range(MOST_ROWS)]
        shown = [rows[place] for place in sorted(answer.best() if answer.best else spaced)]
    groups = [name for name in answer.groups if name in columns]
    needed = {name: _least_width(name, shown) for name in columns if name not in groups}
    left_out = _left_out(needed, answer.essential, answer.telling, width)
    side_by_side = [name for name in needed if name not in left_out]
    if _total(needed[name] for name in side_by_side) <= width:
        _print_grid(shown, side_by_side, needed, width, groups)
    else:
        left_out = []
        pairs = [[(name, _text(row, name)) for name in columns] for row in shown]
        print("\n\n".join(listing([pair for pair in row if pair[1]], width) for row in pairs))
    if len(shown) < len(rows):
        which = "those that add most to the front" if answer.best else "evenly spaced"
        text = f"{len(shown)} of {len(rows)} rows, {which}; --format csv prints all"
        print("\n".join(_wrap(text, width)))
    if left_out:
        text = f"too narrow for {', '.join(left_out)}; --columns NAMES prints what you name"
        print("\n".join(_wrap(text, width)))


def with_interval(row: Row, name: str, low: object, high: object) -> Row:
    """Return a row for a terminal: a number whose range is open is a text, and so is a corrected accuracy."""
    from dse.measure.hardware.interval import is_open
    from dse.store import plain_cell

    value, low, high = plain_cell(row.get(name)), plain_cell(low), plain_cell(high)
    if not (isinstance(low, int | float) and isinstance(high, int | float)):
        return row
    if is_open(low, high):
        return {**row, name: f"at least {cell(low)}"}
    return {**row, name: f"{value:.3f} ({low:.3f}-{high:.3f})"} if name.endswith("corrected") else row


def _same(rows: Sequence[Row], columns: Sequence[str]) -> list[str]:
    """Return the columns with one value in all of several rows; the first column is never among them."""
    if len(rows) < 2:
        return []
    return [name for name in columns[1:] if len({_text(row, name) for row in rows}) == 1]


def _least_width(name: str, rows: Sequence[Row]) -> int:
    """Return the width below which a column would break a number, a header or a word."""
    cells = [_text(row, name) for row in rows]
    if _is_prose(name, rows):
        words = max((len(word) for text in cells for word in text.split()), default=0)
        return max(len(name), words, min(_PROSE, max(map(len, cells))))
    return max(len(name), *map(len, cells))


def _is_prose(name: str, rows: Sequence[Row]) -> bool:
    """Return whether a column holds sentences, which may be wrapped between words."""
    return any(isinstance(text := row.get(name), str) and len(text) > _PROSE and " " in text for row in rows)


def _total(widths: Iterable[int]) -> int:
    each = list(widths)
    return sum(each) + _GAP * (len(each) - 1)


def _left_out(
    needed: Mapping[str, int], essential: Sequence[str], telling: Sequence[str], width: int
) -> list[str]:
    """Return the columns that do not fit: of those not essential the last, but telling ones after others."""
    out: list[str] = []
    for name in sorted([*needed][::-1], key=lambda name: name in telling) if essential else ():
        if _total(needed[x] for x in needed if x not in out) <= width:
            break
        if name not in essential:
            out.append(name)
    return [name for name in needed if name in out]


def _print_grid(
    rows: Sequence[Row], columns: Sequence[str], needed: Mapping[str, int], width: int, groups: Sequence[str]
) -> None:
    """Print the header once, and the rows below the values of the groups that they are of."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from dse.store import plain_cell

    console = Console(width=width, highlight=False)
    numeric = {
        name: all(isinstance(plain_cell(row.get(name)), int | float | None) for row in rows)
        for name in columns
    }

    def print_part(part: Sequence[Row], has_header: bool) -> None:
        table = Table(
            box=None, pad_edge=False, padding=(0, _GAP, 0, 0), header_style="bold", show_header=has_header
        )
        for name in columns:
            table.add_column(
                Text(one_line(name)),
                justify="right" if numeric[name] else "left",
                no_wrap=not _is_prose(name, rows),
                min_width=needed[name],
            )
        for row in part:
            table.add_row(*(Text(_text(row, name)) for name in columns))
        console.print(table)

    if not groups:
        print_part(rows, True)
        return
    print_part([], True)
    for values, part in itertools.groupby(rows, lambda row: [_text(row, name) for name in groups]):
        console.print(Text(", ".join(values), style="bold"))
        print_part(list(part), False)


def _wrap(text: str, width: int, subsequent_indent: str = "") -> list[str]:
    """Return lines that break between words alone; spaces within them stay, and options with their value."""
    whole = _OPTION.sub(lambda option: option[0].replace(" ", _KEPT), one_line(text))
    broken = textwrap.wrap(
        whole,
        width,
        subsequent_indent=subsequent_indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_KEPT, " ") for line in broken]


def wrapped(text: str) -> str:
    """Return a text wrapped between words at the width of the terminal."""
    width = _width()
    return "\n".join(_wrap(text, width)) if width else one_line(text)


def listing(pairs: Sequence[tuple[str, str]], width: int | None = None) -> str:
    """Return names and texts side by side, wrapped between words at the width of the terminal.

    width: in characters; None: that of the terminal, and without one no line is wrapped.
    """
    width = width or _width()
    pairs = [(one_line(name), one_line(text)) for name, text in pairs]
    indent = max((len(name) for name, _ in pairs), default=0) + _GAP
    longest_word = max((len(word) for _, text in pairs for word in text.split()), default=0)
    if width is None or width - indent < max(_PROSE // 2, min(longest_word, width - _GAP)):
        indent = indent if width is None else _GAP
    listed = []
    for name, text in pairs:
        head = f"{name:<{indent}}" if len(name) + _GAP <= indent else f"{name}{' ' * _GAP}"
        if width is None:
            listed.append(f"{head}{text}".rstrip())
            continue
        wrapped = _wrap(f"{head}{text}", width, subsequent_indent=" " * indent)
        listed += wrapped or [name]
    return "\n".join(listed)


def _width() -> int | None:
    """Return the width of the terminal or $COLUMNS in characters, None where the output goes elsewhere."""
    if not (sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdecimal()):
        return None
    return max(shutil.get_terminal_size().columns, 1)


def _text(row: Row, name: str) -> str:
    """Return a value of a row as text; of an error two digits are known at most."""
    return cell(row.get(name), 2 if name.endswith("_se") else 4)


def cell(value: object, digits: int = 4) -> str:
    """Return a value as text for a table: some significant digits, '-' for a missing value."""
    from dse.store import plain_cell

    value = plain_cell(value)
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.0f}" if abs(value) >= 10_000 else f"{value:.{digits}g}"
    return one_line(str(value))
