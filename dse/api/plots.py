"""The figures of a study as methods: `study.plot.front()` draws figure `front` with its own defaults."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from dse import registry
from dse.config.faults import known_names
from dse.config.values import keys_of
from dse.figures import Results, draw

if TYPE_CHECKING:
    import plotly.graph_objects


class Plots:
    """The figures of a study; a figure's keys (`dse describe figures NAME`) are arguments of its method."""

    def __init__(self, results: Results) -> None:
        """Draw figures of these results."""
        self._results = results

    def __getattr__(self, name: str) -> Callable[..., plotly.graph_objects.Figure]:
        """Return what draws a figure.

        Raises:
            AttributeError: there is no such figure.
        """
        figures = registry.known("figures")
        if name not in figures:
            where = registry.elsewhere("figures", name)
            raise AttributeError(f"unknown figure '{name}'{where}; {known_names(name, figures)}")

        def drawn(design: Any = None, **keys: Any) -> plotly.graph_objects.Figure:
            """Draw the figure.

            Args:
                design: a trial's number or a row with one, such as `study.best()`; None: the figure's
                    default.
                keys: of the figure.

            Raises:
                ValueError: the figure has no such key, or nothing to show.
                TypeError: the design is something else, or the figure needs a key.
            """
            if design is not None:
                keys = {"trial": _trial(design)} | keys
            known = keys_of(figures[name])
            if strange := [key for key in keys if key not in known]:
                raise ValueError(f"figure {name} has no key '{strange[0]}'; {known_names(strange[0], known)}")
            if lacks := [key for key, about in known.items() if about.default is None and key not in keys]:
                raise TypeError(f"figure {name} needs {lacks[0]}: {known[lacks[0]].rule.doc}")
            return draw(self._results, name, **keys)

        drawn.__name__, drawn.__doc__ = name, figures[name].__doc__
        return drawn

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
