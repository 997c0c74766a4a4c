"""What is damaged in a study's folder, what it costs, and its repair; nothing that can be read is lost."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dse import store
from dse.audit import record
from dse.config import ConfigError, SearchSpace, load_space
from dse.hardware.profile import load_all
from dse.store import StoreError
from dse.study import environment, lines, notes, points, precision, pricing, saved_views
from dse.study import trials as tables
from dse.study.ledger import Ledger, drop_refused
from dse.study.record import RunRecord, load_record
from dse.study.results import plain_space

_SPACE, _JOURNAL = "search_space.yaml", "journal.log"
_TABLES = ("trials.parquet", "points.parquet")
_AGAIN = "`dse run` with the study's search space"


@dataclass(frozen=True)
class Damage:
    """One thing that is damaged.

    file: relative to the study. fault: what is wrong. cost: what is lost with it.
    remedy: what `--repair` does, and what is left to do.
    repair: does it; None where only the user can.
    """

    file: str
    fault: str
    cost: str
    remedy: str
    repair: Callable[[], object] | None


def examine(folder: Path) -> list[Damage]:
    """Return everything that is damaged in a study's folder, in the order of repair.

    Raises:
        StoreError: the folder holds no study, or a file cannot be read now.
    """
    if not any((folder / name).exists() for name in (_SPACE, _JOURNAL, "artefacts")):
        raise StoreError(f"{folder}: is not the folder of a study: there is no {_SPACE}")
    return [*_runs(folder), *_texts(folder), *_journal(folder), *_tables(folder), *_profiles(folder)]


def repair(folder: Path, damages: list[Damage]) -> list[str]:
    """Repair what can be repaired; return the files that still wait for the user.

    Raises:
        StoreError: the study runs, or its folder cannot be written.
    """
    left = []
    with store.exclusive(folder):
        store.sweep(folder)
        for damage in damages:
            try:
                if damage.repair is None:
                    left.append(damage.file)
                else:
                    damage.repair()
            except (ConfigError, store.Damaged) as error:
                left.append(f"{damage.file} ({str(error).splitlines()[0]})")
    return left


def _fault(path: Path, read: Callable[[Path], object]) -> str:
    """Return what is wrong with a file, without the file and the remedy; '' if nothing is."""
    try:
        read(path)
    except store.Damaged as error:
        text = str(error).removesuffix(f"; {store.REMEDY}")
        return text.removeprefix(f"{path}: ")
    return ""


def _runs(folder: Path) -> Iterator[Damage]:
    for run in sorted(folder.glob("artefacts/*/repeat_*")):
        name = str(run.relative_to(folder))
        if fault := _fault(run, load_record):
            yield Damage(
                name, fault, "one run", f"the run is removed; {_AGAIN} trains it again", _removal(run)
            )
            continue
        for path in sorted(run.glob("precision_*.npz")):
            if precision.is_damaged(path):
                remedy = f"the file is removed; {_AGAIN} evaluates it again"
                yield Damage(f"{name}/{path.name}", "is damaged", "one evaluation", remedy, _removal(path))


def _removal(path: Path) -> Callable[[], object]:
    return lambda: store.remove(path)


def _texts(folder: Path) -> Iterator[Damage]:
    if fault := _fault(folder / _SPACE, plain_space):
        remedy = f"{_AGAIN} writes it again once it has compared it with the finished runs"
        yield Damage(_SPACE, fault, "nothing: runs hold their settings", remedy, None)
    if fault := _fault(folder / store.ENVIRONMENT, _sessions):
        remedy, cost = "one of this session is written", "when and where earlier sessions ran"
        yield Damage(store.ENVIRONMENT, fault, cost, remedy, lambda: environment.begin(folder, []))
    removed = f"it is removed; {_AGAIN} writes it again"
    for name, read, cost in (
        (store.WARNINGS, _list, "warnings, until they are found again"),
        (record.FILE, record.read, "the audit, until `dse audit` is run again"),
    ):
        path = folder / name
        if path.exists() and (fault := _fault(path, read)):
            yield Damage(name, fault, cost, removed, _removal(path))
    for name, reader, cost in (
        (notes.FILE, notes.read, "notes and pins on designs"),
        (saved_views.FILE, saved_views.read, "saved views of the page"),
    ):
        written = folder / name
        if written.exists() and (fault := _fault(written, reader)):
            remedy = f"it is renamed to {name}.damaged, to be read by eye"
            yield Damage(name, fault, cost, remedy, functools.partial(_set_aside, written))
    for path in sorted([*folder.glob("hardware/*.yaml"), *folder.glob("plugins/*.py")]):
        if fault := _fault(path, store.read_sealed_text):
            yield Damage(
                str(path.relative_to(folder)), fault, "the copy, not the original", removed, _removal(path)
            )


def _profiles(folder: Path) -> Iterator[Damage]:
    for path in sorted(folder.glob("hardware/*.yaml")):
        if not _fault(path, store.read_sealed_text) and (fault := pricing.outdated(path)):
            yield Damage(
                str(path.relative_to(folder)),
                fault,
                "no run: points are priced anew, trials keep the costs that the sampler received",
                "it is replaced with the profile as it is now, and all points are priced with that",
                lambda: write_tables(folder),
            )


def _set_aside(path: Path) -> None:
    path.replace(path.with_name(f"{path.name}.damaged"))


def _sessions(path: Path) -> None:
    """Read the sessions of a study.

    Raises:
        Damaged: the file is missing, or not what was written.
    """
    if not path.exists():
        raise store.damaged(path, "is missing")
    environment.sessions(path.parent)


def _list(path: Path) -> None:
    """Read a list.

    Raises:
        Damaged: it is not what was written.
    """
    if not isinstance(store.read_json(path), list):
        raise store.damaged(path, "holds no list")


def _journal(folder: Path) -> Iterator[Damage]:
    content = lines.read(folder / _JOURNAL)
    if faults := content.faults or drop_refused(content.logs):
        yield Damage(
            _JOURNAL,
            "; ".join(faults),
            "when these designs were proposed",
            f"it is written anew from its other lines and the records; a copy stays as {_JOURNAL}.damaged",
            lambda: Ledger(folder / _JOURNAL, _space(folder)),
        )


def _tables(folder: Path) -> Iterator[Damage]:
    faults = {
        name: fault
        for name in _TABLES
        if (folder / name).exists() and (fault := _fault(folder / name, _table))
    }
    for number, (name, fault) in enumerate(faults.items()):
        yield Damage(
            name, fault, "nothing: it follows from the runs", "it is written again",
            (lambda: write_tables(folder)) if number == 0 else lambda: None,
        )  # fmt: skip


def _table(path: Path) -> None:
    """Read a table.

    Raises:
        Damaged: it is not what was written.
    """
    import pyarrow.parquet

    store.verify(path)
    try:
        pyarrow.parquet.read_table(path)
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise store.damaged(path, f"cannot be read: {str(error).splitlines()[0]}") from None


def _space(folder: Path) -> SearchSpace:
    plain_space(folder / _SPACE)  # raises if it is not what was written
    return load_space(folder / _SPACE)


def write_tables(folder: Path, ledger: Ledger | None = None) -> dict[int, dict[str, Any]]:
    """Write the tables from runs and journal, and the profiles that price them; return trial -> its row.

    Args:
        folder: of the study, which the caller has locked.
        ledger: its journal, if it is open.
    """
    space = _space(folder)
    profiles = load_all(space.hardware, space.source.parent)
    runs: dict[int, list[RunRecord]] = {}
    for run in sorted(folder.glob("artefacts/*/repeat_*")):
        if (found := load_record(run)) is not None:
            runs.setdefault(found.trial, []).append(found)
    trials = {trial: sorted(of, key=lambda x: x.repeat) for trial, of in sorted(runs.items())}
    entries = (ledger or Ledger(folder / _JOURNAL, space)).entries
    pricing.keep(profiles, folder)
    table = tables.trials_table(space, trials, [entry for entry in entries if entry.excluded])
    with store.published(folder / _TABLES[0]) as path:
        store.write_table(path, table)
    points.write_points(folder / _TABLES[1], space, folder, trials, profiles)
    rows = table.to_dict("records")
    return {int(row["trial"]): {str(name): store.plain_cell(x) for name, x in row.items()} for row in rows}
