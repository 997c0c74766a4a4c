"""The page of a study folder: what it shows, and the file of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas

from dse import store
from dse.measure.objectives.accuracy import wilson_se
from dse.measure.on_chips import DRAWN
from dse.show.dashboard.definition import Definition, load
from dse.show.dashboard.details import packed_details, shown_first
from dse.show.dashboard.gather import gather_page
from dse.show.dashboard.progress import gather_progress
from dse.show.dashboard.write import filled, write_filled
from dse.show.figures.front import numbers
from dse.show.report.gather import gather_marks
from dse.skyline import front
from dse.store import StoreError
from dse.study import health, held, pricing, resampling, rivals
from dse.study.question import Question
from dse.study.results import Study

LARGEST_BYTES = 7_800_000
"""Largest size of a page in a file: most mail servers accept it. The drawing library takes 4.8 MB of it."""
_ROOM_BYTES = 200_000, 1_500_000
"""Least and largest room for the details of designs in it; between these, the room that the points leave."""


@dataclass(frozen=True)
class PageRequest:
    """The options of a page.

    definition: its parts and initial settings; None: `dashboards/study.yaml`.
    question: which runs, chips and samples its points are of; without samples, none says how certain it is.
    """

    definition: Definition | None = None
    question: Question = Question()  # noqa: RUF009 (frozen)


def load_definition(folder: Path, name: str) -> Definition:
    """Read the definition of a study's page; views may be those of its trusted plugins.

    Args:
        folder: of the study; without a search space, no plugin is loaded.
        name: a shipped definition, or a YAML file.

    Raises:
        ConfigError: no such definition, or everything that is wrong with the file.
        StoreError: the search space is damaged.
    """
    if (folder / "search_space.yaml").is_file():
        Study(folder).load_plugins()
    return load(name)


def write_page(
    study: Study, path: Path | None = None, request: PageRequest | None = None, *, plays: bool = True
) -> Path:
    """Write the page of a study, by default as page.html in its folder, and return the path.

    It holds the details of as many designs as fit, those on the fronts first, and with `plays` what plays
    recordings to the designs of its first cards, and the model cards of its picks.

    Raises:
        ConfigError: a hardware profile does not exist or is wrong.
        StoreError: a table or an artefact is damaged, or there is nothing to sample.
    """
    request = checked(study, request or PageRequest())
    points = with_recordings(study, study.points(request.question.hardware))
    page = page_of(study, points, request) | progress_of(study.folder)
    if plays:
        from dse.show.dashboard import cards, touches  # kernels run: a page alone needs none

        if rows := touches.shown_first(page):
            played = _of_rows(page, rows, points)
            page["touches"] = touches.gather_touches(study, played, request.question.hardware)
            page["cards"] = cards.gather_cards(study, _of_rows(page, _picked(page, rows), points))
    least, most = _ROOM_BYTES
    room = min(most, max(least, LARGEST_BYTES - len(filled("page", page).html)))
    details = packed_details(study, points, shown_first(page), room, request.question.hardware)
    target = path or study.folder / "page.html"
    return write_filled("page", page | ({"details": details} if details else {}), target)


def _picked(page: Mapping[str, Any], first: Sequence[int]) -> list[int]:
    """Return some rows of a page, and the pick of each task and chip."""
    from dse.show.dashboard import touches

    split = [page["columns"][name]["values"] for name in ("task", "hardware") if name in page["columns"]]
    groups = {key: row for row, key in reversed([*enumerate(zip(*split, strict=True))])}
    picks = [row for at in groups.values() for row in touches.shown_first(page, at)[:1]]
    return list(dict.fromkeys([*first, *picks]))


def _of_rows(page: Mapping[str, Any], rows: Sequence[int], points: pandas.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of the table of points that some rows of its page are."""
    if not rows:
        return []
    names = [name for name in ("trial", "point", "hardware") if name in page["columns"]]
    named = points.set_index(names, drop=False)
    keys = [tuple(page["columns"][name]["values"][row] for name in names) for row in rows]
    return [{str(name): x for name, x in named.loc[[key]].iloc[0].items()} for key in keys]


def page_of(study: Study, points: pandas.DataFrame | None, request: PageRequest) -> dict[str, Any]:
    """Return the page of a study without its progress; points are None before the first trial."""
    table = pandas.DataFrame() if points is None else _with_failures(study, points)
    audit = study.audit
    marks, lacks = _marks(study) if len(table) else ([], [])
    if request.question.draws and len(table):
        table = table.assign(**_certainty(study, table, request))
    page = gather_page(
        table,
        name=study.space["study"],
        objectives=study.objectives,
        notes=[
            *(rivals.brief(study, request.question) if len(table) else ()),
            *study.warnings,
            *held.remarks(study.folder),
            *(health.faults(study.trials) if len(table) else ()),
            *lacks,
        ],
        results=str(study.folder),
        hardware=request.question.hardware,
        definition=request.definition,
        marks=marks,
    )
    rows = [] if audit is None else [store.plain_cell(row.columns) for row in audit.rows]
    points_at = _written_at(study.folder / "points.parquet")
    chips = table["hardware"].dropna().unique() if "hardware" in table else ()
    labels = {str(name): pricing.label_of(study.folder, str(name)) for name in chips}
    return page | {"audit": rows, "points_at": points_at, "chips": labels}


def _written_at(path: Path) -> str | None:
    """Return when a file was written, ISO 8601 in UTC; None if there is no file."""
    try:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds")
    except OSError:
        return None


def with_recordings(study: Study, points: pandas.DataFrame) -> pandas.DataFrame:
    """Return points whose `accuracy_se` is at least that of the number of validation recordings.

    The spread over seeds leaves out that there are few recordings: that of a deterministic design is 0.
    """
    if not {"trial", "repeats", "accuracy", "accuracy_se"} <= set(points):
        return points
    repeated = (numbers(points, "repeats") > 1) & np.isfinite(numbers(points, "accuracy"))
    if not repeated.any():
        return points
    of_folds = study.space.get("split", {}).get("k_fold") is not None  # whose recordings are not the same
    n = np.ones(len(points))
    for trial, places in points.groupby("trial", sort=False).indices.items():
        record = store.read_record(store.first_run(study.folder, int(str(trial))))
        n[places] = max(record["samples"].get("validation", 0), 1)
    n *= np.where(of_folds, np.nan_to_num(numbers(points, "repeats"), nan=1.0), 1.0)
    accuracy = np.where(repeated, numbers(points, "accuracy"), 0.0)
    least = wilson_se(np.rint(accuracy * n), n)
    error = numbers(points, "accuracy_se")
    return points.assign(accuracy_se=np.where(repeated, np.fmax(error, least), error))


def checked(study: Study, request: PageRequest) -> PageRequest:
    """Return a request after a check: profiles can be read and, with samples, an objective is uncertain."""
    pricing.profiles(study.folder, request.question.hardware)
    if not request.question.draws:
        return request
    names = {name for name, _ in study.objectives}
    is_priced = request.question.hardware or study.space.get("hardware")
    if not names & {*resampling.ACCURACIES, *(DRAWN if is_priced else ())}:
        text = "no objective is an accuracy, or depends on uncertain numbers of the study's hardware"
        raise StoreError(f"{study.folder}: nothing to sample: {text} ({', '.join(DRAWN)})")
    return request


def _certainty(study: Study, table: pandas.DataFrame, request: PageRequest) -> dict[str, pandas.Series]:
    """Return the fraction of samples in which each point is on its task's front.

    front_share varies the hardware's uncertain numbers, front_probability also recordings and seeds. NaN for
    rows that are on no front by rule, such as failed trials; a column that has nothing to sample is missing.
    """
    among = front.comparable(table, study.objectives, by="task").rows
    shares, _ = resampling.certainty(
        [study.folder],
        [table],
        request.question.hardware,
        study.objectives,
        request.question.draws or 0,
        among,
        "task",
    )
    return {name: share.reindex(table.index) for name, share in shares.items()}


def progress_of(folder: Path) -> dict[str, Any]:
    """Return the progress of a study; None, which hides this part of the page, if it is unknown."""
    try:
        return {"progress": gather_progress(folder)}
    except StoreError:
        return {"progress": None}


def _marks(study: Study) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the published designs to draw beside a study, or a sentence if they cannot be read."""
    try:
        return gather_marks(study), []
    except store.StoreError as error:
        return [], [f"Published designs are not shown: {error}."]


def _with_failures(study: Study, points: pandas.DataFrame) -> pandas.DataFrame:
    """Return design points and the failed trials of their study."""
    trials = study.trials
    failed = trials[trials["status"] == "failed"]
    parts = [part for part in (points, failed) if len(part)]
    return pandas.concat(parts, ignore_index=True) if parts else trials
