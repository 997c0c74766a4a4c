"""Figures: each file gathers a record of plain numbers, then draws the record with plotly.

Contract: `gather_*` is pure and tested without a browser; `draw_*` adds no number of its own.
To add one: `dse/figures/<name>.py` with both, and a line here.
"""

from dse.figures.breakdown import draw_breakdown, gather_breakdown
from dse.figures.confusion import draw_confusion, gather_confusion
from dse.figures.core_map import draw_core_map, gather_core_map
from dse.figures.energy import draw_energy, gather_energy
from dse.figures.front import draw_front, gather_front
from dse.figures.grid import draw_grid, gather_grid
from dse.figures.isi import draw_distances, draw_isi, draw_isi_samples, gather_distances, gather_isi
from dse.figures.learning import draw_learning, gather_learning
from dse.figures.lengths import draw_lengths, gather_lengths, longest
from dse.figures.parallel import draw_parallel, gather_parallel
from dse.figures.precision import draw_precision, gather_precision
from dse.figures.progress import draw_progress, gather_progress
from dse.figures.raster import draw_recording, gather_recording
from dse.figures.recognition import draw_recognition, gather_recognition
from dse.figures.surface import draw_surface, draw_surfaces, gather_surface, stored_surface
from dse.figures.trial import TrialView, draw_course, draw_pins, gather_trial

__all__ = [
    "TrialView",
    "draw_breakdown",
    "draw_confusion",
    "draw_core_map",
    "draw_course",
    "draw_distances",
    "draw_energy",
    "draw_front",
    "draw_grid",
    "draw_isi",
    "draw_isi_samples",
    "draw_learning",
    "draw_lengths",
    "draw_parallel",
    "draw_pins",
    "draw_precision",
    "draw_progress",
    "draw_recognition",
    "draw_recording",
    "draw_surface",
    "draw_surfaces",
    "gather_breakdown",
    "gather_confusion",
    "gather_core_map",
    "gather_distances",
    "gather_energy",
    "gather_front",
    "gather_grid",
    "gather_isi",
    "gather_learning",
    "gather_lengths",
    "gather_parallel",
    "gather_precision",
    "gather_progress",
    "gather_recognition",
    "gather_recording",
    "gather_surface",
    "gather_trial",
    "longest",
    "stored_surface",
]
