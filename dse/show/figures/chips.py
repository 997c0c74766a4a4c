"""All chips side by side: what the pick costs there, and the cheapest design at the accuracy of all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.base.registry import fixed, register
from dse.show.figures import Results, gain_of, of_task, task_key
from dse.show.figures.front import interval, numbers
from dse.show.figures.labels import (
    OKABE_ITO_LIGHT,
    Drawing,
    axis_title,
    interval_bars,
    label,
    rows_layout,
    safe,
)
from dse.skyline.admissible import fitting, honest
from dse.skyline.pick import pick

_ROW_PX, _MARGIN_PX = 52, 120


@dataclass(frozen=True)
class Chips:
    """The picks of one task on each chip, (chip,) each.

    gain, cost: columns. level: the largest gain that all chips reach.
    hardware: names. pick_gain: of the pick there.
    pick: (chip, 3) its cost, and the distance to the ends of its interval.
    least: (chip, 3) the same of the cheapest design with `level`.
    without: chips that cannot run or hold any design, or whose costs are not known.
    """

    gain: str
    cost: str
    task: str
    level: float
    hardware: tuple[str, ...]
    pick_gain: Array
    pick: Array
    least: Array
    without: tuple[str, ...]


@register("figures", "chips")
@dataclass(frozen=True)
class ChipsFigure:
    """What the pick costs on each chip, and what the cheapest design does at the accuracy that all reach."""

    cost: str = fixed("", doc="column of a cost (default: energy, else the first that is minimised)")
    task: str = task_key()

    def gather(self, results: Results) -> Chips:
        points, cost = of_task(results.points(), self.task), self.cost
        if "hardware" not in points:
            raise ValueError("points must be on hardware, got a study without it")
        gain, ties = gain_of(results, points)
        less = [goal.column for goal in ties if goal.direction == "min"]
        cost = cost or ("energy_uj" if "energy_uj" in less else next(iter(less), ""))
        if gain is None or not cost:
            raise ValueError("objectives must maximise a column and minimise another")
        if cost not in points:
            raise ValueError(f"cost must be a column of the points, got '{cost}'")
        frame, held = points[honest(points)], fitting(points)[honest(points)]
        tables, without = {}, []
        for chip, rows in frame.groupby("hardware", sort=False):
            known = np.isfinite(numbers(rows, cost)) & np.isfinite(numbers(rows, gain))
            priced = rows[known & held[frame["hardware"] == chip]]
            if len(priced):
                tables[str(chip)] = priced
            else:
                without.append(str(chip))
        if not tables:
            raise ValueError(f"{cost} must be known on some hardware, got none on {', '.join(without)}")
        picks = {chip: pick(rows, [], gain, ties).row for chip, rows in tables.items()}
        level = min(float(row[gain]) for row in picks.values() if row is not None)
        gains, picked, cheapest = [], [], []
        for chip, rows in tables.items():
            costs = np.column_stack([numbers(rows, cost), *interval(rows, cost)])
            chosen = int(np.flatnonzero(rows.index == picks[chip].name)[0])  # type: ignore[union-attr]
            able = np.flatnonzero(numbers(rows, gain) >= level)
            gains.append(numbers(rows, gain)[chosen])
            picked.append(costs[chosen])
            cheapest.append(costs[able[np.argmin(costs[able, 0])]])
        task = str(frame["task"].iloc[0]) if "task" in frame else ""
        at_picks = np.array(gains), np.array(picked), np.array(cheapest)
        return Chips(gain, cost, task, level, tuple(tables), *at_picks, tuple(without))

    def draw(self, record: Chips) -> Drawing:
        """Draw a row per chip: its pick, and the cheapest design at the common accuracy, with intervals."""
        import plotly.graph_objects as go

        places = np.arange(len(record.hardware))
        gain = label(record.gain)[0]
        parts = (
            (f"pick, {gain} as written", record.pick, "circle-open", -0.15),
            (f"cheapest with {gain} {record.level:.3f}", record.least, "circle", 0.15),
        )
        is_log = bool((record.pick[:, 0] > 0).all() and (record.least[:, 0] > 0).all())
        figure = go.Figure()
        for (name, costs, symbol, shift), colour in zip(parts, OKABE_ITO_LIGHT[1::-1], strict=True):
            cost, low, high = costs.T
            figure.add_scatter(
                x=cost,
                y=places + shift,
                mode="markers",
                name=safe(name),
                marker={"symbol": symbol, "size": 9, "color": colour},
                error_x=interval_bars(low, high),
                hovertemplate="%{x:.4g}<extra></extra>",
            )
        for place, (cost, value) in enumerate(zip(record.pick[:, 0], record.pick_gain, strict=True)):
            note = {"showarrow": False, "yanchor": "bottom", "yshift": 4, "font": {"size": 10}}
            x = float(np.log10(cost)) if is_log else float(cost)
            figure.add_annotation(x=x, y=place - 0.15, text=f"{value:.3f}", **note)
        unknown = safe(", ".join(record.without))
        of = f"{safe(record.task)}: " if record.task else ""
        title = of + axis_title(record.cost) + (f"<br>not known: {unknown}" if unknown else "")
        layout = rows_layout(title, record.hardware, _ROW_PX, _MARGIN_PX, 2)
        layout["xaxis"] |= {"type": "log" if is_log else "linear", "exponentformat": "none"}
        figure.update_layout(layout, separators=".\u202f")
        return figure.update_xaxes(separatethousands=True)
