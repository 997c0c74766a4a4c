"""C on this machine: every spike and decision of random networks equals the engine's."""

from __future__ import annotations

from pathlib import Path

import pytest

from dse.deploy.targets.c99 import C99
from tests.deploy.c import nets


@pytest.mark.parametrize("number", range(3))
def test_spikes_and_decisions_equal(number: int, tmp_path: Path) -> None:
    made, fired = nets.case(number)
    C99().write(made, tmp_path)
    assert C99().verify(made, tmp_path, nets.reference(made, fired)).kind == "faithful"
