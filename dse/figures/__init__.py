"""Figures: each file gathers a record of plain numbers, then draws the record with plotly.

Contract: `gather_*` is pure and tested without a browser; `draw_*` adds no number of its own.
To add one: `dse/figures/<name>.py` with both, and a line here.
"""

from dse.figures.confusion import draw_confusion, gather_confusion
from dse.figures.front import draw_front, gather_front
from dse.figures.surface import draw_surface, gather_surface
from dse.figures.trial import TrialView, draw_course, draw_pins, gather_trial

__all__ = [
    "TrialView",
    "draw_confusion",
    "draw_course",
    "draw_front",
    "draw_pins",
    "draw_surface",
    "gather_confusion",
    "gather_front",
    "gather_surface",
    "gather_trial",
]
