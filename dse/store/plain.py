"""Records and numbers as JSON holds them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from dse.base.records import Head


def plain(value: Any) -> Any:
    """Return numpy's numbers and arrays, mappings and sequences as Python's own, which JSON can hold.

    NaN and infinities stay.

    Raises:
        TypeError: JSON has no such value.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(element) for key, element in value.items()}
    if isinstance(value, list | tuple):
        return [plain(element) for element in value]
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def plain_cell(value: Any) -> Any:
    """Return a table's cell as JSON holds it: None where it is missing or not finite."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain_cell(element) for key, element in value.items()}
    if isinstance(value, list | tuple):
        return [plain_cell(element) for element in value]
    if isinstance(value, np.generic | np.ndarray):
        return plain_cell(value.tolist())
    text = str(value)
    return None if text in ("<NA>", "NaT") else text


def heads_document(heads: Sequence[Head]) -> list[dict[str, Any]]:
    """Return the parts of a joint target as JSON holds them; `heads_of` reads them back."""
    return [
        {"name": head.name, "classes": list(head.classes), "of_class": head.of_class.tolist()}
        for head in heads
    ]


def heads_of(document: Iterable[Mapping[str, Any]]) -> tuple[Head, ...]:
    """Return the heads of `heads_document`."""
    return tuple(
        Head(head["name"], tuple(head["classes"]), np.array(head["of_class"], dtype=np.int64))
        for head in document
    )
