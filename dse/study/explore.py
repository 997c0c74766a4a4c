"""Run a study: propose designs, train them, report to the sampler; then repeat and round the front."""

from __future__ import annotations

import contextlib
import secrets
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dse import store
from dse.config import ConfigError, Fault, SearchSpace
from dse.config.bounds import MOST_TRIALS
from dse.config.settings import missing
from dse.data.dataset import cache
from dse.data.recordings import PLACES, RecordingError
from dse.data.recordings.files import locate
from dse.measure.hardware.profile import of_space
from dse.study import health, pricing
from dse.study import tables as both
from dse.study.audit import record
from dse.study.claim import Coordinator, claim, join, process_before
from dse.study.data_sets import DataSets
from dse.study.executors import loky
from dse.study.known import KnownBefore
from dse.study.ledger import Ledger
from dse.study.mended import opened
from dse.study.points import PointsTable
from dse.study.progress import Progress, shown
from dse.study.racing import Race
from dse.study.results import Study
from dse.study.rounding import round_fronts
from dse.study.runs import UNTRAINED, Runs
from dse.study.searches import Batches, FrontRepeats, Search, n_trials
from dse.study.session import Session
from dse.study.training import Training
from dse.study.workers import OutOfTime, Workers

if TYPE_CHECKING:
    import pandas

_REFRESH_S = 2.0
_REFRESH_SHARE = 0.05
_LAST_S = 15.0  # that tables and page of a study take at last
_STOPPED = "the search stopped: "


def run(
    space: SearchSpace,
    results: str | Path = "results",
    *,
    jobs: int | None = None,
    progress: bool = True,
    on_trial: Callable[[dict[str, Any]], object] | None = None,
) -> Study:
    """Train the missing runs of a study and return it; this also resumes an interrupted study.

    Where another process runs the study, this one shares its trainings (`dse.study.claim`).

    Args:
        space: what to explore.
        results: the study's folder is made in here, named as the study.
        jobs: number of worker processes; None: that of the search space.
        progress: show it on stderr.
        on_trial: called with the row of each trial that ends here.

    Raises:
        ConfigError: the folder holds a study of another search space, or of other recordings; or the
            device is missing; or another process runs the study, whose designs race.
        RecordingError: the recordings do not fit the search space.
        StoreError: the folder is in use or cannot be written; nothing finished is lost.
        KeyboardInterrupt: after Ctrl-C; finished runs and the tables are written.
    """
    until_s = _until_s(space, time.monotonic())
    if lack := missing(space.execution.device):
        raise ConfigError([Fault(str(space.source), 0, f"execution.device {space.execution.device} {lack}")])
    if (n_designs := n_trials(space)) > MOST_TRIALS:
        text = f"search.n_trials must be at most {MOST_TRIALS}, got {n_designs} designs; sample fewer of them"
        raise ConfigError([Fault(str(space.source), 0, text)])
    n_workers = jobs or space.execution.jobs
    with (
        shown(progress, n_workers) as report,
        _begun(space, Path(results) / space.study, n_workers, report, until_s) as (session, coordinator),
    ):
        _explored(session, coordinator, on_trial)
    return Study(session.folder)


@contextlib.contextmanager
def _begun(
    space: SearchSpace, folder: Path, n_workers: int, report: Progress, until_s: float | None
) -> Iterator[tuple[Session, Coordinator]]:
    """Yield a session of a study that has begun, or joined others, and its coordinator."""
    profiles = of_space(space)
    with contextlib.ExitStack() as at_the_end:
        coordinator = Coordinator(folder, at_the_end)
        if coordinator.is_first:
            store.sweep(folder)
            book, notes = at_the_end.enter_context(opened(folder, space.search.batch))
            for note in [*notes, *pricing.check(profiles, folder), *claim(space, book)]:
                report.note(note)
            _keep_audit(space, book)
        else:
            join(space, folder)
            report.note(f"{folder}: another process runs this study; this one shares its trainings")
            book = at_the_end.enter_context(store.Book(folder, writes=True, is_session=True))
        coordinator.begin(book)
        workers = at_the_end.enter_context(_workers(space, n_workers, folder, until_s))
        yield Session(space, book, tuple(profiles), workers, report), coordinator


def _explored(
    session: Session, coordinator: Coordinator, on_trial: Callable[[dict[str, Any]], object] | None
) -> None:
    """Search, repeat and round what is on the fronts, and write the tables."""
    space, report, ledger, data = session.space, session.progress, Ledger(session.book), DataSets(session)
    runs = Runs(session, data, on_trial)
    training = Training(session, data, runs, coordinator)
    results_tables = _Tables(PointsTable(space, session.folder, session.profiles), runs, ledger, coordinator)
    before = None if space.limits is None else KnownBefore(space, session.profiles, data.shape)
    runs.recall(ledger.entries)
    if coordinator.is_first:
        runs.forget_checkpoints()
    report.expect(n_trials(space) * space.search.repeats - runs.count(space.search.repeats))

    def train(search: Search) -> None:
        while (asked := search.ask()) is not None:
            training.complete(asked.entries, asked.repeats, results_tables.refresh, asked.until)
            search.tell(asked)

    stopped = ""
    try:
        with session.workers:
            batches = Batches(session, ledger, runs, data, before)
            race = Race(batches, session, runs) if space.search.racing else None
            train(race or batches)
            if not coordinator.leads:
                report.note("the process that writes the tables ends the study")
                return
            runs.recall(ledger.entries)
            if race is not None and (sentence := race.saved(ledger.entries)):
                report.note(sentence)
            train(FrontRepeats(session, ledger, runs, results_tables.points))
            round_fronts(session, runs, data, ledger.entries, results_tables.points, results_tables.refresh)
    except OutOfTime:
        runs.recall(ledger.entries)
        stopped = "its time is over (search.stop.minutes); the same command goes on"
    except KeyboardInterrupt:
        runs.recall(ledger.entries)  # a run may have finished that no worker has reported yet
        results_tables.write()
        raise
    results_tables.write()
    runs.remark(runs.untrained(), UNTRAINED)
    runs.remark([f"{_STOPPED}{stopped}"] if stopped else [], _STOPPED)
    runs.remark(health.remarks(space.decision, runs.trials()), health.PREFIX)


def _until_s(space: SearchSpace, began_s: float) -> float | None:
    """Return when trainings end, so that tables, page and answer are written in the command's time too."""
    if space.search.stop is None:
        return None
    whole_s = 60 * space.search.stop.minutes
    return began_s + whole_s - min(0.3 * whole_s, max(_LAST_S, 0.05 * whole_s))


def _workers(space: SearchSpace, n: int, folder: Path, until_s: float | None) -> Workers:
    """Return the workers that a search space names."""
    execution = space.execution
    if execution.backend == "loky":
        if (dead := process_before(folder)) is not None:
            loky.clear(dead)
        return Workers(n, until_s=until_s)
    from dse.study.executors.dask import Dask, Unusable

    source = folder.absolute() / f"{store.TEMPORARY}{secrets.token_hex(4)}"  # swept if we die now
    with store.explained(folder):
        source.touch()
    try:
        shared = [source, *_places(space)]
        return Workers(n, Dask(n, execution.address, execution.scheduler_file, shared), until_s)
    except Unusable as error:
        raise ConfigError([Fault(str(space.source), 0, f"execution: {error}")]) from None
    finally:
        source.unlink(missing_ok=True)


def _places(space: SearchSpace) -> list[Path]:
    """Return the files and folders of recordings that a search space names."""
    sections: dict[str, Any] = space.to_plain()
    entries = [sections.get(name) or {} for name in ("data", "test")]
    places = []
    for one in (one for entry in entries for one in entry.get("choice", [entry])):
        for key in PLACES:
            with contextlib.suppress(RecordingError):  # shipped, or missed where it is read
                if isinstance(name := one.get(key), str):
                    kind: Literal["file", "folder"] = "folder" if key == "folder" else "file"
                    places.append(locate(name, space.source.parent, kind))
    return places


def _keep_audit(space: SearchSpace, book: store.Book) -> None:
    """Store the last audit of the search space with the study, if there is one that can be read."""
    with contextlib.suppress(OSError, RuntimeError, RecordingError, store.StoreError):
        if (audit := record.last(space, cache.usual_root())) is not None:
            book.keep(record.DOCUMENT, record.plain(audit))


class _Tables:
    """The tables of a study, written now and then so that they can be read while a long study runs."""

    def __init__(self, points: PointsTable, runs: Runs, ledger: Ledger, coordinator: Coordinator) -> None:
        self._points, self._runs, self._ledger, self._coordinator = points, runs, ledger, coordinator
        self._due = time.monotonic()

    def refresh(self) -> None:
        """Write the tables unless they are recent: that takes at most `_REFRESH_SHARE` of the time."""
        began = time.monotonic()
        if began >= self._due:
            self.write()
            ended = time.monotonic()
            self._due = ended + max(_REFRESH_S, (ended - began) / _REFRESH_SHARE)

    def points(self) -> pandas.DataFrame:
        """Return the table of design points."""
        return self._points.table(self._runs.trials())

    def write(self) -> None:
        """Write both tables, the hardware profiles that costs are computed from, and the copy of the book.

        One coordinator does.
        """
        if not self._coordinator.leads:
            return
        both.write(self._points, self._runs.trials(), self._ledger.entries)
        store.back_up(self._ledger.book)
