"""How many faults are injected: a few of each kind, or with FAULTS=N (`make faults`) N of each."""

from __future__ import annotations

import os

import pytest


@pytest.fixture(scope="session")
def n_faults() -> int:
    return int(os.environ.get("FAULTS", "8"))
