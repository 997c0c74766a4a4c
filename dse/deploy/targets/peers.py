"""Other frameworks that run what targets write, in this environment or in one of `make peers`."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path


def interpreter(package: str, *others: str) -> Path | None:
    """Return the Python that has some packages: this one, or that of `make peers` for the first; or None."""
    if all(find_spec(name) is not None for name in (package, *others)):
        return Path(sys.executable)
    python = Path(sys.prefix) / "peers" / package / "bin" / "python"
    return python if python.is_file() else None
