"""What one `dse run` of a study has, for all that take part in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dse.config import SearchSpace
from dse.measure.hardware.profile import Profile
from dse.store import Book
from dse.study.progress import Progress
from dse.study.workers import Workers


@dataclass(frozen=True)
class Session:
    """One process that runs a study.

    space: the search space.
    book: of the study, which the process has locked or joined.
    profiles: of the hardware.
    workers: train, prepare and evaluate.
    progress: is told what happens.
    """

    space: SearchSpace
    book: Book
    profiles: tuple[Profile, ...]
    workers: Workers
    progress: Progress

    @property
    def folder(self) -> Path:
        """The folder of the study."""
        return self.book.folder

    @property
    def budget(self) -> int:
        """Bytes of memory that a worker may use."""
        execution = self.space.execution
        return self.workers.memory_budget(execution.memory_gib, execution.device)
