"""The designs of a study in its book: what the sampler proposes, and the results that it receives.

A design is on the disk before it is trained.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from dse.search.limits import Exclusion
from dse.store import Book, StoreError

_NO_VALUES: Mapping[Any, float] = MappingProxyType({})


@dataclass(frozen=True)
class Entry:
    """A design that the sampler proposed.

    trial: its number, from 0. batch: number of its batch.
    proposed_s: when the sampler proposed it, in seconds since 1970.
    reported_s: when the sampler received its result, in seconds since 1970; None: not yet.
    values: its objectives; None before the report, and for a failed trial.
    excluded: why it is not trained; '' if it is.
    enqueued: whether the user asked for it (`dse enqueue`), not the sampler.
    at_rungs: epochs -> first objective there.
    stopped: whether it stopped at a rung.
    """

    trial: int
    batch: int
    design: Mapping[str, object]
    proposed_s: float
    reported_s: float | None = None
    values: tuple[float, ...] | None = None
    excluded: str = ""
    enqueued: bool = False
    at_rungs: Mapping[int, float] = field(default_factory=dict)
    stopped: bool = False

    @property
    def is_reported(self) -> bool:
        """Whether the sampler received its result."""
        return self.reported_s is not None

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Entry:
        """Return the entry of a row of the book."""
        more, values = row["more"], row["objectives"]
        return cls(
            trial=row["trial"],
            batch=row["batch"],
            design=row["design"],
            proposed_s=row["proposed_s"],
            reported_s=row["reported_s"],
            values=None if values is None else tuple(values),
            excluded=row["excluded"],
            enqueued=bool(row["enqueued"]),
            at_rungs={int(n): x for n, x in more.get("at_rungs", {}).items()},
            stopped=more.get("stopped", False),
        )

    def row(self) -> dict[str, Any]:
        """Return it as a row of the book; `of` is the way back."""
        parts = {
            "at_rungs": dict(self.at_rungs),
            "stopped": self.stopped,
        }
        return {
            "trial": self.trial,
            "batch": self.batch,
            "design": dict(self.design),
            "proposed_s": self.proposed_s,
            "enqueued": int(self.enqueued),
            "reported_s": self.reported_s,
            "objectives": None if self.values is None else list(self.values),
            "excluded": self.excluded,
            "more": {name: x for name, x in parts.items() if x},
        }


def read_entries(folder: Path) -> list[Entry]:
    """Return the designs of a study in the order of proposal; none where its book cannot be read."""
    try:
        with Book(folder) as book:
            return [Entry.of(row) for row in book.rows("trial")]
    except StoreError:
        return []


class Ledger:
    """The designs of one study, in its book.

    Raises:
        StoreError: the book cannot be read or written.
    """

    def __init__(self, book: Book) -> None:
        self.book = book
        self._version: int | None = None
        self.read()

    def read(self) -> None:
        """Read the designs again if somebody else has written the book."""
        if self._version != (version := self.book.version()):
            self._version = version
            self._entries: list[Entry] = []
            self._of_batch: dict[int, list[int]] = {}
            for row in self.book.rows("trial"):
                self._add(Entry.of(row))

    def _add(self, entry: Entry) -> None:
        self._of_batch.setdefault(entry.batch, []).append(entry.trial)
        self._entries.append(entry)

    @property
    def entries(self) -> list[Entry]:
        """Every entry in the order of proposal; `trial` counts from 0."""
        return list(self._entries)

    def batch(self, number: int) -> list[Entry]:
        """Return the entries of a batch in the order of proposal."""
        return [self._entries[trial] for trial in self._of_batch.get(number, ())]

    def ask(self, batch: int, designs: Sequence[Mapping[str, object]], *, enqueued: bool = False) -> None:
        """Append designs that are about to be trained; `enqueued`: the user asked for them."""
        self._append([self._next(batch, design, n, enqueued=enqueued) for n, design in enumerate(designs)])

    def exclude(self, batch: int, design: Mapping[str, object], why: Exclusion) -> None:
        """Append a design that is not trained."""
        entry = self._next(batch, design, 0)
        self._append([replace(entry, reported_s=entry.proposed_s, excluded=why.reason)])

    def exclude_proposed(self, trial: int, why: Exclusion) -> None:
        """Write that a design, which was proposed, is not trained after all."""
        self._end(trial, excluded=why.reason)

    def tell(
        self,
        trial: int,
        values: Sequence[float] | None,
        at_rungs: Mapping[int, float] = _NO_VALUES,
        *,
        stopped: bool = False,
    ) -> None:
        """Write the result of a trial: its objectives, or None for a failed trial.

        Args:
            trial: its number.
            values: its objectives, at its last rung if it stopped there.
            at_rungs: epochs -> first objective there.
            stopped: whether it stopped at a rung.
        """
        objectives = None if values is None else tuple(map(float, values))
        self._end(trial, values=objectives, at_rungs=dict(at_rungs), stopped=stopped)

    def _next(self, batch: int, design: Mapping[str, object], after: int, *, enqueued: bool = False) -> Entry:
        written = json.loads(json.dumps(dict(design)))  # as it is read after a restart
        return Entry(len(self._entries) + after, batch, written, time.time(), enqueued=enqueued)

    def _append(self, entries: Sequence[Entry]) -> None:
        self.book.put("trial", [entry.row() for entry in entries])
        for entry in entries:
            self._add(entry)

    def _end(self, trial: int, **how: Any) -> None:
        entry = replace(self._entries[trial], reported_s=time.time(), **how)
        self.book.put("trial", [entry.row()])
        self._entries[trial] = entry

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Write everything of the block at once, at its end; nobody else writes meanwhile."""
        with self.book.together():
            self.read()
            yield
