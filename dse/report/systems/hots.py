"""C: accuracy of HOTS by its number of layers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dse.config.contracts import Family
from dse.registry import param
from dse.report.designs import StudyTask, best
from dse.report.marks import Mark, mark
from dse.report.papers import Paper, paper
from dse.report.rows import Row, measured

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Layers(Paper):
    """HOTS; accuracies by number of layers."""

    accuracy: Mapping[str, float] = param(doc="accuracy")
    accuracy_natural: Mapping[str, float] = param(doc="accuracy, natural textures")


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return the accuracy of the best design of one, two and three layers."""
    printed, table = paper("C", Layers), []
    for part, n, chosen in _by_layers(parts):
        text = f"{printed.accuracy[str(n)]:g}; natural {printed.accuracy_natural[str(n)]:g}"
        table.append(measured(part, "C", f"accuracy, {_layers(n)}", text, chosen))
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the published accuracies of as many layers as ours, on artificial and on natural textures."""
    printed = paper("C", Layers)
    for part, n, _ in _by_layers(parts):
        for textures, accuracy in (
            ("artificial", printed.accuracy),
            ("natural", printed.accuracy_natural),
        ):
            yield mark("C", part, f"{_layers(n)} on {textures} textures", {"accuracy": accuracy[str(n)]})


def _layers_of(model: Family) -> int:
    return int(getattr(model, "layers", 0))


def _by_layers(parts: Sequence[StudyTask]) -> Iterator[tuple[StudyTask, int, pandas.Series[Any]]]:
    """Yield the best design of each printed number of layers."""
    printed = paper("C", Layers)
    for part in parts:
        designs = part.of(printed.families)
        layers = designs["trial"].map(lambda trial, part=part: _layers_of(part.model(int(trial))))
        for n in map(int, printed.accuracy):
            chosen = best(designs[layers == n])
            if chosen is not None:
                yield part, n, chosen


def _layers(n: int) -> str:
    return f"{n} layer{'s' if n > 1 else ''}"
