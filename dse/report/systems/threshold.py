"""F: threshold encoding as printed, which reads the label, and honest: the leak is their difference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dse.report.designs import Found
from dse.report.leaks import Chosen, chosen, mark_of_leak, rows_of_leak
from dse.report.marks import Mark
from dse.report.rows import Row, measured, published


def rows(parts: Sequence[Found]) -> list[Row]:
    """Return both accuracies, the leak, and the times of the first output spike."""
    paper = published()["F"]
    leaky, honest = _both(parts)
    found = rows_of_leak("F", paper["accuracy"], leaky, honest)
    low, high = paper["first_spike_ms"]
    for name, one in (("as printed (transductive)", leaky), ("honest", honest)):
        if one is not None:
            text = f"{low} to {high}" if one is leaky or leaky is None else None
            row = measured(one[0], "F", f"first_spike_ms, mean, {name}", text, one[1], "first_spike_ms")
            found += [row] if row.ours is not None else []
    return found


def marks(parts: Sequence[Found]) -> Iterator[Mark]:
    """Yield the published accuracy, of an encoding that reads the label."""
    low, high = published()["F"]["first_spike_ms"]
    yield from mark_of_leak(
        "F", published()["F"]["accuracy"], *_both(parts), f"first spikes {low} to {high} ms"
    )


def _both(parts: Sequence[Found]) -> tuple[Chosen | None, Chosen | None]:
    """Return the best design as printed, and the best honest one."""
    families = published()["F"]["families"]
    leaky = chosen(parts, families, transductive=True)
    return leaky, chosen(parts, families, transductive=False)
