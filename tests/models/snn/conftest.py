"""What tests of spiking networks share."""

import pytest

from dse.models.snn import contrasts


@pytest.fixture(autouse=True)
def few_candidates(request, monkeypatch):
    """A network that starts by contrasts chooses among few, but where the choice itself is tested."""
    if request.path.stem not in ("test_contrasts", "test_printed_spaces", "test_as_printed"):
        monkeypatch.setattr(contrasts, "_CANDIDATES", 64)
