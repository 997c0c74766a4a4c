"""The page of a study on a server, read again as the study goes on; details and bundles of its designs."""

from __future__ import annotations

import contextlib
import io
import tempfile
import zipfile
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path

import pandas

from dse import store
from dse.base import trust
from dse.show.dashboard.details import gather_details
from dse.show.dashboard.live import Live, Page, stamp
from dse.show.dashboard.serve import Download, Refused, Server, Site
from dse.show.dashboard.study import PageRequest, checked, page_of, progress_of, with_recordings
from dse.show.dashboard.verdicts import folder_of
from dse.store import StoreError
from dse.study import results
from dse.study.results import Study

_NO_TRIAL = "The study has no finished trial of this number."
_NO_TARGET = "A target of the search space cannot be written on the machine that serves this page."
_KNOWS_LABELS = "This design cannot be deployed: its encoder reads the labels of the recordings."
_CHANGED = "The study has changed since this point was evaluated; reload the page."
_DAMAGED = "This design cannot be exported: an artefact is damaged, or the disk is full."

_BOOK = (store.BOOK, f"{store.BOOK}-wal")
"""The book of a study, and its log while it is written."""


def page_server(folder: Path, host: str, port: int, request: PageRequest | None = None) -> Server:
    """Return a server of the page of a study; the study may have no finished trial yet.

    Raises:
        ConfigError: a hardware profile does not exist or is wrong.
        StoreError: the folder holds no study, or there is nothing to sample.
        OSError: the host is not an address of this machine, or the port is in use.
    """
    if not (folder / "search_space.yaml").is_file():
        raise StoreError(f"{folder}: is not the folder of a study: there is no search_space.yaml")
    study = Study(folder)
    study.load_plugins()
    site = StudySite(study, checked(study, request or PageRequest()))
    needed = [folder / name for name in ("search_space.yaml", "trials.parquet", "points.parquet")]
    going_on = [folder / name for name in (*_BOOK, store.RUNS)]
    live = Live(site.read, needed, going_on, site.waiting, lambda: store.is_held(folder))
    return Server(live, host, port, site, trust.token(str(folder.resolve())))


class StudySite(Site):
    """The page of a study, and the designs of the tables that it read last."""

    def __init__(self, study: Study, request: PageRequest) -> None:
        """Gather the page of a study without trials; the tables are read by `read`."""
        self._study, self._request = study, request
        self._points = self._shown = pandas.DataFrame()
        self._page = self._empty = page_of(study, None, request)
        self._stamps: dict[str, object] = {}
        self._warnings: list[str] = []

    def read(self) -> Page:
        """Return the page; a part whose file has not changed is the same object as before."""
        # Trials end all the time; the tables, and the part of the page made from them, change now and then.
        is_other = self._changed(*_BOOK) and self._warned()
        if self._changed("trials.parquet", "points.parquet", "search_space.yaml") or is_other:
            try:
                study = results.open(self._study.folder)
                self._points = study.points(self._request.question.hardware)
                self._shown = with_recordings(study, self._points)
                self._page = page_of(study, self._shown, self._request)
            except BaseException:
                self._stamps.clear()
                raise
        return {**self._page, **progress_of(self._study.folder)}

    def _warned(self) -> bool:
        """Read the warnings; return whether there are others than before."""
        before, self._warnings = self._warnings, self._study.warnings
        return before != self._warnings

    def _changed(self, *names: str) -> bool:
        """Return whether one of some files has changed since this was asked last."""
        now = {name: stamp(self._study.folder / name) for name in names}
        has = any(name not in self._stamps or self._stamps[name] != at for name, at in now.items())
        self._stamps |= now
        return has

    def waiting(self) -> Page:
        """Return the page before the first trial has ended."""
        return {**self._empty, **progress_of(self._study.folder)}

    def details(self, trial: int) -> Page:
        """Return the details of a trial that has finished."""
        if "trial" not in self._shown:
            raise Refused(HTTPStatus.NOT_FOUND, _NO_TRIAL)
        try:
            return gather_details(self._study, self._shown, trial, self._request.question.hardware)
        except StoreError as error:
            raise Refused(HTTPStatus.NOT_FOUND, _NO_TRIAL) from error

    def touches(self, trial: int, point: int) -> Page:
        """Return what plays held recordings to a design point."""
        from dse.show.dashboard.touches import gather_touches  # engine and kernels: a page alone needs none

        row = self._row(trial, point)
        with _refusing():
            return gather_touches(self._study, [row], self._request.question.hardware)

    def card(self, trial: int, point: int, hardware: str) -> Page:
        """Return the model card of a design point."""
        from dse.show.dashboard.cards import gather_card

        with _refusing():
            return {"parts": gather_card(self._study, self._row(trial, point, hardware))}

    def _row(self, trial: int, point: int, hardware: str | None = None) -> dict[str, object]:
        """Return the first row of a design point, on a chip where one is named and points have one."""
        rows = self._points
        chip = {} if hardware is None or not (hardware or "hardware" in rows) else {"hardware": hardware}
        for name, value in {"trial": trial, "point": point, **chip}.items():
            rows = rows[rows[name] == value] if name in rows else rows.iloc[:0]
        if rows.empty:
            raise Refused(HTTPStatus.NOT_FOUND, "The study has no such design point.")
        return {str(column): value for column, value in rows.iloc[0].items()}

    def bundle(self, trial: int, point: int, hardware: str) -> Download:
        """Return the bundle of a design point as a zip file; nothing is written to the study.

        It is that of the study's folder whose targets were run, if there is one; another holds the targets of
        the search space, written and not verified. A refusal names no path.
        """
        from dse.deploy import bundle
        from dse.deploy.export import export

        row = self._row(trial, point, hardware)
        name = f"trial_{trial}_point_{point}"
        if (verified := folder_of(self._study.folder, trial, point, hardware)) is not None:
            with contextlib.suppress(bundle.BundleError, OSError):  # a damaged one is made anew
                bundle.read(verified)
                return Download(f"{name}.zip", _zipped(verified, name))
        with _refusing(), tempfile.TemporaryDirectory(prefix="dse-bundle-") as temporary:
            folder = Path(temporary) / name
            export(self._study, row, folder, self._study.space.get("targets", ()))
            return Download(f"{name}.zip", _zipped(folder, name))


@contextlib.contextmanager
def _refusing() -> Iterator[None]:
    """Refuse what cannot be exported, by its reason."""
    from dse.deploy.bundle import BundleError
    from dse.deploy.targets import TargetError

    try:
        yield
    except (ValueError, StoreError, OSError) as error:
        reasons = ((TargetError, _NO_TARGET), (BundleError, _KNOWS_LABELS), (ValueError, _CHANGED))
        text = next((text for kind, text in reasons if isinstance(error, kind)), _DAMAGED)
        conflict = HTTPStatus.CONFLICT if text == _CHANGED else HTTPStatus.UNPROCESSABLE_ENTITY
        raise Refused(conflict, text) from error


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
