"""What is damaged in a study's folder, what it costs, and its repair; nothing that can be read is lost.

Checks compare what the parts of a study say of each other: the journal, the folders of runs, their records,
the tables, the checkpoints, and what racing has written down. Whatever lets `dse run` stop or hang, or leaves
the tables behind the records, is named by one of them.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from dse import seeds, store
from dse.config import ConfigError, load_space
from dse.store import StoreError
from dse.study import checkpoints, held, imported, ledger, lines, precision
from dse.study.contents import MALFORMED, Contents, matches, said, set_aside
from dse.study.kinds import AGAIN, ASIDE, FILES
from dse.study.record import IMPORTED, RunRecord

_FOLDERS = (
    *("artefacts", "artefacts/*", "artefacts/*/repeat_*", "hardware", "plugins", "queue", "racing"),
    *("checkpoints", "checkpoints/*", "checkpoints/*/artefacts", "checkpoints/*/artefacts/*"),
    "checkpoints/*/artefacts/*/repeat_*",
)
_LOCKS = (".lock", ".notes.lock")
_OF_RUNS = ("artefacts/*/repeat_*/*", "checkpoints/*/artefacts/*/repeat_*/*")
_MOST_ROUNDS = 6  # of repairs: one may uncover what another hid

Repair = Callable[[], object]


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


def examine(folder: Path) -> list[Damage]:
    """Return everything that is damaged in a study's folder, in the order of repair.

    Raises:
        StoreError: the folder holds no study.
    """
    if not any(os.path.lexists(folder / name) for name in (store.SPACE, store.JOURNAL, "artefacts")):
        raise StoreError(f"{folder}: is not the folder of a study: there is no {store.SPACE}")
    study, found = Contents(folder), dict[str, Damage]()
    for check in _CHECKS:
        for damage in check(study):
            found.setdefault(damage.file, damage)  # what a later check says follows from it
    return list(found.values())


def repair(folder: Path) -> list[Damage]:
    """Repair what can be repaired; return what is left for `dse run` and for the user.

    Raises:
        StoreError: the study runs, or its folder cannot be written.
    """
    for damage in _access(Contents(folder)):
        if damage.file in (".", *_LOCKS) and damage.repair is not None:
            damage.repair()  # what the lock needs
    with store.exclusive(folder):
        store.sweep(folder)
        left = examine(folder)
        for _ in range(_MOST_ROUNDS):
            for damage in left:
                if damage.repair is not None:
                    with contextlib.suppress(ConfigError, StoreError):  # it is damaged yet, and listed again
                        damage.repair()
            before, left = left, examine(folder)
            if [(x.file, x.fault) for x in before] == [(x.file, x.fault) for x in left]:
                break
    return left


def _removal(path: Path) -> Repair:
    return partial(store.remove, path)


def _access(study: Contents) -> Iterator[Damage]:
    """What is none of the file or folder that it should be, or may not be read."""
    files = [*_LOCKS, store.JOURNAL, "page.html", *(kind.place for kind in FILES), *_OF_RUNS]
    places = [("", True), *((x, True) for x in _FOLDERS), *((x, False) for x in files)]
    for pattern, is_folder in places:
        for path in matches(study.folder, pattern) if pattern else [study.folder]:
            needed = stat.S_IRWXU if is_folder else stat.S_IRUSR
            if pattern in (*_LOCKS, store.JOURNAL):
                needed |= stat.S_IWUSR
            try:
                mode = path.stat().st_mode
                is_right = stat.S_ISDIR(mode) if is_folder else stat.S_ISREG(mode)
                fault = "" if is_right else f"is not a {'folder' if is_folder else 'file'}"
            except OSError as error:
                mode, fault = needed, "" if path.exists() else f"leads nowhere ({error.strerror})"
            if fault and pattern not in (store.JOURNAL, *_OF_RUNS):  # which other checks look at as a whole
                aside = partial(set_aside, study.folder, path)
                yield Damage(study.name(path), fault, "what it should hold", ASIDE, aside)
            elif not fault and mode & needed != needed:
                fault = f"may not be used: its permissions are {stat.S_IMODE(mode):03o}"
                remedy = "its owner may use it again"
                allow = partial(path.chmod, stat.S_IMODE(mode) | needed)
                yield Damage(study.name(path), fault, "nothing", remedy, allow)


def _journal(study: Contents) -> Iterator[Damage]:
    path, content = study.folder / store.JOURNAL, study.lines
    if study.faults:
        yield Damage(
            store.JOURNAL,
            "; ".join(study.faults),
            "when these designs were proposed",
            f"it is written anew from its other lines and the records; {store.JOURNAL}.damaged is a copy",
            lambda: ledger.Ledger(path, load_space(study.folder / store.SPACE)),
        )
    elif content.cut:
        remedy = f"it is cut off; {AGAIN} writes it again"
        cut = partial(lines.JournalLines, path)
        yield Damage(store.JOURNAL, f"{content.cut}, the last one", "nothing that has finished", remedy, cut)


def _runs(study: Contents) -> Iterator[Damage]:
    """Runs that are damaged, lie elsewhere, or are of another design than the journal's."""
    again = f"the run is removed; {AGAIN} trains it again"
    for run, found in study.runs.items():
        name = study.name(run)
        if isinstance(found, StoreError):
            if (home := _home(study, run)) not in (None, run):
                remedy = f"it is moved to {study.name(home)}, or aside if a run is there"
                yield Damage(name, said(found, run), "nothing", remedy, partial(_bring, study, run, home))
            elif isinstance(found, store.Damaged):
                yield Damage(name, said(found, run), "one run", again, _removal(run))
            else:
                yield Damage(name, said(found, run), "one run, until it can be read", "by hand")
            continue
        if not study.knows(found.trial):
            remedy = f"{AGAIN} takes it up when it proposes the design again"
            yield Damage(name, "is in no line of the journal", "one run, until then", remedy)
        elif not study.faults and not _is_of(study, found):
            yield Damage(name, "holds a run of another design or seed", "one run", again, _removal(run))
        for path in sorted(run.iterdir()):
            if path.match("precision_*.npz"):
                if precision.is_damaged(path):
                    remedy = f"the file is removed; {AGAIN} evaluates it again"
                    yield Damage(study.name(path), "is damaged", "one evaluation", remedy, _removal(path))
            elif path.name not in (store.RECORD, *found.files) and not store.is_temporary(path):
                aside = partial(set_aside, study.folder, path)
                yield Damage(study.name(path), "is no file of this run", "nothing", ASIDE, aside)


def _home(study: Contents, run: Path) -> Path | None:
    """Return where the run in a folder belongs, by its record; None where that cannot be read."""
    try:
        plain = store.read_json(run / store.RECORD)
        return store.run_folder(study.folder, int(plain["trial"]), int(plain["repeat"]))
    except (StoreError, LookupError, TypeError, ValueError):
        return None


def _bring(study: Contents, run: Path, home: Path) -> None:
    if os.path.lexists(home):
        set_aside(study.folder, run)
    else:
        with store.explained(home):
            home.parent.mkdir(parents=True, exist_ok=True)
            run.replace(home)
    with contextlib.suppress(OSError):  # unless others are there
        run.parent.rmdir()


def _is_of(study: Contents, found: RunRecord) -> bool:
    if found.trial >= IMPORTED or not study.space:
        return True
    design = study.entries[found.trial].design
    is_design = seeds.design_key(design) == seeds.design_key(found.design)
    return is_design and found.seed == study.space.get("seed")


def _missing(study: Contents) -> Iterator[Damage]:
    """Runs of which the journal or the tables say that they have finished."""
    expected = {x.trial: study.repeats for x in study.entries if x.is_reported and not x.excluded}
    with contextlib.suppress(StoreError, *MALFORMED):
        table = held.read(study.folder / held.TRIALS)
        for trial, n in zip(table["trial"], table["repeats"], strict=True):
            expected[trial] = max(n, expected.get(trial, 0))
    for trial, n in sorted(expected.items()):
        of_trial = study.records.get(trial, {})
        for repeat in range(n) if not any(x.told for x in of_trial.values()) else ():
            run = store.run_folder(study.folder, trial, repeat)
            if repeat not in of_trial and run not in study.runs:
                again = f"{AGAIN} trains it again"
                remedy = again if trial < IMPORTED else "`dse import` brings it back"
                yield Damage(study.name(run), "is missing: the run had finished", "one run", remedy)


def _checkpoints(study: Contents) -> Iterator[Damage]:
    """Where unfinished trainings stand, against where racing lets them stand."""
    standing: dict[int, int] = {}
    for path in matches(study.folder, "checkpoints/*/artefacts/*/repeat_*"):
        if path.is_dir() and (fault := _checkpoint(study, path, standing)):
            remedy = f"it is removed; {AGAIN} trains on from where it can"
            yield Damage(study.name(path), fault, "some epochs of a training", remedy, _removal(path))
    for one, after in itertools.chain(*(itertools.pairwise(x) for x in study.rounds.values())):
        for trial in (*after["trials"], *(x["trial"] for x in after["stopped"])):
            if trial in one["trials"] and trial not in study.records:
                if standing.get(trial, 0) < (one["epochs"] or 0):
                    path = store.run_folder(checkpoints.rung_folder(study.folder, one["epochs"]), trial, 0)
                    fault = f"is missing: trial {trial} stood at this rung"
                    remedy = f"{AGAIN} trains it again"
                    yield Damage(study.name(path), fault, f"{one['epochs']} epochs of a training", remedy)


def _checkpoint(study: Contents, path: Path, standing: dict[int, int]) -> str:
    """Return what is wrong with a checkpoint; '' if nothing is, and then note that its trial stands there."""
    epochs = path.parents[2].name
    try:
        plain = store.load_run(path) or {}
        trial, repeat = int(plain["trial"]), int(plain["repeat"])
        if checkpoints.made_as(plain, int(epochs))[1] != int(epochs):
            return f"is of a training that stood after {plain['epochs']} epochs"
    except (StoreError, *MALFORMED) as error:
        return said(error, path)
    if not study.knows(trial):
        return "is of a trial that the journal does not name"
    record = study.records.get(trial, {}).get(repeat)
    if record is not None and record.stopped_at_epoch is None:
        return "is of a run that has ended"
    is_audited = record is not None and trial in study.audited  # it trains on beside its record
    rung = study.stops[trial]["epochs"] if trial in study.stops else math.inf
    if int(epochs) > rung and not is_audited:
        return f"lies beyond the rung of {rung} epochs, where racing has stopped the design"
    standing[trial] = max(standing.get(trial, 0), int(epochs))
    return ""


def _files(study: Contents) -> Iterator[Damage]:
    """Files of `FILES` that are missing, or not what was written."""
    for kind in FILES:
        needed = [study.folder / name for name in kind.needed(study)]
        for path in dict.fromkeys([*needed, *matches(study.folder, kind.place)]):
            try:
                if not os.path.lexists(path):
                    raise store.damaged(path, "is missing")
                kind.read(study, path)
            except (StoreError, *MALFORMED) as error:
                is_due = kind.mend is not None and not (kind.needs_journal and study.faults)
                mend = partial(kind.mend, study, path) if is_due and kind.mend else None
                yield Damage(study.name(path), said(error, path), kind.cost, kind.remedy, mend)


def _recordings(study: Contents) -> Iterator[Damage]:
    """Recordings that are no longer those that the runs were trained on."""
    if study.space.get("plugins"):
        return  # whose code would run
    records = [x for of in study.records.values() for x in of.values() if x.data and x.finished]
    for record in {x.data: x for x in records}.values():
        if imported.have_changed(study.folder, record):
            cost = "the study cannot go on"
            remedy = "restore them, or use another --results folder"
            name = study.name(store.run_folder(study.folder, record.trial, record.repeat))
            yield Damage(name, "was trained on other recordings than those of today", cost, remedy)


_CHECKS: tuple[Callable[[Contents], Iterator[Damage]], ...] = (
    *(_access, _journal, _runs, _files, _missing, _checkpoints, _recordings),
)
