"""Questions to a person at a terminal: on stderr, for stdout is for results."""

from __future__ import annotations

import sys

from dse.base.text import lines, one_line


def is_person() -> bool:
    """Return whether there is somebody to ask."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def answered(question: str, default: str = "") -> str:
    """Return what a person answers, the default where there is none or the answer is empty."""
    if not is_person():
        return default
    print(f"{lines(question)}{f' [{default}]' if default else ''}: ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip() or default


def trusts(what: str, digest: str) -> bool:
    """Return whether a person says that code may run."""
    rights = f"is code that would run here with your rights (SHA-256 {digest})"
    question = f"{one_line(what)}\n{rights}.\nRun it, now and later?"
    return answered(question, "no").lower() in ("y", "yes")
