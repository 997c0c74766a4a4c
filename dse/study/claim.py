"""Whose a study folder is: the search space that it was started with, its sessions, its coordinators.

Each `dse run` on the folder is a coordinator, and they share its trainings. The first one begins the study,
and others join it. All propose the same designs, which they find in the book where another one was first, and
tell their samplers the same results. A run is trained by the coordinator that has claimed it in the book; a
claim holds while its coordinator lives, which the system knows: each has locked a folder of its own,
`coordinators/<name>`. One of them holds the lock of the study. It writes the tables, and does what comes
after the search; when it ends, another one takes the lock.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import math
import os
import platform
import secrets
import time
from collections.abc import Iterable, Mapping, Set
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

import dse
from dse import store
from dse.config import ConfigError, Fault, SearchSpace, load_space
from dse.data.recordings import PLACES
from dse.store import Book, InUse
from dse.study.held import LOADER, plain_space

_HINT = "change it back, or use another study name or --results folder"
# Recordings are compared by their contents, run by run (dse.study.runs), not by their paths.
_PLACES = tuple(f"{section}.{key}" for section in ("data", "test") for key in PLACES)


def _matters(key: str) -> bool:
    """Return whether a key of a search space may change results."""
    return (not key.startswith("execution.") or key == "execution.device") and key not in _PLACES


def join(space: SearchSpace, folder: Path) -> None:
    """Check that another coordinator works on the same search space in a folder, but for section `execution`.

    Raises:
        ConfigError: it does not, or designs race.
    """
    now = yaml.load(space.to_yaml(), LOADER)
    texts = [
        f"{key} is {new!r}, but {old!r} in the study that runs in {folder}"
        for key, old, new in changes(_started_with(folder / store.SPACE, now), now)
        if _matters(key)
    ]
    if space.search.racing is not None:
        texts.append(f"search.racing: {folder} runs, and its designs race against all others of one process")
    if texts:
        raise ConfigError([Fault(str(space.source), 0, text) for text in texts])


def _started_with(path: Path, now: dict[str, Any]) -> dict[str, Any]:
    """Return the search space of a study, with the defaults of keys of `now` that it did not know.

    Raises:
        StoreError: its copy at `path` is missing or damaged.
    """
    before = plain_space(path)
    chips = {"hardware": now.get("hardware", [])}  # files of chips lie beside another file
    with contextlib.suppress(ConfigError):  # of an earlier version, or of plugins that are files
        if before != now:
            return {
                **yaml.load(load_space(before | chips).to_yaml(), LOADER),
                "hardware": before.get("hardware"),
            }
    return before


def claim(space: SearchSpace, book: store.Book) -> list[str]:
    """Write the search space, its plugins and the session to the folder, or check that they are the same.

    Some keys change no result and may differ: the folder of the recordings, the number of processes, more
    trials, other precisions of trained networks, targets, limits, when a search stops, and hardware after
    the first. The device may not: another one rounds differently. Until a run has finished or a design was
    enqueued, any search space may replace the one before.

    A damaged copy of the search space is written anew if the finished runs were trained as this one says.

    Returns:
        What was damaged and is written anew, a sentence each.
    """
    folder, notes = book.folder, []
    path = folder / store.SPACE
    now = yaml.load(space.to_yaml(), LOADER)
    files = [Path(plugin.source) for plugin in space.plugins if plugin.source.endswith(".py")]
    copies = {file: folder / "plugins" / f"{number}_{file.name}" for number, file in enumerate(files)}
    if not store.runs_in(folder) and not any(row["enqueued"] for row in book.rows("trial")):
        book.drop("trial")
        if not _trains_the_same(path, now, copies):
            store.remove(folder / "checkpoints")
            book.drop("study", "name GLOB 'racing/*'")
    else:
        before = now
        try:
            before = _started_with(path, now)
        except store.Damaged as error:
            _check_runs(space, folder)
            notes.append(f"{error}; it is written anew: the finished runs fit this search space")
        faults = [
            Fault(str(space.source), 0, f"{key} is {new!r}, but {folder} was started with {old!r}; {_HINT}")
            for key, old, new in changes(before, now)
            if _matters(key)
            and not (key == "search.n_trials" and _count(new) >= _count(old))
            and not (key == "hardware" and old[:1] == new[:1])
            and not key.startswith(("precision", "targets", "limits", "search.stop"))
            and not (key == "search.batch" and space.search.sampler_name == "grid")
        ]
        faults += [
            Fault(str(file), 0, f"differs from {copy}, which {folder} was started with; {_HINT}")
            for file, copy in copies.items()
            if copy.is_file() and (was := _copied(copy, notes)) is not None and was != _text(file)
        ]
        if faults:
            raise ConfigError(faults)
    begin(book)
    store.write_text(path, space.to_yaml())
    for file, copy in copies.items():
        store.write_text(copy, _text(file))
    return notes


def _trains_the_same(path: Path, now: Any, copies: Mapping[Path, Path]) -> bool:
    """Return whether trainings that a folder has begun may go on."""
    try:
        differing = changes(_started_with(path, now), now)
        same = all(copy.is_file() and store.read_text(copy) == _text(x) for x, copy in copies.items())
    except store.StoreError:
        return False
    return same and all(x.startswith("execution.") and x != "execution.device" for x, *_ in differing)


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace")


def _copied(copy: Path, notes: list[str]) -> str | None:
    """Return the copy of a plugin; None, with a note, if it is damaged."""
    try:
        return store.read_text(copy)
    except store.Damaged as error:
        notes.append(f"{error}; it is written anew")
        return None


def _check_runs(space: SearchSpace, folder: Path) -> None:
    """Check that the finished runs were trained as the search space says."""
    runs = store.runs_in(folder).items()
    for run in (store.run_file(folder, trial, repeat) for trial, of in runs for repeat in of):
        try:
            record = store.read_record(run)
            trained = record.get("sections", {})
            would = store.plain(space.resolve(record["design"]).to_plain())
        except store.Damaged:
            continue
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            text = f"does not hold the design of {run}: {error}; {_HINT}"
            raise ConfigError([Fault(str(space.source), 0, text)]) from None
        differing = [
            (f"{section}.{key}", old, would[section][key])
            for section in ("task", "model", "training")
            for key, old in (trained.get(section) or {}).items()
            if key in (would.get(section) or {}) and would[section][key] != old
        ]
        differing += [] if record["seed"] == space.seed else [("seed", record["seed"], space.seed)]
        if differing:
            texts = [f"{key} is {new!r}, but {run} was trained with {old!r}" for key, old, new in differing]
            raise ConfigError([Fault(str(space.source), 0, f"{text}; {_HINT}") for text in texts])


def changes(before: Any, now: Any, name: str = "") -> list[tuple[str, Any, Any]]:
    """Return (dotted key, old, new) for every difference of two nested mappings."""
    if not (isinstance(before, dict) and isinstance(now, dict)):
        return [] if before == now else [(name, before, now)]
    keys = dict.fromkeys([*before, *now])
    return [c for k in keys for c in changes(before.get(k), now.get(k), f"{name}.{k}" if name else str(k))]


def _count(n_trials: int | None) -> float:
    return math.inf if n_trials is None else n_trials


PACKAGES = ("numpy", "numba", "torch", "optuna", "pandas", "pyarrow", "scikit-learn", "moocore")


def describe() -> dict[str, object]:
    """Return the interpreter, the machine and the versions of the packages that compute results."""
    return {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "system": platform.platform(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "process": os.getpid(),
        "versions": {
            "dse": dse.__version__,
            **{name: version for name in PACKAGES if (version := _version(name)) is not None},
        },
    }


def sessions(folder: Path) -> list[Any]:
    """Return the sessions of a study, first to last; none where nothing is written yet.

    Raises:
        Damaged: its book is not what was written.
        StoreError: it cannot be read now.
    """
    return list(store.document(folder, store.ENVIRONMENT, []))


def begin(book: store.Book) -> None:
    """Write that a session begins."""
    book.keep(store.ENVIRONMENT, [*book.document(store.ENVIRONMENT, []), describe()])


def process_before(folder: Path) -> int | None:
    """Return the process of the session before the one that has begun; None: none is known."""
    process = sessions(folder)[-2:][0].get("process")
    return process if type(process) is int and process != os.getpid() else None


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


_PATIENCE_S, _GLANCE_S = 10.0, 0.2  # for who has the lock of a study and is no coordinator

Key = tuple[int, int]
"""Trial and repeat of a run."""


class Coordinator:
    """This process among the coordinators of a study, until `at_the_end` is closed.

    Attributes:
        is_first: whether it is the only one so far.

    Raises:
        InUse: another process has the lock, and is no coordinator.
        StoreError: the folder cannot be written, or locked.
    """

    def __init__(self, folder: Path, at_the_end: contextlib.ExitStack) -> None:
        self._folder, self._at_the_end = folder, at_the_end
        self._name = secrets.token_hex(4)
        self._book: Book | None = None
        until_s = time.monotonic() + _PATIENCE_S
        self.is_first = self._has_lock = False
        while not self.is_first and not store.living(folder):
            try:
                at_the_end.enter_context(store.exclusive(folder))
                self.is_first = self._has_lock = True
            except InUse:  # who has the lock may begin soon, or end
                if time.monotonic() > until_s:
                    raise
                time.sleep(_GLANCE_S)

    @property
    def leads(self) -> bool:
        """Whether it holds the lock of the study, which it takes where nobody does."""
        if not self._has_lock:
            with contextlib.suppress(InUse):
                self._at_the_end.enter_context(store.exclusive(self._folder, is_alone=False))
                self._has_lock = True
        return self._has_lock

    def begin(self, book: Book) -> None:
        """Let others join; what a coordinator that has died has claimed is free."""
        self._book = book
        if self.is_first:
            store.remove(self._folder / store.COORDINATORS)
            book.drop("claim")
        own = self._folder / store.COORDINATORS / self._name
        self._at_the_end.callback(store.remove, own)
        self._at_the_end.enter_context(store.exclusive(own))

    def claim(self, runs: Iterable[Key], beside: Set[Key]) -> set[Key]:
        """Claim runs beside those that it trains now; return those that no other one has claimed before."""
        assert self._book is not None  # it has begun
        with self._book.together():
            ours = set(self.unclaimed(runs))
            self.free()
            rows = [{"trial": x, "repeat": n, "coordinator": self._name} for x, n in sorted(ours | beside)]
            self._book.put("claim", rows)
        return ours

    def unclaimed(self, runs: Iterable[Key]) -> list[Key]:
        """Return those runs that no other coordinator has claimed, in their order."""
        assert self._book is not None  # it has begun
        living = {self._name: False}  # name -> whether its claims hold against us
        held = {}
        for row in self._book.rows("claim"):
            name = row["coordinator"]
            if name not in living:
                living[name] = store.is_held(self._folder / store.COORDINATORS / name) is not False
            held[row["trial"], row["repeat"]] = living[name]
        return [run for run in runs if not held.get(run)]

    def free(self) -> None:
        """Give back what it has claimed."""
        assert self._book is not None  # it has begun
        self._book.drop("claim", "coordinator = ?", self._name)
