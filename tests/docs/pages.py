"""Run the code blocks of a page of docs/, in order, in an empty folder beside the shipped study.

A `sh` block holds `dse` commands, a `python` block is executed; the `text` block after either shows what it
prints on a terminal. A comment before a block says more: `<!-- file: NAME -->` also writes the block to a
file, and `<!-- not run: REASON -->` has its syntax checked only.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import sys
import types
from pathlib import Path

import yaml

from dse.cli import main
from dse.cli.command_line import parser

_BLOCK = re.compile(
    r"(?:<!-- (?P<mark>file|not run): (?P<what>[^>]+) -->\n)?```(?P<language>\w+)[^\n]*\n(?P<text>.*?)^```$",
    flags=re.DOTALL | re.MULTILINE,
)
_PROGRESS = re.compile(r"preparing data: |\d+/\d+ trial ")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_MASKS = (
    (r"train_s +\S+", "train_s ..."),
    (r"\b\d+\.?\d* s\b", "... s"),
    (r"(ram_bytes|flash_bytes|compiler) +\S.*", r"\1 ..."),
)


class Terminal(io.StringIO):
    """What a command prints, on a terminal."""

    def isatty(self) -> bool:
        return True


def performed(page, check):
    """Return a page with the outputs that its blocks print here.

    Args:
        page: its text.
        check: called with the source of a block that is marked as not run, and its language.
    """
    module = types.ModuleType("page")
    sys.modules["page"] = module
    printed = None
    pieces, end = [], 0
    for block in _BLOCK.finditer(page):
        text = block["text"]
        adjacent = page[end : block.start()].strip() == ""
        pieces.append(page[end : block.start()])
        end = block.end()
        if block["language"] == "text" and printed is not None and adjacent:
            pieces.append(f"```text\n{printed.rstrip()}\n```")
            printed = None
            continue
        pieces.append(block[0])
        printed = None
        if block["mark"] == "not run":
            check(text, block["language"])
            continue
        if block["mark"] == "file":
            Path(block["what"]).write_text(text, encoding="utf-8")
        if block["language"] == "sh":
            printed = _commands(text)
        elif block["language"] == "python":
            with contextlib.redirect_stdout(Terminal()) as stream:
                exec(compile(text, "page", "exec"), module.__dict__)
            printed = _shown(stream)
        elif block["language"] == "yaml":
            yaml.safe_load(text)
    return "".join([*pieces, page[end:]])


def masked(page):
    """Return a page without what differs between runs and machines."""
    for pattern, text in _MASKS:
        page = re.sub(pattern, text, page)
    return page


def syntax(text, language):
    """Raise SyntaxError or SystemExit where a block that is not run cannot be read."""
    if language == "python":
        compile(text, "page", "exec")
    for line in text.splitlines() if language == "sh" else []:
        program, *arguments = shlex.split(line, comments=True) or [""]
        if program == "dse":
            parser(arguments[:1]).parse_args(arguments)


def _commands(text):
    with contextlib.redirect_stdout(Terminal()) as stream, contextlib.redirect_stderr(stream):
        for line in text.splitlines():
            if words := shlex.split(line, comments=True):
                assert words[0] == "dse", line
                code = main(words[1:])
                assert code == 0, f"{line}: exit code {code}\n{stream.getvalue()}"
    return _shown(stream)


def _shown(stream):
    """Return what stands on a terminal, without colours and progress."""
    lines = [_COLOUR.sub("", line).rstrip() for line in stream.getvalue().splitlines()]
    return "\n".join(line for line in lines if not _PROGRESS.match(line))
