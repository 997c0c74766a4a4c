"""C: accuracy of HOTS by its number of layers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from dse.config.contracts import Family
from dse.report.designs import Found, best
from dse.report.marks import Mark, mark
from dse.report.rows import Row, measured, published

if TYPE_CHECKING:
    import pandas


def rows(parts: Sequence[Found]) -> list[Row]:
    """Return the accuracy of the best design of one, two and three layers."""
    paper = published()["C"]
    found = []
    for part, n, chosen in _by_layers(parts):
        text = f"{paper['accuracy'][n]:g}; natural {paper['accuracy_natural'][n]:g}"
        found.append(measured(part, "C", f"accuracy, {_layers(n)}", text, chosen))
    return found


def marks(parts: Sequence[Found]) -> Iterator[Mark]:
    """Yield the published accuracies of as many layers as ours, on artificial and on natural textures."""
    paper = published()["C"]
    for part, n, _ in _by_layers(parts):
        for textures, figure in (("artificial", "accuracy"), ("natural", "accuracy_natural")):
            yield mark("C", part, f"{_layers(n)} on {textures} textures", {"accuracy": paper[figure][n]})


def _layers_of(model: Family) -> int:
    return int(getattr(model, "layers", 0))


def _by_layers(parts: Sequence[Found]) -> Iterator[tuple[Found, int, pandas.Series[Any]]]:
    """Yield the best design of each printed number of layers."""
    paper = published()["C"]
    for part in parts:
        designs = part.of(paper["families"])
        layers = designs["trial"].map(lambda trial, part=part: _layers_of(part.model(int(trial))))
        for n in paper["accuracy"]:
            chosen = best(designs[layers == n])
            if chosen is not None:
                yield part, n, chosen


def _layers(n: int) -> str:
    return f"{n} layer{'s' if n > 1 else ''}"
