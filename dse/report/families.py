"""Spiking and other model families: what accuracy costs in each, and which side wins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dse.report.designs import Chosen, StudyTask, best_of
from dse.report.rows import FAMILIES, Row, measured
from dse.skyline.rivals import spiking

if TYPE_CHECKING:
    import pandas

WITHIN = 0.02
"""Largest loss of accuracy, against the best of the same side, for a cheaper design."""

_SPIKES = "spikes_per_inference_no_input"
_SHORT = {"n_weights": "W_t", _SPIKES: "own spikes", "energy_uj": "energy_uj"}
_COSTS = tuple(_SHORT)
# On moved windows, and on groups without training recordings.
_HONEST = ("accuracy_shifted", "accuracy_unseen")
# Own spikes are those of hidden and output neurons, per inference.
_BUDGETS = (("n_weights", 10_000), ("n_weights", 20_000), (_SPIKES, 400))


@dataclass(frozen=True)
class _Side:
    """The designs of the spiking families, or of the others; `best` is the most accurate one."""

    name: str
    is_spiking: bool
    designs: list[tuple[StudyTask, pandas.DataFrame]]

    def best(self, column: str = "", limit: float = float("inf")) -> Chosen | None:
        """Return the best design whose column is within a limit."""
        return best_of(
            [
                (part, rows[rows[column].astype(float) <= limit] if column else rows)
                for part, rows in self.designs
            ]
        )

    def most(self, column: str) -> Chosen | None:
        """Return the design with the largest value of a column; None where no design has one."""
        values = [
            (part, row)
            for part, rows in self.designs
            if column in rows
            for _, row in rows[rows[column].notna()].iterrows()
        ]
        return max(values, key=lambda x: float(x[1][column]), default=None)

    def least(self, column: str, accuracy: float) -> Chosen | None:
        """Return the cheapest design of at least some accuracy."""
        picked = []
        for part, rows in self.designs:
            if column in rows:
                among = rows[(rows["accuracy"] >= accuracy) & rows[column].notna()]
                picked += [(part, row) for _, row in among.iterrows()]
        return min(picked, key=lambda x: (float(x[1][column]), -float(x[1]["accuracy"])), default=None)


def compared(parts: Sequence[StudyTask]) -> tuple[list[Row], list[str]]:
    """Return what accuracy costs on each side for one task on the same recordings, and the winner.

    Only designs with the same split of the recordings are compared. If both sides exist, but under different
    splits, the result is one sentence about that.
    """
    by_split: dict[str, list[StudyTask]] = {}
    for part in parts:
        by_split.setdefault(part.split, []).append(part)
    rows: list[Row] = []
    notes: list[str] = []
    for alike in by_split.values():
        comparison = _against(alike)
        if comparison is not None:
            rows += comparison[0]
            notes.append(f"{alike[0].about}: {comparison[1]}")
    if not rows and _against(parts) is not None:
        text = "spiking and other designs use different splits and cannot be compared"
        notes.append(f"{parts[0].about}: {text}")
    return rows, notes


def _against(parts: Sequence[StudyTask]) -> tuple[list[Row], str] | None:
    """Return the rows of a comparison and the winner; None if a side has no design."""
    sides = [_side(parts, is_spiking=True), _side(parts, is_spiking=False)]
    tops = [top for side in sides if (top := side.best()) is not None]
    rows, verdicts = _best(sides, tops, "accuracy")
    if not verdicts:
        return None
    for column, limit in _BUDGETS:
        for side in sides:
            design = side.best(column, limit) if side.is_spiking or column == "n_weights" else None
            if design is not None:
                figure = f"best accuracy, {side.name}, {_SHORT[column]} <= {limit}"
                rows.append(measured(design[0], FAMILIES, figure, None, design[1]))
    profiles = {str(name) for part in parts if "hardware" in part.table for name in part.table["hardware"]}
    for column in _COSTS if len(profiles) < 2 else _COSTS[:-1]:  # energies of two chips do not compare
        costs = []
        for side, (_, most_accurate) in zip(sides, tops, strict=True):
            design = side.least(column, float(most_accurate["accuracy"]) - WITHIN)
            if design is not None and (side.is_spiking or column != _SPIKES):
                figure = f"least {_SHORT[column]}, {side.name}, within {WITHIN:g}"
                rows.append(measured(design[0], FAMILIES, figure, None, design[1], column))
                costs.append(float(design[1][column]))
        if len(costs) == len(sides):
            on = f" on {', '.join(profiles)}" if column == "energy_uj" else ""
            verdicts.append(_verdict(f"least {_SHORT[column]}{on}", costs, lower=True))
    rows += _of_each_family(parts)
    for column in _HONEST:
        more, winner = _best(sides, [top for side in sides if (top := side.most(column)) is not None], column)
        rows += more
        verdicts += winner
    return rows, "; ".join(verdicts)


def _best(sides: Sequence[_Side], tops: Sequence[Chosen], column: str) -> tuple[list[Row], list[str]]:
    """Return the rows of the best designs of both sides, and the winner; nothing if a side has none."""
    if len(tops) < len(sides):
        return [], []
    rows = [
        measured(part, FAMILIES, f"best {column}, {side.name}", None, row, column)
        for side, (part, row) in zip(sides, tops, strict=True)
    ]
    values, names = [float(row[column]) for _, row in tops], [f"{row['family']} " for _, row in tops]
    error = math.hypot(*(row.se or 0.0 for row in rows))
    return rows, [_verdict(column, values, names, error, lower=False)]


def _of_each_family(parts: Sequence[StudyTask]) -> list[Row]:
    """Return the best accuracy of each family that was also evaluated on moved windows or unseen groups."""
    rows = []
    known = [(part, part.table[~part.table["transductive"]]) for part in parts]
    for family in dict.fromkeys(name for _, table in known for name in table["family"]):
        best = best_of([(part, table[table["family"] == family]) for part, table in known])
        if best is not None:
            row = measured(best[0], FAMILIES, f"best accuracy, {family}", None, best[1])
            rows += [row] if row.shifted is not None or row.unseen is not None else []
    return rows


def _side(parts: Sequence[StudyTask], *, is_spiking: bool) -> _Side:
    """Return the honest designs of the families that spike, or of those that do not."""
    designs = []
    for part in parts:
        honest = part.table[~part.table["transductive"]]
        rows = honest[spiking(honest) == is_spiking]
        if not rows.empty:
            designs.append((part, rows))
    return _Side("spiking" if is_spiking else "not spiking", is_spiking, designs)


def _verdict(
    what: str,
    values: Sequence[float],
    names: Sequence[str] = ("", ""),
    error: float = 0.0,
    *,
    lower: bool,
) -> str:
    """Return the winner in words, such as `accuracy: not spiking wins (knn 0.91 against snn 0.89)`.

    A difference of no more than its standard error is a draw.
    """
    sides = [
        f"{name}{value:.0f}" if value >= 1000 else f"{name}{value:.4g}"
        for name, value in zip(names, values, strict=True)
    ]
    if abs(values[0] - values[1]) <= error:
        return f"{what}: a draw ({sides[0]} against {sides[1]})"
    spiking_wins = (values[0] < values[1]) == lower
    winner, loser = sides if spiking_wins else sides[::-1]
    return f"{what}: {'spiking' if spiking_wins else 'not spiking'} wins ({winner} against {loser})"
