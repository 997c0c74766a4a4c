"""Where the energy of an inference goes on one hardware: dynamic energy by cause, and static energy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dse import store
from dse.base.records import Floats
from dse.base.registry import fixed, register
from dse.measure.hardware.cost import cost
from dse.show.figures import NothingRecorded, Results, chip_of, hardware_key, recorded, trial_key
from dse.show.figures.labels import (
    OKABE_ITO_LIGHT,
    Drawing,
    beside,
    drawn,
    interval_bars,
    rows_layout,
    safe,
    short,
)

DYNAMIC, STATIC, TOTAL = OKABE_ITO_LIGHT[0], OKABE_ITO_LIGHT[4], OKABE_ITO_LIGHT[2]
QUIET = "rgba(127, 135, 145, 0.9)"
_BARS = 0.58  # share of the width that the longest bar takes; the rest is for its numbers


@dataclass(frozen=True)
class Breakdown:
    """Energy per inference, flat out or at the sensor's period; means over the repeats of a design.

    causes, dynamic_uj: what happens, dearest first, and what it costs, (cause,); causes that cost nothing
        are left out.
    static_uj: static energy while computing.
    energy_uj: all of it, with the ends of its interval.
    misfits: what does not fit the hardware, a sentence each.

    All but the ends are NaN, and there are no causes, where the profile gives intervals only.
    """

    causes: tuple[str, ...]
    dynamic_uj: Floats
    static_uj: float
    energy_uj: float
    energy_uj_low: float
    energy_uj_high: float
    misfits: tuple[str, ...]


@register("figures", "energy")
@dataclass(frozen=True)
class EnergyFigure:
    """Energy per inference by cause, for the full read-out of a trial on a chip."""

    hardware: str = hardware_key()
    trial: int | None = trial_key()
    pace: str = fixed(
        "flat",
        doc="static energy of computing flat out, or of the sensor's step period",
        choices=("flat", "period"),
    )

    def gather(self, results: Results) -> Breakdown:
        trial, runs = recorded(results, self.trial, "read_out.npz")
        chip = chip_of(results, self.hardware)
        costs = [cost(chip, store.work_of(run).mapped(lambda counts: counts[-1:])) for run in runs]
        paced = self.pace == "period"

        def mean(values: Iterable[Floats]) -> float:
            return float(np.mean([np.asarray(value).item() for value in values]))

        by_cause = {cause: mean(one.breakdown[cause] for one in costs) for cause in costs[0].breakdown}
        total = [one.energy_throttled_uj if paced else one.energy_uj for one in costs]
        static = [one.static_throttled_uj if paced else one.static_uj for one in costs]
        if paced and not np.isfinite(mean(one.value for one in total)):
            raise NothingRecorded(f"trial {trial} on {chip.name} must have an energy at the sensor's period")
        paid = sorted(((cause, uj) for cause, uj in by_cause.items() if uj > 0), key=lambda pair: -pair[1])
        return Breakdown(
            causes=tuple(cause for cause, _ in paid),
            dynamic_uj=np.array([uj for _, uj in paid]),
            static_uj=mean(one.value for one in static),
            energy_uj=mean(one.value for one in total),
            energy_uj_low=mean(one.low for one in total),
            energy_uj_high=mean(one.high for one in total),
            misfits=tuple(map(str, costs[0].misfits)),
        )

    def draw(self, record: Breakdown) -> Drawing:
        """Draw a bar for every cause, for static energy, and for all together, which has the interval."""
        rows = [
            (cause.replace("_", " "), float(uj), DYNAMIC)
            for cause, uj in zip(record.causes, record.dynamic_uj, strict=True)
        ]
        if record.static_uj > 0:
            rows.append(("static", record.static_uj, STATIC))
        low, high = record.energy_uj_low, record.energy_uj_high
        known = bool(np.isfinite(record.energy_uj))
        # Without a value, the bar of the total lies between the ends of its interval.
        total = record.energy_uj if known else high - low
        ends = f"{short(low)}–{short(high)}"
        words = [*(short(uj) for _, uj, _ in rows), f"{short(record.energy_uj)} ({ends})" if known else ends]
        names = [safe(name) for name, _, _ in rows] + ["total"]
        bars = {
            "type": "bar",
            "orientation": "h",
            "y": list(range(len(names))),
            "x": [uj for _, uj, _ in rows] + [total],
            "base": [0.0] * len(rows) + [0.0 if known else low],
            "marker": {"color": [colour for _, _, colour in rows] + [TOTAL]},
            "error_x": interval_bars(
                [0.0] * len(rows) + [record.energy_uj - low if known else 0.0],
                [0.0] * len(rows) + [high - record.energy_uj if known else 0.0],
                width=4,
                color=QUIET,
            ),
            "customdata": [f"{name}: {text} µJ" for name, text in zip(names, words, strict=True)],
            "hovertemplate": "%{customdata}<extra></extra>",
            "showlegend": False,
        }
        # Beside the bars, where nothing covers them: a total's interval is often longer than its bar.
        reach = [*(uj for _, uj, _ in rows), max(high, total)]
        written = [
            beside(text, end / max(reach) * _BARS, place, xref="paper", font={"size": 10})
            for place, (end, text) in enumerate(zip(reach, words, strict=True))
        ]
        names = [*(name for name, _, _ in rows), "total"]
        layout = rows_layout("energy of an inference (µJ)", names, 26, 60)
        layout["xaxis"] |= {"range": [0, max(reach) / _BARS]}
        layout |= {"annotations": written, "bargap": 0.35, "margin": {"l": 96, "r": 12, "t": 8, "b": 40}}
        return drawn([bars], layout)
