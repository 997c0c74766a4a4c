"""What 0.01 of accuracy costs at the pick: the pick against a cheaper point, in each cost, with its interval.

The cheaper point is the cheapest with at most `WINDOW` less. Its interval is that of the difference of these
two: no point is chosen anew within it, because noise would always find a cheaper one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.show.figures import Results, gain_of, hardware_key, of_task, on_one_chip, task_key
from dse.show.figures.front import numbers
from dse.show.figures.labels import OKABE_ITO_LIGHT, Drawing, beside, drawn, interval_bars, label, safe, short
from dse.skyline.admissible import admissible
from dse.skyline.pick import economy, pick

WINDOW = 0.05
"""Of accuracy, that a cheaper point may give up."""

_SPIKES = "spikes_per_inference"
_Z = 1.645  # of a 90 % interval
_ROW_PX, _MARGIN_PX = 44, 110


@dataclass(frozen=True)
class Prices:
    """What a hundredth more of what is maximised costs.

    gain: its column. task, trial: of the pick.
    columns: of the costs. price, low, high: (cost,) per hundredth, and its 90 % interval, without an upper
        end where the two points cannot be told apart.
    before, at: (cost,) of the cheaper point, and of the pick.
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
    """What 0.01 of accuracy costs at the pick, in each cost, with its 90 % interval."""

    hardware: str = hardware_key()
    task: str = task_key()

    def gather(self, results: Results) -> Prices:
        points = of_task(on_one_chip(results.points(), self.hardware), self.task)
        gain, ties = gain_of(results, points)
        if gain is None:
            raise ValueError("an objective must be maximised, such as accuracy:max")
        frame = points[admissible(points)]
        if frame.empty:
            raise ValueError("some design must fit the chip; choose another with the key hardware")
        values = numbers(frame, gain)
        known = values[np.isfinite(values)]
        if not len(known) or known.min() < 0 or known.max() > 1:
            raise ValueError(f"{gain} must be a fraction, in [0, 1], of some points")
        picked = pick(frame, [], gain, ties).row
        assert picked is not None  # no budget excludes anything
        costs = [goal.column for goal in [*ties, *economy(frame)] if goal.direction == "min"]
        costs += [_SPIKES] if np.isfinite(numbers(frame, _SPIKES)).any() else []
        errors = np.nan_to_num(numbers(frame, f"{gain}_se"))
        rows = []
        for column in dict.fromkeys(costs):
            cost = numbers(frame, column)
            if not np.isfinite(numbers(frame.loc[[picked.name]], column))[0]:
                continue
            use = np.isfinite(values) & np.isfinite(cost)
            place = int(np.flatnonzero(frame.index[use] == picked.name)[0])
            price = price_of(values[use], cost[use], errors[use], place)
            if price is not None:
                rows.append((column, *price))
        if not rows:
            raise ValueError(f"no point with {gain} at most {WINDOW} below {picked[gain]:.3f} is cheaper")
        columns, *parts = zip(*rows, strict=True)
        task = str(picked["task"]) if "task" in frame else ""
        return Prices(gain, task, int(picked.get("trial", 0)), columns, *(np.array(part) for part in parts))

    def draw(self, record: Prices) -> Drawing:
        """Draw the price in each cost as a share of what the pick costs, with interval and numbers."""
        known = np.isfinite(record.high)
        low, high = (100 * part / record.at for part in (record.low, record.high))
        share = np.where(known, 100 * record.price / record.at, low)
        top = 1.2 * float(np.max(np.where(known, high, low)))
        beyond = np.where(known, high, top)
        names = [safe(label(column)[0]) for column in record.columns]
        words = []
        for column, is_known, *numbers_of in zip(
            record.columns, known, record.price, record.low, record.high, strict=True
        ):
            price, least, most = (short(float(x)) for x in numbers_of)
            unit = label(column)[1]
            words.append(
                f"{price} {unit}".strip() + f" ({least} to {most})"
                if is_known
                else f"at least {least} {unit}".strip()
            )
        prices = {
            "x": share,
            "y": names,
            "mode": "markers",
            "marker": {
                "size": 9,
                "color": OKABE_ITO_LIGHT[0],
                "symbol": ["circle" if is_known else "triangle-right" for is_known in known],
            },
            "error_x": interval_bars(share - low, beyond - share),
            "customdata": words,
            "hovertemplate": "%{y}: %{customdata} per 0.01<extra></extra>",
        }
        notes = [beside(text, 0, name, xshift=0, yshift=12) for name, text in zip(names, words, strict=True)]
        of = safe(f"{record.task + ': ' if record.task else ''}price of 0.01 of {label(record.gain)[0]}")
        layout = {
            "annotations": notes,
            "xaxis": {
                "title": {"text": f"{of},<br>% of what trial {record.trial} costs"},
                "range": [min(0, float(low.min())), 1.1 * top],
            },
            "yaxis": {"autorange": "reversed", "automargin": True, "showgrid": False},
            "showlegend": False,
            "height": _MARGIN_PX + _ROW_PX * max(3, len(names)),
        }
        return drawn([prices], layout)


def price_of(
    gain: Array, cost: Array, error: Array, pick: int
) -> tuple[float, float, float, float, float] | None:
    """Return price, low and high end, and the costs of a cheaper point and of the pick; None without one.

    Args:
        gain: (point,) what is maximised.
        cost: (point,).
        error: (point,) standard error of the gain.
        pick: place of the pick.
    """
    order = np.lexsort((-gain, cost))
    other = int(order[np.argmax(gain[order] >= gain[pick] - WINDOW - 1e-9)])
    saved, less = float(cost[pick] - cost[other]), float(gain[pick] - gain[other])
    spread = _Z * float(np.hypot(error[pick], error[other]))
    if saved <= 0 or less + spread <= 0:  # nothing is paid, or nothing is gained for it
        return None
    price, low, high = (
        saved / (100 * gained) if gained > 0 else np.inf for gained in (less, less + spread, less - spread)
    )
    return price, low, high, float(cost[other]), float(cost[pick])
