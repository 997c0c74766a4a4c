"""The golden vectors of the CUBA network, read from the shared reference folder."""

import functools
from pathlib import Path

import pytest

from benchmarks.golden import Case, read

FILE = Path(__file__).resolve().parents[1] / ".." / "shared" / "reference" / "cuba_golden.npz"

__all__ = ["FILE", "Case", "cases"]


@functools.cache
def cases():
    """Return one pytest parameter per case and mode, or one that skips with its reason."""
    if not FILE.exists():
        return [
            pytest.param(None, marks=pytest.mark.skip(reason="shared/reference/cuba_golden.npz is absent"))
        ]
    return [pytest.param(case, id=f"{case.name}-{case.mode}") for case in read(FILE)]
