"""The page of a study folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dse.study import Study


def write_page(study: Study, path: Path | None = None) -> Path:
    """Write the page of a study, by default as page.html in its folder, and return where."""
    import pandas

    from dse import dashboard

    trials = study.trials
    failed = trials[trials["status"] == "failed"]
    parts = [part for part in (study.points(), failed) if len(part)]
    frame = pandas.concat(parts, ignore_index=True) if parts else trials
    return dashboard.write_page(
        frame,
        path or study.folder / "page.html",
        name=study.space["study"],
        objectives=study.objectives,
        notes=study.warnings,
    )
