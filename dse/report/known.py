"""What a cheap reader of spike counts knows of the recordings of a study, beside its networks.

The audit of a study has the figure: validation chooses the reader, the test set tells what it knows. A
network far below it has not learnt what its data hold, whatever else differs from a paper.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dse.measure.objectives.accuracy import wilson_se
from dse.report.designs import StudyTask, best, record
from dse.study import health

if TYPE_CHECKING:
    import pandas

_PLAIN = "a plain reader of the same data"
_BEYOND = 2.0
"""Standard errors of a difference that is no accident."""


@dataclass(frozen=True)
class Known:
    """The accuracy of a cheap reader, its standard error, and whether it is of the test set."""

    reader: str
    accuracy: float
    se: float
    on_test: bool

    def __str__(self) -> str:
        part = "test" if self.on_test else "validation"
        return f"{_PLAIN} ({self.reader}) {self.accuracy:.3f} ± {self.se:.2g} on {part}"


def known_of(part: StudyTask, row: pandas.Series[Any]) -> Known | None:
    """Return what a cheap reader knows of the data set that a design was trained on; None: not recorded.

    Designs with other windows, encoders or preprocessing than the audited one have data sets of their own.
    """
    known = part.known
    if known is None or not known.data:
        return None
    if record(part.study.folder, int(row["trial"])).get("data") != known.data:
        return None
    if known.test is not None and known.test_se is not None:
        return Known(known.reader, known.test, known.test_se, True)
    if known.accuracy is None or known.se is None:
        return None
    return Known(known.reader, known.accuracy, known.se, False)


def shown_causes(
    part: StudyTask, row: pandas.Series[Any], accuracy: float | None = None, printed: float | None = None
) -> list[str]:
    """Return why a design knows less than it might, as far as measurements of the study show it.

    Args:
        part: its task.
        row: the design.
        accuracy: of the design, on the test set where there is one; None: whatever it is, it is no accuracy.
        printed: the accuracy that a paper prints; None: none is.
    """
    causes = [f"its states leave 24 bits: {text}" for text in [health.overflow(row)] if text]
    known = known_of(part, row)
    if known is None or accuracy is None or (printed is not None and accuracy >= printed):
        return causes
    samples = record(part.study.folder, int(row["trial"])).get("samples", {})
    n = int(samples.get("test" if known.on_test else "validation", 0))
    error = math.hypot(known.se, float(wilson_se(round(accuracy * n), n)) if n else 0.0)
    if known.accuracy - accuracy > _BEYOND * error:
        causes.append(f"{known}: the design has not learnt what its data hold")
    elif printed is not None and printed - known.accuracy > _BEYOND * known.se:
        causes.append(f"{known}: no cheap reader finds more in these recordings")
    return causes


def notes(parts: Sequence[StudyTask]) -> list[str]:
    """Return a sentence per task whose best design is far below a cheap reader, or that has no reader."""
    sentences = []
    for part in parts:
        row = best(part.of(dict.fromkeys(part.table["family"])))
        if row is None or part.joint:
            continue
        if part.known is None or not part.known.data:
            sentences.append(
                f"{part.name}: what a plain reader knows of its recordings is not recorded: `dse audit` of "
                "its search space records it, and `dse run` of the same keeps it with the study"
            )
        elif (known := known_of(part, row)) is not None:
            accuracy = float(row["accuracy_test" if known.on_test and "accuracy_test" in row else "accuracy"])
            about = f"{part.name}, {part.task}: trial {int(row['trial'])} ({row['family']}) {accuracy:.3f}"
            texts = shown_causes(part, row, accuracy)
            sentences += [f"{about}; {text}" for text in texts if text.startswith(_PLAIN)]
    return list(dict.fromkeys(sentences))
