"""Two studies of one search space as one: equal designs once, and their repeats joined."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dse import seeds, store
from dse.config import ConfigError, Fault, SearchSpace, load_space
from dse.search.limits import Exclusion
from dse.study import pricing, tables
from dse.study.claim import changes_elsewhere
from dse.study.explore import values_of
from dse.study.journal import Entry, read_journal
from dse.study.ledger import Ledger
from dse.study.record import RunRecord, load_record
from dse.study.results import plain_space
from dse.study.warm import copy_run

_SPACE, _JOURNAL = "search_space.yaml", "journal.log"


@dataclass(frozen=True)
class _Study:
    """A study to merge; records: trial -> repeat -> record, versions: of dse, that wrote them."""

    folder: Path
    entries: Sequence[Entry]
    records: Mapping[int, Mapping[int, RunRecord]]
    versions: frozenset[str]

    @classmethod
    def read(cls, folder: Path) -> _Study:
        plain_space(folder / _SPACE)  # raises if it is none
        records: dict[int, dict[int, RunRecord]] = {}
        versions = set()
        for run in sorted(folder.glob("artefacts/*/repeat_*")):
            versions.add(str(store.read_record(run).get("version")))
            if (record := load_record(run)) is not None:
                records.setdefault(record.trial, {})[record.repeat] = record
        return cls(folder, read_journal(folder / _JOURNAL), records, frozenset(versions))


def merge(first: Path, second: Path, into: Path) -> dict[str, int]:
    """Write a study that holds the designs and runs of two studies of one search space.

    Runs are copied with their files. What was measured at other precisions is evaluated again by `dse run`;
    imported networks stay where they are.

    Args:
        first: folder of a study, which no process runs.
        second: folder of the other one.
        into: folder of the new study, which must not exist; its name becomes that of the study.

    Returns:
        Number of designs, of those in both studies, and of runs.

    Raises:
        ConfigError: search space, recordings, hardware or version of the studies differ; one fault each.
        StoreError: a folder is no study, damaged or in use, or `into` exists.
    """
    if into.exists():
        raise store.StoreError(f"{into}: exists already; merge into a new folder")
    if first.resolve() == second.resolve():
        raise store.StoreError(f"{first}: a study cannot be merged with itself")
    for folder in (first, second):
        if not (folder / _SPACE).is_file():
            raise store.StoreError(f"{folder}: is not the folder of a study")
    with store.exclusive(first), store.exclusive(second):
        studies = _Study.read(first), _Study.read(second)
        space = load_space(first / _SPACE, {"study": into.name, "execution.storage": "null"})
        _check(space, *studies)
        staging = into.parent / f"{store.TEMPORARY}{secrets.token_hex(4)}"
        try:
            counts = _written(space, studies, staging / into.name)
            with store.explained(into):
                os.replace(staging / into.name, into)
        finally:
            store.remove(staging)
    return counts


def _check(space: SearchSpace, one: _Study, two: _Study) -> None:
    """Check that two studies are of one search space, on the same recordings, and by the same version."""
    plain = [plain_space(study.folder / _SPACE) for study in (one, two)]
    texts = [f"{key} is {new!r}, but {old!r} in {one.folder}" for key, old, new in changes_elsewhere(*plain)]
    if plain[0].get("search", {}).get("racing") is not None:
        texts.append("search.racing: studies that race cannot be merged: each compares its own designs")
    if one.versions and two.versions and one.versions != two.versions:
        versions = [", ".join(sorted(study.versions)) for study in (one, two)]
        texts.append(f"its runs are of dse {versions[1]}, but of {versions[0]} in {one.folder}")
    for name in sorted({x.name for x in (one.folder / "plugins").glob("*.py")}):
        copies = [study.folder / "plugins" / name for study in (one, two)]
        if not copies[1].is_file() or len({store.read_sealed_text(copy) for copy in copies}) > 1:
            texts.append(f"plugin {name} differs from that in {one.folder}")
    for chip in sorted((one.folder / "hardware").glob("*.yaml")):
        if (two.folder / "hardware" / chip.name).is_file():
            texts += pricing.differences(one.folder, two.folder, chip.stem)
    data = _data_of(space, one)
    differing = [key for key, name in _data_of(space, two).items() if data.get(key, name) != name]
    if differing:
        texts.append(f"its runs were trained on other recordings than those in {one.folder}")
    if texts:
        raise ConfigError([Fault(str(two.folder), 0, text) for text in texts])


def _data_of(space: SearchSpace, study: _Study) -> dict[tuple[str, int], str]:
    """Return what a data set follows from, its axes and its fold -> its key."""
    k = space.split.k_fold.k if space.split.k_fold is not None else 1
    keys = {}
    for of_trial in study.records.values():
        for record in of_trial.values():
            if record.data:
                axes = {
                    name: x
                    for name, x in record.design.items()
                    if space.axes[name].place[0] not in ("model", "training")
                }
                keys[seeds.design_key(axes), record.repeat % k] = record.data
    return keys


def _written(space: SearchSpace, studies: Sequence[_Study], folder: Path) -> dict[str, int]:
    """Write the merged study to a folder of its name."""
    n_first = 1 + max((entry.batch for entry in studies[0].entries), default=-1)
    number_of: dict[str, int] = {}
    merged: list[tuple[int, Entry, dict[int, tuple[Path, RunRecord]]]] = []
    n_both = 0
    for study, offset in zip(studies, (0, n_first), strict=True):
        for entry in study.entries:
            runs = {
                repeat: (store.run_folder(study.folder, entry.trial, repeat), record)
                for repeat, record in study.records.get(entry.trial, {}).items()
            }
            key = seeds.design_key(entry.design)
            if key not in number_of:
                number_of[key] = len(merged)
                merged.append((entry.batch + offset, entry, runs))
                continue
            batch, known, of_known = merged[number_of[key]]
            n_both += 1
            better = entry if known.excluded and not entry.excluded else known
            failed = not of_known or any(record.failed for _, record in of_known.values())
            joined = {**of_known, **runs} if failed and runs else {**runs, **of_known}
            merged[number_of[key]] = batch, better, joined
    with store.explained(folder):
        folder.mkdir(parents=True)
    _write_lists(studies, folder)
    store.write_sealed_text(folder / _SPACE, space.to_yaml())
    for study in reversed(studies):  # copies of the first one last
        for path in [*study.folder.glob("hardware/*.yaml"), *study.folder.glob("plugins/*.py")]:
            store.write_sealed_text(folder / path.relative_to(study.folder), store.read_sealed_text(path))
    ledger = Ledger(folder / _JOURNAL, space)
    # A search goes through batches without a gap, and what no study has finished is trained after all others.
    merged.sort(key=lambda one: not one[1].excluded and not one[1].is_reported and not one[2])
    n_runs, number, last = 0, -1, -1
    with ledger.together():
        for trial, (batch, entry, runs) in enumerate(merged):
            if entry.excluded and not runs:
                ledger.exclude(max(0, number), entry.design, Exclusion(entry.excluded, (), {}))
                continue
            is_pending = not entry.is_reported and not runs
            if batch != last or is_pending:
                number, last = number + 1, batch
            ledger.ask(number, [entry.design], enqueued=entry.enqueued or is_pending)
            for repeat, (run, _) in sorted(runs.items()):
                copy_run(run, trial, store.run_folder(folder, trial, repeat))
                n_runs += 1
            records = [record for _, (_, record) in sorted(runs.items())]
            if 0 in runs:
                ledger.tell(trial, values_of(space, records[: space.search.repeats]))
    tables.write_again(folder)
    return {"designs": len(merged), "in_both": n_both, "runs": n_runs}


def _write_lists(studies: Sequence[_Study], folder: Path) -> None:
    """Write the sessions and the warnings of both studies; all that is written here has one identity."""
    identity = {"identity": store.new_identity()}
    for name in (store.ENVIRONMENT, store.WARNINGS):
        items: dict[str, Any] = {}
        for path in (study.folder / name for study in studies):
            for item in store.read_json(path) if path.exists() else ():
                items.setdefault(json.dumps(item, sort_keys=True), item)
        if items:
            is_session = name == store.ENVIRONMENT
            written = [item | identity if is_session else item for item in items.values()]
            store.write_json(folder / name, written)
