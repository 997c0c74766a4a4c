"""What is damaged in a study's folder, what it costs, and its repair; nothing that can be read is lost.

Checks compare what the parts of a study say of each other: the book, the files that it knows, the records of
runs, and the tables. Whatever lets `dse run` stop or hang, or leaves the tables behind the records, is named
by one of them. A checkpoint that is damaged costs some epochs: `dse run` removes it.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import stat
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from dse import store
from dse.base import seeds
from dse.config import ConfigError
from dse.measure.hardware.profile import load, names
from dse.store import StoreError
from dse.study import held, mended, precision, pricing, tables
from dse.study.held import plain_space
from dse.study.ledger import Entry, read_entries
from dse.study.record import RunRecord, load_record
from dse.study.results import is_earlier, sections_found

AGAIN = "`dse run` with the study's search space"
ASIDE = "it is renamed, its name ending in .damaged, to be read by eye"
_FOLDERS = (
    *(store.RUNS, precision.FOLDER, f"{precision.FOLDER}/*", "hardware", "plugins"),
    *("checkpoints", "checkpoints/*", f"checkpoints/*/{store.RUNS}"),
)
_OF_RUNS = (f"{store.RUNS}/*", f"{precision.FOLDER}/*/*", f"checkpoints/*/{store.RUNS}/*")
_LOCK = ".lock"
_TABLES = (held.TRIALS, held.POINTS)
_TEXTS = (store.SPACE, "plugins/*.py", "hardware/*.yaml")
_MOST_ROUNDS = 6  # of repairs: one may uncover what another hid
_MALFORMED = (LookupError, TypeError, ValueError, AttributeError)

Repair = Callable[[], Sequence[str] | None]
"""Repairs; returns what to say of it in sentences, if anything."""


@dataclass(frozen=True)
class Damage:
    """One thing that is damaged.

    file: relative to the study. fault: what is wrong. cost: what is lost with it.
    remedy: what `--repair` does, and what is left to do.
    repair: does it; None where `dse run` or the user has to.
    """

    file: str
    fault: str
    cost: str
    remedy: str
    repair: Repair | None = None


@dataclass(frozen=True)
class _Study:
    """What can be read in the folder of a study."""

    folder: Path

    @cached_property
    def space(self) -> Mapping[str, Any]:
        """Its search space, empty if that cannot be read."""
        with contextlib.suppress(StoreError):
            return plain_space(self.folder / store.SPACE)
        return {}

    @cached_property
    def fault(self) -> str:
        """What is wrong with its book; without a fault it names every design."""
        try:
            return mended.fault(self.folder)
        except StoreError as error:
            return _said(error, self.folder / store.BOOK)

    @cached_property
    def entries(self) -> Sequence[Entry]:
        """The designs of its book."""
        return read_entries(self.folder)

    @cached_property
    def runs(self) -> Mapping[Path, RunRecord | StoreError]:
        """File of a run -> its record, or why it has none."""
        runs: dict[Path, RunRecord | StoreError] = {}
        for path in _matches(self.folder, f"{store.RUNS}/*"):
            try:
                if store.named(path) is None:
                    raise store.damaged(path, "is no file of this study")
                found = load_record(path)
                assert found is not None  # of a file
                runs[path] = found
            except StoreError as error:
                runs[path] = error
        return runs

    @cached_property
    def records(self) -> dict[int, dict[int, RunRecord]]:
        """Trial -> repeat -> record, of the runs that can be read."""
        records: dict[int, dict[int, RunRecord]] = {}
        for found in self.runs.values():
            if isinstance(found, RunRecord):
                records.setdefault(found.trial, {})[found.repeat] = found
        return records

    def knows(self, trial: int) -> bool:
        """Return whether the book names a trial; True where the book is damaged."""
        return bool(self.fault) or 0 <= trial < len(self.entries)

    def name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()


def examine(folder: Path) -> list[Damage]:
    """Return everything that is damaged in a study's folder, in the order of repair.

    Raises:
        StoreError: the folder holds no study.
    """
    if not any(os.path.lexists(folder / name) for name in (store.SPACE, store.BOOK, store.RUNS)):
        raise StoreError(f"{folder}: is not the folder of a study: there is no {store.SPACE}")
    study, found = _Study(folder), dict[str, Damage]()
    for check in (_book,) if is_earlier(folder) else _CHECKS:
        for damage in check(study):
            found.setdefault(damage.file, damage)  # what a later check says follows from it
    return list(found.values())


def repair(folder: Path) -> tuple[list[Damage], list[str]]:
    """Repair what can be repaired; return what is left for `dse run` and for the user, and what was done.

    Raises:
        StoreError: the study runs, or its folder cannot be written.
    """
    for damage in _access(_Study(folder)):
        if damage.file in (".", _LOCK) and damage.repair is not None:
            damage.repair()  # what the lock needs
    with store.exclusive(folder):
        store.sweep(folder)
        left, notes = examine(folder), list[str]()
        for _ in range(_MOST_ROUNDS):
            for damage in left:
                if damage.repair is not None:
                    with contextlib.suppress(ConfigError, StoreError):  # it is damaged yet, and listed again
                        notes += damage.repair() or ()
                        if damage.file == store.BOOK:
                            break  # what it said of other files is no longer so
            before, left = left, examine(folder)
            if [(x.file, x.fault) for x in before] == [(x.file, x.fault) for x in left]:
                break
        with contextlib.suppress(StoreError), store.Book(folder, writes=True) as book:
            store.back_up(book)
    return left, notes


def _access(study: _Study) -> Iterator[Damage]:
    """What is none of the file or folder that it should be, or may not be read."""
    files = (_LOCK, store.BOOK, "page.html", *_TEXTS, *_TABLES, *_OF_RUNS)
    places = [("", True), *((x, True) for x in _FOLDERS), *((x, False) for x in files)]
    for pattern, is_folder in places:
        for path in _matches(study.folder, pattern) if pattern else [study.folder]:
            needed = stat.S_IRWXU if is_folder else stat.S_IRUSR
            if pattern in (_LOCK, store.BOOK):
                needed |= stat.S_IWUSR
            try:
                mode = path.stat().st_mode
                is_right = stat.S_ISDIR(mode) if is_folder else stat.S_ISREG(mode)
                fault = "" if is_right else f"is not a {'folder' if is_folder else 'file'}"
            except OSError as error:
                mode, fault = needed, "" if path.exists() else f"leads nowhere ({error.strerror})"
            if fault and pattern != store.BOOK:  # which is mended as a whole
                aside = partial(store.set_aside, study.folder, path)
                yield Damage(study.name(path), fault, "what it should hold", ASIDE, aside)
            elif not fault and mode & needed != needed:
                fault = f"may not be used: its permissions are {stat.S_IMODE(mode):03o}"
                remedy = "its owner may use it again"
                allow = partial(path.chmod, stat.S_IMODE(mode) | needed)
                yield Damage(study.name(path), fault, "nothing", remedy, allow)


def _book(study: _Study) -> Iterator[Damage]:
    if is_earlier(study.folder):
        fault = "is missing: an earlier version of dse wrote the study"
        yield Damage(store.BOOK, fault, "nothing", "the folder is converted", partial(_mend, study))
    elif study.fault:
        remedy = f"it is restored from {store.COPY}; {store.BOOK}.damaged is what it was"
        yield Damage(store.BOOK, study.fault, "what is newer than its copy", remedy, partial(_mend, study))
    copy = study.folder / store.COPY
    if os.path.lexists(copy) and (fault := mended.fault(study.folder, store.COPY)):
        cost = "nothing" if not study.fault else "the queue, and what racing decided"
        yield Damage(store.COPY, fault, cost, "it is written again", partial(_mend, study))


def _mend(study: _Study) -> list[str]:
    """Restore the book, and write its copy; return what was done, in sentences."""
    with mended.opened(study.folder, study.space.get("search", {}).get("batch") or 1) as (_, notes):
        return notes


def _runs(study: _Study) -> Iterator[Damage]:
    """Runs that are damaged, lie elsewhere, or are of another design than the book's."""
    again = f"the run is moved aside; {AGAIN} trains it again"
    for run, found in study.runs.items():
        name, aside = study.name(run), partial(_aside, study, run)
        if isinstance(found, StoreError):
            if store.named(run) is None:
                yield Damage(name, _said(found, run), "nothing", ASIDE, aside)
            elif isinstance(found, store.Damaged):
                yield Damage(name, _said(found, run), "one run", again, aside)
            else:
                yield Damage(name, _said(found, run), "one run, until it can be read", "by hand")
        elif not study.knows(found.trial):
            remedy = f"{AGAIN} takes it up when it proposes the design again"
            yield Damage(name, "is no design of the book", "one run, until then", remedy)
        elif not study.fault and not _is_of(study, found):
            yield Damage(name, "holds a run of another design or seed", "one run", again, aside)
    for path in _matches(study.folder, f"{precision.FOLDER}/*/*"):
        if precision.read(path) is None:
            remedy = f"the file is moved aside; {AGAIN} evaluates it again"
            aside = partial(_aside, study, path)
            yield Damage(study.name(path), "is damaged", "one evaluation", remedy, aside)


def _aside(study: _Study, path: Path) -> None:
    """Move a file aside, which the book is to know no more."""
    if os.path.lexists(path):
        store.set_aside(study.folder, path)
    with store.Book(study.folder, writes=True) as book:
        store.note_files(book, [path])


def _is_of(study: _Study, found: RunRecord) -> bool:
    if not study.space:
        return True
    design = study.entries[found.trial].design
    is_design = seeds.design_key(design) == seeds.design_key(found.design)
    return is_design and found.seed == study.space.get("seed")


def _missing(study: _Study) -> Iterator[Damage]:
    """Runs and evaluations that have finished by the book."""
    known = store.digests(study.folder)
    expected = {store.named(Path(x)) for x in known if x.startswith(f"{store.RUNS}/")} - {None}
    repeats = int(study.space.get("search", {}).get("repeats", 1))
    ended = [entry.trial for entry in study.entries if entry.is_reported and not entry.excluded]
    expected |= set(itertools.product(ended, range(repeats)))
    for trial, repeat in sorted(run for run in expected if run is not None):
        run = store.run_file(study.folder, trial, repeat)
        if repeat not in study.records.get(trial, {}) and run not in study.runs:
            again = f"{AGAIN} trains it again"
            yield Damage(study.name(run), "is missing: the run had finished", "one run", again)
    for name in sorted(x for x in known if x.startswith(f"{precision.FOLDER}/")):
        path = study.folder / name
        if not os.path.lexists(path):
            remedy = f"{AGAIN} evaluates it again"
            yield Damage(name, "is missing", "one evaluation", remedy, partial(_aside, study, path))


def _texts(study: _Study) -> Iterator[Damage]:
    """The search space, copies of plugins, and hardware profiles."""
    space = study.folder / store.SPACE
    if (fault := _wrong(space, plain_space)) is not None:
        remedy = f"{AGAIN} writes it again once it has compared it with the finished runs"
        yield Damage(store.SPACE, fault, "nothing: runs hold their settings", remedy)
    sources = [Path(x) for x in study.space.get("plugins", ()) if x.endswith(".py")]
    plugins = {study.folder / f"plugins/{n}_{file.name}": file for n, file in enumerate(sources)}
    for path in dict.fromkeys([*plugins, *_matches(study.folder, "plugins/*.py")]):
        if (fault := _wrong(path, partial(_check_plugin, plugins.get(path)))) is not None:
            remedy = f"it is moved aside; {AGAIN} writes it again"
            aside = partial(_aside, study, path)
            yield Damage(study.name(path), fault, "the copy, not the original", remedy, aside)
    measured = [x.numbers for of in study.records.values() for x in of.values() if x.numbers is not None]
    chips = sorted({study.folder / f"hardware/{chip}.yaml" for one in measured for chip in one.hardware})
    for path in dict.fromkeys([*chips, *_matches(study.folder, "hardware/*.yaml")]):
        if (fault := _wrong(path, partial(_check_chip, study.folder))) is not None:
            cost = "no run: points are priced anew, trials keep the costs that the sampler received"
            remedy = "it is replaced with the profile as it is now, and all points are priced with that"
            yield Damage(study.name(path), fault, cost, remedy, partial(_tables_again, study, path))


def _tables(study: _Study) -> Iterator[Damage]:
    for name in _TABLES:
        path = study.folder / name
        if os.path.lexists(path) or study.records:
            if (fault := _wrong(path, partial(_check_table, study))) is not None:
                again = None if study.fault else partial(_tables_again, study)
                yield Damage(name, fault, "nothing: it follows from the runs", "it is written again", again)


def _recordings(study: _Study) -> Iterator[Damage]:
    """Recordings that are no longer those that the runs were trained on."""
    if study.space.get("plugins"):
        return  # whose code would run
    records = [x for of in study.records.values() for x in of.values() if x.data and x.finished]
    for record in {x.data: x for x in records}.values():
        keys = [key for *_, key in sections_found(study.folder, record)]
        if keys and record.data not in keys:
            cost = "the study cannot go on"
            remedy = "restore them, or use another --results folder"
            name = study.name(store.run_file(study.folder, record.trial, record.repeat))
            yield Damage(name, "was trained on other recordings than those of today", cost, remedy)


def _wrong(path: Path, check: Callable[[Path], object]) -> str | None:
    """Return what is wrong with a file in words; None if nothing is."""
    try:
        if not os.path.lexists(path):
            return "is missing"
        check(path)
    except (StoreError, *_MALFORMED) as error:
        return _said(error, path)
    return None


def _check_plugin(source: Path | None, path: Path) -> None:
    text = store.read_text(path)
    if source is not None and source.is_file() and source.read_text("utf-8", "replace") != text:
        raise ValueError(f"differs from {source}, which the study was started with")


def _check_chip(folder: Path, path: Path) -> None:
    try:
        found = pricing.kept(folder, path.stem)
    except ConfigError as error:
        raise ValueError(error.faults[0].message.split(";")[0]) from None
    if found.name != path.stem:
        raise ValueError(f"is the profile of {found.name}")
    if path.stem in names() and pricing.differ(found, load(path.stem)):
        raise ValueError("has other numbers than the profile has now")


def _check_table(study: _Study, path: Path) -> None:
    """Check a table, and that it holds the runs of the study, but for those that are damaged themselves."""
    table = held.read(path)
    if ("status" in table) != (path.name == held.TRIALS):
        raise ValueError("is another table")
    made_from, rows = json.loads(store.made_from(path) or "{}"), held.counted(table)
    one_each = dict.fromkeys(made_from.get("digests", ()), 1) if path.name == held.TRIALS else {}
    written = Counter({int(trial): n for trial, n in made_from.get("rows", one_each).items()})
    if written and (wrong := sorted(t for t in rows | written if rows[t] != written[t])):
        raise ValueError(f"has {rows[wrong[0]]} rows of trial {wrong[0]}, not {written[wrong[0]]}")
    found = held.behind(path)
    lacking = found.lacking if made_from else study.records.keys() - rows
    for what, trials in (("lacks", lacking), ("is older than the runs of", found.changed)):
        if known := sorted(trial for trial in trials if trial in study.records and study.knows(trial)):
            raise ValueError(f"{what} {held.named(known)}: {len(known)} of {len(study.records)} trials")


def _tables_again(study: _Study, profile: Path | None = None) -> None:
    """Write the tables, and the profiles that price them."""
    if profile is not None:
        _aside(study, profile)
    tables.write_again(study.folder)


def _said(error: Exception, path: Path) -> str:
    """Return what an error says of a file, without the file and the remedy."""
    if isinstance(error, LookupError):
        return f"holds something else (key {error} is missing)"
    text = str(error).splitlines()[0].removesuffix(f"; {store.REMEDY}")
    return text.removeprefix(f"{path}: ").removeprefix(f"{path}/")


def _matches(folder: Path, pattern: str) -> list[Path]:
    """Return what a folder holds of a pattern, links that lead nowhere too."""
    if "*" not in pattern:
        return [folder / pattern] if os.path.lexists(folder / pattern) else []
    paths = sorted(folder.glob(pattern))
    return [path for path in paths if ".damaged" not in path.name and not store.is_temporary(path)]


_CHECKS: tuple[Callable[[_Study], Iterator[Damage]], ...] = (
    *(_access, _book, _runs, _texts, _tables, _missing, _recordings),
)
