"""Numba functions that are compiled once per version of the engine, and kept on disk between processes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba


@cache
def _sources() -> str:
    """Return a hash of every source file of the engine."""
    found = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator: `numba.njit` with the options, cached, without the interpreter lock.

    Numba's cache is fresh as long as the function's own file is, although the code of other files is inlined
    into it: after an update of one file it would run what was compiled from the old one. Here the cached code
    is that of all files of the engine.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        found = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
        kept: Any = getattr(getattr(found, "_cache", None), "_cache_file", None)
        if hasattr(kept, "_source_stamp"):
            kept._source_stamp = _sources()
        return found

    return decorate
