"""Asking for designs, training them, telling the sampler; then repeating the front."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from dse import registry, store, tables
from dse.config import SearchSpace
from dse.execution import Workers
from dse.ledger import Ledger
from dse.progress import Progress, shown
from dse.runs import Record, Runs
from dse.search.space import n_designs
from dse.seeds import design_key
from dse.study.claim import claim
from dse.study.results import Study


def run(
    space: SearchSpace, results: str | Path = "results", *, jobs: int | None = None, progress: bool = True
) -> Study:
    """Train what is missing of a study and return it; an interrupted study goes on where it stopped.

    Args:
        space: what to explore.
        results: the study's folder is made in here, named as the study.
        jobs: worker processes; None: as the search space says.
        progress: show it on stderr.

    Raises:
        ConfigError: the folder holds a study of another search space, or of other recordings.
        RecordingError: the recordings do not fit the search space.
        StoreError: the folder is in use or cannot be written; nothing finished is lost.
        KeyboardInterrupt: after Ctrl-C; finished runs and the tables are written.
    """
    folder = Path(results) / space.study
    with store.exclusive(folder), shown(progress) as report:
        store.sweep(folder)
        claim(space, folder)
        ledger = Ledger(folder / "journal.log", space)
        workers = Workers(jobs or space.execution.jobs)
        runs = Runs(space, folder, workers, report)
        runs.recall(ledger.entries)
        report.expect(_n_trials(space) * space.search.repeats - runs.count(space.search.repeats))
        try:
            with workers:
                _search(space, folder, ledger, runs, report)
                _repeat_front(space, folder, ledger, runs, report)
        except KeyboardInterrupt:
            runs.recall(ledger.entries)  # a run may have finished without having been heard of
            _write_tables(space, folder, runs)
            raise
        _write_tables(space, folder, runs)
    return Study(folder)


def _search(space: SearchSpace, folder: Path, ledger: Ledger, runs: Runs, report: Progress) -> None:
    """Ask, train and tell batch by batch; batches that the ledger holds are not asked for again."""
    settings = space.search
    sampler = registry.known("search.samplers")[settings.sampler](**settings.options).start(
        space, [direction for _, direction in space.objectives]
    )
    number = 0
    while True:
        entries = [e for e in ledger.entries if e.batch == number]
        n_before = sum(e.batch < number for e in ledger.entries)
        if not entries or not any(e.told for e in entries):
            # A process that died while asking left part of a batch; the sampler proposes the same one again.
            missing = min(settings.batch, _n_trials(space) - n_before) - len(entries)
            if missing > 0:
                known = {design_key(e.design) for e in entries}
                proposed = sampler.ask(len(entries) + missing)
                new = [d for d in proposed if design_key(d) not in known][:missing]
                ledger.ask(number, new)
                if len(new) < missing:
                    report.note(
                        f"the sampler has no other designs: {n_before + len(entries) + len(new)} in all"
                    )
                entries = [e for e in ledger.entries if e.batch == number]
        if not entries:
            return
        n_finished = runs.count()
        runs.complete(entries, settings.repeats)
        for entry in entries:
            if not entry.told:
                ledger.tell(entry.trial, _values(space, runs.of(entry.trial)[: settings.repeats]))
        told = [e for e in ledger.entries if e.batch == number]
        sampler.tell([e.design for e in told], [e.values for e in told])
        if runs.count() > n_finished:  # so that a long study can be looked at while it runs
            _write_tables(space, folder, runs)
        number += 1


def _repeat_front(space: SearchSpace, folder: Path, ledger: Ledger, runs: Runs, report: Progress) -> None:
    """Train designs of the front again until every one has its repeats; each repeat may move the front."""
    wanted = space.search.repeats_on_front
    while wanted > space.search.repeats:
        points = tables.points_table(space, folder, runs.trials())
        if points.empty:
            return
        from dse.skyline import skyline

        front = set(skyline(points, space.objectives, by="task").rows["trial"])
        short = [e for e in ledger.entries if e.trial in front and len(runs.of(e.trial)) < wanted]
        if not short:
            return
        report.expect(sum(wanted - len(runs.of(e.trial)) for e in short))
        runs.complete(short, wanted)


def _write_tables(space: SearchSpace, folder: Path, runs: Runs) -> None:
    trials = runs.trials()
    for name, frame in (
        ("trials", tables.trials_table(space, trials)),
        ("points", tables.points_table(space, folder, trials)),
    ):
        with store.published(folder / f"{name}.parquet") as path:
            frame.to_parquet(path, index=False)


def _n_trials(space: SearchSpace) -> int:
    return space.search.n_trials or n_designs(space) or 0


def _values(space: SearchSpace, records: Sequence[Record]) -> tuple[float, ...] | None:
    """Return the objectives of a trial's full read-out, None where it failed or has no such number."""
    if any(record["status"] == "failed" for record in records):
        return None
    row = tables.summary(records, space.hardware[0] if space.hardware else None)
    values = [float(row.get(name, math.nan)) for name, _ in space.objectives]
    return tuple(values) if all(map(math.isfinite, values)) else None
