"""How many faults are injected: a few of each kind, or with FAULTS=N (`make faults`) N of each."""

import os
from collections import Counter

import pytest

from dse.study import explore
from tests import tiny_study

_TRIED = Counter[str]()


@pytest.fixture(scope="session")
def n_faults():
    return int(os.environ.get("FAULTS", "8"))


@pytest.fixture(scope="session")
def tried():
    """Faults that were injected, by kind; of each, its test has shown that nothing is lost or believed."""
    return _TRIED


def pytest_terminal_summary(terminalreporter):
    if "FAULTS" in os.environ and _TRIED:
        terminalreporter.section("faults injected")
        for kind, n in _TRIED.items():
            terminalreporter.write_line(f"{kind:<32} {n:>6}")
        terminalreporter.write_line(f"{'in all':<32} {_TRIED.total():>6}")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a finished study's search space, with its results and its cache."""
    folder = tmp_path_factory.mktemp("whole")
    _finish(folder)
    yield folder


@pytest.fixture(scope="module")
def another(whole, tmp_path_factory):
    """The folder of a finished study of the same name and designs as that of `whole`, of another seed."""
    folder = tmp_path_factory.mktemp("another")
    _finish(folder, seed=8)
    return folder / "results" / "tiny"


def _finish(folder, **sections):
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("DSE_CACHE", str(folder / "cache"))
        space = tiny_study.make_space(folder, execution={"jobs": 1}, **sections)
        explore.run(space, folder / "results", progress=False)
