"""`dse report`: whether to spike, chips, and what a cheap reader knows of the recordings.

Designs are selected on validation; test accuracy is printed beside. What others publish stands beside:
plugins register it in section `reports` (`Published`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

if TYPE_CHECKING:
    from dse.show.report.designs import StudyTask
    from dse.show.report.rows import Row
    from dse.study.results import Study


class ReportError(ValueError):
    """A report cannot be made of these studies, or there is none; the message is a line per reason."""


@dataclass(frozen=True)
class System:
    """A published system: a letter in the rows of `dse report`.

    title: what it is. source: the publication, as in REFERENCES.md. families: ours that stand beside it.
    """

    title: str
    source: str
    families: tuple[str, ...]


@dataclass(frozen=True)
class Mark:
    """A published design, which the page draws beside ours.

    name: letter of its system, and which of its designs. task: our task that it is compared with.
    values: the published numbers, by the name of our column.
    source: the publication, as in REFERENCES.md.
    caption: one sentence; it claims no more than the publication.
    """

    name: str
    task: str
    values: Mapping[str, float]
    source: str
    caption: str


@dataclass(frozen=True)
class Table:
    """A report as rows of columns, sentences about them, and the columns that a terminal shows."""

    rows: Sequence[Mapping[str, object]]
    notes: Sequence[str]
    shown: Sequence[str]


class Published(Protocol):
    """A component of section `reports`: what others publish, beside studies of ours.

    about: help of the option `--NAME KEY` of `dse report`, which prints `table` of that key.
    """

    about: ClassVar[str]

    def systems(self) -> Mapping[str, System]:
        """Return the published systems by their letters."""

    def rows(self, parts: Sequence[StudyTask]) -> tuple[Sequence[Row], Sequence[str]]:
        """Return the rows of these systems beside designs of ours, and sentences about them."""

    def marks(self, parts: Sequence[StudyTask]) -> Sequence[Mark]:
        """Return the published designs that are compared with designs of ours."""

    def table(self, studies: Sequence[Study], key: str, folder: Path | None) -> Table:
        """Return one report, and write the folder about it if one is named.

        Raises:
            ReportError: no study fits, or there is no report of this key.
            StoreError: a study's folder is damaged, or `folder` holds something else.
        """
