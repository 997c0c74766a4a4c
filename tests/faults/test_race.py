"""Real trainings that are killed at any moment: the same command ends with the same tables, bit by bit."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from dse import store
from dse.study.ledger import read_entries
from tests.faults import raced
from tests.study.test_crash import ROOT
from tests.waiting import PATIENCE_S, until

KILLS = 4  # of a study; fewer where faults are few
SIGNALS = (
    ("coordinator", signal.SIGKILL),
    ("worker", signal.SIGKILL),
    ("both", signal.SIGKILL),
    ("coordinator", signal.SIGTERM),
    ("coordinator", signal.SIGHUP),
    ("coordinator", signal.SIGINT),
)


class Server:
    """A process that runs studies, each in a fork; first one of each kind, undisturbed, by itself."""

    def __init__(self, cache: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", raced.__name__],
            cwd=ROOT,
            env={**os.environ, "DSE_CACHE": str(cache)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

        self._undisturbed: dict[str, Path] = {}

    def undisturbed(self, name: str, folders: pytest.TempPathFactory) -> Path:
        """Return the folder of a study that nothing has ended early."""
        if name not in self._undisturbed:
            folder = self._undisturbed[name] = folders.mktemp(name)
            raced.write(folder, name)
            assert self._run(folder, False, None) == 0, (folder / "told").read_text()
        return self._undisturbed[name]

    def run(self, folder: Path, kill: dict[str, Any] | None = None) -> int:
        """Run the study of a folder, to a kill as in `raced`; return its exit code once it has ended."""
        (folder / "sent").unlink(missing_ok=True)
        code = self._run(folder, True, kill)
        until(lambda: is_free(folder), "its worker to end")
        return code

    def _run(self, *request: object) -> int:
        assert self._process.stdin is not None and self._process.stdout is not None
        print(json.dumps(request, default=str), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        assert line, "the server has ended"
        return int(line)

    def close(self) -> None:
        self._process.communicate(timeout=PATIENCE_S)
        assert self._process.returncode == 0


def is_free(folder):
    """Return whether no process works on the study of a folder."""
    try:
        with store.exclusive(folder / "killed"):
            return True
    except store.StoreError:
        return False


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    started = Server(tmp_path_factory.mktemp("cache"))
    yield started
    started.close()


def ended(folder):
    """Return the runs that have finished or failed, and which file says so; those that stopped may go on."""
    runs = (folder / "killed" / "runs").glob("*.npz")
    last = {path: path.stat() for path in runs if store.read_record(path)["status"] != "stopped"}
    return {str(path.relative_to(folder)): (x.st_ino, x.st_mtime_ns) for path, x in last.items()}


def documents(study):
    """Return what racing has written down in a study."""
    with store.Book(study) as book:
        return {row["name"]: row["content"] for row in book.rows("study", "name GLOB 'racing/*'")}


def assert_same(folder, whole):
    for name in ("trials.parquet", "points.parquet"):
        tables = [pd.read_parquet(of / "killed" / name) for of in (folder, whole)]
        one, other = (t.drop(columns=[x for x in t if x.startswith("train_s")]) for t in tables)
        assert_frame_equal(one, other, check_exact=True)
    assert ended(folder).keys() == ended(whole).keys()
    racing = [documents(of / "killed") for of in (folder, whole)]
    assert racing[0] == racing[1]
    entries = [read_entries(of / "killed") for of in (folder, whole)]
    one, other = ([(e.trial, e.batch, e.design, e.values, e.excluded) for e in each] for each in entries)
    assert one == other
    assert not list(folder.rglob(f"{store.TEMPORARY}*"))
    assert not list((folder / "killed" / "checkpoints").glob("*/runs/*.npz"))


def drawn(rng, moments, seconds):
    """Return a kill: three in four at a moment, each kind as often as any other."""
    who, number = rng.choice(SIGNALS)
    if rng.random() < 0.25:
        return {"after_s": rng.uniform(0, seconds), "who": "coordinator", "number": number}
    moment = rng.choice(sorted(moments))
    return {"moment": moment, "at": rng.randint(1, moments[moment]), "who": who, "number": number}


def test_killed_at_every_moment_of_a_race(tmp_path, tmp_path_factory, server, n_faults, tried):
    n_killed = number = 0
    while n_killed < (n_faults if n_faults >= 100 else n_faults // 4):  # each takes some seconds
        rng, name = random.Random(number), "mixed" if number % 4 == 3 else "race"
        whole = server.undisturbed(name, tmp_path_factory)
        moments = Counter((whole / "moments").read_text().splitlines())
        folder = tmp_path / str(number)
        folder.mkdir()
        raced.write(folder, name)
        kept = {}
        for _ in range(KILLS if n_faults >= 100 else KILLS // 2):
            kill = drawn(rng, moments, seconds=3.0)
            code, told = server.run(folder, kill), (folder / "told").read_text()
            about = f"study {number} ({name}), {kill}: exit {code}\n{told}"
            number_, is_sent = kill["number"], (folder / "sent").exists()
            survives = not is_sent or (kill["who"] == "worker" and code == 0)
            assert code == 0 if survives else code in (-number_, 128 + number_), about
            assert "Traceback" not in told and "Exception" not in told, about
            now = ended(folder)
            assert kept.items() <= now.items(), f"a run was lost or made twice: {about}"
            kept = now
            if is_sent:
                n_killed += 1
                at = kill.get("moment", "a random moment")
                tried[f"race: {signal.Signals(number_).name} of {kill['who']}: {at}"] += 1
        assert server.run(folder) == 0, (number, (folder / "told").read_text())
        assert kept.items() <= ended(folder).items(), f"a run was lost or made twice: study {number}"
        assert_same(folder, whole)
        number += 1
