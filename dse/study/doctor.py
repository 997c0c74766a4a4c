"""What is damaged in a study's folder, what it costs, and its repair; nothing that can be read is lost.

Checks compare what the parts of a study say of each other: the journal, the folders of runs, their records,
the tables, the checkpoints, and what racing has written down. Whatever lets `dse run` stop or hang, or leaves
the tables behind the records, is named by one of them.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import stat
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from dse import seeds, store
from dse.audit import record as audit
from dse.config import ConfigError, load_space
from dse.hardware.profile import load, names
from dse.store import StoreError
from dse.study import (
    checkpoints,
    environment,
    held,
    imported,
    journal,
    ledger,
    lines,
    notes,
    precision,
    pricing,
    saved_views,
    tables,
)
from dse.study.record import IMPORTED, RunRecord, load_record
from dse.study.results import plain_space

_AGAIN = "`dse run` with the study's search space"
_REMOVED = f"it is removed; {_AGAIN} writes it again"
_ASIDE = "it is renamed, its name ending in .damaged, to be read by eye"
_FOLDERS = (
    *("artefacts", "artefacts/*", "artefacts/*/repeat_*", "hardware", "plugins", "queue", "racing"),
    *("checkpoints", "checkpoints/*", "checkpoints/*/artefacts", "checkpoints/*/artefacts/*"),
    "checkpoints/*/artefacts/*/repeat_*",
)
_LOCKS = (".lock", ".notes.lock")
_AUDIT, _REPEATS = "racing/audit.json", "front_repeats.json"
_OF_RUNS = ("artefacts/*/repeat_*/*", "checkpoints/*/artefacts/*/repeat_*/*")
_MOST_ROUNDS = 6  # of repairs: one may uncover what another hid

_MALFORMED = (LookupError, TypeError, ValueError, AttributeError)

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


@dataclass(frozen=True)
class _Study:
    """What can be read in the folder of a study.

    space: its search space, empty if that cannot be read. lines: of its journal.
    runs: folder of a run -> its record, or why it has none.
    """

    folder: Path
    space: Mapping[str, Any]
    lines: lines.Lines
    entries: Sequence[journal.Entry]
    runs: Mapping[Path, RunRecord | StoreError]

    @classmethod
    def of(cls, folder: Path) -> _Study:
        space: Mapping[str, Any] = {}
        with contextlib.suppress(StoreError):
            space = plain_space(folder / store.SPACE)
        try:
            content = lines.read(folder / store.JOURNAL)
        except StoreError as error:
            content = lines.Lines(faults=[_said(error, folder / store.JOURNAL)])
        runs: dict[Path, RunRecord | StoreError] = {}
        for run in sorted(folder.glob("artefacts/*/*")):
            if run.is_dir() and not store.is_temporary(run):
                try:
                    found = load_record(run)
                    assert found is not None  # of a folder
                    runs[run] = found
                except StoreError as error:
                    runs[run] = error
        return cls(folder, space, content, journal.read_journal(folder / store.JOURNAL), runs)

    @cached_property
    def records(self) -> dict[int, dict[int, RunRecord]]:
        """Trial -> repeat -> record, of the runs that can be read."""
        records: dict[int, dict[int, RunRecord]] = {}
        for found in self.runs.values():
            if isinstance(found, RunRecord):
                records.setdefault(found.trial, {})[found.repeat] = found
        return records

    @cached_property
    def rounds(self) -> dict[int, list[dict[str, Any]]]:
        """Batch -> the rounds that racing has decided, where they can be read."""
        rounds = {}
        for path in sorted(self.folder.glob("racing/[0-9]*.json")):
            with contextlib.suppress(StoreError, ValueError):
                rounds[int(path.stem)] = _rounds(self, path)
        return rounds

    @cached_property
    def stops(self) -> dict[int, int]:
        """Trial -> epochs after which racing decided to stop it."""
        rounds = itertools.chain.from_iterable(self.rounds.values())
        return {x["trial"]: x["epochs"] for one in rounds for x in one["stopped"]}

    @cached_property
    def audited(self) -> set[int]:
        """The stopped designs that the audit of racing trains on."""
        with contextlib.suppress(StoreError, LookupError, TypeError):
            return set(store.read_json(self.folder / _AUDIT)["trials"])
        return set()

    @cached_property
    def batches(self) -> dict[int, list[int]]:
        """Batch -> its trials."""
        batches: dict[int, list[int]] = {}
        for entry in self.entries:
            if not entry.excluded:
                batches.setdefault(entry.batch, []).append(entry.trial)
        return batches

    @property
    def repeats(self) -> int:
        """Runs of every design."""
        return int(self._search.get("repeats", 1))

    @property
    def _search(self) -> Mapping[str, Any]:
        return self.space.get("search") or {}

    @property
    def n_audited(self) -> int:
        """How many stopped designs each audit of racing trains on."""
        return int((self._search.get("racing") or {}).get("audit", 0))

    def knows(self, trial: int) -> bool:
        """Return whether the journal names a trial, or it was imported."""
        return 0 <= trial < len(self.entries) or trial >= IMPORTED

    def name(self, path: Path) -> str:
        return str(path.relative_to(self.folder))


def examine(folder: Path) -> list[Damage]:
    """Return everything that is damaged in a study's folder, in the order of repair.

    Raises:
        StoreError: the folder holds no study.
    """
    if not any(os.path.lexists(folder / name) for name in (store.SPACE, store.JOURNAL, "artefacts")):
        raise StoreError(f"{folder}: is not the folder of a study: there is no {store.SPACE}")
    study, found = _Study.of(folder), dict[str, Damage]()
    for check in _CHECKS:
        for damage in check(study):
            found.setdefault(damage.file, damage)  # what a later check says follows from it
    return list(found.values())


def repair(folder: Path) -> list[Damage]:
    """Repair what can be repaired; return what is left for `dse run` and for the user.

    Raises:
        StoreError: the study runs, or its folder cannot be written.
    """
    for damage in _access(_Study.of(folder)):  # the lock too
        if damage.repair is not None:
            damage.repair()
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


def _removal(path: Path) -> Repair:
    return partial(store.remove, path)


def _set_aside(folder: Path, path: Path) -> None:
    """Move what lies in a study's folder to beside where it lay, under a name that nothing reads."""
    first, *rest = path.relative_to(folder).parts
    for n in itertools.count():
        top = folder / f"{first}.damaged{n or ''}"
        place = top.joinpath(*rest)
        if not os.path.lexists(place) and (not os.path.lexists(top) or top.is_dir()):
            with store.explained(place):
                place.parent.mkdir(parents=True, exist_ok=True)
                path.replace(place)
            return


def _access(study: _Study) -> Iterator[Damage]:
    """What is none of the file or folder that it should be, or may not be read."""
    files = [*_LOCKS, store.JOURNAL, "page.html", *(kind.place for kind in _FILES), *_OF_RUNS]
    places = [("", True), *((x, True) for x in _FOLDERS), *((x, False) for x in files)]
    for pattern, is_folder in places:
        for path in _matches(study.folder, pattern) if pattern else [study.folder]:
            what = "a folder" if is_folder else "a file"
            needed = stat.S_IRWXU if is_folder else stat.S_IRUSR
            if pattern in (*_LOCKS, store.JOURNAL):
                needed |= stat.S_IWUSR
            try:
                mode = path.stat().st_mode
                is_right = stat.S_ISDIR(mode) if is_folder else stat.S_ISREG(mode)
                fault = "" if is_right else f"is not {what}"
            except OSError as error:
                mode, fault = needed, "" if path.exists() else f"leads nowhere ({error.strerror})"
            if fault and pattern not in _OF_RUNS:  # a run is looked at as a whole
                aside = partial(_set_aside, study.folder, path)
                yield Damage(study.name(path), fault, "what it should hold", _ASIDE, aside)
            elif not fault and mode & needed != needed:
                fault = f"may not be used: its permissions are {stat.S_IMODE(mode):03o}"
                remedy = "its owner may use it again"
                allow = partial(path.chmod, stat.S_IMODE(mode) | needed)
                yield Damage(study.name(path), fault, "nothing", remedy, allow)


def _journal(study: _Study) -> Iterator[Damage]:
    path, content = study.folder / store.JOURNAL, study.lines
    faults = content.faults or ledger.drop_refused([*content.logs])
    if fault := ledger.of_another(study.folder, content.logs):
        faults = [fault]
    if faults := faults or ledger.lost(study.folder, content.logs):
        yield Damage(
            store.JOURNAL,
            "; ".join(faults),
            "when these designs were proposed",
            f"it is written anew from its other lines and the records; a copy stays as {store.JOURNAL}.damaged",
            lambda: ledger.Ledger(path, load_space(study.folder / store.SPACE)),
        )
    elif content.cut:
        remedy = f"it is cut off; {_AGAIN} writes it again"
        cut = partial(lines.JournalLines, path)
        yield Damage(store.JOURNAL, f"{content.cut}, the last one", "nothing that has finished", remedy, cut)
    elif not content.logs and not os.path.lexists(path) and study.space:
        yield Damage(store.JOURNAL, "is missing", "nothing: no design has a run", f"{_AGAIN} begins it")


def _runs(study: _Study) -> Iterator[Damage]:
    """Runs that are damaged, lie elsewhere, or are of another design than the journal's."""
    is_sound = not study.lines.faults and not ledger.lost(study.folder, study.lines.logs)
    again = f"the run is removed; {_AGAIN} trains it again"
    for run, found in study.runs.items():
        name = study.name(run)
        if isinstance(found, StoreError):
            if (home := _home(study, run)) not in (None, run):
                remedy = f"it is moved to {study.name(home)}, or aside if a run is there"
                yield Damage(name, _said(found, run), "nothing", remedy, partial(_bring, study, run, home))
            elif isinstance(found, store.Damaged):
                yield Damage(name, _said(found, run), "one run", again, _removal(run))
            else:
                yield Damage(name, _said(found, run), "one run, until it can be read", "by hand")
            continue
        if is_sound and not study.knows(found.trial):
            remedy = f"{_AGAIN} takes it up when it proposes the design again"
            yield Damage(name, "is in no line of the journal", "one run, until then", remedy)
        elif is_sound and not _is_of(study, found):
            yield Damage(name, "holds a run of another design or seed", "one run", again, _removal(run))
        for path in sorted(run.iterdir()):
            if path.match("precision_*.npz"):
                if precision.is_damaged(path):
                    remedy = f"the file is removed; {_AGAIN} evaluates it again"
                    yield Damage(study.name(path), "is damaged", "one evaluation", remedy, _removal(path))
            elif path.name not in (store.RECORD, *found.files) and not store.is_temporary(path):
                aside = partial(_set_aside, study.folder, path)
                yield Damage(study.name(path), "is no file of this run", "nothing", _ASIDE, aside)


def _home(study: _Study, run: Path) -> Path | None:
    """Return where the run in a folder belongs, by its record; None where that cannot be read."""
    try:
        plain = store.read_json(run / store.RECORD)
        return store.run_folder(study.folder, int(plain["trial"]), int(plain["repeat"]))
    except (StoreError, LookupError, TypeError, ValueError):
        return None


def _bring(study: _Study, run: Path, home: Path) -> None:
    if os.path.lexists(home):
        _set_aside(study.folder, run)
    else:
        with store.explained(home):
            home.parent.mkdir(parents=True, exist_ok=True)
            run.replace(home)
    with contextlib.suppress(OSError):  # unless others are there
        run.parent.rmdir()


def _is_of(study: _Study, found: RunRecord) -> bool:
    if found.trial >= IMPORTED or not study.space:
        return True
    design = study.entries[found.trial].design
    is_design = seeds.design_key(design) == seeds.design_key(found.design)
    return is_design and found.seed == study.space.get("seed")


def _missing(study: _Study) -> Iterator[Damage]:
    """Runs of which the journal or the tables say that they have finished."""
    expected = {x.trial: study.repeats for x in study.entries if x.is_reported and not x.excluded}
    with contextlib.suppress(StoreError):
        table = held.read(study.folder / held.TRIALS)
        for trial, n in zip(table["trial"], table["repeats"], strict=True):
            expected[trial] = max(n, expected.get(trial, 0))
    for trial, n in sorted(expected.items()):
        of_trial = study.records.get(trial, {})
        for repeat in range(n) if not any(x.told for x in of_trial.values()) else ():
            run = store.run_folder(study.folder, trial, repeat)
            if repeat not in of_trial and run not in study.runs:
                again = f"{_AGAIN} trains it again"
                remedy = again if trial < IMPORTED else "`dse import` brings it back"
                yield Damage(study.name(run), "is missing: the run had finished", "one run", remedy)


def _checkpoints(study: _Study) -> Iterator[Damage]:
    """Where unfinished trainings stand, against where racing lets them stand."""
    standing: dict[int, int] = {}
    for path in _matches(study.folder, "checkpoints/*/artefacts/*/repeat_*"):
        if path.is_dir() and (fault := _checkpoint(study, path, standing)):
            remedy = f"it is removed; {_AGAIN} trains on from where it can"
            yield Damage(study.name(path), fault, "some epochs of a training", remedy, _removal(path))
    for one, after in itertools.chain(*(itertools.pairwise(x) for x in study.rounds.values())):
        for trial in (*after["trials"], *(x["trial"] for x in after["stopped"])):
            if trial in one["trials"] and trial not in study.records:
                if standing.get(trial, 0) < (one["epochs"] or 0):
                    path = store.run_folder(checkpoints.rung_folder(study.folder, one["epochs"]), trial, 0)
                    fault = f"is missing: trial {trial} stood at this rung"
                    remedy = f"{_AGAIN} trains it again"
                    yield Damage(study.name(path), fault, f"{one['epochs']} epochs of a training", remedy)


def _checkpoint(study: _Study, path: Path, standing: dict[int, int]) -> str:
    """Return what is wrong with a checkpoint; '' if nothing is, and then note that its trial stands there."""
    epochs = path.parents[2].name
    try:
        plain = store.load_run(path) or {}
        trial, repeat = int(plain["trial"]), int(plain["repeat"])
        if checkpoints.made_as(plain, int(epochs))[1] != int(epochs):
            return f"is of a training that stood after {plain['epochs']} epochs"
    except (StoreError, *_MALFORMED) as error:
        return _said(error, path)
    if not study.knows(trial):
        return "is of a trial that the journal does not name"
    record = study.records.get(trial, {}).get(repeat)
    if record is not None and record.stopped_at_epoch is None:
        return "is of a run that has ended"
    is_audited = record is not None and trial in study.audited  # it trains on beside its record
    if int(epochs) > study.stops.get(trial, math.inf) and not is_audited:
        return f"lies beyond the rung of {study.stops[trial]} epochs, where racing has stopped the design"
    standing[trial] = max(standing.get(trial, 0), int(epochs))
    return ""


def _files(study: _Study) -> Iterator[Damage]:
    """Files of `_FILES` that are missing, or not what was written."""
    for kind in _FILES:
        needed = [study.folder / name for name in kind.needed(study)]
        for path in dict.fromkeys([*needed, *_matches(study.folder, kind.place)]):
            try:
                if not os.path.lexists(path):
                    raise store.damaged(path, "is missing")
                kind.read(study, path)
            except (StoreError, *_MALFORMED) as error:
                mend = None if kind.mend is None else partial(kind.mend, study, path)
                yield Damage(study.name(path), _said(error, path), kind.cost, kind.remedy, mend)


@dataclass(frozen=True)
class _File:
    """A kind of file in a study's folder.

    place: its name, or a pattern. read: raises what is wrong with one; `ValueError` if it holds other things.
    cost, remedy: as of `Damage`. mend: repairs one. needed: names of those that must be there.
    """

    place: str
    read: Callable[[_Study, Path], object]
    cost: str
    remedy: str
    mend: Callable[[_Study, Path], object] | None
    needed: Callable[[_Study], Iterable[str]] = lambda _: ()


def _remove(_: _Study, path: Path) -> None:
    store.remove(path)


def _aside(study: _Study, path: Path) -> None:
    _set_aside(study.folder, path)


def _tables_again(study: _Study, path: Path) -> None:
    """Write the tables, and the profiles that price them."""
    if path.parent.name == "hardware":
        store.remove(path)
    tables.write_again(study.folder)


def _sessions(study: _Study, path: Path) -> None:
    environment.sessions(study.folder)


def _texts(_: _Study, path: Path) -> None:
    written = store.read_json(path)
    if not isinstance(written, list) or not all(isinstance(text, str) for text in written):
        raise ValueError("is no list of texts")


def _queued(_: _Study, path: Path) -> None:
    dict(store.read_json(path, needs_seal=False)["design"])


def _chip(study: _Study, path: Path) -> None:
    """Check a copy of a hardware profile, also against that of this version, if it has one."""
    try:
        found = pricing.profile(study.folder, path.stem)
    except ConfigError as error:
        raise ValueError(error.faults[0].message.split(";")[0]) from None
    if found.name != path.stem:
        raise ValueError(f"is the profile of {found.name}")
    if path.stem in names() and pricing.differ(found, load(path.stem)):
        raise ValueError("has other numbers than the profile has now")


def _plugin(study: _Study, path: Path) -> None:
    """Check a copy of a plugin, also against its file where that is found."""
    text = store.read_sealed_text(path)
    source = _plugins(study).get(study.name(path))
    if source is not None and source.is_file() and source.read_text("utf-8", "replace") != text:
        raise ValueError(f"differs from {source}, which the study was started with")


def _plugins(study: _Study) -> dict[str, Path]:
    """Return the copies of plugins -> their files."""
    files = [Path(x) for x in study.space.get("plugins", ()) if x.endswith(".py")]
    return {f"plugins/{number}_{file.name}": file for number, file in enumerate(files)}


def _chips(study: _Study) -> list[str]:
    """Return the copies of the profiles that runs were measured on."""
    measured = [x.numbers for of in study.records.values() for x in of.values() if x.numbers is not None]
    return [f"hardware/{name}.yaml" for name in sorted({chip for x in measured for chip in x.hardware})]


def _rounds(study: _Study, path: Path) -> list[dict[str, Any]]:
    """Return the rounds of a batch.

    Raises:
        ValueError, KeyError, TypeError: it holds other things, or names a trial of another batch.
        StoreError: it cannot be read.
    """
    rounds = list(store.read_json(path)["rounds"])
    known = set(study.batches.get(int(path.stem), ()))
    for one in rounds:
        stopped = [x["trial"] for x in one["stopped"] if int(x["epochs"]) and str(x["reason"])]
        if unknown := {*one["trials"], *stopped} - known:
            raise ValueError(f"names trial {min(unknown)}, which is not in batch {int(path.stem)}")
        if one["epochs"] is not None and int(one["epochs"]) < 1:
            raise ValueError(f"has a rung of {one['epochs']} epochs")
    return rounds


def _rounds_again(study: _Study, path: Path) -> None:
    """Write the rounds of a batch that has ended from its records; let one that has not ended begin anew."""
    trials = study.batches.get(int(path.stem), [])
    store.remove(path)
    if not all(study.entries[trial].is_reported for trial in trials):
        for trial in trials:
            for place in (study.folder, *study.folder.glob("checkpoints/*")):
                store.remove(store.run_folder(place, trial, 0).parent)
    elif trials:
        of = {trial: study.records.get(trial, {}).get(0) for trial in trials}
        stopped = [
            {"trial": trial, "epochs": record.stopped_at_epoch, "reason": record.reason}
            for trial, record in of.items()
            if record is not None and record.stopped_at_epoch is not None
        ]
        rung = int(study.space["search"]["racing"]["rungs"][0])
        going = sorted(set(trials) - {x["trial"] for x in stopped})
        first = {"epochs": rung, "trials": trials, "stopped": []}
        store.write_json(path, {"rounds": [first, {"epochs": None, "trials": going, "stopped": stopped}]})


def _raced(study: _Study) -> list[str]:
    """Return the rounds of the batches in which designs have stopped."""
    stopped = {
        t for t, of in study.records.items() if any(x.stopped_at_epoch is not None for x in of.values())
    }
    return [f"racing/{n:05d}.json" for n, trials in study.batches.items() if stopped & {*trials}]


def _trained_on(study: _Study) -> list[int]:
    """Return the designs that racing has stopped, and that an audit has trained on."""
    return sorted(
        trial
        for trial in study.stops
        if not any(x.stopped_at_epoch is not None for x in study.records.get(trial, {}).values())
        and study.entries[trial].is_reported
    )


def _audited(study: _Study, path: Path) -> None:
    found = store.read_json(path)
    if unknown := [x for x in found["trials"] if x not in study.stops]:
        raise ValueError(f"names trial {unknown[0]}, which racing has not stopped")
    if not 0 < int(found["designs"]) <= len(study.entries) or len(set(found["trials"])) < len(
        found["trials"]
    ):
        raise ValueError("counts designs that the journal does not name, or one twice")
    [*map(str, found.get("sentences", ()))]


def _audit_again(study: _Study, path: Path) -> None:
    """Write which designs the audit has drawn; remove the file where it draws the same ones again."""
    drawn = _trained_on(study)
    if len(drawn) < study.n_audited or not drawn:
        store.remove(path)
    else:
        store.write_json(path, {"designs": len(study.entries), "trials": drawn})


def _repeated(study: _Study, path: Path) -> None:
    for one in store.read_json(path)["rounds"]:
        if unknown := [x for x in one["repeats"] if not study.knows(int(x)) or int(one["repeats"][x]) < 1]:
            raise ValueError(f"names trial {unknown[0]}, which the study does not have")


def _more_repeats(study: _Study) -> dict[str, int]:
    """Return trial -> its runs, of the designs that were repeated because their place was undecided."""
    if (study.space.get("search") or {}).get("front_undecided") is None:
        return {}
    n = {trial: len(of) for trial, of in study.records.items() if trial < IMPORTED}
    return {str(trial): n_runs for trial, n_runs in n.items() if n_runs > study.repeats}


def _repeats_again(study: _Study, path: Path) -> None:
    store.remove(path)
    if more := _more_repeats(study):
        shown = dict.fromkeys(more, 0.5)
        store.write_json(path, {"rounds": [{"repeats": more, "probability": shown}]})


def _table(study: _Study, path: Path) -> None:
    """Check a table, and that it holds the runs of the study.

    Raises:
        Damaged: it is not what was written.
        ValueError: it holds other runs.
    """
    columns = set(held.read(path).columns)
    if ("status" in columns) != (path.name == held.TRIALS):
        raise ValueError("is another table")
    made_from = json.loads(store.made_from(path) or "{}")
    rows, runs = held.counted(path), store.runs_in(study.folder)
    written: Counter[int] = Counter()
    for trial, _, n in made_from.get("parts", ((x, 0, 1) for x in made_from.get("digests", ()))):
        written[int(trial)] += n
    if not made_from and path.name == held.TRIALS:
        written = Counter(list(runs))
    if written and (wrong := sorted(t for t in rows | written if rows[t] != written[t])):
        raise ValueError(f"has {rows[wrong[0]]} rows of trial {wrong[0]}, not {written[wrong[0]]}")
    found = held.behind(path)
    known = [trial for trial in found.lacking if study.knows(trial)]
    for what, trials in (("lacks", known), ("is older than the runs of", found.changed)):
        if trials:
            raise ValueError(f"{what} {held.named(trials)}: {len(trials)} of {len(runs)} trials")
    if found.lost and runs:
        raise ValueError(f"holds {held.named(found.lost)}, of which a run is missing")


def _recordings(study: _Study) -> Iterator[Damage]:
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


_FILES = (
    _File(store.SPACE, lambda _, path: plain_space(path), "nothing: runs hold their settings",
          f"{_AGAIN} writes it again once it has compared it with the finished runs", None,
          lambda _: [store.SPACE]),
    _File(store.ENVIRONMENT, _sessions, "when and where earlier sessions ran",
          "one of this session is written", lambda study, _: environment.begin(study.folder, []),
          lambda _: [store.ENVIRONMENT]),
    _File(store.WARNINGS, _texts, "warnings, until they are found again", _REMOVED, _remove),
    _File(audit.FILE, lambda _, path: audit.read(path), "the audit, until `dse audit` is run again",
          _REMOVED, _remove),
    _File(notes.FILE, lambda _, path: notes.read(path), "notes and pins on designs", _ASIDE, _aside),
    _File(saved_views.FILE, lambda _, path: saved_views.read(path), "saved views of the page", _ASIDE, _aside),
    _File("queue/*_*.json", _queued, "a design that was asked for", _ASIDE, _aside),
    _File("plugins/*.py", _plugin, "the copy, not the original", _REMOVED, _remove, _plugins),
    _File("racing/[0-9]*.json", _rounds, "when designs of a batch stopped; of one that has not ended its runs",
          "it is written anew from the records, or the batch begins anew", _rounds_again, _raced),
    _File(_AUDIT, _audited, "what the audit of racing has said",
          f"it is written anew from the records; {_AGAIN} ends the audit", _audit_again,
          lambda study: [_AUDIT] if _trained_on(study) else []),
    _File(_REPEATS, _repeated, "why designs were repeated",
          "it is written anew from the records", _repeats_again,
          lambda study: [_REPEATS] if _more_repeats(study) else []),
    _File("hardware/*.yaml", _chip,
          "no run: points are priced anew, trials keep the costs that the sampler received",
          "it is replaced with the profile as it is now, and all points are priced with that", _tables_again,
          _chips),
    *(_File(name, _table, "nothing: it follows from the runs", "it is written again", _tables_again,
            lambda study, name=name: [name] if study.records else []) for name in (held.TRIALS, held.POINTS)),
)  # fmt: skip

_CHECKS: tuple[Callable[[_Study], Iterator[Damage]], ...] = (
    *(_access, _journal, _runs, _files, _missing, _checkpoints, _recordings),
)
