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
from dse.deploy.verdict import in_words
from dse.store import StoreError

_FOLDER = "bundles"


@dataclass(frozen=True)
class Exported:
    """What a bundle says of itself: the design point, and the verdict on each target by name."""

    folder: Path
    record: Mapping[str, Any]
    targets: Mapping[str, Mapping[str, Any]]


def exported(study: Path, trial: int) -> Iterator[Exported]:
    """Yield the bundles of a trial, in the order of their names; damaged ones are left out."""
    from dse.deploy.bundle import SCHEMA, sealed

    for path in sorted((study / _FOLDER).glob("*/bundle.json")):
        with contextlib.suppress(StoreError, KeyError, TypeError, AttributeError, ValueError):
            document = store.read_json(path)
            is_whole = document["checksum"] == sealed(document)["checksum"]
            if is_whole and document["schema"] == SCHEMA and document["record"]["trial"] == trial:
                yield Exported(path.parent, document["record"], document["targets"])


def sentences(study: Path, trial: int) -> list[dict[str, Any]]:
    """Return the verdicts on a trial's bundles: `point`, and `text` that names target and verdict."""
    return [
        {"point": each.record.get("point"), "text": f"{name}: {_sentence(verdict)}"}
        for each in exported(study, trial)
        for name, verdict in sorted(each.targets.items())
    ]


def _sentence(verdict: Mapping[str, Any]) -> str:
    kind, n = verdict["kind"], verdict["n_recordings"]
    named = in_words(kind, verdict.get("run_by", ()))
    run = f" on {n} recordings" if n else ""
    differ = (
        f", {100 * verdict['decisions_differ']:.3g} % of decisions differ" if kind == "approximate" else ""
    )
    reason = f" ({verdict['reason']})" if verdict["reason"] else ""
    return f"{named}{run}{differ}{reason}"


def folder_of(study: Path, trial: int, point: int, hardware: str) -> Path | None:
    """Return the folder of the bundle of a design point that has targets; None if there is none.

    Args:
        study: folder of the study.
        trial: number of the trial.
        point: number of the point.
        hardware: of the point; '' if points have none.
    """
    for each in exported(study, trial):
        is_point = each.record.get("point") == point and each.record.get("hardware", "") == hardware
        if is_point and each.targets:
            return each.folder
    return None
