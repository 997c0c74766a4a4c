"""Rate windows and HOTS: accuracy and t_C on printed pins and on natural textures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from dse.show.report.designs import StudyTask, best, sections_of
from dse_papers.report.facts import is_artificial, scene_of
from dse_papers.report.ours import ACCURACY, Measure, Ours, Side, missing, of_column, over_runs

_COUNTING = ("knn", "naive_bayes", "mlp")


def labels(part: StudyTask) -> dict[str, str]:
    """Return whether the textures are printed pins (artificial) or others (natural)."""
    scene = scene_of(part, sections_of(part.study.folder, int(part.table["trial"].iloc[0])))
    return {"textures": "artificial" if is_artificial(scene) else "natural"}


def _column(columns: Mapping[str, str], side: Side, condition: Mapping[str, str]) -> Ours:
    row = best(side.designs(condition["family"]))
    return _no(condition["family"]) if row is None else of_column(side, row, columns)


def _hots(side: Side, condition: Mapping[str, str]) -> Ours:
    designs, n = side.designs("hots"), int(condition["layers"])
    layers = [int(getattr(side.part.model(int(trial)), "layers", 0)) for trial in designs["trial"]]
    row = best(designs[np.array(layers, dtype=int) == n])
    return _no(f"hots of {n} layers") if row is None else of_column(side, row, ACCURACY)


def _window(side: Side, condition: Mapping[str, str]) -> Ours:
    row = best(side.designs(*_COUNTING))
    if row is None:
        return _no(" or ".join(_COUNTING))
    window_ms = float(getattr(side.part.model(int(row["trial"])), "window_ms", 0))
    return replace(over_runs([window_ms], row), why=f"of {row['family']}, the most accurate")


def _onset(side: Side, condition: Mapping[str, str]) -> Ours:
    return missing("`dse figure RESULTS psth` draws it; the paper reads it off its figure")


def _no(what: str) -> Ours:
    return missing(f"the study has no {what}")


OURS: Mapping[str, Measure] = {
    "accuracy": partial(_column, ACCURACY),
    "t_c_ms": partial(_column, {"t_c_ms": ""}),
    "hots_accuracy": _hots,
    "window_ms": _window,
    "onset_ms": _onset,
}
