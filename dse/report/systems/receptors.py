"""G: receptors and a time-delayed ELM: accuracy, information, the leak.

As printed, windows of one run that overlap are in training and in test.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dse.report.designs import StudyTask
from dse.report.leaks import Chosen, chosen, mark_of_leak, rows_of_leak
from dse.report.marks import Mark
from dse.report.papers import publication, systems
from dse.report.rows import Row, measured

_PAPER = "004"


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return both accuracies, the leak, information transfer, size and time to recognition."""
    printed = publication(_PAPER)
    leaky, honest = _both(parts)
    table = rows_of_leak("G", printed.number("accuracy"), leaky, honest)
    if honest is None:
        return table
    part, row = honest
    for column in ("itr_bits", "itr_bits_per_s", "t_c_ms"):
        table.append(measured(part, "G", f"{column}, honest", None, row, column))
    base = replace(measured(part, "G", "", None, row), se=None, test=None)
    runs = part.arrays(int(row["trial"]), "read_out")
    accuracy = np.mean([run["accuracy"] for run in runs], axis=0)
    earliest = float(runs[0]["decision_latency_ms"][accuracy.argmax()])
    hidden = float(np.sum(getattr(part.model(int(row["trial"])), "hidden", 0)))
    return [
        *table,
        replace(
            base,
            figure="time of the highest accuracy, ms",
            published=printed.number("recognition_ms"),
            ours=earliest,
        ),
        replace(base, figure="hidden nodes", published=printed.number("hidden"), ours=hidden),
    ]


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the published accuracy; its split put windows of one run on both sides."""
    yield from mark_of_leak("G", publication(_PAPER).number("accuracy"), *_both(parts))


def _both(parts: Sequence[StudyTask]) -> tuple[Chosen | None, Chosen | None]:
    """Return the best design as printed, and the best honest one."""
    families = systems()["G"].families
    leaky = chosen(parts, families, transductive=True, encoders=False)
    return leaky, chosen(parts, families, transductive=False)
