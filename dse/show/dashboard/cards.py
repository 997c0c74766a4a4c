"""The model card of a design point on a page: that of its bundle (`dse.deploy.card`), in parts."""

from __future__ import annotations

import contextlib
import functools
import re
from collections.abc import Mapping, Sequence
from typing import Any

from dse.deploy.bundle import BundleError, read
from dse.deploy.card import card
from dse.deploy.export import bundle_of
from dse.show.dashboard.verdicts import exported, folder_of
from dse.study.results import Study

_MARKED = re.compile(r"\\(.)|\*\*|`")
_CELLS = re.compile(r"(?<!\\)\|")
_plain = functools.partial(_MARKED.sub, lambda mark: mark[1] or "")


def gather_card(study: Study, point: Mapping[str, Any]) -> list[list[Any]]:
    """Return the model card of a row of a study's points: that of its verified bundle, or of a new one.

    Returns:
        [tag, content] of each part, in their order: h2, h3, p or code with a text, ul with texts, table with
        rows of texts.

    Raises:
        ValueError: as `dse.deploy.export.export`; also `BundleError` and `StoreError`.
    """
    trial, at, hardware = point["trial"], point.get("point", 0), str(point.get("hardware", ""))
    if (verified := folder_of(study.folder, int(trial), int(at), hardware)) is not None:
        with contextlib.suppress(BundleError, OSError):  # a damaged one is made anew
            bundle = read(verified)
            return parts(card(bundle, bundle.targets))
    return parts(card(bundle_of(study, point), {}))


def gather_cards(study: Study, points: Sequence[Mapping[str, Any]]) -> dict[str, list[list[Any]]]:
    """Return the model cards of rows of a study's points and of its verified bundles, by trial.point@chip.

    A design without one is left out.
    """
    cards = {}
    for point in [*points, *(record for _, record, _ in exported(study.folder))]:
        with contextlib.suppress(Exception):  # a family of a user's module may fail in any way
            key = f"{int(point['trial'])}.{int(point['point'])}@{point.get('hardware', '')}"
            cards[key] = gather_card(study, point)
    return cards


def parts(text: str) -> list[list[Any]]:
    """Return the parts of a card's Markdown, as of `gather_card`."""
    found: list[list[Any]] = []
    for line in filter(None, text.splitlines()):
        begun = found[-1][0] if found else ""
        if line.startswith("|"):
            cells = [_plain(cell).strip() for cell in _CELLS.split(line)[1:-1]]
            if begun != "table":
                found.append(["table", []])
            if any(cell.strip("-") for cell in cells):
                found[-1][1].append(cells)
        elif line.startswith("- "):
            if begun != "ul":
                found.append(["ul", []])
            found[-1][1].append(_plain(line[2:]))
        elif line.startswith("    "):
            found.append(["code", line.strip()])
        else:
            level = len(line) - len(line.lstrip("#"))
            found.append([f"h{level + 1}" if level else "p", _plain(line[level:].strip())])
    return found
