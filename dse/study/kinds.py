"""The kinds of files in a study's folder: how one is checked, what its loss costs, and how it is mended."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from dse import store
from dse.audit import record as audit
from dse.config import ConfigError
from dse.hardware.profile import load, names
from dse.study import environment, held, notes, pricing, tables
from dse.study.contents import AUDIT, Contents, rounds_in, set_aside
from dse.study.record import IMPORTED
from dse.study.results import plain_space

AGAIN = "`dse run` with the study's search space"
ASIDE = "it is renamed, its name ending in .damaged, to be read by eye"
_REMOVED = f"it is removed; {AGAIN} writes it again"
_REPEATS = "front_repeats.json"


@dataclass(frozen=True)
class File:
    """A kind of file in a study's folder.

    place: its name, or a pattern. read: raises what is wrong with one; `ValueError` if it holds other things.
    cost, remedy: as of `Damage`. mend: repairs one. needed: names of those that must be there.
    needs_journal: whether `mend` waits until the journal is mended.
    """

    place: str
    read: Callable[[Contents, Path], object]
    cost: str
    remedy: str
    mend: Callable[[Contents, Path], object] | None
    needed: Callable[[Contents], Iterable[str]] = lambda _: ()
    needs_journal: bool = False


def _remove(_: Contents, path: Path) -> None:
    store.remove(path)


def _aside(study: Contents, path: Path) -> None:
    set_aside(study.folder, path)


def _tables_again(study: Contents, path: Path) -> None:
    """Write the tables, and the profiles that price them."""
    if path.parent.name == "hardware":
        store.remove(path)
    tables.write_again(study.folder)


def _sessions(study: Contents, path: Path) -> None:
    environment.sessions(study.folder)


def _texts(_: Contents, path: Path) -> None:
    written = store.read_json(path)
    if not isinstance(written, list) or not all(isinstance(text, str) for text in written):
        raise ValueError("is no list of texts")


def _queued(_: Contents, path: Path) -> None:
    dict(store.read_json(path, needs_seal=False)["design"])


def _chip(study: Contents, path: Path) -> None:
    """Check a copy of a hardware profile, also against that of this version, if it has one."""
    try:
        found = pricing.profile(study.folder, path.stem)
    except ConfigError as error:
        raise ValueError(error.faults[0].message.split(";")[0]) from None
    if found.name != path.stem:
        raise ValueError(f"is the profile of {found.name}")
    if path.stem in names() and pricing.differ(found, load(path.stem)):
        raise ValueError("has other numbers than the profile has now")


def _plugin(study: Contents, path: Path) -> None:
    """Check a copy of a plugin, also against its file where that is found."""
    text = store.read_sealed_text(path)
    source = _plugins(study).get(study.name(path))
    if source is not None and source.is_file() and source.read_text("utf-8", "replace") != text:
        raise ValueError(f"differs from {source}, which the study was started with")


def _plugins(study: Contents) -> dict[str, Path]:
    """Return the copies of plugins -> their files."""
    files = [Path(x) for x in study.space.get("plugins", ()) if x.endswith(".py")]
    return {f"plugins/{number}_{file.name}": file for number, file in enumerate(files)}


def _chips(study: Contents) -> list[str]:
    """Return the copies of the profiles that runs were measured on."""
    measured = [x.numbers for of in study.records.values() for x in of.values() if x.numbers is not None]
    return [f"hardware/{name}.yaml" for name in sorted({chip for x in measured for chip in x.hardware})]


def _rounds_again(study: Contents, path: Path) -> None:
    """Write the rounds of a batch that has ended from its records; of others `dse run` decides anew."""
    batch = study.batches.get(int(path.stem), ())
    trials = [trial for trial in batch if not study.entries[trial].excluded]
    store.remove(path)
    if trials and all(len(study.records.get(trial, ())) >= study.repeats for trial in trials):
        stopped = [study.stops[trial] for trial in trials if trial in study.stops]
        going = [trial for trial in trials if trial not in study.stops]
        first = {"epochs": study.search["racing"]["rungs"][0], "trials": trials, "stopped": []}
        store.write_json(path, {"rounds": [first, {"epochs": None, "trials": going, "stopped": stopped}]})


def _raced(study: Contents) -> list[str]:
    """Return the rounds of the batches in which designs have stopped."""
    return [f"racing/{n:05d}.json" for n, trials in study.batches.items() if study.stops.keys() & {*trials}]


def _trained_on(study: Contents) -> list[int]:
    """Return the designs that racing has stopped, and that an audit has trained on."""
    of_trial = study.records.items()
    return [t for t, of in of_trial if t in study.stops and next(iter(of.values())).finished]


def _audited(study: Contents, path: Path) -> None:
    found = store.read_json(path)
    if unknown := [x for x in found["trials"] if x not in study.stops]:
        raise ValueError(f"names trial {unknown[0]}, which racing has not stopped")
    if not 0 < int(found["designs"]) or len(set(found["trials"])) < len(found["trials"]):
        raise ValueError("counts no design, or names one twice")
    [*map(str, found.get("sentences", ()))]


def _audit_again(study: Contents, path: Path) -> None:
    """Write which designs the audit has drawn; remove the file where it draws the same ones again."""
    store.remove(path)
    if (drawn := _trained_on(study)) and len(drawn) >= study.search["racing"]["audit"]:
        store.write_json(path, {"designs": len(study.entries), "trials": drawn})


def _repeated(study: Contents, path: Path) -> None:
    for one in store.read_json(path)["rounds"]:
        if unknown := [x for x in one["repeats"] if not study.knows(int(x)) or int(one["repeats"][x]) < 1]:
            raise ValueError(f"names trial {unknown[0]}, which the study does not have")


def _undecided(study: Contents) -> list[str]:
    """Return the list of repeats, if designs were repeated because their place was undecided."""
    n = [len(of) for trial, of in study.records.items() if trial < IMPORTED]
    is_set = study.search.get("front_undecided") is not None
    return [_REPEATS] if is_set and max(n, default=0) > study.repeats else []


def _table(study: Contents, path: Path) -> None:
    """Check a table, and that it holds the runs of the study, but for those that are damaged themselves.

    Raises:
        Damaged: it is not what was written.
        ValueError: it holds other runs.
    """
    table = held.read(path)
    if ("status" in table) != (path.name == held.TRIALS):
        raise ValueError("is another table")
    made_from, rows = json.loads(store.made_from(path) or "{}"), held.counted(table)
    written: Counter[int] = Counter()
    for trial, _, n in made_from.get("parts", ((x, 0, 1) for x in made_from.get("digests", ()))):
        written[int(trial)] += n
    if written and (wrong := sorted(t for t in rows | written if rows[t] != written[t])):
        raise ValueError(f"has {rows[wrong[0]]} rows of trial {wrong[0]}, not {written[wrong[0]]}")
    found = held.behind(path)
    lacking = found.lacking if made_from else study.records.keys() - rows
    for what, trials in (("lacks", lacking), ("is older than the runs of", found.changed)):
        if known := sorted(trial for trial in trials if trial in study.records and study.knows(trial)):
            raise ValueError(f"{what} {held.named(known)}: {len(known)} of {len(study.records)} trials")


def _with_records(name: str) -> Callable[[Contents], list[str]]:
    return lambda study: [name] if study.records else []


FILES = (
    File(store.SPACE, lambda study, path: study.space or plain_space(path),
         "nothing: runs hold their settings",
         f"{AGAIN} writes it again once it has compared it with the finished runs", None,
         lambda _: [store.SPACE]),
    File(store.ENVIRONMENT, _sessions, "when and where earlier sessions ran",
         "a new one is written", lambda study, _: environment.begin(study.folder, []),
         lambda _: [store.ENVIRONMENT]),
    File(store.WARNINGS, _texts, "warnings, until they are found again", _REMOVED, _remove),
    File(audit.FILE, lambda _, path: audit.read(path), "the audit, until `dse audit` is run again",
         _REMOVED, _remove),
    File(notes.FILE, lambda _, path: notes.read(path), "notes and pins on designs", ASIDE, _aside),
    File("queue/*_*.json", _queued, "a design that was asked for", ASIDE, _aside),
    File("plugins/*.py", _plugin, "the copy, not the original", _REMOVED, _remove, _plugins),
    File("racing/[0-9]*.json", rounds_in, "when designs of a batch stopped",
         f"it is written anew from the records, or by {AGAIN}", _rounds_again, _raced, True),
    File(AUDIT, _audited, "what the audit of racing has said",
         f"it is written anew from the records, or by {AGAIN}", _audit_again,
         lambda study: [AUDIT] if _trained_on(study) else [], True),
    File(_REPEATS, _repeated, "why designs were repeated", _REMOVED, _remove, _undecided, True),
    File("hardware/*.yaml", _chip,
         "no run: points are priced anew, trials keep the costs that the sampler received",
         "it is replaced with the profile as it is now, and all points are priced with that", _tables_again,
         _chips),
    *(File(name, _table, "nothing: it follows from the runs", "it is written again", _tables_again,
           _with_records(name), True) for name in (held.TRIALS, held.POINTS)),
)  # fmt: skip
