"""Bundles of a study's designs whose targets were run: folders below `bundles` in the study's folder.

`dse pick RESULTS --export RESULTS/bundles/NAME --target TARGET --verify RECORDINGS` makes one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dse import store
from dse.store import StoreError

_FOLDER = "bundles"


@dataclass(frozen=True)
class Exported:
    """What a bundle says of itself: the design point, and the verdict on each target by name."""

    folder: Path
    record: Mapping[str, Any]
    targets: Mapping[str, Mapping[str, Any]]


def exported(study: Path) -> Iterator[Exported]:
    """Yield the bundles of a study, in the order of their names; damaged ones are left out."""
    from dse.deploy.bundle import SCHEMA, sealed

    for path in sorted((study / _FOLDER).glob("*/bundle.json")):
        with contextlib.suppress(StoreError, KeyError, TypeError, AttributeError, ValueError):
            document = store.read_json(path)
            is_whole = document["checksum"] == sealed(document)["checksum"]
            if is_whole and document["schema"] == SCHEMA:
                yield Exported(path.parent, document["record"], document["targets"])


def folder_of(study: Path, trial: int, point: int, hardware: str) -> Path | None:
    """Return the folder of the bundle of a design point that has targets; None if there is none.

    Args:
        study: folder of the study.
        trial: number of the trial.
        point: number of the point.
        hardware: of the point; '' if points have none.
    """
    asked = {"trial": trial, "point": point, "hardware": hardware}
    for each in exported(study):
        if each.targets and {name: each.record.get(name, "") for name in asked} == asked:
            return each.folder
    return None
