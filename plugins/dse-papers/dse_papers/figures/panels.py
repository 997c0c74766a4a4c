"""A panel for every class, in rows of equal size, with one scale for all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dse.base.records import Dataset, Ints
from dse.show.figures.labels import safe

if TYPE_CHECKING:
    import plotly.graph_objects

MOST_COLUMNS = 4
_ROW_PX, _MARGIN_PX = 130, 90


def class_panels(
    names: Sequence[str], x_title: str, y_title: str, top: float, most_columns: int = MOST_COLUMNS
) -> tuple[plotly.graph_objects.Figure, list[tuple[int, int]]]:
    """Return an empty figure with a panel for every class, and the row and column of each panel, from 1.

    Args:
        names: of the classes.
        x_title: below all panels.
        y_title: beside all panels.
        top: largest value of any panel.
        most_columns: panels in a row, at most.
    """
    from plotly.subplots import make_subplots

    n_columns = min(len(names), most_columns)
    n_rows = -(-len(names) // n_columns)
    figure = make_subplots(
        rows=n_rows,
        cols=n_columns,
        subplot_titles=[safe(name) for name in names],
        shared_xaxes=True,
        shared_yaxes=True,
        x_title=x_title,
        y_title=y_title,
        horizontal_spacing=0.16 / n_columns,
        vertical_spacing=min(0.5 / n_rows, 34 / (_ROW_PX * n_rows)),
    )
    figure.update_annotations(font_size=12)
    figure.update_layout(
        showlegend=False,
        height=max(3 * _ROW_PX, _ROW_PX * n_rows + _MARGIN_PX),
        margin={"l": 72, "r": 16, "t": 32, "b": 60},
    )
    # Axes that share a scale are not scaled to their data.
    figure.update_yaxes(range=[0, 1.05 * top or 1.0], nticks=5)
    figure.update_xaxes(nticks=4, tickangle=0)
    places = [(k // n_columns + 1, k % n_columns + 1) for k in range(len(names))]
    for row, column in places[-n_columns:]:  # the last row may be shorter
        figure.update_xaxes(showticklabels=True, row=row, col=column)
    return figure, places


def task_labels(dataset: Dataset, task: str = "") -> tuple[Ints, tuple[str, ...]]:
    """Return the class of every sample, (n,), and the names of the classes.

    Args:
        dataset: with a single target or a joint one.
        task: head of a joint target; '': the first.

    Raises:
        ValueError: the target has no such head.
    """
    if not dataset.heads:
        if task:
            raise ValueError(f"task must be absent, because the target is not joint, got '{task}'")
        return dataset.target, dataset.classes
    heads = {head.name: head for head in dataset.heads}
    if task and task not in heads:
        raise ValueError(f"task must be one of {', '.join(heads)}, got '{task}'")
    head = heads[task] if task else dataset.heads[0]
    return np.where(dataset.target < 0, -1, head.of_class[dataset.target]), head.classes


def chosen_classes(names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Return the numbers of the named classes, of all where none is named.

    Raises:
        ValueError: there is no such class.
    """
    for name in wanted:
        if name not in names:
            raise ValueError(f"classes must be of {', '.join(names)}, got '{name}'")
    return [names.index(name) for name in wanted] or list(range(len(names)))
