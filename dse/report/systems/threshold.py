"""F: threshold encoding as printed, which reads the label, and honest: the leak is their difference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dse.report.designs import StudyTask
from dse.report.leaks import Chosen, chosen, mark_of_leak, rows_of_leak
from dse.report.marks import Mark
from dse.report.papers import publication, systems
from dse.report.rows import Row, measured

_PAPER = "003"


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return both accuracies, the leak, and the times of the first output spike."""
    leaky, honest = _both(parts)
    table = rows_of_leak("F", publication(_PAPER).number("accuracy"), leaky, honest)
    low, high = _first_spikes_ms()
    for name, one in (("as printed (transductive)", leaky), ("honest", honest)):
        if one is not None:
            text = f"{low:g} to {high:g}" if one is leaky or leaky is None else None
            row = measured(one[0], "F", f"first_spike_ms, mean, {name}", text, one[1], "first_spike_ms")
            ends = [
                measured(one[0], "F", f"{column}, {name}", end, one[1], column)
                for column, end in (("first_spike_class_min_ms", low), ("first_spike_class_max_ms", high))
            ]
            table += [x for x in (row, *ends) if x.ours is not None]
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the published accuracy, of an encoding that reads the label."""
    low, high = _first_spikes_ms()
    text = f"first spikes {low:g} to {high:g} ms"
    yield from mark_of_leak("F", publication(_PAPER).number("accuracy"), *_both(parts), text)


def _first_spikes_ms() -> list[float]:
    """Return the printed times of the first output spike, fastest and slowest texture."""
    return sorted(publication(_PAPER).table("first_spike_ms").values())


def _both(parts: Sequence[StudyTask]) -> tuple[Chosen | None, Chosen | None]:
    """Return the best design as printed, and the best honest one."""
    families = systems()["F"].families
    leaky = chosen(parts, families, transductive=True)
    return leaky, chosen(parts, families, transductive=False)
