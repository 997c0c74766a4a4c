"""The results of a study that runs or has finished: tables and records."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse import store
from dse.base import registry
from dse.study import held
from dse.study.record import RunRecord, load_records, plain_records

if TYPE_CHECKING:
    import pandas

    from dse.base.records import Array, Dataset
    from dse.config import Sections
    from dse.data.preprocessing.stages import Stages
    from dse.measure.hardware.profile import Profile
    from dse.skyline.table import Goal
    from dse.study.audit import Audit


EARLIER = ("journal.log", "environment.json", "artefacts")
"""What folders of earlier versions hold (`dse.study.earlier`)."""


@dataclass(frozen=True)
class Study:
    """The results in a study's folder."""

    folder: Path

    @cached_property
    def space(self) -> dict[str, Any]:
        """The search space with every default written out, as plain data."""
        return held.plain_space(self.folder / "search_space.yaml")

    @property
    def objectives(self) -> list[Goal]:
        """The objectives of the search space: (column, 'max' or 'min') each."""
        from dse.skyline.table import Goal

        pairs = (text.split(":") for text in self.space["objectives"])
        return [Goal(name, direction) for name, direction in pairs]

    @property
    def trials(self) -> pandas.DataFrame:
        """One row per trial (`dse.study.trials`)."""
        return held.without_lost(self.folder, held.read(self.folder / held.TRIALS))

    def load_plugins(self) -> None:
        """Load those plugins of the search space that the user trusts already (`registry.load_trusted`).

        Raises:
            StoreError: the search space is damaged.
        """
        names = self.space.get("plugins")
        registry.load_trusted(names if isinstance(names, list) else (), self.folder / "search_space.yaml")

    def points(self, hardware: Sequence[str] = ()) -> pandas.DataFrame:
        """Return one row per design point: a trial, a time of its answer, and a hardware profile.

        Args:
            hardware: names or files of profiles to price the points on; empty: the profiles of the study.
        """
        if hardware:
            from dse.study import pricing

            return pricing.points(self.folder, hardware)
        return held.without_lost(self.folder, held.read(self.folder / held.POINTS))

    def runs(self, trial: int) -> list[dict[str, Any]]:
        """Return the records of a trial's runs, repeat 0 first.

        Raises:
            StoreError: an artefact of the trial is damaged, or the study has no such trial.
        """
        return plain_records(self.folder, trial)

    def best_trial(self) -> int:
        """Return the most accurate finished trial, the first of several.

        Raises:
            StoreError: none has finished.
        """
        trials = self.trials
        finished = trials[trials["status"] == "finished"]
        if finished.empty:
            raise store.StoreError(f"{self.folder}: has no finished trial")
        return int(finished.sort_values("accuracy", ascending=False, kind="stable")["trial"].iloc[0])

    def classes(self, trial: int) -> tuple[str, ...]:
        """Return the names of the classes of a trial.

        Raises:
            StoreError: as in `runs`.
        """
        return load_records(self.folder, trial)[0].classes

    def sections(self, trial: int) -> dict[str, Any]:
        """Return the sections of a trial's design as plain data, with what was fitted to recordings.

        Raises:
            StoreError: as in `runs`.
        """
        return dict(load_records(self.folder, trial)[0].sections)

    def arrays(self, trial: int, name: str) -> list[dict[str, Array]]:
        """Return the arrays of a file of a trial's artefacts, such as read_out.npz, of each run that has it.

        Raises:
            StoreError: as in `runs`, or the file is damaged.
        """
        return [
            store.load_arrays(store.run_file(self.folder, trial, record.repeat) / name)
            for record in load_records(self.folder, trial)
            if name in record.files
        ]

    def stages(self, trial: int, sample: int) -> Stages:
        """Return an event recording at every stage of the preprocessing of a trial's first run.

        The recording is read again, from where its file is looked up, or simulated again.

        Raises:
            RecordingError: the recordings are not events, are not found, or have no such number.
            StoreError: as in `dataset`, which has the length of windows that the search space leaves open.
        """
        from dse.config import Sections
        from dse.data import dataset

        sections = Sections.from_plain(self.sections(trial), str(self.folder))
        if sections.window.n_steps is None:
            window = replace(sections.window, n_steps=self.dataset(trial).n_steps)
            sections = replace(sections, window=window)
        return dataset.stages(sections, self.folder, sample)

    def dataset(self, trial: int) -> Dataset:
        """Return the data set of the first run of a trial, prepared again where the cache has it no more.

        Raises:
            StoreError: as in `runs`, or its recordings are not found, or cannot be read.
        """
        from dse.data import dataset
        from dse.data.dataset import cache
        from dse.data.recordings import RecordingError

        root, record = cache.usual_root(), load_records(self.folder, trial)[0]
        data = dataset.find(root, record.data)
        try:
            return data or dataset.load(dataset.prepare(*trained_on(self.folder, record), root))
        except RecordingError as error:
            lost = f"the data set of trial {trial} is no longer in the cache"
            raise store.StoreError(f"{self.folder}: {lost}: {error}") from None

    def chip(self, name: str) -> Profile:
        """Return a hardware profile: the study's copy, or a shipped one."""
        from dse.study import pricing

        return pricing.profile(self.folder, name)

    @property
    def warnings(self) -> list[str]:
        """Warnings about the study's recordings, such as levels that reveal the label."""
        return list(store.document(self.folder, store.WARNINGS, []))

    @property
    def audit(self) -> Audit | None:
        """The audit of the study's recordings and split; None where `dse audit` had not run before."""
        from dse.study.audit import record

        document = store.document(self.folder, record.DOCUMENT)
        return None if document is None else record.of_plain(document)


def sections_found(folder: Path, record: RunRecord) -> Iterator[tuple[Sections, Path, str]]:
    """Yield the sections of a run, what its recordings are relative to, and their key, wherever found.

    The key is `record.data` where the recordings are what the run was trained on.
    """
    from dse.config import ConfigError, load_space
    from dse.data import dataset
    from dse.data.recordings import RecordingError

    try:
        space = load_space(folder / store.SPACE)
        sections = space.resolve(record.design)
    except (ConfigError, ValueError, OSError):
        return
    if space.split.k_fold is not None:
        sections = sections.on_fold(record.repeat % space.split.k_fold.k)
    for base in (Path.cwd(), folder, folder.parent.parent):
        with contextlib.suppress(RecordingError, ValueError, OSError):
            yield sections, base, dataset.dataset_key(sections, base)


def trained_on(folder: Path, record: RunRecord) -> tuple[Sections, Path]:
    """Return the sections of a run, and the folder of the recordings that it was trained on.

    Raises:
        RecordingError: they are not found, or have changed.
    """
    from dse.data.recordings import RecordingError

    for sections, base, key in sections_found(folder, record):
        if key == record.data:
            return sections, base
    raise RecordingError(f"{folder}: the recordings of trial {record.trial} are not found, or have changed")


def is_earlier(folder: Path) -> bool:
    """Return whether an earlier version wrote the folder of a study."""
    return any((folder / name).exists() for name in EARLIER)


def open(folder: str | Path) -> Study:
    """Return the study in a folder.

    Raises:
        StoreError: there is none, or nothing has finished yet.
    """
    path = Path(folder)
    for name in ("search_space.yaml", held.TRIALS, held.POINTS):
        if not (path / name).is_file():
            raise store.StoreError(f"{path}: is not the folder of a study with results: there is no {name}")
    if not (path / store.BOOK).is_file() and is_earlier(path):
        text = "an earlier version of dse wrote this study"
        raise store.StoreError(f"{path}: {text}; `dse doctor {path} --repair` converts it")
    study = Study(path)
    study.load_plugins()
    return study
