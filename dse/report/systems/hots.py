"""C: accuracy of HOTS by its number of layers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from dse.config.contracts import Family
from dse.report.designs import StudyTask, best
from dse.report.marks import Mark, mark
from dse.report.papers import publication, systems
from dse.report.rows import Row, measured

if TYPE_CHECKING:
    import pandas

_PAPER = "001"
_TEXTURES = ("artificial", "natural")


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return the accuracy of the best design of one, two and three layers."""
    table = []
    for part, n, chosen in _by_layers(parts):
        artificial, natural = (_accuracy(textures, n) for textures in _TEXTURES)
        text = f"{artificial:g}; natural {natural:g}"
        table.append(measured(part, "C", f"accuracy, {_layers(n)}", text, chosen))
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the published accuracies of as many layers as ours, on artificial and on natural textures."""
    for part, n, _ in _by_layers(parts):
        for textures in _TEXTURES:
            values = {"accuracy": _accuracy(textures, n)}
            yield mark("C", part, f"{_layers(n)} on {textures} textures", values)


def _accuracy(textures: str, n: int) -> float:
    """Return the printed accuracy of n layers."""
    return publication(_PAPER).number("hots_accuracy", textures, str(n))


def _layers_of(model: Family) -> int:
    return int(getattr(model, "layers", 0))


def _by_layers(parts: Sequence[StudyTask]) -> Iterator[tuple[StudyTask, int, pandas.Series[Any]]]:
    """Yield the best design of each printed number of layers."""
    printed = publication(_PAPER).table("hots_accuracy", _TEXTURES[0])
    for part in parts:
        designs = part.of(systems()["C"].families)
        layers = designs["trial"].map(lambda trial, part=part: _layers_of(part.model(int(trial))))
        for n in map(int, printed):
            chosen = best(designs[layers == n])
            if chosen is not None:
                yield part, n, chosen


def _layers(n: int) -> str:
    return f"{n} layer{'s' if n > 1 else ''}"
