"""Entries that are whole or not there, whoever writes, reads, removes or dies at the same time."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dse.data.dataset import cache

ROOT = Path(__file__).resolve().parents[3]


def entry(root, key, size=1000):
    """Make an entry with a file of some bytes; return its folder."""

    def fill(folder):
        (folder / "data").write_bytes(b"x" * size)

    return cache.made(root, key, fill)


def keys(root):
    return {path.name for path in root.iterdir() if path.name[0] != "."}


def parts(root):
    return list(root.glob(".writing-*"))


def used_at(root, key, seconds):
    os.utime(root / key / "entry.json", (seconds, seconds))


@pytest.fixture
def root(tmp_path):
    cache.tidy(tmp_path / "cache")
    return tmp_path / "cache"


@pytest.fixture
def room_for_two(monkeypatch):
    monkeypatch.setenv("DSE_CACHE_GIB", repr(2500 / 2**30))


def started(code, root):
    """Run code in another process, with the root as its argument; a line on stdout says that it is there."""
    text = (
        "import sys, time; from pathlib import Path; from dse.data.dataset import cache\n"
        f"root = Path(sys.argv[1])\n{code}"
    )
    return subprocess.Popen(
        [sys.executable, "-c", text, str(root)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )


def line(process):
    return process.stdout.readline().strip()


def killed(process):
    process.send_signal(signal.SIGKILL)
    process.communicate()


def test_what_was_made_is_there(root):
    folder = entry(root, "a")
    assert folder == root / "a"
    assert cache.find(root, "a") == folder
    assert (folder / "data").read_bytes() == b"x" * 1000
    assert cache.find(root, "b") is None

    def never(folder):
        raise AssertionError("what is there is not made again")

    assert cache.made(root, "a", never) == folder


@pytest.mark.parametrize("damage", ["cut", "longer", "lost", "no sizes", "torn sizes", "odd sizes"])
def test_a_damaged_entry_is_removed_and_made_again(root, damage):
    folder = entry(root, "a")
    if damage in ("cut", "longer"):
        (folder / "data").write_bytes(b"x" * (999 if damage == "cut" else 1001))
    elif damage == "lost":
        (folder / "data").unlink()
    elif damage == "no sizes":
        (folder / "entry.json").unlink()
    else:
        (folder / "entry.json").write_text('{"data": 10' if damage == "torn sizes" else '["data"]')
    assert cache.find(root, "a") is None
    assert keys(root) == set() and not parts(root)
    assert (entry(root, "a") / "data").stat().st_size == 1000


def test_the_least_recently_used_go_first(root, room_for_two):
    for seconds, key in enumerate("abc"):
        entry(root, key)
        used_at(root, key, seconds)
    cache.tidy(root)
    assert keys(root) == {"b", "c"}
    assert cache.find(root, "b")  # a use: now c is the oldest
    entry(root, "d")
    assert keys(root) == {"b", "d"}


def test_what_was_used_within_a_day_stays(root, room_for_two, monkeypatch):
    for key in "abc":
        entry(root, key)
    now, day_s = int(time.time()), 24 * 3600
    for key, hours in (("a", 23), ("b", 12), ("c", 1)):
        used_at(root, key, now - 3600 * hours)
    cache.tidy(root)
    assert keys(root) == {"a", "b", "c"}
    used_at(root, "a", now - day_s - 3600)
    cache.tidy(root)
    assert keys(root) == {"b", "c"}
    monkeypatch.setenv("DSE_CACHE_GIB", "0")  # an entry larger than the limit
    used_at(root, "b", 0)
    cache.tidy(root)
    assert keys(root) == {"c"}


def test_what_is_mapped_outlives_its_entry(root):
    folder = entry(root, "a")
    mapped = np.memmap(folder / "data", np.uint8, mode="r")
    cache.discard(root, "a")
    cache.discard(root, "never made")
    assert keys(root) == set() and not parts(root)
    assert bytes(mapped) == b"x" * 1000


def test_what_is_no_entry_is_nobodys_to_remove(root, room_for_two):
    (root / "thesis").mkdir()
    (root / "thesis" / "chapter").write_bytes(b"x" * 5000)
    (root / "notes").write_text("mine")
    for seconds, key in enumerate("abc"):
        entry(root, key)
        used_at(root, key, seconds)
    cache.tidy(root)
    assert keys(root) == {"b", "c", "thesis", "notes"}
    assert (root / "thesis" / "chapter").exists()


WRITER = """
def fill(folder):
    (folder / "data").write_bytes(b"y" * 1000)
    print("writing", flush=True)
    while not (root.parent / "go").exists():
        time.sleep(0.005)
cache.made(root, "a", fill)
print("made", flush=True)
"""


def test_two_processes_that_write_the_same_entry(root):
    both = [started(WRITER, root) for _ in range(2)]
    assert [line(process) for process in both] == ["writing", "writing"]
    assert len(parts(root)) == 2
    (root.parent / "go").touch()
    assert [line(process) for process in both] == ["made", "made"]
    assert [process.wait(120) for process in both] == [0, 0]
    for process in both:
        process.communicate()
    assert keys(root) == {"a"} and not parts(root)
    assert (root / "a" / "data").read_bytes() == b"y" * 1000


def test_kill_9_in_the_middle_of_a_write(root):
    dead, alive = started(WRITER, root), started(WRITER, root)
    assert [line(dead), line(alive)] == ["writing", "writing"]
    killed(dead)
    assert keys(root) == set() and len(parts(root)) == 2
    cache.tidy(root)
    assert len(parts(root)) == 1, "what a living process writes stays"
    killed(alive)
    (root / ".writing-a-00").mkdir()  # before anything was written
    assert (entry(root, "a") / "data").read_bytes() == b"x" * 1000
    assert not parts(root)


@pytest.mark.parametrize("moment", ["in a write", "at the rename", "given up"])
def test_a_write_that_fails_leaves_nothing(root, monkeypatch, moment):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    def fill(folder):
        (folder / "data").write_bytes(b"x")
        assert len(parts(root)) == 1
        if moment == "given up":
            raise KeyboardInterrupt
        if moment == "in a write":
            full()

    if moment == "at the rename":
        monkeypatch.setattr("dse.store.files.os.replace", full)
    with pytest.raises((OSError, KeyboardInterrupt), match=r"^$|No space left"):
        cache.made(root, "a", fill)
    assert keys(root) == set() and not parts(root)


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"DSE_CACHE": "/x/mine", "XDG_CACHE_HOME": "/x/cache"}, "/x/mine"),
        ({"DSE_CACHE": "~/mine"}, "/x/home/mine"),
        ({"XDG_CACHE_HOME": "/x/cache"}, "/x/cache/dse"),
        ({"XDG_CACHE_HOME": "cache"}, "/x/home/.cache/dse"),
        ({}, "/x/home/.cache/dse"),
    ],
)
def test_where_it_is(environment, expected, monkeypatch):
    for name in ("DSE_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"HOME": "/x/home", **environment}.items():
        monkeypatch.setenv(name, value)
    assert cache.usual_root() == Path(expected)


def test_a_home_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "file" / "cache"))
    root, note = cache.opened_root(tmp_path / "study" / "cache")
    assert root == tmp_path / "study" / "cache"
    assert note.startswith(f"prepared data cannot be cached for other runs and are written to {root}: ")
    assert "Not a directory" in note
    entry(root, "a")
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "new" / "cache"))
    assert cache.opened_root(tmp_path / "study" / "cache") == (tmp_path / "new" / "cache", "")

    def homeless():
        raise RuntimeError("Could not determine home directory.")

    for name in ("DSE_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pathlib.Path.home", homeless)
    assert cache.opened_root(tmp_path / "study" / "cache")[0] == root


def test_the_limit(tmp_path, monkeypatch):
    for disk_gib, expected in ((100, 10), (1000, 20)):
        disk = SimpleNamespace(total=disk_gib * 2**30)
        monkeypatch.setattr("dse.data.dataset.cache.shutil.disk_usage", lambda path, disk=disk: disk)
        assert cache.limit_bytes(tmp_path) == expected * 2**30
    monkeypatch.setenv("DSE_CACHE_GIB", "0.5")
    assert cache.limit_bytes(tmp_path) == 2**29
    for wrong in ("-1", "much", "nan", "inf"):
        monkeypatch.setenv("DSE_CACHE_GIB", wrong)
        with pytest.raises(
            ValueError, match=f"DSE_CACHE_GIB must be a number of GiB, at least 0, got '{wrong}'"
        ):
            cache.limit_bytes(tmp_path)
