"""Power of one design on every hardware: at rest, and beyond it while it runs.

Source: Brayshaw et al., real-time texture classification, Fig. 5 (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.show.figures import NothingRecorded, Results, full_read_outs, trial_key, trial_of
from dse.show.figures.front import interval, numbers
from dse.show.figures.labels import OKABE_ITO_LIGHT, Drawing, beside, interval_bars, rows_layout, safe, watts

IDLE, RUNNING = "power_idle_w", "power_w"
_INTERVAL = "#59616B"
_ROOM = 2.2  # width of the axis by the longest bar; the rest is for its numbers
_BAR_PX, _MARGIN_PX = 48, 100


@dataclass(frozen=True)
class Power:
    """Power of one design, (hardware,) each.

    idle_w: at rest. beyond_w: what running adds to it.
    low_w, high_w: distance from the power while running to the ends of its interval, 0 where none is known.
    without: hardware whose power is not known.
    """

    hardware: tuple[str, ...]
    idle_w: Array
    beyond_w: Array
    low_w: Array
    high_w: Array
    without: tuple[str, ...]


@register("figures", "power")
@dataclass(frozen=True)
class PowerFigure:
    """Power of a trial on every hardware profile of the study: at rest, and beyond it while it runs."""

    trial: int | None = trial_key()

    def gather(self, results: Results) -> Power:
        points = results.points()
        rows = full_read_outs(points[points["trial"] == trial_of(results, self.trial)])
        for column in ("hardware", IDLE, RUNNING):
            if column not in rows:
                raise NothingRecorded(f"points must have a column {column}, got a study without it")
        rows = rows.drop_duplicates("hardware")  # of several tasks the first counts
        idle_w, power_w = numbers(rows, IDLE), numbers(rows, RUNNING)
        known = np.isfinite(idle_w) & np.isfinite(power_w)
        names = rows["hardware"].astype(str).to_numpy()
        if not known.any():
            of = f"on {', '.join(names)}" if len(names) else "of the trial"
            raise NothingRecorded(f"{IDLE} and {RUNNING} must be known on some hardware, got none {of}")
        low, high = interval(rows, RUNNING)
        return Power(
            hardware=tuple(names[known].tolist()),
            idle_w=idle_w[known],
            beyond_w=power_w[known] - idle_w[known],
            low_w=low[known],
            high_w=high[known],
            without=tuple(names[~known].tolist()),
        )

    def draw(self, record: Power) -> Drawing:
        """Draw a bar per hardware: at rest, and after it what running adds; the interval is that of the sum.

        Hardware whose power is not known is named below.
        """
        import plotly.graph_objects as go

        places = list(range(len(record.hardware)))
        parts = (("at rest", record.idle_w), ("beyond, running", record.beyond_w))
        figure = go.Figure()
        for (name, power_w), colour in zip(parts, OKABE_ITO_LIGHT, strict=False):
            figure.add_bar(
                orientation="h",
                y=places,
                x=power_w,
                name=name,
                marker={"color": colour},
                hovertemplate=f"{name}: %{{x:.4g}} W<extra></extra>",
            )
        figure.data[1].error_x = interval_bars(record.low_w, record.high_w, width=4, color=_INTERVAL)
        # Beside the interval, because a part may be too small to hold its number.
        ends_w = record.idle_w + record.beyond_w + record.high_w
        for place, (idle_w, beyond_w) in enumerate(zip(record.idle_w, record.beyond_w, strict=True)):
            text = f"{watts(float(idle_w))} + {watts(float(beyond_w))}"
            figure.add_annotation(beside(text, float(ends_w[place]), place))
        unknown = safe(", ".join(record.without))
        title = "power (W)" + (f"<br>not known: {unknown}" if unknown else "")
        figure.update_layout(rows_layout(title, record.hardware, _BAR_PX, _MARGIN_PX, 3), barmode="stack")
        return figure.update_xaxes(range=[0, _ROOM * float(ends_w.max())])
