"""A study driven from outside: designs that a user wants trained, or asks for and measures elsewhere.

A running search reads what is enqueued at each batch. A design that is asked for is on the disk, with its
number, before it is returned. Values that are told become the record of a run without files
(`dse.study.record.TOLD`), and the tables mark them. A design that is never told is trained by the next
`dse run`.
"""

from __future__ import annotations

import contextlib
import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dse import registry, store
from dse.config import ConfigError, Fault, SearchSpace, load_space
from dse.config.faults import known_names
from dse.config.space import Design
from dse.config.values import echo
from dse.config.yaml_lines import Document, in_file_order, read_document
from dse.hardware.profile import of_space
from dse.seeds import design_key
from dse.store import Book, back_up, explained
from dse.study import tables, warm
from dse.study.claim import claim
from dse.study.held import plain_space
from dse.study.known import KnownBefore
from dse.study.ledger import Entry, Ledger
from dse.study.mended import opened
from dse.study.progress import Progress
from dse.study.record import Numbers, RunRecord, load_record
from dse.study.runs import Runs
from dse.study.searches import Batches, values_of
from dse.study.warm import axis_value, on_axes
from dse.study.workers import Workers


def ask(space: SearchSpace, results: str | Path, n: int) -> tuple[list[tuple[int, Design]], list[str]]:
    """Propose designs to be measured elsewhere; return each with its number, and notes.

    Args:
        space: what to explore.
        results: folder of studies; that of this one is made in it.
        n: number of designs; fewer are returned where the space has no more.

    Raises:
        ConfigError, StoreError: as in `dse.study.explore.run`.
    """
    folder = Path(results) / space.study
    profiles = of_space(space)
    earlier = warm.earlier_trials(space)
    with store.exclusive(folder), Workers(1) as workers, contextlib.ExitStack() as at_the_end:
        store.sweep(folder)
        book, notes = at_the_end.enter_context(opened(folder, space.search.batch))
        notes += claim(space, book)
        ledger = Ledger(book)
        runs = Runs(space, book, profiles, workers, Progress())
        runs.recall(ledger.entries)
        before = None if space.limits is None else KnownBefore(space, profiles, runs.shape)
        batches = Batches(space, ledger, runs, before, earlier, Progress())
        number = 1 + max((entry.batch for entry in ledger.entries), default=-1)
        for batch in range(number):
            batches.learn(batch)
        designs = batches.propose(number, n, enqueued=True) or []
        if len(designs) < n:
            notes.append(f"the sampler found {len(designs)} designs that are new")
        return [(entry.trial, x) for entry, x in zip(batches.of(number), designs, strict=True)], notes


def tell(folder: Path, trial: int, told: Mapping[str, float], failed: str = "") -> dict[str, Any]:
    """Record the values of a design that was asked for; return its row of the table of trials.

    Args:
        folder: of the study.
        trial: number of the design.
        told: column -> value; every objective among them.
        failed: instead of values, why there are none.

    Raises:
        ConfigError: every fault of the values.
        StoreError: the design was not asked for or has a result, or the folder is in use.
    """
    plain_space(folder / store.SPACE)  # raises if it is none
    space = load_space(folder / store.SPACE)
    of_space(space)
    with store.exclusive(folder), opened(folder, space.search.batch) as (book, _):
        ledger = Ledger(book)
        entry = _asked(folder, ledger, trial)
        if not failed:
            _check(space, folder, told)
        run = store.run_file(folder, trial, 0)
        record = RunRecord(
            trial=trial,
            repeat=0,
            design=entry.design,
            seed=space.seed,
            reason=failed,
            numbers=None if failed else _numbers(space, told),
            told=not failed,
        )
        store.remove(run)  # of a `tell` that was interrupted
        store.save_run(run, record.to_plain(), {})
        store.note_files(book, [run])
        ledger.tell(trial, None if failed else values_of(space, [record]))
        return tables.write_again(folder)[trial]


def _asked(folder: Path, ledger: Ledger, trial: int) -> Entry:
    """Return the entry of a design that waits for its values."""
    waiting = [entry.trial for entry in ledger.entries if not entry.is_reported]
    shown = ", ".join(map(str, waiting[:10])) + (" and more" if len(waiting) > 10 else "")
    hint = f"designs that wait for values: {shown or 'none; `dse ask` proposes one'}"
    if not 0 <= trial < len(ledger.entries):
        raise store.StoreError(f"{folder}: design {trial} was never asked for; {hint}")
    entry = ledger.entries[trial]
    if entry.excluded:
        raise store.StoreError(f"{folder}: design {trial} is excluded: {entry.excluded}; {hint}")
    run = store.run_file(folder, trial, 0)
    trained = load_record(run) if run.exists() else None
    if entry.is_reported or (trained is not None and not trained.told):
        raise store.StoreError(f"{folder}: design {trial} has its result; {hint}")
    return entry


def _check(space: SearchSpace, folder: Path, told: Mapping[str, float]) -> None:
    """Check values that are told."""
    declared = registry.columns()
    objectives = [name for name, _ in space.objectives]
    known = sorted({*declared, *objectives, "accuracy"})
    texts = [f"objective {name} is missing" for name in objectives if name not in told]
    for name, value in told.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f". Did you mean '{near[0]}'?" if near else ""
            texts.append(f"unknown column '{name}'; `dse describe objectives` has all{hint}")
        elif not math.isfinite(value):
            texts.append(f"{name} must be finite, got {value:g}")
        elif name.startswith("accuracy") and not 0 <= value <= 1:
            texts.append(f"{name} must be within 0 and 1, got {value:g}")
    if texts:
        raise ConfigError([Fault(str(folder), 0, text) for text in texts])


def _numbers(space: SearchSpace, told: Mapping[str, float]) -> Numbers:
    """Return values as the numbers of a run: costs are those on the first chip, which it fits unless told."""
    of_chips = registry.columns("hardware").keys() if space.hardware else set()
    chip = {"fits": True, **{name: value for name, value in told.items() if name in of_chips}}
    chip["fits"] = bool(chip["fits"])
    ends = {f"{name}{end}": value for name, value in chip.items() for end in ("_low", "_high")}
    chip = {name: value for name, value in ends.items() if name in of_chips} | chip
    columns = {name: value for name, value in told.items() if name not in of_chips}
    first = [profile.name for profile in of_space(space)][:1]
    return Numbers(columns, {name: chip for name in first})


def read_designs(space: SearchSpace, path: Path) -> list[Design]:
    """Return the designs of a YAML file: a mapping of axes to values, or a list of these.

    Raises:
        ConfigError: every design that is none of the search space, with its line.
    """
    document = read_document(path, {})
    if document.faults:
        raise in_file_order(document.faults)
    written = document.data if isinstance(document.data, list) else [document.data]
    designs: list[Design] = []
    faults: list[Fault] = []
    for index, one in enumerate(written):
        where = (index,) if isinstance(document.data, list) else ()
        design = on_axes(space, one) if isinstance(one, dict) else None
        if design is not None:
            designs.append(design)
        else:
            faults += _faults(space, one, document, where)
    if not written:
        faults.append(document.fault((), "must hold at least one design, got none"))
    if faults:
        raise in_file_order(faults)
    return designs


def _faults(space: SearchSpace, one: object, document: Document, where: tuple[int, ...]) -> list[Fault]:
    if not isinstance(one, dict):
        return [document.fault(where, f"a design must be a mapping of axes to values, got {echo(one)}")]
    faults = []
    for name, value in one.items():
        axis = space.axes.get(name)
        if axis is None:
            text = f"unknown axis '{name}'; {known_names(name, space.axes)}"
            faults.append(document.fault((*where, name), text))
        elif axis_value(axis, value) is None:
            text = f"{name} must be on its axis {axis.to_plain()}, got {echo(value)}"
            faults.append(document.fault((*where, name), text))
    if not faults:
        needed = list(space.active(one))
        text = f"a design must have the axes {', '.join(needed)}, got {', '.join(map(str, one)) or 'none'}"
        faults.append(document.fault(where, text))
    return faults


def enqueue(folder: Path, designs: Sequence[Design]) -> None:
    """Append designs to the queue of a study's folder; a design that waits already keeps its place.

    Raises:
        StoreError: the folder cannot be written.
    """
    with explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with Book(folder, writes=True) as book:
        with book.together():
            rows = book.rows("queue")
            known = {design_key(row["design"]) for row in rows}
            place = 1 + max((row["place"] for row in rows), default=0)
            new = [dict(design) for design in designs if design_key(design) not in known]
            book.put("queue", [{"place": place + n, "design": design} for n, design in enumerate(new)])
        back_up(book)
