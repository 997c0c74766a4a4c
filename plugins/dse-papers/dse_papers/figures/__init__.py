"""Figures that papers print, and that studies of ours redraw."""

from dse_papers.figures import grid, intervals, lengths, psth, surface

__all__ = ["grid", "intervals", "lengths", "psth", "surface"]
