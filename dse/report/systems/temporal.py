"""B: accuracy and time to classification of classifiers on rate windows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from dse.registry import param
from dse.report.designs import StudyTask, best
from dse.report.marks import Mark, mark
from dse.report.papers import Paper, paper
from dse.report.rows import Row, measured


@dataclass(frozen=True)
class Windows(Paper):
    """Classifiers on rate windows; figures by family, of artificial and of natural textures."""

    accuracy: Mapping[str, float] = param(doc="accuracy")
    t_c_ms: Mapping[str, int] = param(doc="time to classification", unit="ms")
    accuracy_natural: Mapping[str, float] = param(doc="accuracy, natural textures")
    t_c_ms_natural: Mapping[str, int] = param(doc="time to classification, natural textures", unit="ms")
    human: float = param(doc="accuracy of people")

    @property
    def columns(self) -> Mapping[str, tuple[Mapping[str, float], Mapping[str, float]]]:
        """Figures of artificial and of natural textures, by our column."""
        return {
            "accuracy": (self.accuracy, self.accuracy_natural),
            "t_c_ms": (self.t_c_ms, self.t_c_ms_natural),
        }


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return accuracy and t_C of the best design of each classifier."""
    windows, table = paper("B", Windows), []
    for part in parts:
        for family in windows.families:
            chosen = best(part.of([family]))
            if chosen is None:
                continue
            for column, (artificial, natural) in windows.columns.items():
                text = f"{artificial[family]}; natural {natural[family]}"
                table.append(measured(part, "B", f"{column}, {family}", text, chosen, column))
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the published classifiers whose kind we have, on artificial and on natural textures."""
    windows = paper("B", Windows)
    for part in parts:
        for family in windows.families:
            if best(part.of([family])) is None:
                continue
            for place, textures in enumerate(("artificial", "natural")):
                values = {column: figures[place][family] for column, figures in windows.columns.items()}
                yield mark("B", part, f"{family} on {textures} textures", values)
