"""The figures of a cost by name, each interval as three."""

from __future__ import annotations

import dataclasses
from typing import Any

from dse.hardware.cost import Cost
from dse.hardware.interval import Interval


def figures_of(cost: Cost) -> dict[str, Any]:
    """Return every field of a cost under its name; of an interval also both ends, with _low and _high."""
    figures: dict[str, Any] = {}
    for field in dataclasses.fields(cost):
        value = getattr(cost, field.name)
        figures |= value.columns(field.name) if isinstance(value, Interval) else {field.name: value}
    return figures
