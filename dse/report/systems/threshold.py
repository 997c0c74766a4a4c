"""F: threshold encoding as printed, which reads the label, and honest: the leak is their difference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dse.registry import param
from dse.report.designs import StudyTask
from dse.report.leaks import Chosen, chosen, mark_of_leak, rows_of_leak
from dse.report.marks import Mark
from dse.report.papers import Paper, paper
from dse.report.rows import Row, measured


@dataclass(frozen=True)
class Encoding(Paper):
    """Threshold encoding: its accuracy, and the range of its first output spikes."""

    accuracy: float = param(doc="accuracy")
    first_spike_ms: tuple[int, int] = param(doc="first output spike, fastest and slowest texture", unit="ms")


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return both accuracies, the leak, and the times of the first output spike."""
    printed = paper("F", Encoding)
    leaky, honest = _both(parts)
    table = rows_of_leak("F", printed.accuracy, leaky, honest)
    low, high = printed.first_spike_ms
    for name, one in (("as printed (transductive)", leaky), ("honest", honest)):
        if one is not None:
            text = f"{low} to {high}" if one is leaky or leaky is None else None
            row = measured(one[0], "F", f"first_spike_ms, mean, {name}", text, one[1], "first_spike_ms")
            table += [row] if row.ours is not None else []
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the published accuracy, of an encoding that reads the label."""
    printed = paper("F", Encoding)
    low, high = printed.first_spike_ms
    yield from mark_of_leak("F", printed.accuracy, *_both(parts), f"first spikes {low} to {high} ms")


def _both(parts: Sequence[StudyTask]) -> tuple[Chosen | None, Chosen | None]:
    """Return the best design as printed, and the best honest one."""
    families = paper("F", Encoding).families
    leaky = chosen(parts, families, transductive=True)
    return leaky, chosen(parts, families, transductive=False)
