"""Figures that papers print, and that studies of ours redraw."""

from dse_papers.figures import grid, histograms, intervals, lengths, preprocessing, psth, surface, sweep

__all__ = ["grid", "histograms", "intervals", "lengths", "preprocessing", "psth", "surface", "sweep"]
