"""The environment of a study, stored beside its results: machine, interpreter and versions."""

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
        Damaged: the file is not what was written, or is that of another study.
        StoreError: it cannot be read now.
    """
    path = folder / store.ENVIRONMENT
    if not path.exists():
        return []
    written = store.read_json(path)
    if not isinstance(written, list) or not all(isinstance(one, dict) for one in written):
        raise store.damaged(path, "holds no list of sessions")
    named = [one["identity"] for one in written if one.get("identity")]
    if (named[-1] if named else "") != store.identity(path):
        raise store.damaged(path, "is a file of another study")
    return written


def begin(folder: Path, earlier: list[Any], *, is_sealed: bool = True) -> None:
    """Write that a session begins; `is_sealed`: whether all files of the study have seals.

    The first session of a study draws its identity; a study that an earlier version began has none.
    """
    identity = store.identity(folder / store.ENVIRONMENT) or store.witnessed(folder)
    if not (identity or earlier or any(folder.glob("artefacts/*/repeat_*"))):
        identity = store.new_identity()
    session = {**describe(), "sealed": is_sealed, **({"identity": identity} if identity else {})}
    store.write_json(folder / store.ENVIRONMENT, [*earlier, session])


def process_before(folder: Path) -> int | None:
    """Return the process of the session before the one that has begun; None: none is known."""
    process = sessions(folder)[-2:][0].get("process")
    return process if type(process) is int and process != os.getpid() else None


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
