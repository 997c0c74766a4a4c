"""The page of a study folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas

    from dse.dashboard.serve import Server
    from dse.study import Study

_NEEDED = ("search_space.yaml", "trials.parquet", "points.parquet")


def write_page(study: Study, path: Path | None = None) -> Path:
    """Write the page of a study, by default as page.html in its folder, and return where."""
    from dse import dashboard

    return dashboard.write_page(
        _table(study),
        path or study.folder / "page.html",
        name=study.space["study"],
        objectives=study.objectives,
        notes=study.warnings,
        results=str(study.folder),
    )


def page_server(folder: Path, host: str, port: int) -> Server:
    """Return a server of the page of a study, which need not have finished a trial yet.

    Raises:
        StoreError: there is no study in the folder.
        OSError: the host is not this machine's, or the port is taken.
    """
    import pandas

    from dse import dashboard, store, study
    from dse.dashboard.serve import Live, Server

    if not (folder / "search_space.yaml").is_file():
        raise store.StoreError(f"{folder}: is no folder of a study: it has no search_space.yaml")

    def gathered(found: Study, table: pandas.DataFrame) -> Mapping[str, Any]:
        return dashboard.gather_page(
            table,
            name=found.space["study"],
            objectives=found.objectives,
            notes=found.warnings,
            results=str(found.folder),
        )

    def read() -> Mapping[str, Any]:
        found = study.open(folder)
        return gathered(found, _table(found))

    waiting = gathered(study.Study(folder), pandas.DataFrame())
    live = Live(read, [folder / name for name in _NEEDED], [folder / store.WARNINGS], waiting)
    return Server(live, host, port)


def _table(study: Study) -> pandas.DataFrame:
    """Return the design points and the failed trials."""
    import pandas

    trials = study.trials
    failed = trials[trials["status"] == "failed"]
    parts = [part for part in (study.points(), failed) if len(part)]
    return pandas.concat(parts, ignore_index=True) if parts else trials
