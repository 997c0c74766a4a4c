"""The figures of a study as methods: `study.plot.front()` draws figure `front` with its own defaults."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dse import registry
from dse.config.faults import known_names
from dse.figures import Results, draw

if TYPE_CHECKING:
    import plotly.graph_objects


class Plots:
    """The figures of a study; a figure's keys (`dse describe figures NAME`) are arguments of its method.

    A first argument without a name is the design: a trial's number or a row with one, such as `study.best()`.
    """

    def __init__(self, results: Results) -> None:
        """Draw figures of these results."""
        self._results = results

    def __getattr__(self, name: str) -> functools.partial[plotly.graph_objects.Figure]:
        """Return what draws a figure.

        Raises:
            AttributeError: there is no such figure.
        """
        figures = registry.known("figures")
        if name not in figures:
            where = registry.elsewhere("figures", name)
            raise AttributeError(f"unknown figure '{name}'{where}; {known_names(name, figures)}")
        return functools.partial(self._drawn, name)

    def _drawn(self, name: str, design: Any = None, **keys: Any) -> plotly.graph_objects.Figure:
        """Draw a figure.

        Raises:
            ValueError: the figure has no such key, needs another one, or has nothing to show.
            TypeError: the design is something else.
        """
        return draw(self._results, name, **({} if design is None else {"trial": _trial(design)}), **keys)

    def __dir__(self) -> list[str]:
        return sorted(registry.known("figures"))

    def __repr__(self) -> str:
        return f"<figures: {', '.join(dir(self))}>"


def _trial(design: Any) -> int:
    """Return the number of a trial, given as such or by a row of a table."""
    try:
        return int(design["trial"] if isinstance(design, Mapping) or hasattr(design, "items") else design)
    except (TypeError, ValueError, KeyError):
        raise TypeError(f"design must be a trial's number or a row of a table, got {design!r}") from None
