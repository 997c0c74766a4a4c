"""Audits of a few recordings, in which what is planted is as clear to fewer trees."""

import pytest

from dse.study.audit import readers


@pytest.fixture(autouse=True, scope="module")
def fewer_trees():
    """A seventh of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(readers, "N_TREES", 25)
        yield
