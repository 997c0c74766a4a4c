"""Coordinators of a study: each `dse run` on its folder is one, and they share its trainings.

The first one begins the study, and others join it. All propose the same designs, which they find in the book
where another one was first, and tell their samplers the same results. A run is trained by the coordinator
that has claimed it in the book; a claim holds while its coordinator lives, which the system knows: each has
locked a folder of its own, `coordinators/<name>`. One of them holds the lock of the study. It writes the
tables, and does what comes after the search; when it ends, another one takes the lock.
"""

from __future__ import annotations

import contextlib
import secrets
import time
from collections.abc import Iterable, Set
from pathlib import Path

from dse import store
from dse.store import Book, InUse

_PATIENCE_S, _GLANCE_S = 10.0, 0.2  # for who has the lock of a study and is no coordinator

Key = tuple[int, int]
"""Trial and repeat of a run."""


class Coordinator:
    """This process among the coordinators of a study, until `at_the_end` is closed.

    Attributes:
        is_first: whether it is the only one so far.

    Raises:
        InUse: another process has the lock, and is no coordinator.
        StoreError: the folder cannot be written, or locked.
    """

    def __init__(self, folder: Path, at_the_end: contextlib.ExitStack) -> None:
        self._folder, self._at_the_end = folder, at_the_end
        self._name = secrets.token_hex(4)
        self._book: Book | None = None
        until_s = time.monotonic() + _PATIENCE_S
        self.is_first = self._has_lock = False
        while not self.is_first and not store.living(folder):
            try:
                at_the_end.enter_context(store.exclusive(folder))
                self.is_first = self._has_lock = True
            except InUse:  # who has the lock may begin soon, or end
                if time.monotonic() > until_s:
                    raise
                time.sleep(_GLANCE_S)

    @property
    def leads(self) -> bool:
        """Whether it holds the lock of the study, which it takes where nobody does."""
        if not self._has_lock:
            with contextlib.suppress(InUse):
                self._at_the_end.enter_context(store.exclusive(self._folder, is_alone=False))
                self._has_lock = True
        return self._has_lock

    def begin(self, book: Book) -> None:
        """Let others join; what a coordinator that has died has claimed is free."""
        self._book = book
        if self.is_first:
            store.remove(self._folder / store.COORDINATORS)
            book.drop("claim")
        own = self._folder / store.COORDINATORS / self._name
        self._at_the_end.callback(store.remove, own)
        self._at_the_end.enter_context(store.exclusive(own))

    def claim(self, runs: Iterable[Key], beside: Set[Key]) -> set[Key]:
        """Claim runs beside those that it trains now; return those that no other one has claimed before."""
        assert self._book is not None  # it has begun
        with self._book.together():
            ours = set(self.unclaimed(runs))
            self.free()
            rows = [{"trial": x, "repeat": n, "coordinator": self._name} for x, n in sorted(ours | beside)]
            self._book.put("claim", rows)
        return ours

    def unclaimed(self, runs: Iterable[Key]) -> list[Key]:
        """Return those runs that no other coordinator has claimed, in their order."""
        assert self._book is not None  # it has begun
        living = {self._name: False}  # name -> whether its claims hold against us
        held = {}
        for row in self._book.rows("claim"):
            name = row["coordinator"]
            if name not in living:
                living[name] = store.is_held(self._folder / store.COORDINATORS / name) is not False
            held[row["trial"], row["repeat"]] = living[name]
        return [run for run in runs if not held.get(run)]

    def free(self) -> None:
        """Give back what it has claimed."""
        assert self._book is not None  # it has begun
        self._book.drop("claim", "coordinator = ?", self._name)
