"""B: accuracy and time to classification of classifiers on rate windows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dse.report.designs import StudyTask, best
from dse.report.marks import Mark, mark
from dse.report.papers import publication, systems
from dse.report.rows import Row, measured

_PAPER = "001"
_TEXTURES = ("artificial", "natural")
_COLUMNS = ("accuracy", "t_c_ms")


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return accuracy and t_C of the best design of each classifier."""
    printed, table = publication(_PAPER), []
    for part in parts:
        for family in systems()["B"].families:
            chosen = best(part.of([family]))
            if chosen is None:
                continue
            for column in _COLUMNS:
                artificial, natural = (printed.number(column, textures, family) for textures in _TEXTURES)
                text = f"{artificial:g}; natural {natural:g}"
                table.append(measured(part, "B", f"{column}, {family}", text, chosen, column))
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the published classifiers whose kind we have, on artificial and on natural textures."""
    printed = publication(_PAPER)
    for part in parts:
        for family in systems()["B"].families:
            if best(part.of([family])) is None:
                continue
            for textures in _TEXTURES:
                values = {column: printed.number(column, textures, family) for column in _COLUMNS}
                yield mark("B", part, f"{family} on {textures} textures", values)
