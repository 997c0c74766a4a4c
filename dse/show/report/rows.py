"""Rows of the report: each holds one number of ours, and the published one beside it where there is one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, SupportsFloat

from dse.measure.hardware.interval import column_names
from dse.measure.objectives.accuracy import wilson_se
from dse.show.report.designs import StudyTask, best, described, record
from dse.study import health

if TYPE_CHECKING:
    import pandas

HARDWARE = "hardware"
"""Value of `system` in rows that compare chips."""

# Column -> the same design on the test set, with settings that validation selects.
_TESTS = {"accuracy": "accuracy_test", "t_p_ms": "t_p_test_ms", "t_h_ms": "t_h_test_ms"}


@dataclass(frozen=True)
class Row:
    """One figure.

    system: letter of a published system, or HARDWARE. figure: name of the number, with its unit.
    published, ours: the numbers; None where one of them does not exist.
    se: standard error of ours; test: the same design on the test set; runs: number of runs behind ours.
    shifted, unseen: accuracy of the same design on moved windows, and on groups without training recordings;
        shifted_se, unseen_se: their standard errors. None where the study did not evaluate them.
    corrected, corrected_low, corrected_high: of an accuracy of ours, `accuracy_corrected` and its interval.
    reader, reader_se: of an accuracy, what a cheap reader of the same data set answers (`Known`).
    hardware: the chip of ours; low, high: the range of ours, from the chip's uncertain numbers.
    """

    system: str
    figure: str
    task: str = ""
    published: float | str | None = None
    ours: float | None = None
    se: float | None = None
    test: float | None = None
    runs: int | None = None
    family: str = ""
    trial: int | None = None
    design: str = ""
    split: str = ""
    study: str = ""
    hardware: str = ""
    low: float | None = None
    high: float | None = None
    shifted: float | None = None
    shifted_se: float | None = None
    unseen: float | None = None
    unseen_se: float | None = None
    reader: float | None = None
    reader_se: float | None = None
    corrected: float | None = None
    corrected_low: float | None = None
    corrected_high: float | None = None

    @property
    def columns(self) -> dict[str, object]:
        """The row as columns."""
        return dict(vars(self))


def measured(
    part: StudyTask,
    system: str,
    figure: str,
    printed: float | str | None,
    row: pandas.Series[Any] | None,
    column: str = "accuracy",
) -> Row:
    """Return the row of one number of a design; without a design, `ours` is None."""
    if row is None:
        return Row(system, figure, part.task, printed, split=part.split, study=part.name)
    of_design = Row(
        system,
        figure,
        part.task,
        printed,
        number(row.get(column)),
        test=number(row.get(_TESTS.get(column, ""))),
        runs=int(row["repeats"]),
        family=str(row["family"]),
        trial=int(row["trial"]),
        design=described(row),
        split=part.split,
        study=part.name,
    )
    if not column.startswith("accuracy"):
        return of_design
    corrected, low, high = (number(row.get(x)) for x in column_names(f"{column}_corrected"))
    known = known_of(part, row)
    return replace(
        of_design,
        se=standard_error(part, row) if column == "accuracy" else number(row.get(f"{column}_se")),
        corrected=corrected,
        corrected_low=low,
        corrected_high=high,
        reader=None if known is None else known.accuracy,
        reader_se=None if known is None else known.se,
        shifted=number(row.get("accuracy_shifted")),
        shifted_se=number(row.get("accuracy_shifted_se")),
        unseen=number(row.get("accuracy_unseen")),
        unseen_se=number(row.get("accuracy_unseen_se")),
    )


def standard_error(part: StudyTask, row: pandas.Series[Any]) -> float | None:
    """Return the standard error of a design's accuracy; if all runs agree, that of the sample size."""
    error = number(row.get("accuracy_se"))
    if error == 0 and part.n_validation:
        error = float(wilson_se(round(row["accuracy"] * part.n_validation), part.n_validation))
    return error


def number(value: SupportsFloat | None) -> float | None:
    """Return a finite number, or None."""
    if value is None:
        return None
    try:
        plain = float(value)
    except (TypeError, ValueError):
        return None
    return plain if math.isfinite(plain) else None


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


def of_readers(parts: Sequence[StudyTask]) -> list[str]:
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
