"""All chips side by side: what the pick costs there, and the cheapest design at the accuracy of all."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.figures import Results, of_task
from dse.figures.front import interval, numbers
from dse.figures.labels import OKABE_ITO_LIGHT, axis_title, label
from dse.records import Array
from dse.registry import param, register
from dse.skyline.admissible import fitting, honest
from dse.skyline.goals import Goal
from dse.skyline.pick import pick

if TYPE_CHECKING:
    import plotly.graph_objects

_ROW_PX, _MARGIN_PX = 52, 120


@dataclass(frozen=True)
class Chips:
    """The picks of one task on each chip, (chip,) each.

    gain, cost: columns. level: the largest gain that all chips reach.
    hardware: names. pick_gain: of the pick there.
    pick_cost, pick_low, pick_high: its cost, and the distance to the ends of its interval.
    least_cost, least_low, least_high: of the cheapest design with `level`.
    without: chips that cannot run or hold any design, or whose costs are not known.
    """

    gain: str
    cost: str
    task: str
    level: float
    hardware: tuple[str, ...]
    pick_gain: Array
    pick_cost: Array
    pick_low: Array
    pick_high: Array
    least_cost: Array
    least_low: Array
    least_high: Array
    without: tuple[str, ...]


@register("figures", "chips")
@dataclass(frozen=True)
class ChipsFigure:
    """What the pick costs on each chip, and what the cheapest design does at the accuracy that all reach."""

    cost: str = param(
        "", doc="column of a cost (default: energy, else the first that is minimised)", axis=False
    )
    task: str = param("", doc="what is predicted (default: the first task)", axis=False)

    def gather(self, results: Results) -> Chips:
        goals = [Goal(name, way) for name, way in results.objectives]
        points, cost = of_task(results.points(), self.task), self.cost
        if "hardware" not in points:
            raise ValueError("points must be on hardware, got a study without it")
        gain = next(
            (goal.column for goal in goals if goal.direction == "max" and goal.column in points), None
        )
        less = [goal.column for goal in goals if goal.direction == "min" and goal.column in points]
        cost = cost or ("energy_uj" if "energy_uj" in less else next(iter(less), ""))
        if gain is None or not cost:
            raise ValueError("objectives must maximise a column and minimise another")
        if cost not in points:
            raise ValueError(f"cost must be a column of the points, got '{cost}'")
        frame, held = points[honest(points)], fitting(points)[honest(points)]
        ties = [goal for goal in goals if goal.column != gain and goal.column in frame]
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
        places = []
        for chip, rows in tables.items():
            costs, low, high = numbers(rows, cost), *interval(rows, cost)
            chosen = int(np.flatnonzero(rows.index == picks[chip].name)[0])  # type: ignore[union-attr]
            able = np.flatnonzero(numbers(rows, gain) >= level)
            least = int(able[np.argmin(costs[able])])
            ends = [values[place] for place in (chosen, least) for values in (costs, low, high)]
            places.append([numbers(rows, gain)[chosen], *ends])
        task = str(frame["task"].iloc[0]) if "task" in frame else ""
        pick_gain, pick_cost, pick_low, pick_high, least_cost, least_low, least_high = np.array(
            places, np.float64
        ).T
        return Chips(
            gain=gain,
            cost=cost,
            task=task,
            level=level,
            hardware=tuple(tables),
            pick_gain=pick_gain,
            pick_cost=pick_cost,
            pick_low=pick_low,
            pick_high=pick_high,
            least_cost=least_cost,
            least_low=least_low,
            least_high=least_high,
            without=tuple(without),
        )

    def draw(self, record: Chips) -> plotly.graph_objects.Figure:
        """Draw a row per chip: its pick, and the cheapest design at the common accuracy, with intervals."""
        import plotly.graph_objects as go

        names = [html.escape(name, quote=False) for name in record.hardware]
        places = np.arange(len(names))
        gain = label(record.gain)[0]
        parts = (
            (
                f"pick, {gain} as written",
                record.pick_cost,
                record.pick_low,
                record.pick_high,
                "circle-open",
                -0.15,
            ),
            (
                f"cheapest with {gain} {record.level:.3f}",
                record.least_cost,
                record.least_low,
                record.least_high,
                "circle",
                0.15,
            ),
        )
        is_log = bool((record.pick_cost > 0).all() and (record.least_cost > 0).all())
        figure = go.Figure()
        for (name, cost, low, high, symbol, shift), colour in zip(parts, OKABE_ITO_LIGHT[1::-1], strict=True):
            bars = {"type": "data", "symmetric": False, "array": high, "arrayminus": low, "thickness": 1}
            figure.add_scatter(
                x=cost,
                y=places + shift,
                mode="markers",
                name=html.escape(name, quote=False),
                marker={"symbol": symbol, "size": 9, "color": colour},
                error_x=bars,
                hovertemplate="%{x:.4g}<extra></extra>",
            )
        for place, (cost, value) in enumerate(zip(record.pick_cost, record.pick_gain, strict=True)):
            note = {"showarrow": False, "yanchor": "bottom", "yshift": 4, "font": {"size": 10}}
            x = float(np.log10(cost)) if is_log else float(cost)
            figure.add_annotation(x=x, y=place - 0.15, text=f"{value:.3f}", **note)
        unknown = html.escape(", ".join(record.without), quote=False)
        of = f"{html.escape(record.task, quote=False)}: " if record.task else ""
        title = of + axis_title(record.cost) + (f"<br>not known: {unknown}" if unknown else "")
        figure.update_layout(
            separators=".\u202f",
            xaxis={
                "title": {"text": title},
                "type": "log" if is_log else "linear",
                "exponentformat": "none",
                "separatethousands": True,
            },
            yaxis={
                "tickvals": places.tolist(),
                "ticktext": names,
                "autorange": "reversed",
                "showgrid": False,
            },
            legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0},
            height=_MARGIN_PX + _ROW_PX * max(2, len(names)),
        )
        return figure
