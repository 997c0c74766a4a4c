"""The lines of a journal: the file that Optuna's journal storage reads and appends, with a checksum per line.

A line is the JSON object of an operation of Optuna and three members that Optuna ignores:

    n       number of the line, from 1; lines of other programs in between do not count
    trial   number of the trial that the line creates
    sum     the beginning of the SHA-256 of the line before it

The line that creates Optuna's study has a member `identity`: that of the study (`dse.store.sealed`).

So a line that was changed, lost, doubled or moved is known by its number, and later trials keep theirs.
A journal of an earlier version begins with lines without them, which are read as they are, unless all
sessions of the study wrote them (`dse.store.requires_seal`).
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from dse import store

# Of Optuna's format: members of JournalOperation.
CREATE_STUDY, CREATE_TRIAL, SET_TRIAL_STATE = 0, 4, 6

_READ = (CREATE_STUDY, CREATE_TRIAL, SET_TRIAL_STATE)

Log = dict[str, Any]
"""An operation of Optuna."""

_MALFORMED = (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError)
_IDENTITY = "identity"
_SUM = re.compile(rb'(\{.*),"sum":"([0-9a-f]{16})"\}')


@dataclass(frozen=True)
class Lines:
    """The content of a journal.

    logs: of the intact lines. faults: what is wrong with the others, each with the number of its line.
    n_bytes: without the last line, if a process died while it wrote it. cut: what is wrong with that; '' if
        nothing is.
    n: that of the last line that has one.
    """

    logs: list[Log] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    n_bytes: int = 0
    n: int = 0
    cut: str = ""


def read(path: Path) -> Lines:
    """Return the lines of a journal; none where there is no file, which is a fault beside finished runs.

    Raises:
        StoreError: it cannot be read now.
    """
    if path.exists() and not path.is_file():
        return Lines(faults=["is not a file"])  # a pipe would never end
    try:
        content = path.read_bytes() if path.exists() else b""
    except OSError as error:
        raise store.unreadable(path, error) from None
    if not content and any(path.parent.glob("artefacts/*/repeat_*")):
        return Lines(faults=["is missing or empty, beside finished runs"])
    logs: list[Log] = []
    faults: list[str] = []
    n, n_bad, fault, is_sealed = 0, 0, "", store.requires_seal(path)
    identity = store.identity(path)
    *lines, torn = content.split(b"\n")
    for number, line in enumerate(lines, start=1):
        if fault:
            faults.append(fault)
        log, fault = _log(line), ""
        if isinstance(log, str):
            n_bad += 1
            fault = f"line {number} {log}"
        elif "sum" in log and log["n"] <= n:
            fault = f"line {number} is a copy of an earlier line, or was moved"
        elif "sum" not in log and is_sealed and log["op_code"] in _READ:
            fault = f"line {number} has no checksum"
        elif "sum" not in log and not is_sealed and faults:  # which trial it is of is not known any more
            fault = f"line {number} cannot be counted"
        else:
            if "sum" in log:
                if log["n"] != n + 1 + n_bad:
                    faults.append(f"lines are missing before line {number}")
                n, n_bad, is_sealed = log["n"], 0, True
            elif not is_sealed:
                n += 1
            logs.append(log)
            if log["op_code"] == CREATE_STUDY and log.get(_IDENTITY, identity) != identity:
                return Lines(faults=["it is the journal of another study"], n_bytes=len(content))
    n_bytes, cut = len(content) - len(torn), ""
    if fault and not torn:  # what the machine was writing when it went down
        n_bytes, cut = n_bytes - len(lines[-1]) - 1, fault
    elif fault:
        faults.append(fault)
    if torn:
        cut = f"line {len(lines) + 1} is incomplete"
    return Lines(logs, faults, n_bytes, n, cut)


def _log(line: bytes) -> Log | str:
    """Return the operation of a line, or what is wrong with it."""
    match = _SUM.fullmatch(line)
    if match is not None and _sum(match[1]) != match[2]:
        return "is damaged (its checksum differs)"
    try:
        log = json.loads(line)
        if match is None and "sum" in log:
            return "is damaged (its checksum differs)"
        if match is not None and not type(log["n"]) is type(log.get("trial", 0)) is int:
            raise ValueError("numbers of lines and trials must be integers")
        int(log.get("trial_id", 0))
        if log["op_code"] == CREATE_TRIAL:
            int(log["user_attrs"]["batch"])
            dict(log["user_attrs"]["design"])
            datetime.fromisoformat(log["datetime_start"])
        elif log["op_code"] == SET_TRIAL_STATE:
            int(log["trial_id"]), int(log["state"])
            [*map(float, log.get("values") or ())]
            if log.get("datetime_complete") is not None:
                datetime.fromisoformat(log["datetime_complete"])
    except _MALFORMED as error:
        return f"is damaged ({type(error).__name__}: {error})"
    return dict(log)


def _sum(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest()[:16].encode()


def counted(
    logs: Sequence[Log], made: Callable[[int, int], Log | None] = lambda *_: None, n_of_batch: int = 1
) -> Iterator[Log]:
    """Yield the lines of a damaged journal so that every trial has its number again.

    Args:
        logs: the intact ones.
        made: trial, its batch -> the line that created the trial; None where nobody knows: later lines are
            left out.
        n_of_batch: trials of a batch.
    """
    n_trials, batch, n_of = 0, 0, 0
    for log in [*logs, None]:
        due: float = math.inf
        if log is not None:
            of_trial = int(log.get("trial_id", n_trials - 1)) + 1
            due = log.get("trial", n_trials) if log["op_code"] == CREATE_TRIAL else of_trial
        while n_trials < due:
            missing = made(n_trials, batch if n_of < n_of_batch else batch + 1)
            if missing is None:
                return
            yield missing | {"trial": n_trials}
            n_of, batch = _in_batch(missing, n_of, batch)
            n_trials += 1
        if log is None:
            return
        if log["op_code"] == CREATE_TRIAL:
            n_of, batch = _in_batch(log, n_of, batch)
            log = log | {"trial": n_trials}
            n_trials += 1
        yield log


def _in_batch(log: Log, n_of: int, batch: int) -> tuple[int, int]:
    """Return the number of trials so far in the batch of a line's trial, and the batch."""
    of = int(log["user_attrs"]["batch"])
    return n_of + 1 if of == batch else 1, of


class JournalLines:
    """A journal file as Optuna's journal storage reads and appends it; the caller holds the study folder.

    Half a last line is cut off. Without a path nothing is written.

    Raises:
        OSError: the file cannot be written.
        StoreError: it cannot be read now.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        content = Lines() if path is None else read(path)
        self.logs, self.faults, self._n = content.logs, content.faults, content.n
        self._n_trials = sum(log["op_code"] == CREATE_TRIAL for log in self.logs)
        if path is not None and not path.exists():
            path.touch()
        elif path is not None and path.is_file():
            if path.stat().st_nlink > 1:  # a copy of hard links: what is appended here is not for the other
                with store.atomic(path) as temporary:
                    shutil.copy2(path, temporary)
            if content.n_bytes < path.stat().st_size:
                os.truncate(path, content.n_bytes)

    def read_logs(self, log_number_from: int) -> Iterator[Log]:
        """Yield the operations from a number on."""
        yield from self.logs[log_number_from:]

    def append_logs(self, logs: Sequence[Mapping[str, Any]]) -> None:
        """Append operations, and let `read_logs` know them."""
        self.logs += map(json.loads, self.append(logs))

    def append(self, logs: Sequence[Mapping[str, Any]]) -> list[bytes]:
        """Append operations and return their lines; they are on the disk by then, or not in the file."""
        lines = [self._line(log) for log in logs]
        if self._path is not None:
            _append(self._path, b"".join(lines))
        return lines

    def replace(self, logs: Sequence[Log]) -> None:
        """Write the journal anew; the file so far is kept beside it, its name ending in `.damaged`."""
        assert self._path is not None
        self._n = self._n_trials = 0
        lines = [self._line(log) for log in logs]
        aside = self._path.with_name(f"{self._path.name}.damaged")
        store.remove(aside)
        if self._path.is_file():
            shutil.copy2(self._path, aside)
        else:
            self._path.replace(aside)
        with store.atomic(self._path) as temporary:
            temporary.write_bytes(b"".join(lines))
        self.logs, self.faults = [json.loads(line) for line in lines], []

    def _line(self, log: Mapping[str, Any]) -> bytes:
        """Return the line of an operation, which is the next one."""
        self._n += 1
        members = {key: value for key, value in log.items() if key not in ("n", "trial", "sum")}
        members["n"] = self._n
        if log["op_code"] == CREATE_TRIAL:
            members["trial"] = self._n_trials
            self._n_trials += 1
        elif log["op_code"] == CREATE_STUDY and self._path and (identity := store.identity(self._path)):
            members[_IDENTITY] = identity
        text = json.dumps(members, separators=(",", ":"))[:-1].encode()
        return text + b',"sum":"' + _sum(text) + b'"}\n'


def _append(path: Path, content: bytes) -> None:
    with path.open("r+b") as file:  # never a new one: the study may have been removed
        n_bytes = file.seek(0, os.SEEK_END)
        try:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            os.truncate(path, n_bytes)  # what follows must not continue half a line
            raise
