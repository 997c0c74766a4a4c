"""Text that leaves the program. Names in recordings and folders come from anywhere, and must act nowhere.

Every text that is written for a terminal, a C compiler or a reader of Markdown goes through a function of
this file. What is data, such as a table or a JSON document, keeps its names as they are.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Callable

# Control characters, format characters (of direction, of no width), surrogates, ends of lines.
_UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")
_C_PAIR = re.compile(r"(?<=[*/?])(?=[*/?])")  # opens or ends a comment, begins a trigraph
_MARKDOWN = re.compile(r"([\\`*\[\]<|&])")


def one_line(text: str) -> str:
    r"""Return a text in one line: unseen characters are escaped, as `\n`, `\x1b` or `\u202e`."""
    return _escaped(text, lambda x: ascii(x)[1:-1])


def lines(text: str) -> str:
    """Return a text of several lines for a terminal; only ends of lines and tabs stay as they are."""
    return _escaped(text, lambda x: x if x in "\n\t" else ascii(x)[1:-1])


def json_line(text: str) -> str:
    """Return a JSON document that a terminal can show; its values stay the same."""
    return _escaped(text, lambda x: json.dumps(x)[1:-1])


def c_comment(text: str) -> str:
    r"""Return a text for a comment in C or C++, `/* */` or `//`, which it neither ends nor continues."""
    return _C_PAIR.sub(" ", one_line(text).replace("\\", "|"))


def c_characters(text: str) -> list[str]:
    """Return the characters of a C string; what is not plain ASCII is written as octal bytes of UTF-8."""
    return [chr(b) if 32 <= b < 127 and chr(b) not in "\"'\\?" else f"\\{b:03o}" for b in text.encode()]


def markdown(text: str) -> str:
    """Return a text for within a line of Markdown: no link of its own, no HTML, no end of a table's cell."""
    return _MARKDOWN.sub(r"\\\1", one_line(text))


def _escaped(text: str, escape: Callable[[str], str]) -> str:
    if text.isprintable():
        return text
    return "".join(escape(x) if unicodedata.category(x) in _UNSEEN else x for x in text)
