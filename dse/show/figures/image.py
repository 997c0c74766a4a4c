"""A figure as a static image for print: PDF, SVG or PNG, drawn by an installed Chrome or Chromium.

Nothing is fetched: the drawing library is plotly's own copy, and the browser is that of DSE_CHROMIUM, else
one that kaleido finds on this machine.
"""

from __future__ import annotations

import contextlib
import os
import queue
import threading
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from dse.base.native.extras import MissingExtra
from dse.show.figures.labels import OKABE_ITO_LIGHT, Drawing

FORMATS = ("pdf", "svg", "png")
SIZE_PX = (700, 450)
"""Width and height of a figure that has none of its own."""

PX_PER_MM = 96 / 25.4
PNG_SCALE = 3.0
"""Dots of a PNG per pixel: 288 dpi."""

_PATIENCE_S = 300.0
"""How long a browser may take for a figure, its start included."""

FONT_PX = 8 * 96 / 72
"""8 pt, the text of a figure in most journals."""

_INK, _RULE = "#1B1E22", "#DFE3E8"
_AXIS: dict[str, Any] = {
    "showline": True,
    "linecolor": _INK,
    "ticks": "outside",
    "tickcolor": _INK,
    "ticklen": 4,
    "gridcolor": _RULE,
    "zeroline": False,
    "automargin": True,
    "title": {"standoff": 8, "font": {"size": FONT_PX}},
}
_SCENE_AXIS: dict[str, Any] = {
    "backgroundcolor": "white",
    "gridcolor": _RULE,
    "linecolor": _INK,
    "nticks": 6,
    "title": {"font": {"size": FONT_PX}},
}
_LAYOUT: dict[str, Any] = {
    "paper_bgcolor": "white",
    "plot_bgcolor": "white",
    "font": {"family": "Helvetica, Arial, sans-serif", "size": FONT_PX, "color": _INK},
    "colorway": OKABE_ITO_LIGHT,
    "margin": {"l": 56, "r": 16, "t": 24, "b": 48},
    "legend": {"tracegroupgap": 2, "orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
    "xaxis": _AXIS,
    "yaxis": _AXIS,
    "scene": {f"{axis}axis": _SCENE_AXIS for axis in "xyz"},
}


def static_image(
    figure: Drawing,
    form: str,
    size_px: tuple[int, int] | None = None,
    png_scale: float = PNG_SCALE,
) -> bytes:
    """Return a figure as the content of a file, on white.

    Args:
        figure: what is drawn.
        form: one of `FORMATS`.
        size_px: width and height, 96 px to the inch; None: those of its layout, else `SIZE_PX`.
        png_scale: dots of a PNG per pixel.

    Raises:
        MissingExtra: kaleido or a browser is missing, or the browser does not start.
    """
    if find_spec("kaleido") is None:
        raise MissingExtra("a figure as PDF, SVG or PNG needs kaleido: pip install 'dse-spiking[figures]'")
    import kaleido
    from choreographer import errors

    gone = errors.BrowserClosedError, errors.BrowserDepsError, errors.BrowserFailedError
    layout = figure.layout
    width, height = size_px or (layout.width or SIZE_PX[0], layout.height or SIZE_PX[1])
    options = {"format": form, "width": width, "height": height, "scale": png_scale if form == "png" else 1}
    browser = {"path": os.environ["DSE_CHROMIUM"]} if os.environ.get("DSE_CHROMIUM") else {}
    try:
        plain = on_white(figure).to_dict()
        content = _answered(
            lambda: kaleido.calc_fig_sync(plain, options, kopts={"mathjax": False, **browser})
        )
    except errors.ChromeNotFoundError:
        raise MissingExtra(
            "a figure as PDF, SVG or PNG needs Chrome or Chromium: install one, or name it in DSE_CHROMIUM"
        ) from None
    except (*gone, errors.ChannelClosedError):  # the last where it ends before it is asked
        raise MissingExtra(
            "a figure as PDF, SVG or PNG needs a Chrome or Chromium that starts: "
            f"{browser.get('path', 'the one on this machine')} did not; name another in DSE_CHROMIUM"
        ) from None
    return content


def _answered(draw: Callable[[], bytes]) -> bytes:
    """Return what a browser draws; kaleido waits for ever for one that is gone, so another is asked."""
    for _ in range(2):
        found: queue.Queue[bytes | BaseException] = queue.Queue()

        def run(found: queue.Queue[bytes | BaseException] = found) -> None:
            try:
                found.put(draw())
            except BaseException as error:
                found.put(error)

        threading.Thread(target=run, daemon=True).start()  # as are those that it starts: none outlives us
        with contextlib.suppress(queue.Empty):
            content = found.get(timeout=_PATIENCE_S)
            if isinstance(content, BaseException):
                raise content
            return content
    raise MissingExtra(f"a browser must draw a figure within {_PATIENCE_S:g} s, and two have not")


def on_white(figure: Drawing) -> Drawing:
    """Return a copy in the style of print; what its layout says itself stays."""
    import plotly.graph_objects as go

    return go.Figure(figure).update_layout(template={"layout": _LAYOUT})
