"""F: threshold encoding as printed, which reads the label, and honest: the leak is their difference."""

from __future__ import annotations

from collections.abc import Sequence

from dse.report.designs import Found
from dse.report.leaks import chosen, rows_of_leak
from dse.report.rows import Row, measured, published


def rows(parts: Sequence[Found]) -> list[Row]:
    """Return both accuracies, the leak, and the times of the first output spike."""
    paper = published()["F"]
    leaky = chosen(parts, paper["families"], transductive=True)
    honest = chosen(parts, paper["families"], transductive=False)
    found = rows_of_leak("F", paper["accuracy"], leaky, honest)
    low, high = paper["first_spike_ms"]
    for name, one in (("as printed (transductive)", leaky), ("honest", honest)):
        if one is not None:
            text = f"{low} to {high}" if one is leaky or leaky is None else None
            row = measured(one[0], "F", f"first_spike_ms, mean, {name}", text, one[1], "first_spike_ms")
            found += [row] if row.ours is not None else []
    return found
