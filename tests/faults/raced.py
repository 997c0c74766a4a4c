"""Studies of real trainings for kills: a race with all that goes with one, and four families without one.

As a program it runs a study for each line of stdin: in its own process, so that every kernel is loaded, or in
a fork, which may send itself a signal at a moment. A moment is a change on the disk: a file or folder gets
its name, or the book is written; in the coordinator, or in the fork that works for it.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import signal
import sys
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from dse import store
from dse.cli import main
from dse.cli.commands import search
from dse.study import workers
from tests.in_process import Forked, InProcess

_SNN = {"kind": "snn", "hidden": {"choice": [[4], [6], [8], [10]]}, "input_delays": {"choice": [[0], [0, 2]]}}
_RACE = {
    "model": _SNN,
    "limits": ["n_weights <= 120"],
    "search": {
        "sampler": "tpe",
        "n_trials": 7,
        "batch": 5,
        "repeats": 2,
        "racing": {"rungs": [1, 3]},
    },
}
_MIXED = {
    "model": {
        "choice": [
            {"kind": "knn", "channels": "each", "window_ms": 20.0},
            {"kind": "mlp", "channels": "each", "window_ms": 20.0, "hidden": 4},
            {"kind": "elm", "window_ms": 20.0, "windows": 2, "hidden": 8},
            {**_SNN, "hidden": [6]},
        ]
    },
    "search": {"sampler": "grid", "repeats_on_front": 2},
}
SPACES = {"race": _RACE, "mixed": _MIXED}

MOMENTS = {
    r"/checkpoints/.*": "a checkpoint",
    r"/runs/[^/]*": "a record",
    r"/precision/.*": "a precision",
    r"/(trials|points)\.parquet": "the tables",
    r"/study\.sqlite\.copy": "the copy of the book",
}
"""Pattern of a path in a study's folder -> what happens there."""

_FASTER = 1000
"""How much faster the clock of a study runs: its tables are refreshed in the first second, not minute."""


def write(folder, name):
    """Write a search space, and its recordings of three classes in two sessions."""
    rng = np.random.default_rng(1)
    label, session = np.repeat(np.arange(3), 8), np.tile([0, 1], 12)
    rate = np.full((len(label), 1, 4), 0.05)
    rate[np.arange(len(label)), 0, label] = 0.4
    np.savez(folder / "x.npz", spikes=rng.random((len(label), 14, 4)) < rate, label=label, session=session)
    columns = {"fabric": "label", "session": "session"}
    space = {
        "study": "killed",
        "seed": 5,
        "data": {"kind": "raster", "file": "x.npz", "step_ms": 5.0, "columns": columns},
        "task": {"target": "fabric"},
        "window": {"n_steps": 12, "at": "middle"},
        "split": {"stratified": {"validation": 0.5}},
        "evaluation": {"leave_out": "session"},
        "training": {"epochs": 5, "batch_size": 6, "learning_rate": 0.02},
        "decision": {"phi": [0, 2], "theta": [0.4, 0.6]},
        "precision": {"weight_bits": [4]},
        "hardware": ["loihi1_silicon"],
        "objectives": ["accuracy:max", "energy_uj:min"],
        "execution": {"jobs": 2, "checkpoint_s": 0},
        **SPACES[name],
    }
    (folder / "killed.yaml").write_text(yaml.safe_dump(space, sort_keys=False))


def run(folder, executor, watch):
    """Run the study of a folder by the command line, but for its page; return the exit code."""
    real, put = time.monotonic, store.Book.put

    def noticed(book, table, rows):
        written = list(rows)
        watch.look_at(table, written)
        put(book, table, written)

    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()):
        patch.setattr(workers, "Loky", executor)
        patch.setattr(store.Book, "put", noticed)
        patch.setattr(search, "_page", lambda study: "no page")
        patch.setattr(os, "fsync", lambda handle: None)  # the machine goes on
        patch.setattr(time, "monotonic", lambda: _FASTER * real())
        return main(["run", str(folder / "killed.yaml"), "--results", str(folder), "--quiet"])


class _Watch:
    """Writes the moments of a study to a file, and sends a signal at one of them.

    Args:
        folder: of the search space.
        kill: number of the signal; who gets it: 'coordinator', 'both', or 'worker', which may be the
            coordinator itself; moment and at, the first being 1, or after_s.
    """

    def __init__(self, folder: Path, kill: dict[str, Any] | None) -> None:
        self._folder, self._kill, self._coordinator = folder, kill or {}, os.getpid()
        self._seen = folder / "moments"
        self._seen.write_text("")
        if "after_s" in self._kill:
            timer = threading.Timer(self._kill["after_s"], self._send)
            timer.daemon = True
            timer.start()

    def look(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Look at what Python is about to do (`sys.addaudithook`)."""
        if event == "os.rename":
            study, place = re.escape(f"{self._folder}/killed"), str(arguments[1])
            for moment in (name for pattern, name in MOMENTS.items() if re.fullmatch(study + pattern, place)):
                self._notice(moment)

    def look_at(self, table: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Look at the rows that the coordinator is about to write to the book."""
        names = {row["name"] for row in rows} if table == "study" else set()
        is_round = any(name.startswith("racing/") for name in names)
        self._notice("a rung is decided" if is_round else "the book")

    def _notice(self, moment: str) -> None:
        with self._seen.open("r+") as file:
            before = file.read().splitlines()
            file.write(f"{moment}\n")
        if self._kill.get("moment") == moment and before.count(moment) + 1 == self._kill["at"]:
            self._send()

    def _send(self) -> None:
        (self._folder / "sent").touch()
        both = self._coordinator, os.getpid()
        for process in {"coordinator": both[:1], "worker": both[1:], "both": both}[self._kill["who"]]:
            os.kill(process, self._kill["number"])


def _serve():
    """Run studies; a line holds folder, whether in a fork, and the kill; an exit code is printed for each."""
    watch = None
    sys.addaudithook(lambda event, arguments: watch and watch.look(event, arguments))
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where the tests run under nohup
    for line in sys.stdin:
        place, is_forked, kill = json.loads(line)
        if is_forked and (child := os.fork()):
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        else:
            watch, code = _Watch(Path(place), kill), 1
            try:
                with open(f"{place}/told", "w") as told, contextlib.redirect_stderr(told):
                    code = run(Path(place), Forked if is_forked else InProcess, watch)
            except BaseException:
                Path(place, "told").write_text(traceback.format_exc())
            if is_forked:
                os._exit(code)
            watch = None
        print(code, flush=True)


if __name__ == "__main__":
    _serve()
