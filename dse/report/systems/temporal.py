"""B: accuracy and time to classification of classifiers on rate windows."""

from __future__ import annotations

from collections.abc import Sequence

from dse.report.designs import Found, best
from dse.report.rows import Row, measured, published


def rows(parts: Sequence[Found]) -> list[Row]:
    """Return accuracy and t_C of the best design of each classifier."""
    paper = published()["B"]
    found = []
    for part in parts:
        for family in paper["families"]:
            chosen = best(part.of([family]))
            if chosen is None:
                continue
            for column in ("accuracy", "t_c_ms"):
                text = f"{paper[column][family]}; natural {paper[f'{column}_natural'][family]}"
                found.append(measured(part, "B", f"{column}, {family}", text, chosen, column))
    return found
