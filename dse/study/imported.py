"""Networks of a study that were trained on elsewhere, back in it: trials beside those of the search.

Such a trial has the design of the one that it began as, a number that no search reaches, and `taken_from` in
its record. It is measured on the validation and test sets of the study, on its decision grid and hardware.
The sampler does not learn of it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dse import dataset, store
from dse.config import ConfigError, SearchSpace, Sections, load_space
from dse.dataset.cache import usual_root
from dse.hardware.profile import of_space
from dse.recordings import RecordingError
from dse.records import Network, Outcome, Response
from dse.store import StoreError
from dse.study import jobs, pricing, tables
from dse.study.mended import opened
from dse.study.record import IMPORTED, RunRecord, load_record


def records(folder: Path) -> dict[int, list[RunRecord]]:
    """Return trial number -> record, of every imported trial; damaged ones are left out."""
    found: dict[int, list[RunRecord]] = {}
    for trial in store.runs_in(folder):
        with contextlib.suppress(StoreError):
            if trial >= IMPORTED and (record := load_record(store.run_file(folder, trial, 0))) is not None:
                found[trial] = [record]
    return found


def source_of(folder: Path, record: RunRecord) -> tuple[SearchSpace, Sections, Path] | None:
    """Return the search space, the sections of a run, and what its recordings are relative to.

    Returns:
        None where the recordings are not found, or have changed.
    """
    return next((found[:3] for found in _found(folder, record) if found[3] == record.data), None)


def have_changed(folder: Path, record: RunRecord) -> bool:
    """Return whether the recordings of a run are found, and nowhere as they were."""
    keys = [key for *_, key in _found(folder, record)]
    return bool(keys) and record.data not in keys


def _found(folder: Path, record: RunRecord) -> Iterator[tuple[SearchSpace, Sections, Path, str]]:
    """Yield search space, sections, base and key of the recordings of a run, wherever they are found."""
    for base in (Path.cwd(), folder, folder.parent.parent):
        with contextlib.suppress(ConfigError, RecordingError, ValueError, OSError):
            space = load_space(folder / "search_space.yaml")
            sections = space.resolve(record.design)
            if space.split.k_fold is not None:
                sections = sections.on_fold(record.repeat % space.split.k_fold.k)
            yield space, sections, base, dataset.dataset_key(sections, base)


def add(folder: Path, origin: RunRecord, network: Network, about: Mapping[str, Any]) -> int:
    """Measure a network on the data of a run, and publish it as a trial; return its number.

    Args:
        folder: of the study.
        origin: record of the run that trained the network before.
        network: with the layers and neurons of that run.
        about: where its weights are from, of the record.

    Raises:
        StoreError: the study runs, it holds these weights already, the recordings are missing or have
            changed, or it cannot be written.
        ConfigError: a profile of the study has changed.
    """
    if (source := source_of(folder, origin)) is None:
        raise StoreError(f"{folder}: the recordings of trial {origin.trial} are not found, or have changed")
    space, sections, base = source
    profiles = of_space(space)
    with store.exclusive(folder), opened(folder, space.search.batch) as (book, _):
        notes = pricing.check(profiles, folder)
        if notes:
            raise StoreError(notes[0])
        before = records(folder)
        for trial, [record] in before.items():
            if record.taken_from == dict(about):
                raise StoreError(f"{folder}: trial {trial} has these weights already")
        trial = max(before, default=IMPORTED - 1) + 1
        run = jobs.Run(
            trial=trial,
            repeat=0,
            design=origin.design,
            seed=origin.seed,
            sections=sections,
            data=usual_root() / origin.data,
            base=base,
            folder=store.run_file(folder, trial, 0),
            phi=tuple(space.decision.phi.tolist()),
            theta=tuple(space.decision.theta.tolist()),
            hardware=tuple(profiles),
            phi_step=space.decision.phi_step,
            read_out_every_ms=space.decision.read_out_every_ms,
            taken_from=about,
        )
        loaded = jobs.load(run)
        data = loaded.data
        validation, test = (
            sections.model.respond(network, data, part) if part.size else None
            for part in (data.validation, data.test)
        )
        assert isinstance(validation, Response)
        jobs.publish(run, Outcome(network, validation, test, {}), loaded)
        store.note_files(book, [run.folder])
        tables.write_again(folder)
    return trial
