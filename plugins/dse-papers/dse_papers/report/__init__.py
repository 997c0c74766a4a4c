"""What five papers on tactile recognition print, beside studies of ours: `published.yaml` holds the numbers.

`systems.py` sets their systems beside the designs of a study, for `dse report` and the marks of the page;
`compare.py` every number of one paper, with what of ours is the same quantity from `tables/`; `folder.py`
writes that as a folder, with the printed figures redrawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from dse.base.registry import register
from dse.show.report import Mark, ReportError, System, Table

if TYPE_CHECKING:
    from dse.show.report.designs import StudyTask
    from dse.show.report.rows import Row
    from dse.study.results import Study

_SHOWN = (
    *(
        "kind",
        "where",
        "quantity",
        "condition",
        "printed",
        "ours",
        "se",
        "low",
        "high",
        "runs",
        "same",
        "why",
    ),
    *("causes", "setup", "study"),
)


@register("reports", "paper")
@dataclass(frozen=True)
class Papers:
    """Systems and printed numbers of five papers on tactile recognition."""

    about: ClassVar[str] = (
        "print every number of one paper beside ours: 000 to 004, or a name such as texture_velocity; the "
        "studies must be of the paper's set-up"
    )

    def systems(self) -> Mapping[str, System]:
        from dse_papers.report.papers import systems

        return systems()

    def rows(self, parts: Sequence[StudyTask]) -> tuple[Sequence[Row], Sequence[str]]:
        from dse_papers.report.systems import rows_of

        return rows_of(parts)

    def marks(self, parts: Sequence[StudyTask]) -> Sequence[Mark]:
        from dse_papers.report.systems import marks_of

        return marks_of(parts)

    def table(self, studies: Sequence[Study], key: str, folder: Path | None) -> Table:
        from dse_papers.report.compare import paper_report
        from dse_papers.report.folder import write_paper
        from dse_papers.report.papers import key_of, publications

        number = key_of(key)
        if number is None:
            papers = ", ".join(f"{x} ({paper.name})" for x, paper in publications().items())
            raise ReportError(f"--paper must be one of {papers}, got '{key}'")
        compared = paper_report(studies, number) if folder is None else write_paper(studies, number, folder)
        return Table([row.columns for row in compared.rows], compared.notes, _SHOWN)
