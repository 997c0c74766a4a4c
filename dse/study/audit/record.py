"""The last audit of a search space, in the cache of prepared data; and as a file of its studies."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dse.config import SearchSpace
from dse.data.dataset import cache, dataset_key
from dse.store import damaged, read_json, write_json
from dse.study.audit.audit import Audit
from dse.study.audit.gather import designs, sections_of
from dse.study.audit.rows import AuditRow

FILE, DOCUMENT = "audit.json", "audit"
"""A file of the cache, and a document of a study."""
_VERSION = 2


def key(space: SearchSpace) -> str:
    """Return the name of an audit's entry: a hash of the data sets that it has read.

    Raises:
        RecordingError: a file is not found.
    """
    keys = [dataset_key(sections_of(space, design), space.source.parent) for design in designs(space)]
    return hashlib.sha256(json.dumps(["audit", _VERSION, keys]).encode()).hexdigest()


def save(audit: Audit, space: SearchSpace, root: Path) -> None:
    """Store an audit in a cache, in place of the one before.

    Raises:
        OSError: the cache cannot be written.
    """
    name = key(space)
    cache.discard(root, name)
    cache.made(root, name, lambda folder: write_json(folder / FILE, plain(audit)))


def last(space: SearchSpace, root: Path) -> Audit | None:
    """Return the last audit of a search space; None where there is none.

    Raises:
        RecordingError: a file of the recordings is not found.
        StoreError: the audit is damaged.
        OSError: the cache cannot be written.
    """
    if (folder := cache.find(root, key(space))) is None:
        return None
    try:
        return of_plain(read_json(folder / FILE))
    except (KeyError, TypeError) as error:
        raise damaged(folder / FILE, f"is no audit: {error}") from error


def plain(audit: Audit) -> dict[str, Any]:
    """Return an audit as JSON holds it; `of_plain` is the way back."""
    return {"rows": [row.columns for row in audit.rows], "notes": audit.notes}


def of_plain(document: Mapping[str, Any]) -> Audit:
    """Return the audit of `plain`.

    Raises:
        KeyError, TypeError: it is none.
    """
    known = {field.name for field in dataclasses.fields(AuditRow)}
    rows = [{name: row[name] for name in row if name in known} for row in document["rows"]]
    return Audit(tuple(AuditRow(**row) for row in rows), tuple(document["notes"]))
