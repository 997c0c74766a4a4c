"""The data sets of a study's designs: who needs which, and the job of a worker that makes them.

A data set is prepared once for equal data sections, in a cache that all studies share, and read as a memory
map. In a cross-validation, repeat r validates on fold r modulo k.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dse import store
from dse.base import seeds
from dse.base.records import Dataset
from dse.base.registry import PluginError
from dse.config.resolved import LeftOut, Sections
from dse.config.yaml_lines import error_of
from dse.data import dataset
from dse.data.dataset import cache
from dse.data.dataset.files import read_meta
from dse.data.dataset.shape import Shape
from dse.data.recordings import RecordingError
from dse.store import Damaged, StoreError
from dse.study.claim import Key
from dse.study.executors.work import Failure
from dse.study.ledger import Entry
from dse.study.progress import Progress
from dse.study.session import Session

Member = tuple[int, int | None]
"""Trial and fold of a data set."""

_MESSAGE_S = 0.5  # shortest time between two messages about the work in progress


@dataclasses.dataclass(frozen=True)
class Prepared:
    """The data set of a design.

    sections: of the design, with its fold. data: folder of the data set, named as its key.
    folds: the same without each of the groups that its runs leave out of training in turn, which are the test
        sets; or why there is none.
    """

    sections: Sections
    data: Path
    folds: tuple[Prepared | Failure, ...] = ()

    @property
    def left_out(self) -> LeftOut:
        """The groups, of a fold."""
        assert self.sections.left_out is not None
        return self.sections.left_out


class DataSets:
    """The data sets of one study in a cache, prepared as they are asked for."""

    def __init__(self, session: Session) -> None:
        self._space, self._book = session.space, session.book
        self._workers, self._progress = session.workers, session.progress
        self._base = session.space.source.parent
        self.cache = _opened_cache(session.folder, session.progress)
        self._keys: dict[tuple[str, int | None], str] = {}  # of designs, without models, and folds
        self._shapes: dict[str, Shape | None] = {}  # by the key of a data set
        self._warned: set[str] = set()

    def fold(self, repeat: int) -> int | None:
        """Return the fold that a repeat validates on; None without cross-validation."""
        k_fold = self._space.split.k_fold
        return None if k_fold is None else repeat % k_fold.k

    def key(self, design: Mapping[str, Any], fold: int | None) -> str:
        """Return the key of the data set of a design and fold, which its model and training do not change."""
        axes = self._space.axes
        shared = {name: x for name, x in design.items() if axes[name].place[0] not in ("model", "training")}
        place = seeds.design_key(shared), fold
        if place not in self._keys:
            self._keys[place] = dataset.dataset_key(self._resolved(design, fold), self._base)
        return self._keys[place]

    def shapes(self, designs: Iterable[Mapping[str, object]]) -> None:
        """Prepare the data sets of some designs, so that `shape` knows them; failures are for training."""
        needed = {}
        for design in designs:
            with contextlib.suppress(ValueError):
                sections = self._resolved(design, self.fold(0))
                needed[dataset.dataset_key(sections, self._base)] = sections
        self._prepare(needed)

    def shape(self, sections: Sections) -> Shape | None:
        """Return the shape of a design's data set, prepared if it is absent; None if it cannot be."""
        fold = self.fold(0)
        sections = sections if fold is None else sections.on_fold(fold)
        key = dataset.dataset_key(sections, self._base)
        if key not in self._shapes:
            failed = self._prepare({key: sections})
            with store.explained(self.cache):
                data = None if failed else dataset.find(self.cache, key)
            self._shapes[key] = None if data is None else Shape.of(data)
        return self._shapes[key]

    def of(
        self, runs: Mapping[Key, Entry], *, with_folds: bool = False, needs_one: bool = False
    ) -> dict[Key, Prepared | Failure]:
        """Prepare the data sets of some runs, trial and repeat -> design.

        Args:
            runs: whose data sets are needed.
            with_folds: also those without the groups that evaluations leave out.
            needs_one: it is an error if none can be prepared.

        Returns:
            A data set of each run, or why there is none.

        Raises:
            ConfigError: the recordings do not fit section `evaluation`.
            RecordingError: as `needs_one` says.
            StoreError: the cache cannot be written.
        """
        designs = {(trial, self.fold(repeat)): entry.design for (trial, repeat), entry in runs.items()}
        prepared: dict[Member, Prepared | Failure] = {}
        for (trial, fold), design in designs.items():
            try:
                sections = self._resolved(design, fold)
                prepared[trial, fold] = Prepared(sections, self.cache / self.key(design, fold))
            except ValueError as error:  # keys that are legal one by one and not together
                prepared[trial, fold] = Failure(type(error).__name__, str(error))
        needed = {x.data.name: x.sections for x in prepared.values() if isinstance(x, Prepared)}
        failures = self._prepare(needed)
        self._refuse_evaluation(failures.values())
        if needs_one and failures and len(failures) == len(needed):
            first = next(iter(failures.values()))
            is_plain = first.error == RecordingError.__name__
            raise RecordingError(first.message if is_plain else f"data cannot be prepared: {first.reason}")
        self._warn(needed.keys() - failures.keys())
        for member, one in prepared.items():
            if isinstance(one, Prepared):
                prepared[member] = failures.get(one.data.name, one)
        if with_folds and self._space.evaluation is not None and self._space.evaluation.groups:
            prepared = self._with_folds(prepared)
        return {(trial, repeat): prepared[trial, self.fold(repeat)] for trial, repeat in runs}

    def _with_folds(self, prepared: Mapping[Member, Prepared | Failure]) -> dict[Member, Prepared | Failure]:
        """Prepare the data sets without the groups that evaluations leave out."""
        folds: dict[Member, list[Prepared]] = {}
        for member, one in prepared.items():
            if isinstance(one, Prepared):
                without = [dataclasses.replace(one.sections, left_out=x) for x in dataset.left_out(one.data)]
                of = [Prepared(x, self.cache / dataset.dataset_key(x, self._base)) for x in without]
                folds[member] = of
        failures = self._prepare({x.data.name: x.sections for of in folds.values() for x in of})
        made = {k: tuple(failures.get(x.data.name, x) for x in of) for k, of in folds.items()}
        return {
            k: dataclasses.replace(x, folds=made[k]) if isinstance(x, Prepared) else x
            for k, x in prepared.items()
        }

    def _warn(self, keys: Iterable[str]) -> None:
        """Print the warnings about data sets once, and store them with the study."""
        warnings = [text for key in sorted(keys) for text in read_meta(self.cache / key).warnings]
        for text in dict.fromkeys(warnings):
            if text not in self._warned:
                self._warned.add(text)
                self._progress.note(f"warning: {text}")
        with self._book.together():
            known = self._book.document(store.WARNINGS, [])
            if set(warnings) - set(known):
                self._book.keep(store.WARNINGS, list(dict.fromkeys([*known, *warnings])))

    def _resolved(self, design: Mapping[str, object], fold: int | None) -> Sections:
        """Return the sections of a design, with its fold."""
        sections = self._space.resolve(design)
        return sections if fold is None else sections.on_fold(fold)

    def _refuse_evaluation(self, failures: Iterable[Failure]) -> None:
        """Raise what the recordings say against section `evaluation`, with its places in the file."""
        texts = dict.fromkeys(text for failure in failures for text in failure.message.split("\n"))
        if faults := [text for text in texts if text.startswith("evaluation.")]:
            raise error_of(self._space.source, faults)

    def _prepare(self, needed: Mapping[str, Sections]) -> dict[str, Failure]:
        """Make the data sets, key -> sections, that are not in the cache; return the failures by key."""
        failures: dict[str, Failure] = {}
        for job, event, again in self._workers.attempts(prepare, self._preparations(needed)):
            if isinstance(event, str):
                self._progress.doing(event)
                continue
            if isinstance(event, Failure):
                stop_if_blameless(event)
                ended = {key: event for key in job.designs if key not in failures}
            else:
                ended = dict([event])
            ended = {key: why for key, why in ended.items() if not self._is_prepared(key)}
            if again is not None and any(why.by_machine for why in ended.values()):
                again.append(job.of([key for key, why in ended.items() if why.by_machine]))
                ended = {key: why for key, why in ended.items() if not why.by_machine}
            failures |= ended
        return failures

    def _preparations(self, needed: Mapping[str, Sections]) -> list[Preparation]:
        """Return the jobs, one for all designs with the same spikes; the jobs share the threads."""
        groups: dict[str, list[str]] = {}
        for key in needed:
            if not self._is_prepared(key):
                groups.setdefault(dataset.same_spikes(needed[key]), []).append(key)
        threads = max(1, self._workers.n // max(1, len(groups))) * self._space.execution.threads
        return [
            Preparation(
                {key: needed[key] for key in keys},
                self._base,
                self.cache,
                threads,
                self._book.folder / f"{store.TEMPORARY}{keys[0]}",
            )
            for keys in groups.values()
        ]

    def _is_prepared(self, key: str) -> bool:
        with store.explained(self.cache):
            return dataset.find(self.cache, key) is not None


def _opened_cache(folder: Path, progress: Progress) -> Path:
    """Return the user's cache, or one in the study's folder if the user's cannot be written."""
    with store.explained(folder / "cache"):
        try:
            root, note = cache.opened_root(folder / "cache")
        except ValueError as error:
            raise StoreError(str(error)) from None
    if note:
        progress.note(note)
    return root


def stop_if_blameless(failure: Failure) -> None:
    """Raise an error that is not the design's fault: a full disk, or a plugin's file that has changed."""
    if failure.error in (StoreError.__name__, Damaged.__name__, PluginError.__name__):
        raise StoreError(failure.message)


@dataclasses.dataclass(frozen=True)
class Preparation:
    """Prepare data sets that have most of their work in common, one after the other.

    designs: key of the data set -> sections of its design. base: folder that recordings are relative to.
    cache: root of the cache. threads: number of threads that simulate trials.
    progress_file: in which the work in progress is written, now and then.
    """

    designs: Mapping[str, Sections]
    base: Path
    cache: Path
    threads: int = 1
    progress_file: Path | None = None

    def of(self, keys: Sequence[str]) -> Preparation:
        """Return the same of some of the designs."""
        return dataclasses.replace(self, designs={key: self.designs[key] for key in keys})


def prepare(job: Preparation) -> Iterator[str | tuple[str, Failure]]:
    """Make the data sets that are not in the cache.

    Yields:
        The key of a data set that cannot be made, and why; a text is work in progress (`Workers.stream`).
    """
    is_due = timer(_MESSAGE_S)

    def say(text: str) -> None:
        if job.progress_file is not None and is_due():
            with contextlib.suppress(OSError):
                job.progress_file.write_text(text, "utf-8")

    for key, sections in job.designs.items():
        try:
            with store.explained(job.cache):
                dataset.prepare(sections, job.base, job.cache, job.threads, say)
        except store.StoreError:
            raise  # a full disk is not the data set's fault
        except Exception as error:
            yield key, Failure.of(error)
    if job.progress_file is not None:
        job.progress_file.unlink(missing_ok=True)


@dataclasses.dataclass(frozen=True)
class Loaded:
    """A data set in a worker.

    leak: why evaluations on the data know the labels; '' if they do not.
    fitted: section -> key -> plain value that was fitted to the recordings.
    """

    data: Dataset
    leak: str
    fitted: Mapping[str, Mapping[str, object]]


_last: dict[Path, Loaded] = {}  # the data set that this process loaded last, by its folder


def load(folder: Path, sections: Sections, base: Path, threads: int = 1) -> Loaded:
    """Return the data set of a design; a process keeps the one that it loaded last.

    It is complete in memory or mapped, so it may be evicted from the cache while it is in use.

    Args:
        folder: of the prepared data set, named as its key.
        sections: of the design.
        base: folder that recordings are relative to.
        threads: that simulate trials, where it was evicted.

    Raises:
        StoreError: the cache cannot be written.
        RecordingError: the data set was evicted, and its recordings have changed or cannot be read.
    """
    if folder not in _last:
        _last.clear()  # before the next one takes memory
        with store.explained(folder.parent):
            data = dataset.load_or_prepare(sections, base, folder, threads)
        meta = read_meta(folder)
        _last[folder] = Loaded(data, meta.transductive, meta.fitted)
    cache.mark_used(folder)
    return _last[folder]


def timer(seconds: float) -> Callable[[], bool]:
    """Return a function that is true where so many seconds have passed since it last was."""
    last_s = time.monotonic()

    def is_due() -> bool:
        nonlocal last_s
        due = time.monotonic() - last_s >= seconds
        last_s = time.monotonic() if due else last_s
        return due

    return is_due
