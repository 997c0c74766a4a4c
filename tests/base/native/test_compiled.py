"""Compiled code is kept on disk under the sources of its package, and made anew when one of them changes."""

import copy
import pickle
import subprocess
import sys

import pytest

from dse.base.native import compiled as module

KERNEL = """\
from dse.base.native.compiled import compiled
from {package}.constants import FACTOR


@compiled()
def scaled(x):
    return FACTOR * x
"""
CALL = """\
from {package}.kernels import scaled
print(scaled(2.0), *scaled.stats.cache_hits.values())
"""


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "made_package"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "constants.py").write_text("FACTOR = 3.0\n")
    (folder / "kernels.py").write_text(KERNEL.format(package=folder.name))
    return folder


def call(package):
    """Return what the kernel gives in a process of its own, and how often its code came from the disk."""
    code = f"import sys; sys.path.insert(0, {str(package.parent)!r})\n" + CALL.format(package=package.name)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return run.stdout.split()


def test_code_is_compiled_once_and_again_after_any_source_of_its_package_changed(package):
    assert call(package) == ["6.0"]
    assert call(package) == ["6.0", "1"]
    (package / "constants.py").write_text("FACTOR = 5.0\n")  # the file of the kernel is as it was
    assert call(package) == ["10.0"]


@pytest.mark.parametrize("name", ["call", "pickle", "copy"])
def test_a_kernel_is_called_and_copied_before_numba_knows_it(name):
    def twice(x):
        return 2 * x

    late = module.compiled()(twice)
    copies = {"call": lambda x: x, "pickle": lambda x: pickle.loads(pickle.dumps(x)), "copy": copy.copy}
    assert copies[name](late)(3) == 6 and late.__name__ == "twice"


def test_the_stamp_is_of_the_package_and_of_what_is_inlined(package):
    module._sources.cache_clear()
    before = module._sources(package)
    (package / "more.py").write_text("X = 1\n")
    assert module._sources(package) == before  # read once per process
    module._sources.cache_clear()
    assert module._sources(package) != before
    module._sources.cache_clear()


@pytest.mark.parametrize("error", [ImportError, AttributeError, TypeError])
def test_an_index_that_cannot_be_read_is_empty(error):
    def load():
        raise error("a type of a module that is no more")

    assert module._readable(load)() == {}
    assert module._readable(lambda: {"a": 1})() == {"a": 1}


def test_another_fault_of_an_index_is_raised():
    def load():
        raise OSError("disk")

    with pytest.raises(OSError, match="disk"):
        module._readable(load)()
