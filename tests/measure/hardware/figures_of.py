"""The figures of a cost by name, each interval as three."""

import dataclasses

from dse.measure.hardware.interval import Interval


def figures_of(cost):
    """Return every field of a cost under its name; of an interval also both ends, with _low and _high."""
    figures = {}
    for field in dataclasses.fields(cost):
        value = getattr(cost, field.name)
        figures |= value.columns(field.name) if isinstance(value, Interval) else {field.name: value}
    return figures
