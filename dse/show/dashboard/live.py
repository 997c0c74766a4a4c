"""The page of files that change, in the last version that could be read."""

from __future__ import annotations

import functools
import hashlib
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dse.base.text import one_line
from dse.show.dashboard.write import Filled, as_json, filled, gzipped

_OFTEN = ("progress",)
"""Keys of a page that change with every trial that ends."""

Page = Mapping[str, Any]


@dataclass(frozen=True)
class Document:
    """A part of a page to send; equal parts have equal tags on every server."""

    part: Page

    @functools.cached_property
    def text(self) -> bytes:
        return as_json(self.part).encode()

    @functools.cached_property
    def tag(self) -> str:
        """Its `ETag`; weak, because the packed answer has the same one."""
        return f'W/"{hashlib.sha256(self.text).hexdigest()[:32]}"'

    @functools.cached_property
    def packed(self) -> bytes:
        return gzipped(self.text)

    def renewed(self, part: Page) -> Document:
        """Return the document of a part: this one where the part has the same objects."""
        same = self.part.keys() == part.keys() and all(part[key] is self.part[key] for key in part)
        return self if same else Document(part)


@dataclass(frozen=True)
class PageVersion:
    """A version of the page: the data from tables, and the progress, which changes with every trial."""

    data: Document
    progress: Document

    @functools.cached_property
    def filled(self) -> Filled:
        tags = {"data.json": self.data.tag, "progress.json": self.progress.tag}
        return filled("page", {**self.data.part, **self.progress.part, "tags": tags}, live=True)

    def renewed(self, page: Page) -> PageVersion:
        """Return the version of a page; a part whose values are the same objects is kept."""
        return PageVersion(
            self.data.renewed({key: value for key, value in page.items() if key not in _OFTEN}),
            self.progress.renewed({key: page[key] for key in _OFTEN if key in page}),
        )


class Live:
    """The page of files that change, in the last version that could be read."""

    def __init__(
        self,
        read: Callable[[], Page],
        required: Sequence[Path],
        optional: Sequence[Path],
        waiting: Callable[[], Page],
        beside: Callable[[], object] = lambda: None,
    ) -> None:
        """Store the files and the functions; nothing is read yet.

        Args:
            read: gathers the page; any exception means that the files cannot be read now. A value that is the
                same object as last time counts as unchanged.
            required: files that a page needs. Every request checks all files; they are read after a change.
            optional: files that may be absent.
            waiting: gathers the page before the files can be read for the first time.
            beside: what else the page depends on: the files are read again when it changes.
        """
        self._read, self._waiting = read, waiting
        self._required, self._files, self._beside = required, [*required, *optional], beside
        self._good: Page | None = None
        self._read_at = ""
        self._stamps: list[object] = []
        self._version: PageVersion | None = None
        self._reading = threading.Lock()

    def version(self) -> PageVersion:
        """Return the current page, or the last one while another request reads the files."""
        if not self._reading.acquire(blocking=self._version is None):
            assert self._version is not None
            return self._version
        try:
            stamps = self._now()
            if self._version is None or stamps != self._stamps:
                last = self._version or PageVersion(Document({}), Document({}))
                self._version = last.renewed(self._page())
                self._stamps = stamps  # files that change during the reading are read again next time
            return self._version
        finally:
            self._reading.release()

    def _now(self) -> list[object]:
        return [*map(stamp, self._files), self._beside()]

    def _page(self, tries: int = 3) -> Page:
        stamps = self._now()
        try:
            page = self._read()
        except Exception as error:  # a file cut short raises nearly anything, and the server goes on
            if tries > 1 and self._now() != stamps:  # replaced meanwhile: parts of two files were read
                return self._page(tries - 1)
            missing = [path.name for path in self._required if not path.exists()]
            if self._good is None and missing:
                return self._waiting()
            print(one_line(str(error)) or type(error).__name__, file=sys.stderr)
            return self._unreadable(missing)
        self._good, self._read_at = page, time.strftime("%H:%M:%S")
        return page

    def _unreadable(self, missing: Sequence[str]) -> Page:
        fault = f"{' and '.join(missing)} cannot be found" if missing else "The tables cannot be read"
        if self._good is None:
            text = f"{fault}: they are damaged or being written. The page reads them again when they change."
            return {**self._waiting(), "state": {"title": "No table to read", "text": text}}
        note = f"{fault} now. The page shows the study as read at {self._read_at}."
        return {**self._good, "notes": [note, *self._good["notes"]]}


def stamp(path: Path) -> tuple[int, int, int] | None:
    """Return inode, time of the last change in ns, and size of a file; None if there is no file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size
