"""C: accuracy of HOTS by its number of layers."""

from __future__ import annotations

from collections.abc import Sequence

from dse.report.designs import Found, best
from dse.report.rows import Row, measured, published


def rows(parts: Sequence[Found]) -> list[Row]:
    """Return the accuracy of the best design of one, two and three layers."""
    paper = published()["C"]
    found = []
    for part in parts:
        designs = part.of(paper["families"])
        layers = designs["trial"].map(lambda trial, part=part: int(part.model(int(trial))["layers"]))
        for n, printed in paper["accuracy"].items():
            chosen = best(designs[layers == n])
            if chosen is not None:
                text = f"{printed:g}; natural {paper['accuracy_natural'][n]:g}"
                figure = f"accuracy, {n} layer{'s' if n > 1 else ''}"
                found.append(measured(part, "C", figure, text, chosen))
    return found
