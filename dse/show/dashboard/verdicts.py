"""Bundles of a study's designs whose targets were run: folders below `bundles` in the study's folder.

`dse pick RESULTS --export RESULTS/bundles/NAME --target TARGET --verify RECORDINGS` makes one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dse import store
from dse.store import StoreError

_FOLDER = "bundles"


def exported(study: Path) -> Iterator[tuple[Path, Mapping[str, Any], Mapping[str, Any]]]:
    """Yield folder, design point and verdicts by target of the bundles of a study that are not damaged."""
    from dse.deploy.bundle import SCHEMA, sealed

    for path in sorted((study / _FOLDER).glob("*/bundle.json")):
        with contextlib.suppress(StoreError, KeyError, TypeError, AttributeError, ValueError):
            document = store.read_json(path)
            is_whole = document["checksum"] == sealed(document)["checksum"]
            if is_whole and document["schema"] == SCHEMA:
                yield path.parent, document["record"], document["targets"]


def folder_of(study: Path, trial: int, point: int, hardware: str) -> Path | None:
    """Return the folder of the bundle of a design point that has targets; None if there is none.

    hardware: of the point; '' if points have none.
    """
    keys = {"trial": trial, "point": point, "hardware": hardware}
    for folder, record, targets in exported(study):
        if targets and {name: record.get(name, "") for name in keys} == keys:
            return folder
    return None
