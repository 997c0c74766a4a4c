"""The page of a trial: its pins and events moving through the image, beside its course over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dse.show.dashboard.write import packed_array, plain_figure, write_filled
from dse.show.figures.labels import OKABE_ITO_DARK, OKABE_ITO_LIGHT
from dse.show.figures.trial import OUTLINE, TrialView, draw_course, draw_pins

_LARGEST = 2**15 - 1


def write_trial_page(view: TrialView, path: Path | str) -> Path:
    """Write the page of a trial as one self-contained HTML file, whole or not at all; return its path."""
    return write_filled("trial", trial_page(view), path)


def trial_page(view: TrialView) -> dict[str, Any]:
    """Return the content of a trial's page, as plain values that JSON can hold.

    Returns:
        name, notes, facts: in words;
        pins, course: the two figures, the first at `moment`;
        step_ms, n_moments, recent_ms, radius_px, outline: of the view;
        px: pin positions (moment, pin, 2) as int16 in units of `px_unit`, base64 of little-endian bytes as
        every array here; t_us int32, x and y int16, polarity uint8: events.
        palette: colours of the figures on a light page, and what they become on a dark one.
    """
    unit = max(float(np.abs(view.px).max(initial=0)), 1.0) / _LARGEST
    events = view.events
    return {
        "name": view.name,
        "notes": _remarks(view),
        "facts": _facts(view),
        "pins": plain_figure(draw_pins(view, view.busiest)),
        "course": plain_figure(draw_course(view)),
        "moment": view.busiest,
        "step_ms": view.step_ms,
        "n_moments": len(view.t_s),
        "recent_ms": view.recent_ms,
        "radius_px": view.radius_px,
        "outline": OUTLINE.round(6).tolist(),
        "px": packed_array(np.rint(view.px / unit), "<i2"),
        "px_unit": unit,
        "t_us": packed_array(events.t_us, "<i4"),
        "x": packed_array(events.x, "<i2"),
        "y": packed_array(events.y, "<i2"),
        "polarity": packed_array(events.polarity, "u1"),
        "palette": {"light": OKABE_ITO_LIGHT, "dark": OKABE_ITO_DARK},
    }


def _facts(view: TrialView) -> str:
    duration_s = float(view.t_s[-1])
    width, height = view.frame_px
    return (
        f"{view.px.shape[1]} pins · {width} × {height} px · {duration_s:.3g} s · "
        f"{view.n_events:,} events, {view.n_events / duration_s / 1e6:.3g} million per s"
    )


def _remarks(view: TrialView) -> list[str]:
    """Return warnings about the figures."""
    if view.n_events == 0:
        return ["No pixel sent an event in this trial."]
    if view.one_in == 1:
        return []
    return [
        f"The image shows one event in {view.one_in}, to keep the page small; "
        "the figures over time count all of them."
    ]
