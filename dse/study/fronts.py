"""The fronts of a study: one for each task, family and hardware profile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dse.study.precision import as_trained

if TYPE_CHECKING:
    import pandas

GROUPS = ("task", "family", "hardware")
"""Columns whose values have a front each: costs compare on one chip alone, and every family has its front."""


def as_if_larger(points: pandas.DataFrame) -> pandas.DataFrame:
    """Return points with hardware that holds none of them replaced by a larger one of its kind.

    A search that finds nothing that fits goes on towards the best designs: at fewer bits, or pruned, they may
    fit. What no hardware can run stays left out.
    """
    from dse.skyline.admissible import fitting

    if not {"fits", "hardware"} <= set(points):
        return points
    held = points["hardware"].isin(points["hardware"][fitting(points)])
    return points.assign(fits=points["fits"].mask(~held & points["fits"].notna(), True))


def fronts(
    points: pandas.DataFrame, goals: Sequence[tuple[str, str]]
) -> Iterator[tuple[pandas.DataFrame, pandas.DataFrame]]:
    """Yield the points of every task, family and chip as they were trained, and the front of these.

    Hardware that holds no point counts as larger (`as_if_larger`). Other precisions are left out: if they
    changed which designs are trained again, the result would depend on interruptions.
    """
    from dse.skyline.front import skyline

    table = as_trained(as_if_larger(points))
    if table.empty:
        return
    by = [name for name in GROUPS if name in table.columns]
    for _, group in table.groupby(by, observed=True) if by else [((), table)]:
        yield group, skyline(group, goals).rows
