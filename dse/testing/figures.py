"""The contract of a figure."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from dse.show.figures import Figure, Results
from dse.testing.expect import expect, expect_component, same, unchanged
from dse.testing.small import SmallStudy


def check_figure(figure: Figure[Any], results: Results | None = None) -> None:
    """Check a figure: what it gathers are plain numbers, and what it draws is a plotly figure of them.

    Args:
        figure: with keys that suit the study.
        results: a study; absent: a small one, with axes model.hidden and window.n_steps.

    Raises:
        AssertionError: what it violates.
    """
    import plotly.graph_objects as go

    name = expect_component(figure)
    study = SmallStudy() if results is None else results
    record = figure.gather(study)
    expect(
        dataclasses.is_dataclass(record) or isinstance(record, tuple),
        f"{name}.gather must return a dataclass, or a tuple of them, got {type(record).__name__}",
    )
    strange = _strange(record)
    expect(strange is None, f"{name}.gather must return plain numbers, arrays and texts, got {strange}")
    expect(same(record, figure.gather(study)), f"{name}.gather must return the same numbers twice")
    drawn = unchanged(f"{name}.draw", figure.draw, record)
    expect(
        isinstance(drawn, go.Figure), f"{name}.draw must return a plotly figure, got {type(drawn).__name__}"
    )
    expect(drawn.data, f"{name}.draw must draw something")
    text = drawn.to_json()
    expect(json.loads(text), f"{name}.draw must return a figure that JSON can hold")
    expect(text == figure.draw(record).to_json(), f"{name}.draw must draw the same twice")


def _strange(value: Any) -> str | None:
    """Return the type of what is no plain number, array, text or record of them; None where all is plain."""
    if value is None or isinstance(value, bool | int | float | str | np.generic):
        return None
    if isinstance(value, np.ndarray):
        return None if value.dtype.kind in "biufU" else f"an array of {value.dtype}"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = [getattr(value, field.name) for field in dataclasses.fields(value)]
    elif isinstance(value, Mapping):
        parts = list(value.values())
    elif isinstance(value, list | tuple):
        parts = list(value)
    else:
        return f"a {type(value).__name__}"
    return next((strange for strange in map(_strange, parts) if strange is not None), None)
