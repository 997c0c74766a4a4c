"""G: receptors and a time-delayed ELM: accuracy, information, the leak.

As printed, windows of one run that overlap are in training and in test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dse.report.designs import Found
from dse.report.leaks import chosen, rows_of_leak
from dse.report.rows import Row, measured, published


def rows(parts: Sequence[Found]) -> list[Row]:
    """Return both accuracies, the leak, information transfer, size and time to recognition."""
    paper = published()["G"]
    leaky = chosen(parts, paper["families"], transductive=True, encoders=False)
    honest = chosen(parts, paper["families"], transductive=False)
    found = rows_of_leak("G", paper["accuracy"], leaky, honest)
    if honest is None:
        return found
    part, row = honest
    for column in ("itr_bits", "itr_bits_per_s", "t_c_ms"):
        found.append(measured(part, "G", f"{column}, honest", None, row, column))
    base = replace(measured(part, "G", "", None, row), se=None, test=None)
    runs = part.arrays(int(row["trial"]), "read_out")
    accuracy = np.mean([run["accuracy"] for run in runs], axis=0)
    earliest = float(runs[0]["decision_latency_ms"][accuracy.argmax()])
    hidden = float(np.sum(part.model(int(row["trial"]))["hidden"]))
    return [
        *found,
        replace(
            base, figure="time of the highest accuracy, ms", published=paper["recognition_ms"], ours=earliest
        ),
        replace(base, figure="hidden nodes", published=paper["hidden"], ours=hidden),
    ]
