"""Rows of a system whose published evaluation leaks labels: as printed, without the leak, the difference."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dse.report.designs import StudyTask, best_of, sections_of
from dse.report.marks import Mark, mark
from dse.report.rows import Row, measured

if TYPE_CHECKING:
    import pandas

Chosen = tuple[StudyTask, "pandas.Series[Any]"]


def chosen(
    parts: Sequence[StudyTask], families: Sequence[str], *, transductive: bool, encoders: bool = True
) -> Chosen | None:
    """Return the best design of some families in several studies, with its study.

    Args:
        parts: studies of one task.
        families: kinds of models.
        transductive: whether the designs have seen the labels.
        encoders: whether to include designs whose encoder reads labels: another leak than that of a split.
    """
    several = [(part, part.of(families, transductive=transductive)) for part in parts]
    if not encoders:
        several = [
            (
                part,
                rows.loc[[index for index, trial in rows["trial"].items() if not _by_encoder(part, trial)]],
            )
            for part, rows in several
        ]
    return best_of(several)


def _by_encoder(part: StudyTask, trial: int) -> bool:
    """Return whether the encoder of a design reads labels."""
    return bool(sections_of(part.study.folder, int(trial)).reads_labels)


def rows_of_leak(system: str, printed: float, leaky: Chosen | None, honest: Chosen | None) -> list[Row]:
    """Return accuracy as printed, honest accuracy, and their difference where both are known."""
    if leaky is None and honest is None:
        return []
    base, row = leaky or (honest[0], None)  # type: ignore[index]
    rows = [measured(base, system, "accuracy, as printed (transductive)", printed, row)]
    if honest is None:
        return rows
    rows.append(measured(honest[0], system, "accuracy, honest", None, honest[1]))
    if leaky is not None:
        ours, errors = [x.ours for x in rows], [x.se for x in rows]
        assert ours[0] is not None and ours[1] is not None  # `best` returns finite accuracies
        se = math.hypot(*errors) if None not in errors else None  # type: ignore[arg-type]
        leak = replace(
            rows[1],
            figure="size of the leak (as printed less honest)",
            ours=ours[0] - ours[1],
            se=se,
            test=None,
            runs=None,
            trial=None,
            design="",
        )
        rows.append(leak)
    return rows


def mark_of_leak(
    system: str, printed: float, leaky: Chosen | None, honest: Chosen | None, more: str = ""
) -> Iterator[Mark]:
    """Yield the printed accuracy if our studies hold a design of that system, honest or not."""
    beside = leaky or honest
    if beside is not None:
        note = "; ".join(filter(None, ["transductive: it has seen the labels", more]))
        yield mark(system, beside[0], "", {"accuracy": printed}, note)
