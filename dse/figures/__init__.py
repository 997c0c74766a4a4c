"""Figures: each file gathers a record of plain numbers, then draws the record with plotly.

Contract: `gather_*` is pure and tested without a browser; `draw_*` adds no number of its own.
To add one: `dse/figures/<name>.py` with both, and a line here.
"""

from dse.figures.confusion import draw_confusion, gather_confusion
from dse.figures.front import draw_front, gather_front
from dse.figures.surface import draw_surface, gather_surface

__all__ = [
    "draw_confusion",
    "draw_front",
    "draw_surface",
    "gather_confusion",
    "gather_front",
    "gather_surface",
]
