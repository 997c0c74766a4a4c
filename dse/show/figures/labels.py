"""What a column is called in figures, and the palette: colour only ever carries meaning."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from typing import Any

from dse.base.records import Array

# Okabe & Ito (2008): eight colours told apart with every common colour vision. Yellow is left out: it
# vanishes on white. One order for a light page, one for a dark page.
OKABE_ITO_LIGHT = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
OKABE_ITO_DARK = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#0072B2", "#D55E00")

_UNITS = {
    "_mm_s": "mm/s",
    "_bits_per_s": "bit/s",
    "_hz": "Hz",
    "_w": "W",
    "_ms": "ms",
    "_us": "µs",
    "_mv": "mV",
    "_uj": "µJ",
    "_mj": "mJ",
    "_days": "d",
    "_mw": "mW",
    "_bits": "bit",
    "_bytes": "byte",
    "_s": "s",
}
_SYMBOLS = {"phi": "φ", "theta": "θ"}

Drawing = Any
"""A figure of plotly, which declares no types. Its import takes a while: `drawn` waits until one is drawn."""

LEGEND = {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0}
"""A legend in a line above the figure."""


def drawn(traces: Sequence[Mapping[str, Any]], layout: Mapping[str, Any]) -> Drawing:
    """Return a figure of traces and a layout, with plotly's own keys."""
    import plotly.graph_objects as go

    return go.Figure(traces, layout)


def label(column: str) -> tuple[str, str]:
    """Return the words and the unit of a column: `energy_uj` is ("energy", "µJ").

    A parameter keeps its dotted path, because that is how the YAML file names it.
    """
    if column in _SYMBOLS:
        return _SYMBOLS[column], ""
    for suffix, unit in _UNITS.items():
        if column.endswith(suffix) and len(column) > len(suffix):
            return _words(column.removesuffix(suffix)), unit
    return _words(column), ""


def axis_title(column: str) -> str:
    """Return a column's words with its unit in brackets, safe as plotly text."""
    words, unit = label(column)
    return safe(f"{words} ({unit})" if unit else words)


def safe(text: str) -> str:
    """Return a text as plotly shows it: no mark-up of its own."""
    return html.escape(text, quote=False)


def shortened(text: str, most: int) -> str:
    """Return a text in at most so many characters."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def colour_of(place: int) -> str:
    """Return the colour of the first, second, ... curve; after the last the first again."""
    return OKABE_ITO_LIGHT[place % len(OKABE_ITO_LIGHT)]


def rows_layout(
    title: str, names: Sequence[str], row_px: int, margin_px: int, least: int = 0
) -> dict[str, Any]:
    """Return the layout of a figure with a row for each name, which may be alike; as high as they are many.

    title: of the horizontal axis, safe as plotly text. margin_px: height beside the rows. least: number of
    rows that there is room for at least.
    """
    rows = {"tickvals": list(range(len(names))), "ticktext": list(map(safe, names))}
    return {
        "xaxis": {"title": {"text": title}},
        "yaxis": {**rows, "autorange": "reversed", "showgrid": False},
        "legend": {**LEGEND, "traceorder": "normal"},
        "height": margin_px + row_px * max(least, len(names)),
    }


def interval_bars(low: Array | list[float], high: Array | list[float], **style: Any) -> dict[str, Any]:
    """Return the bars of intervals: distances from a value to their ends."""
    return {"type": "data", "symmetric": False, "array": high, "arrayminus": low} | {"thickness": 1} | style


def beside(text: str, x: float, y: object, **more: Any) -> dict[str, Any]:
    """Return a note right of a place."""
    return {"text": text, "x": x, "y": y, "showarrow": False, "xanchor": "left", "xshift": 6, **more}


def watts(value: float) -> str:
    """Return a power with the unit in which it is short: `56 W`, `43 mW`, `63 µW`."""
    unit, scale = next(((u, x) for u, x in (("W", 1.0), ("mW", 1e3)) if abs(value) * x >= 1), ("µW", 1e6))
    return f"{short(value * scale)} {unit}" if value else "0 W"


def short(value: object, digits: int = 3) -> str:
    """Return a value in at most so many significant digits, anything but a number as its text."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if value != value or value in (float("inf"), float("-inf")):
        return "–"
    rounded = float(f"{value:.{digits}g}")
    if abs(rounded) >= 1000:
        return f"{rounded:,.0f}".replace(",", "\u202f")
    # Decimals, as in the words of a page, not 5e-05.
    return f"{rounded:.12f}".rstrip("0").rstrip(".") if 1e-6 <= abs(rounded) < 1e-4 else f"{rounded:g}"


def _words(column: str) -> str:
    is_symbol = "." in column or re.fullmatch("t_[a-z]", column)  # a dotted path, or t_p, t_h, t_c
    return column if is_symbol else column.removeprefix("n_").replace("_", " ")
