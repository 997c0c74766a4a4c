"""Which cores of a chip a network occupies: one cell per core, coloured by layer."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse import store
from dse.base.records import Array, Workload
from dse.base.registry import register
from dse.measure.hardware.placement import neurons_per_core
from dse.measure.hardware.plan import NotApplicable
from dse.show.figures import Results, chip_of, hardware_key, recorded, trial_key
from dse.show.figures.labels import LEGEND, Drawing, colour_of, drawn, safe

FREE = "rgba(127, 135, 145, 0.18)"
_WIDER = 2.2  # times as many columns of cores as rows, about the shape of the figure
_LETTERS = 48  # in a line of the narrow panel


@dataclass(frozen=True)
class CoreMap:
    """Where the layers of a network go; cores are numbered layer by layer.

    layers: names of the layers after the input; one name where they share a core.
    neurons: of each layer, (core,) neurons on each of its cores.
    n_cores, low, high: cores in use, and what practice may take.
    on_chip: cores of the chip.
    misfits: what does not fit, a sentence each.
    """

    layers: tuple[str, ...]
    neurons: tuple[Array, ...]
    n_cores: int
    low: int
    high: int
    on_chip: int
    misfits: tuple[str, ...]


@register("figures", "cores")
@dataclass(frozen=True)
class CoresFigure:
    """Cores of a chip that the layers of a trial occupy."""

    hardware: str = hardware_key()
    trial: int | None = trial_key()

    def gather(self, results: Results) -> CoreMap:
        _, runs = recorded(results, self.trial, "read_out.npz")
        load = store.work_of(runs[0]).mapped(lambda counts: counts[-1:])
        chip = chip_of(results, self.hardware)
        placement = chip.plan(load, chip.ends).placement
        if placement is None or not isinstance(load, Workload) or "cores" not in chip.numbers():
            raise NotApplicable(f"{chip.name} is not divided into cores")
        sizes = load.sizes[1:]
        if len(placement.cores) == len(sizes):
            names = [f"layer {k}" for k in range(1, len(sizes))] + ["output"]
        else:  # all layers share what cores there are
            names, sizes = ["all layers"], (sum(sizes),)
        return CoreMap(
            layers=tuple(names),
            neurons=tuple(
                neurons_per_core(n, cores) for n, cores in zip(sizes, placement.cores, strict=True)
            ),
            n_cores=placement.n_cores,
            low=placement.low or placement.n_cores,
            high=placement.high or placement.n_cores,
            on_chip=int(chip.cores.value),  # type: ignore[attr-defined]
            misfits=tuple(map(str, placement.misfits)),
        )

    def draw(self, record: CoreMap) -> Drawing:
        """Draw every core of the chip, those in use coloured by layer; what does not fit stands below."""
        n = max(record.n_cores, record.on_chip)
        n_columns = int(np.ceil(np.sqrt(n * _WIDER)))
        n_rows = -(-n // n_columns)
        traces, first = [], 0
        for k, (name, neurons) in enumerate(zip(record.layers, record.neurons, strict=True)):
            total = int(neurons.sum())
            words = [
                f"core {core}: {name}, {count} of {total} neurons ({count / total:.0%})"
                for core, count in enumerate(neurons.tolist(), first)
            ]
            cells = _cells((n_rows, n_columns), first, words, colour_of(k))
            traces.append(cells | {"name": f"{name}: {len(words)}"})
            first += len(words)
        free = [f"core {core}: free" for core in range(first, n)]
        if free:
            cells = _cells((n_rows, n_columns), first, free, FREE)
            traces.append(cells | {"name": "free", "showlegend": False})
        counted = f"{record.n_cores} of {record.on_chip} cores"
        if (record.low, record.high) != (record.n_cores, record.n_cores):
            counted += f"; {record.low} to {record.high} as placed by compilers"
        lines = [counted]
        for text in record.misfits:
            lines += textwrap.wrap(f"Does not fit: {text}.", _LETTERS)
        below = 16 + 15 * len(lines)
        hidden = {"visible": False, "fixedrange": True, "constrain": "domain"}
        layout = {
            "annotations": [
                {
                    "name": "cores",
                    "text": "<br>".join(safe(line) for line in lines),
                    **{"x": 0, "xref": "paper", "xanchor": "left", "align": "left"},
                    **{"y": 0, "yref": "y domain", "yanchor": "top", "yshift": -4},
                    "showarrow": False,
                    "font": {"size": 11},
                }
            ],
            "xaxis": {**hidden, "range": [-0.5, n_columns - 0.5], "constraintoward": "left"},
            "yaxis": {**hidden, "range": [n_rows - 0.5, -0.5], "scaleanchor": "x", "constraintoward": "top"},
            "height": 200 + below,
            "margin": {"l": 8, "r": 8, "t": 32, "b": below},
            "legend": {**LEGEND, "font": {"size": 10}},
        }
        return drawn(traces, layout)


def _cells(shape: tuple[int, int], first: int, words_of_cores: Sequence[str], colour: str) -> dict[str, Any]:
    """Return the cells of consecutive cores of a grid (row, column), and what hovering says of each."""
    cells = np.full(shape, np.nan, np.float32)
    words = np.full(shape, "", object)
    place = slice(first, first + len(words_of_cores))
    cells.flat[place], words.flat[place] = 1, words_of_cores
    return {
        "type": "heatmap",
        "z": cells,
        "text": words.tolist(),
        "colorscale": [[0, colour], [1, colour]],
        "showscale": False,
        "showlegend": True,
        "xgap": 1,
        "ygap": 1,
        "hovertemplate": "%{text}<extra></extra>",
        "hoverongaps": False,
    }
