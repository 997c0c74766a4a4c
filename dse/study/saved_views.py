"""Saved views of the page: what it shows under a name, a file of the study beside its notes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from dse import store
from dse.study.notes import locked

FILE = "views.json"
LONGEST_NAME, LONGEST_LINK = 60, 4000
"""Characters of a view."""
MOST = 200
"""Views of a study."""


@dataclass(frozen=True)
class View:
    """What a page shows.

    name: its own in the study. link: the fragment of the page's address. at: ISO 8601, UTC.
    """

    name: str
    link: str
    at: str


def read(path: Path) -> list[View]:
    """Return the views of a file.

    Raises:
        Damaged: it is not what was written.
        StoreError: it cannot be read now.
    """
    document = store.read_json(path)
    try:
        return [View(**view) for view in document]
    except TypeError:
        raise store.damaged(path, "holds no views") from None


def of(folder: Path) -> list[View]:
    """Return the views of a study by name.

    Raises:
        StoreError: as in `read`.
    """
    path = folder / FILE
    return sorted(read(path) if path.exists() else [], key=lambda view: view.name)


def write(folder: Path, name: str, link: str) -> None:
    """Replace the view of a name; one without a link is removed.

    Raises:
        StoreError: the name or the link is too long, the view is one too many, or the file is damaged or
            cannot be written.
    """
    name = name.strip()
    if not 0 < len(name) <= LONGEST_NAME or len(link) > LONGEST_LINK:
        raise store.StoreError(
            f"a view must have a name of 1 to {LONGEST_NAME} characters and a link of at most {LONGEST_LINK}"
        )
    with locked(folder):
        views = [view for view in of(folder) if view.name != name]
        if link:
            views.append(View(name, link, datetime.now(UTC).isoformat(timespec="seconds")))
        if len(views) > MOST:
            raise store.StoreError(f"{folder}: a study has at most {MOST} views")
        store.write_json(folder / FILE, [asdict(view) for view in views])


def plain(folder: Path) -> list[dict[str, str]]:
    """Return the views of a study as JSON holds them; none where they cannot be read."""
    try:
        return [asdict(view) for view in of(folder)]
    except store.StoreError:
        return []
