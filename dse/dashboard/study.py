"""The page of a study folder."""

from __future__ import annotations

import contextlib
import io
import re
import secrets
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas

    from dse.dashboard.definition import Definition
    from dse.dashboard.serve import Download, Server, Stamp
    from dse.skyline.compare import Comparison
    from dse.skyline.goals import Goal
    from dse.study.results import Study

LARGEST_BYTES = 7_800_000
"""Largest size of a page in a file: most mail servers accept it. The drawing library takes 4.8 MB of it."""
_ROOM_BYTES = 200_000, 1_500_000
"""Least and largest room for the details of designs in it; between these, the room that the points leave."""

_NO_TRIAL = "The study has no finished trial of this number."
_NEEDED = ("search_space.yaml", "trials.parquet", "points.parquet")


@dataclass(frozen=True)
class PageRequest:
    """The options of a page.

    definition: its parts and initial settings; None: `dashboards/study.yaml`.
    n_draws: number of samples of recordings, seeds and the hardware's uncertain numbers, which show how
        certain each point's place on the front is; 0: no samples.
    hardware: names or files of profiles to price the points on; empty: the profiles of the study.
    repeats: of a design with several runs, 'mean' of all, or the 'last' or 'worst' run alone.
    """

    definition: Definition | None = None
    n_draws: int = 0
    hardware: tuple[str, ...] = ()
    repeats: str = "mean"


def load_definition(folder: Path, name: str) -> Definition:
    """Read the definition of a study's page; views may be those of its trusted plugins.

    Args:
        folder: of the study; without a search space, no plugin is loaded.
        name: a shipped definition, or a YAML file.

    Raises:
        ConfigError: no such definition, or everything that is wrong with the file.
        StoreError: the search space is damaged.
    """
    from dse.dashboard.definition import load
    from dse.study.results import Study

    if (folder / "search_space.yaml").is_file():
        Study(folder).load_plugins()
    return load(name)


def write_page(study: Study, path: Path | None = None, request: PageRequest | None = None) -> Path:
    """Write the page of a study, by default as page.html in its folder, and return the path.

    It holds the details of as many designs as fit, those on the fronts first.

    Raises:
        ConfigError: a hardware profile does not exist or is wrong.
        StoreError: a table or an artefact is damaged, or there is nothing to sample.
    """
    from dse.dashboard.details import packed_details, shown_first
    from dse.dashboard.write import filled, write_filled

    request = request or PageRequest()
    _check(study, request)
    points = _with_recordings(study, study.points(request.hardware, request.repeats))
    page = _gathered(study, _with_failures(study, points), request) | _progress(study.folder)
    least, most = _ROOM_BYTES
    room = min(most, max(least, LARGEST_BYTES - len(filled("page", page).html)))
    details = packed_details(study, points, shown_first(page), room, request.hardware)
    target = path or study.folder / "page.html"
    return write_filled("page", page | ({"details": details} if details else {}), target)


def write_comparison(
    compared: Comparison, tables: Mapping[str, pandas.DataFrame], objectives: Sequence[Goal], path: Path
) -> Path:
    """Write the page of two studies: the points of both, coloured by study; return the path.

    Trials of the second study are numbered on after those of the first; `numbered` tells from where, so that
    readers see the number that each has in its study.

    Args:
        compared: `dse.study.comparison.compare_studies`.
        tables: the points by the name of their study.
        objectives: of both.
        path: file to write.
    """
    import pandas

    from dse.dashboard.definition import load
    from dse.dashboard.gather import gather_page
    from dse.dashboard.write import write_filled
    from dse.skyline.compare import STUDY
    from dse.store import plain_cell

    (one, first), (other, second) = tables.items()
    numbered = None
    if {"trial"} <= set(first) & set(second):
        start = int(first["trial"].max()) + 1
        second = second.assign(trial=second["trial"] + start)
        numbered = {"from": start, "first": one, "second": other}
    named = zip(tables, (first, second), strict=True)
    frame = pandas.concat([table.assign(**{STUDY: name}) for name, table in named], ignore_index=True)
    page = gather_page(
        frame,
        name=" and ".join(tables),
        objectives=list(objectives),
        notes=compared.notes,
        results="",
        definition=load(),
    )
    sections = {"studies": compared.summary, "gains": compared.gains}
    plain = {key: [plain_cell(row) for row in table.to_dict("records")] for key, table in sections.items()}
    return write_filled("page", page | plain | {"colour": STUDY, "numbered": numbered}, path)


def page_server(folder: Path, host: str, port: int, request: PageRequest | None = None) -> Server:
    """Return a server of the page of a study; the study may have no finished trial yet.

    Raises:
        ConfigError: a hardware profile does not exist or is wrong.
        StoreError: the folder holds no study, or there is nothing to sample.
        OSError: the host is not an address of this machine, or the port is in use.
    """
    import pandas

    from dse import store, trust
    from dse.dashboard.serve import Live, Server, Writing, stamp
    from dse.study import notes, results, saved_views
    from dse.study.results import Study

    if not (folder / "search_space.yaml").is_file():
        raise store.StoreError(f"{folder}: is not the folder of a study: there is no search_space.yaml")
    request = request or PageRequest()
    Study(folder).load_plugins()
    _check(Study(folder), request)
    designs = _Designs(Study(folder), request.hardware)

    tables = [folder / name for name in (*_NEEDED, store.WARNINGS)]
    last_stamps: list[Stamp | None] = []
    last_page: dict[str, Any] = {}
    last_written: tuple[list[Stamp | None], dict[str, Any]] = ([], {})
    token = secrets.token_urlsafe(24)

    def by_readers() -> dict[str, Any]:
        nonlocal last_written
        now = [stamp(folder / name) for name in (notes.FILE, saved_views.FILE)]
        if now != last_written[0]:
            last_written = (now, _by_readers(folder))
        return {**last_written[1], "note_token": token}

    def read() -> Mapping[str, Any]:
        nonlocal last_stamps, last_page
        # Trials end all the time; the tables, and the part of the page made from them, change now and then.
        stamps = [stamp(path) for path in tables]
        if stamps != last_stamps:
            study = results.open(folder)
            designs.points = study.points(request.hardware, request.repeats)
            designs.shown = _with_recordings(study, designs.points)
            page = _gathered(study, _with_failures(study, designs.shown), request)
            last_stamps, last_page = stamps, page
        return {**last_page, **_progress(folder), **by_readers()}

    empty = _gathered(Study(folder), pandas.DataFrame(), request)
    going_on = [folder / "journal.log", folder / "artefacts", tables[-1]]
    going_on += [folder / notes.FILE, folder / saved_views.FILE]
    waiting = lambda: {**empty, **_progress(folder)}  # noqa: E731
    live = Live(read, tables[:-1], going_on, waiting, lambda: store.is_held(folder))
    return Server(
        live,
        host,
        port,
        designs.details,
        designs.bundle,
        Writing(
            token,
            lambda *note: _write(folder, notes.write, *note),
            lambda *view: _write(folder, saved_views.write, *view),
        ),
        trust.token(str(folder.resolve())),
    )


def _write(folder: Path, write: Callable[..., object], *what: object) -> None:
    """Write a note or a view.

    Raises:
        Refused: it cannot be written; the text names no path.
    """
    from dse.dashboard.serve import Refused
    from dse.store import StoreError

    try:
        write(folder, *what)
    except StoreError as error:
        text = re.sub(rf"^{re.escape(str(folder))}(/[^:/]*)?: ", "", str(error))
        raise Refused(HTTPStatus.UNPROCESSABLE_ENTITY, text) from error


def _by_readers(folder: Path) -> dict[str, Any]:
    """Return what readers of the page have written."""
    from dse.study import notes, saved_views

    return {"design_notes": notes.plain(folder), "saved_views": saved_views.plain(folder)}


class _Designs:
    """The details and bundles of single designs for a server: designs of the table that it read last."""

    def __init__(self, study: Study, hardware: Sequence[str]) -> None:
        self._study = study
        self._hardware = hardware
        self.points: pandas.DataFrame | None = None
        self.shown: pandas.DataFrame | None = None

    def details(self, trial: int) -> Mapping[str, Any]:
        """Return the details of a trial.

        Raises:
            Refused: there is no such trial, or it failed.
        """
        from dse.dashboard.details import gather_details
        from dse.dashboard.serve import Refused
        from dse.store import StoreError

        if self.shown is None or "trial" not in self.shown:
            raise Refused(HTTPStatus.NOT_FOUND, _NO_TRIAL)
        try:
            return gather_details(self._study, self.shown, trial, self._hardware)
        except StoreError as error:
            raise Refused(HTTPStatus.NOT_FOUND, _NO_TRIAL) from error

    def bundle(self, trial: int, point: int, hardware: str) -> Download:
        """Return the bundle of a design point as a zip file; nothing is written to the study.

        It is that of the study's folder whose targets were run, if there is one; another holds the targets of
        the search space, written and not verified.

        Raises:
            Refused: there is no such point, or it cannot be exported; the text names no path.
        """
        from dse.dashboard.serve import Download, Refused
        from dse.dashboard.verdicts import folder_of
        from dse.deploy.bundle import BundleError, read
        from dse.deploy.export import export
        from dse.deploy.targets import TargetError
        from dse.store import StoreError

        row = self._row(trial, point, hardware)
        if row is None:
            raise Refused(HTTPStatus.NOT_FOUND, "The study has no such design point.")
        name = f"trial_{trial}_point_{point}"
        if (verified := folder_of(self._study.folder, trial, point, hardware)) is not None:
            with contextlib.suppress(BundleError, OSError):  # a damaged one is made anew
                read(verified)
                return Download(f"{name}.zip", _zipped(verified, name))
        try:
            with tempfile.TemporaryDirectory(prefix="dse-bundle-") as temporary:
                folder = Path(temporary) / name
                export(self._study, row, folder, self._study.space.get("targets", ()))
                return Download(f"{name}.zip", _zipped(folder, name))
        except TargetError as error:
            text = "A target of the search space cannot be written on the machine that serves this page."
            raise Refused(HTTPStatus.UNPROCESSABLE_ENTITY, text) from error
        except BundleError as error:
            text = "This design cannot be deployed: its encoder reads the labels of the recordings."
            raise Refused(HTTPStatus.UNPROCESSABLE_ENTITY, text) from error
        except ValueError as error:
            text = "The study has changed since this point was evaluated; reload the page."
            raise Refused(HTTPStatus.CONFLICT, text) from error
        except (StoreError, OSError) as error:
            text = "This design cannot be exported: an artefact is damaged, or the disk is full."
            raise Refused(HTTPStatus.UNPROCESSABLE_ENTITY, text) from error

    def _row(self, trial: int, point: int, hardware: str) -> Mapping[str, Any] | None:
        """Return a design point; None if there is none, or several."""
        if self.points is None or not {"trial", "point"} <= set(self.points):
            return None
        rows = self.points[self.points["trial"] == trial]
        rows = rows[rows["point"] == point]
        if "hardware" in rows or hardware:
            rows = rows[rows["hardware"] == hardware] if "hardware" in rows else rows.iloc[:0]
        return {str(name): value for name, value in rows.iloc[0].items()} if len(rows) == 1 else None


def _zipped(folder: Path, name: str) -> bytes:
    """Return a folder as a zip file, under a name; equal files give equal bytes."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            entry = zipfile.ZipInfo(f"{name}/{path.relative_to(folder).as_posix()}")  # always dated 1980
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, path.read_bytes())
    return packed.getvalue()


def _gathered(study: Study, table: pandas.DataFrame, request: PageRequest) -> dict[str, Any]:
    from dse.dashboard.gather import gather_page
    from dse.store import plain_cell
    from dse.study import health, held

    audit = study.audit
    marks, lacks = _marks(study) if len(table) else ([], [])
    if request.n_draws and len(table):
        table = table.assign(**_certainty(study, table, request))
    page = gather_page(
        table,
        name=study.space["study"],
        objectives=study.objectives,
        notes=[
            *study.warnings,
            *held.remarks(study.folder),
            *(health.faults(study.trials) if len(table) else ()),
            *lacks,
            *_of_runs(request),
        ],
        results=str(study.folder),
        hardware=request.hardware,
        definition=request.definition,
        marks=marks,
        repeats=request.repeats,
    )
    rows = [] if audit is None else [plain_cell(row.columns) for row in audit.rows]
    points_at = _written_at(study.folder / "points.parquet")
    return page | {"audit": rows, "points_at": points_at} | _by_readers(study.folder)


def _of_runs(request: PageRequest) -> list[str]:
    """Return a note if the numbers of a design are not the means of its runs."""
    which = {"last": "last run", "worst": "run of least accuracy"}.get(request.repeats)
    return (
        [f"The numbers of a design are those of its {which} alone; details are of all runs."] if which else []
    )


def _written_at(path: Path) -> str | None:
    """Return when a file was written, ISO 8601 in UTC; None if there is no file."""
    from datetime import UTC, datetime

    try:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds")
    except OSError:
        return None


def _with_recordings(study: Study, points: pandas.DataFrame) -> pandas.DataFrame:
    """Return points whose `accuracy_se` is at least that of the number of validation recordings.

    The spread over seeds leaves out that there are few recordings: that of a deterministic design is 0.
    """
    from dse import store
    from dse.figures.front import numbers
    from dse.measure.objectives.accuracy import wilson_se

    if not {"trial", "repeats", "accuracy", "accuracy_se"} <= set(points):
        return points
    repeated = (numbers(points, "repeats") > 1) & np.isfinite(numbers(points, "accuracy"))
    if not repeated.any():
        return points
    of_folds = study.space.get("split", {}).get("k_fold") is not None  # whose recordings are not the same
    n = np.ones(len(points))
    for trial, places in points.groupby("trial", sort=False).indices.items():
        record = store.read_json(store.run_folder(study.folder, int(str(trial)), 0) / "record.json")
        n[places] = max(record["samples"].get("validation", 0), 1)
    n *= np.where(of_folds, np.nan_to_num(numbers(points, "repeats"), nan=1.0), 1.0)
    accuracy = np.where(repeated, numbers(points, "accuracy"), 0.0)
    least = wilson_se(np.rint(accuracy * n), n)
    error = numbers(points, "accuracy_se")
    return points.assign(accuracy_se=np.where(repeated, np.fmax(error, least), error))


def _check(study: Study, request: PageRequest) -> None:
    """Check that profiles can be read and, with samples, that an objective is uncertain.

    Raises:
        ConfigError: a profile does not exist or is wrong.
        StoreError: there is nothing to sample.
    """
    from dse.measure.on_chips import DRAWN
    from dse.store import StoreError
    from dse.study import pricing, resampling

    pricing.profiles(study.folder, request.hardware)
    if not request.n_draws:
        return
    if request.repeats != "mean":
        raise StoreError(f"--repeats {request.repeats} is one run of each design: --draws samples all runs")
    names = {name for name, _ in study.objectives}
    if not names & {*DRAWN, *resampling.ACCURACIES}:
        text = (
            "nothing to sample: no objective is an accuracy or depends on uncertain numbers of hardware "
            f"({', '.join(DRAWN)})"
        )
        raise StoreError(f"{study.folder}: {text}")
    if not names & {*resampling.ACCURACIES} and not (request.hardware or study.space.get("hardware")):
        raise StoreError(f"{study.folder}: nothing to sample: the study has no hardware")


def _certainty(study: Study, table: pandas.DataFrame, request: PageRequest) -> dict[str, pandas.Series]:
    """Return the fraction of samples in which each point is on its task's front.

    front_share varies the hardware's uncertain numbers, front_probability also recordings and seeds. NaN for
    rows that are on no front by rule, such as failed trials; a column that has nothing to sample is missing.
    """
    from dse.skyline import front
    from dse.study import resampling

    among = front.comparable(table, study.objectives, by="task").rows
    shares, _ = resampling.certainty(
        [study.folder], [table], request.hardware, study.objectives, request.n_draws, among, "task"
    )
    return {name: share.reindex(table.index) for name, share in shares.items()}


def _progress(folder: Path) -> dict[str, Any]:
    """Return the progress of a study; None, which hides this part of the page, if it is unknown."""
    from dse.dashboard.progress import gather_progress
    from dse.store import StoreError

    try:
        return {"progress": gather_progress(folder)}
    except StoreError:
        return {"progress": None}


def _marks(study: Study) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the published designs to draw beside a study, or a sentence if they cannot be read."""
    from dse import store
    from dse.report.gather import gather_marks

    try:
        return gather_marks(study), []
    except store.StoreError as error:
        return [], [f"Published designs are not shown: {error}."]


def _with_failures(study: Study, points: pandas.DataFrame) -> pandas.DataFrame:
    """Return design points and the failed trials of their study."""
    import pandas

    trials = study.trials
    failed = trials[trials["status"] == "failed"]
    parts = [part for part in (points, failed) if len(part)]
    return pandas.concat(parts, ignore_index=True) if parts else trials
