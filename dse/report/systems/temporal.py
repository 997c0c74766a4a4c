"""B: accuracy and time to classification of classifiers on rate windows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dse.report.designs import Found, best
from dse.report.marks import Mark, mark
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


def marks(parts: Sequence[Found]) -> Iterator[Mark]:
    """Yield the published classifiers whose kind we have, on artificial and on natural textures."""
    paper = published()["B"]
    for part in parts:
        for family in paper["families"]:
            if best(part.of([family])) is None:
                continue
            for textures, ending in (("artificial", ""), ("natural", "_natural")):
                values = {column: paper[f"{column}{ending}"][family] for column in ("accuracy", "t_c_ms")}
                yield mark("B", part, f"{family} on {textures} textures", values)
