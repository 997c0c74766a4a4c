"""A disk that fails at any write, is read-only, or cannot be locked; a clock that jumps: nothing is lost."""

from __future__ import annotations

import builtins
import datetime
import errno
import fcntl
import io
import os
import random
import shutil
import time
from pathlib import Path
from typing import Any

import pytest
from pandas.testing import assert_frame_equal

from dse import store
from dse.cli import main
from dse.config import load_space
from dse.store import book
from dse.study import claim, explore, results
from dse.study.doctor import examine

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


@pytest.fixture
def space(whole):
    return load_space(whole / "tiny.yaml")


def finished_runs(study):
    records = [(path, path.stat()) for path in study.glob("runs/*.npz")]
    return {path: (status.st_ino, status.st_mtime_ns) for path, status in records}


def assert_same(study, whole):
    expected = results.open(whole / "results" / "tiny")
    for one, other in ((study.trials, expected.trials), (study.points(), expected.points())):
        one, other = (frame.drop(columns="train_s", errors="ignore") for frame in (one, other))
        assert_frame_equal(one, other, check_exact=True)
    assert examine(study.folder) == []


def harmful(rng, at, study):
    """Return what stands in for os.fsync and does harm at one call, or from it on, and what the harm is."""
    kind = rng.choice(("ENOSPC", "ENOSPC", "EDQUOT", "EIO", "EROFS", "removed"))
    lasts = rng.random() < 0.5
    n_calls = 0

    def fsync(_):
        nonlocal n_calls
        n_calls += 1
        if n_calls == at or (lasts and n_calls > at):
            if kind == "removed":
                shutil.rmtree(study, ignore_errors=True)
            else:
                number = getattr(errno, kind)
                raise OSError(number, os.strerror(number))

    return fsync, "results removed in mid-run" if kind == "removed" else "a full or failing disk"


def test_a_disk_that_fails_at_any_write(whole, space, tmp_path, n_faults, tried):
    calls = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", calls.append)
        explore.run(space, tmp_path / "counted", progress=False)
    assert len(calls) > 20  # beside those of SQLite
    for number in range(max(4, n_faults // 2)):
        rng, folder = random.Random(f"disk {number}"), tmp_path / str(number)
        study = folder / "tiny"
        fsync, kind = harmful(rng, rng.randint(1, len(calls)), study)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "fsync", fsync)
            try:
                explore.run(space, folder, progress=False)
            except store.StoreError as error:
                assert str(error).count("\n") == 0 and str(folder) in str(error), (number, error)
        before = finished_runs(study)
        assert_same(explore.run(space, folder, progress=False), whole)
        assert before.items() <= finished_runs(study).items(), (number, "a run was lost or made twice")
        assert not list(folder.rglob(f"{store.TEMPORARY}*")), number
        shutil.rmtree(folder)
        tried[kind] += 1


@pytest.fixture
def make_read_only(monkeypatch):
    """Let the system refuse every change below a folder, as of a disk that is mounted read-only."""

    def refuse(folder):
        def guard(module, name, writes):
            real = getattr(module, name)

            def guarded(path, *arguments, **more):
                is_path = isinstance(path, str | os.PathLike)
                if is_path and Path(path).is_relative_to(folder) and writes(*arguments, **more):
                    raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
                return real(path, *arguments, **more)

            monkeypatch.setattr(module, name, guarded)

        def opens_to_write(mode="r", *_, **__):
            return bool(set(mode) & set("wax+"))

        for module in (io, builtins):
            guard(module, "open", opens_to_write)
        guard(os, "open", lambda flags, *_, **__: bool(flags & WRITES))
        for name in ("mkdir", "replace", "rename", "unlink", "rmdir", "truncate", "utime"):
            guard(os, name, lambda *_, **__: True)
        connected = book._connected

        def connected_to_read(path, mode):  # as SQLite does of itself there
            return connected(path, "mode=ro" if path.is_relative_to(folder) else mode)

        monkeypatch.setattr(book, "_connected", connected_to_read)

    return refuse


def test_a_read_only_study_is_read_and_not_run(whole, tmp_path, make_read_only, capsys, tried):
    study = Path(shutil.copytree(whole / "results" / "tiny", tmp_path / "results" / "tiny"))
    make_read_only(tmp_path / "results")
    for command in (["skyline"], ["doctor"], ["pick"]):
        assert main([*command, str(study), "--json"]) == 0, capsys.readouterr().err
        tried["a read-only study"] += 1
    capsys.readouterr()
    for arguments in (
        ["run", str(whole / "tiny.yaml"), "--results", str(tmp_path / "results")],
        ["run", str(whole / "tiny.yaml"), "--results", str(tmp_path / "results" / "new")],
        ["dashboard", str(study), "--html", str(study / "page.html")],
        ["pick", str(study), "--export", str(study / "bundle")],
    ):
        assert main(arguments) == 2, arguments
        err = capsys.readouterr().err
        assert err.count("\n") == 1 and "Read-only file system" in err, (arguments, err)
        tried["a read-only study"] += 1


@pytest.fixture
def unlockable(monkeypatch):
    """Folders of a file system without locks."""
    folders = []
    real = fcntl.flock

    def flock(handle, operation):
        if any(Path(os.readlink(f"/proc/self/fd/{handle}")).is_relative_to(folder) for folder in folders):
            raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))
        real(handle, operation)

    monkeypatch.setattr(fcntl, "flock", flock)
    return folders


def test_a_file_system_without_locks(whole, space, tmp_path, unlockable, monkeypatch, tried):
    unlockable.append(tmp_path / "results")
    with pytest.raises(store.StoreError, match=r"cannot be locked \(No locks available\); use a --results"):
        explore.run(space, tmp_path / "results", progress=False)
    assert not [x for x in (tmp_path / "results" / "tiny").iterdir() if x.name != ".lock"]
    unlockable[:] = [tmp_path / "cache"]
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    study = explore.run(space, tmp_path / "results", progress=False)
    assert_same(study, whole)
    assert [*(study.folder / "cache").glob("*/entry.json")]
    tried["no locks"] += 2


@pytest.fixture
def jumping(monkeypatch):
    """Let the clock of the machine jump by up to 30 days, back or forth, each time that it is read."""
    rng, now_s = random.Random(27), time.time()

    def jump():
        return now_s + rng.uniform(-30, 30) * 86400

    class Jumping(datetime.datetime):
        @classmethod
        def now(cls, tz: datetime.tzinfo | None = None) -> Any:
            return cls.fromtimestamp(jump(), tz)

    monkeypatch.setattr(time, "time", jump)
    monkeypatch.setattr(claim, "datetime", Jumping)
    yield


def test_a_clock_that_jumps(whole, space, tmp_path, jumping, monkeypatch, capsys, tried):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    for _ in range(2):  # the second one finds all
        study = explore.run(space, tmp_path, progress=False)
        assert_same(study, whole)
        before = finished_runs(study.folder)
        tried["a clock that jumps"] += 1
    assert finished_runs(study.folder) == before
    page = tmp_path / "page.html"
    assert main(["dashboard", str(study.folder), "--html", str(page)]) == 0, capsys.readouterr().err
