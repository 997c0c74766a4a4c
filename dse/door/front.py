"""The front of studies or tables, with all that can be asked for: chips, duty, uncertain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dse.skyline import front
from dse.skyline.constraints import ExpressionError
from dse.skyline.front import Skyline
from dse.skyline.goals import Goal
from dse.store import StoreError
from dse.study import held, pricing, resampling
from dse.study.repeats import over_repeats

if TYPE_CHECKING:
    import pandas

DRAWS = 200
"""Default number of samples of recordings, seeds and uncertain numbers."""


def front_of(
    results: Sequence[str | Path],
    objectives: Sequence[Goal],
    where: str | Sequence[str] | None = None,
    by: Sequence[str] = (),
    *,
    hardware: Sequence[str] = (),
    contacts_per_hour: float | None = None,
    battery_mwh: float | None = None,
    draws: int | None = None,
    confidence: float | None = None,
    repeats: str = "mean",
) -> tuple[Skyline, list[str]]:
    """Return the non-dominated points, and the columns on duty and certainty that were added to them.

    Args:
        results: folders of studies, or CSV, Parquet or JSON tables, which are concatenated.
        objectives: columns and directions.
        where: condition, or several.
        by: columns whose values have separate fronts.
        hardware: profiles, by name or file, to compute costs on; empty: those of each study.
        contacts_per_hour: inferences per hour, for columns power_mw and battery_h.
        battery_mwh: capacity of the battery.
        draws: number of samples; column front_share varies the chip's uncertain numbers, front_probability
            also recordings and seeds. None: 200 for the latter alone.
        confidence: keep points whose front_probability is at least this.
        repeats: of a design with several runs, 'mean' of all, or the 'last' or 'worst' run alone.

    Raises:
        ExpressionError: an unknown column or direction, a condition that cannot be read, or a confidence
            where nothing has a probability.
        TableError: a table cannot be read.
    """
    import pandas

    frames = pricing.tables(results, list(hardware))
    frames = _repeated(results, frames, repeats, sampled=bool(draws) or confidence is not None)
    frame = pandas.concat(frames, ignore_index=True)
    frame = pricing.on_duty(frame, contacts_per_hour, battery_mwh)
    skyline = front.skyline(frame, objectives, where, by)
    rows, beside = skyline.rows, ["power_mw", "battery_h"]
    notes = [*skyline.notes, *(text for path in results for text in held.remarks(Path(path)))]
    if draws:
        names = [name for name, _ in objectives]
        drawing = pricing.draws(results, frames, list(hardware), names, draws)
        candidates = front.comparable(frame, objectives, where, by).rows
        share = front.front_share(candidates, objectives, drawing, by)
        rows = rows.assign(front_share=pandas.Series(share, candidates.index)[rows.index])
        beside.append("front_share")
    is_accurate = any(name in resampling.ACCURACIES for name, _ in objectives)
    if repeats == "mean" and is_accurate and all(Path(path).is_dir() for path in results):
        try:
            drawing = resampling.draws(results, frames, list(hardware), objectives, draws or DRAWS)
            candidates = front.comparable(frame, objectives, where, by).rows
            share = front.front_share(candidates, objectives, drawing, by)
        except StoreError as error:
            notes.append(f"no front_probability: {error}")
        else:
            rows = rows.assign(front_probability=pandas.Series(share, candidates.index)[rows.index])
            beside.append("front_probability")
    if confidence is not None:
        if "front_probability" not in rows:
            raise ExpressionError("confidence needs studies with an accuracy among the objectives")
        n_all = len(rows)
        rows = rows.loc[rows["front_probability"] >= confidence]
        notes.append(f"{n_all - len(rows)} of {n_all} points of the front are on it with less confidence")
    return Skyline(rows, notes), beside


def _repeated(
    results: Sequence[str | Path], frames: list[pandas.DataFrame], repeats: str, *, sampled: bool
) -> list[pandas.DataFrame]:
    """Return the points with the numbers of the chosen runs.

    Raises:
        ExpressionError: samples are asked for too; they are over all runs.
        StoreError: a table is no study.
    """
    if repeats == "mean":
        return frames
    if sampled:
        raise ExpressionError(f"repeats {repeats} is one run of each design: samples are over all runs")
    pricing.check_studies(results, "repeats needs")
    return [over_repeats(Path(path), frame, repeats) for path, frame in zip(results, frames, strict=True)]
