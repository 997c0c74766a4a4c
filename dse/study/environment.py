"""The sessions of a study, in its book: machine, interpreter and versions of each."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dse import store

PACKAGES = ("dse", "numpy", "numba", "torch", "optuna", "pandas", "pyarrow", "scikit-learn", "moocore")


def describe() -> dict[str, object]:
    """Return the interpreter, the machine and the versions of the packages that compute results."""
    return {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "system": platform.platform(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "process": os.getpid(),
        "versions": {name: version for name in PACKAGES if (version := _version(name)) is not None},
    }


def sessions(folder: Path) -> list[Any]:
    """Return the sessions of a study, first to last; none where nothing is written yet.

    Raises:
        Damaged: its book is not what was written.
        StoreError: it cannot be read now.
    """
    return list(store.document(folder, store.ENVIRONMENT, []))


def begin(book: store.Book) -> None:
    """Write that a session begins."""
    book.keep(store.ENVIRONMENT, [*book.document(store.ENVIRONMENT, []), describe()])


def process_before(folder: Path) -> int | None:
    """Return the process of the session before the one that has begun; None: none is known."""
    process = sessions(folder)[-2:][0].get("process")
    return process if type(process) is int and process != os.getpid() else None


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
