"""The environment of a study, stored beside its results: machine, interpreter and versions."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from datetime import UTC, datetime

PACKAGES = ("dse", "numpy", "numba", "torch", "optuna", "pandas", "pyarrow", "scikit-learn", "moocore")


def describe() -> dict[str, object]:
    """Return the interpreter, the machine and the versions of the packages that compute results."""
    return {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "system": platform.platform(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "versions": {name: version for name in PACKAGES if (version := _version(name)) is not None},
    }


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
