"""Consent to code that a file names: what runs because somebody wrote its name into a folder.

A plugin that a search space, a study, a page definition or a bundle names is code of whoever wrote that file.
It runs if its digest is in the user's list, or if the user says yes: to the question on a terminal, or by
`--trust`. A yes is kept: the list is $DSE_CONFIG/trusted, else that of $XDG_CONFIG_HOME/dse, else of
~/.config/dse, a digest and a name per line. Whoever removes a line is asked again.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import os
import secrets
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path

LIST, _KEY = "trusted", "key"

Question = Callable[[str, str], bool]
"""What the code is and its digest -> whether the user says yes."""

# Threads do not inherit it: nothing that is not in the list runs in their name.
_answer: ContextVar[Question | bool] = ContextVar("answer", default=False)


@contextlib.contextmanager
def answering(answer: Question | bool) -> Iterator[None]:
    """Let something say for the user whether code that is not in the list may run; by default it may not."""
    token = _answer.set(answer)
    try:
        yield
    finally:
        _answer.reset(token)


def consents(what: str, digest: str, *, asks: bool) -> bool:
    """Return whether code may run, and keep a yes; a list that cannot be written is no reason against it.

    Args:
        what: the code, in a few words.
        digest: SHA-256 of all that decides what runs.
        asks: whether the user may be asked.
    """
    if digest in _listed():
        return True
    answer = _answer.get()
    if not (answer if isinstance(answer, bool) else asks and answer(what, digest)):
        return False
    with contextlib.suppress(OSError, RuntimeError):
        with _made(LIST).open("a", encoding="utf-8", errors="replace") as file:
            file.write(f"{digest} {what!r}\n")
    return True


def _listed() -> set[str]:
    try:
        text = (_folder() / LIST).read_text("utf-8", "replace")
    except (OSError, RuntimeError):
        return set()
    return {line.partition(" ")[0] for line in text.splitlines()}


def token(name: str) -> str:
    """Return a text that only this user can know, the same one for a name as long as the key is kept."""
    key = secrets.token_bytes(32)
    with contextlib.suppress(OSError, RuntimeError):
        with contextlib.suppress(FileExistsError):
            file = os.open(_made(_KEY), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(file, "wb") as new:
                new.write(key)
        kept = (_folder() / _KEY).read_bytes()
        key = kept if len(kept) == len(key) else key
    return hmac.digest(key, name.encode(errors="surrogateescape"), hashlib.sha256).hex()


def _made(name: str) -> Path:
    folder = _folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder / name


def _folder() -> Path:
    """Return the folder of the user's own files."""
    if folder := os.environ.get("DSE_CONFIG"):
        return Path(folder).expanduser().absolute()
    base = Path(os.environ.get("XDG_CONFIG_HOME", ""))
    # The specification of XDG_CONFIG_HOME says that a relative path is invalid.
    return (base if base.is_absolute() else Path.home() / ".config") / "dse"
