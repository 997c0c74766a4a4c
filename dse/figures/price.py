"""What a point of accuracy costs at the pick: the slope of the front in each cost, with its interval.

A price is a mean over the accuracies from `WINDOW` below the pick up to it, because single steps of a front
are noise: the least cost at the pick's accuracy, minus the least cost at `WINDOW` less, per hundredth. Its
interval samples the standard errors of the accuracies, alike for the points of a trial.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.figures import Results, hardware_key, of_task, on_one_chip
from dse.figures.front import numbers
from dse.figures.labels import OKABE_ITO_LIGHT, label, short
from dse.records import Array
from dse.registry import param, register
from dse.skyline.admissible import admissible
from dse.skyline.goals import Goal
from dse.skyline.pick import economy, pick

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

WINDOW = 0.05
"""Of accuracy, over which a price is a mean."""

_SPIKES = "spikes_per_inference"
_DRAWS = 400
_QUANTILES = (0.05, 0.95)
_ROW_PX, _MARGIN_PX = 44, 110


@dataclass(frozen=True)
class Prices:
    """What a hundredth more of what is maximised costs.

    gain: its column. task, trial: of the pick.
    columns: of the costs. price, low, high: (cost,) per hundredth, and its 90 % interval, infinite where
        a sample has no point of the accuracy.
    before, at: (cost,) least cost at `WINDOW` less, and at the pick's own.
    """

    gain: str
    task: str
    trial: int
    columns: tuple[str, ...]
    price: Array
    low: Array
    high: Array
    before: Array
    at: Array


@register("figures", "price")
@dataclass(frozen=True)
class PriceFigure:
    """What a point of accuracy costs at the pick, in each cost, with its 90 % interval."""

    hardware: str = hardware_key()
    task: str = param("", doc="what is predicted (default: the first task)", axis=False)

    def gather(self, results: Results) -> Prices:
        points = of_task(on_one_chip(results.points(), self.hardware), self.task)
        return gather_prices(points, [Goal(name, way) for name, way in results.objectives])

    def draw(self, record: Prices) -> plotly.graph_objects.Figure:
        return draw_prices(record)


def gather_prices(points: pandas.DataFrame, goals: Sequence[Goal]) -> Prices:
    """Gather the prices at the pick of a table.

    Args:
        points: design points of one task on one chip.
        goals: objectives; the first that is maximised is what is paid for.

    Raises:
        ValueError: nothing is maximised, it is no fraction, or no point lies a window below the pick.
    """
    gain = next((goal.column for goal in goals if goal.direction == "max" and goal.column in points), None)
    if gain is None:
        raise ValueError("an objective must be maximised, such as accuracy:max")
    frame = points[admissible(points)]
    if frame.empty:
        raise ValueError("some design must fit the chip; choose another with the key hardware")
    values = numbers(frame, gain)
    known = values[np.isfinite(values)]
    if not len(known) or known.min() < 0 or known.max() > 1:
        raise ValueError(f"{gain} must be a fraction, in [0, 1], of some points")
    ties = [goal for goal in goals if goal.column != gain and goal.column in frame]
    picked = pick(frame, [], gain, ties).row
    assert picked is not None  # no budget excludes anything
    costs = [goal.column for goal in [*ties, *economy(frame)] if goal.direction == "min"]
    costs += [_SPIKES] if np.isfinite(numbers(frame, _SPIKES)).any() else []
    trial = frame["trial"].to_numpy() if "trial" in frame else np.arange(len(frame))
    errors = np.nan_to_num(numbers(frame, f"{gain}_se"))
    rows = []
    for column in dict.fromkeys(costs):
        cost = numbers(frame, column)
        if not np.isfinite(numbers(frame.loc[[picked.name]], column))[0]:
            continue
        use = np.isfinite(values) & np.isfinite(cost)
        place = int(np.flatnonzero(frame.index[use] == picked.name)[0])
        price = price_of(values[use], cost[use], errors[use], trial[use], place)
        if price is not None:
            rows.append((column, *price))
    if not rows:
        raise ValueError(f"no point has {gain} more than {WINDOW} below the pick's {picked[gain]:.3f}")
    columns, *parts = zip(*rows, strict=True)
    task = str(picked["task"]) if "task" in frame else ""
    return Prices(gain, task, int(picked.get("trial", 0)), columns, *(np.array(part) for part in parts))


def price_of(
    gain: Array, cost: Array, error: Array, trial: Array, pick: int
) -> tuple[float, float, float, float, float] | None:
    """Return price, low and high end, and the least costs before and at a pick; None if nothing lies below.

    Args:
        gain: (point,) what is maximised.
        cost: (point,).
        error: (point,) standard error of the gain.
        trial: (point,) points of one trial err alike.
        pick: place of the pick.
    """
    order = np.lexsort((-gain, cost))
    gain, cost, error, trial = gain[order], cost[order], error[order], trial[order]
    pick = int(np.flatnonzero(order == pick)[0])
    level, low = gain[pick], gain[pick] - WINDOW - 1e-9
    if not (gain < low).any():
        return None

    def per_hundredth(gains: Array) -> tuple[Array, Array, Array]:
        shift = (gains[:, pick] - gain[pick])[:, None]
        ends = []
        for wanted in (low + shift, level + shift):
            reached = gains >= wanted
            ends.append(np.where(reached.any(axis=1), cost[reached.argmax(axis=1)], np.inf))
        before, at = ends
        return (
            np.where(np.isinf(at), np.inf, (at - np.where(np.isinf(at), 0, before)) / (100 * WINDOW)),
            before,
            at,
        )

    price, before, at = (float(part[0]) for part in per_hundredth(gain[None]))
    _, code = np.unique(trial, return_inverse=True)
    unit = np.random.default_rng(1).standard_normal((_DRAWS, int(code.max()) + 1))
    sampled, _, _ = per_hundredth(gain + error * unit[:, code])
    least, most = np.quantile(sampled, _QUANTILES, method="inverted_cdf")
    return price, float(least), float(most), before, at


def draw_prices(prices: Prices) -> plotly.graph_objects.Figure:
    """Draw the price in each cost as a share of what the pick costs, with its interval and its numbers."""
    import plotly.graph_objects as go

    share, low, high = (100 * part / prices.at for part in (prices.price, prices.low, prices.high))
    top = float(np.max(np.where(np.isfinite(high), high, share)))
    beyond = np.where(np.isfinite(high), high, top)
    names = [html.escape(label(column)[0], quote=False) for column in prices.columns]
    words = []
    for k, column in enumerate(prices.columns):
        unit = label(column)[1]
        ends = " to ".join(
            short(float(part[k])) if np.isfinite(part[k]) else "∞" for part in (prices.low, prices.high)
        )
        words.append(f"{short(float(prices.price[k]))} {unit}".strip() + f" ({ends})")
    figure = go.Figure(
        go.Scatter(
            x=share,
            y=names,
            mode="markers",
            marker={"size": 9, "color": OKABE_ITO_LIGHT[0]},
            error_x={
                "type": "data",
                "symmetric": False,
                "array": beyond - share,
                "arrayminus": share - low,
                "thickness": 1,
            },
            customdata=words,
            hovertemplate="%{y}: %{customdata} per point<extra></extra>",
        )
    )
    for name, text in zip(names, words, strict=True):
        figure.add_annotation(x=0, y=name, text=text, showarrow=False, xanchor="left", yshift=12)
    of = html.escape(
        f"{prices.task + ': ' if prices.task else ''}price of a point of {label(prices.gain)[0]}", quote=False
    )
    figure.update_layout(
        xaxis={
            "title": {"text": f"{of},<br>% of what trial {prices.trial} costs"},
            "range": [min(0, float(low.min())), 1.1 * top],
        },
        yaxis={"autorange": "reversed", "automargin": True, "showgrid": False},
        showlegend=False,
        height=_MARGIN_PX + _ROW_PX * max(3, len(names)),
    )
    return figure
