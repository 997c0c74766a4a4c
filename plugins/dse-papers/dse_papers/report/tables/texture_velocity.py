"""Texture and velocity: ends of the front, their reductions, rank correlations, kinds of profile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.show.report.designs import StudyTask, best, sections_of
from dse.show.report.rows import number
from dse_papers.report.correlation import spearman
from dse_papers.report.ends import front_ends
from dse_papers.report.facts import of_movement, scene_of
from dse_papers.report.ours import (
    ACCURACY,
    SPREAD,
    VALIDATION,
    Measure,
    Ours,
    Side,
    missing,
    of_column,
    over_runs,
)
from dse_papers.report.papers import publication

if TYPE_CHECKING:
    import pandas

_PAPER = "002"
_BEST = "best accuracy"
_TEST, _VALIDATION = "accuracy_test", "accuracy"
_CHOICE = "spikes_per_inference_no_input"
_S = {"spikes_total_no_input": ""}
_COST = {"spikes": "spikes_total_no_input", "n_weights": "n_weights"}


def labels(part: StudyTask) -> dict[str, str]:
    """Return what is predicted: a texture or a movement."""
    return {"task": "movement" if of_movement(part) else "texture"}


def _designs(side: Side) -> pandas.DataFrame:
    """Return the networks of one task; cascades only where there are no others."""
    plain = side.designs("snn")
    return side.designs("cascade") if plain.empty else plain


def _end(side: Side, end: str) -> pandas.Series[Any] | None:
    """Return an end of the front, which validation selects."""
    designs = _designs(side)
    if end == _BEST:
        return best(designs)
    if designs.empty:
        return None
    chosen = front_ends(designs, _CHOICE).get(end)
    return None if chosen is None else designs.loc[chosen]


def _column(columns: Mapping[str, str], side: Side, condition: Mapping[str, str]) -> Ours:
    return of_column(side, _end(side, condition.get("end", _BEST)), columns)


def _spikes(side: Side, condition: Mapping[str, str]) -> Ours:
    """Return S of the test set; a test set of another size has another S."""
    ours = _column(_S, side, condition)
    printed_n = publication(_PAPER).number("n_test")
    if not isinstance(ours.value, float) or side.n_test in (0, printed_n):
        return ours
    printed = publication(_PAPER).number("spikes", condition["task"], condition["end"])
    why = f"per test sample {ours.value / side.n_test:.0f}, printed {printed / printed_n:.0f}"
    return replace(ours, why=why)


def _setting(name: str, side: Side, condition: Mapping[str, str]) -> Ours:
    row = _end(side, _BEST)
    if row is None:
        return missing("no such design")
    return over_runs([float(np.sum(getattr(side.part.model(int(row["trial"])), name)))], row)


def _spearman(side: Side, condition: Mapping[str, str]) -> Ours:
    designs, cost = _designs(side), _COST[condition["figure"]]
    if cost not in designs or designs[cost].isna().any():
        cost = _CHOICE
    on_test = _on_test(designs)
    accuracy = designs[_TEST if on_test else _VALIDATION].to_numpy(float)
    rho = number(spearman(accuracy, designs[cost].to_numpy(float)))
    if rho is None:
        return missing("fewer than two designs, or all of them alike")
    why = "" if on_test else VALIDATION
    return Ours(rho, runs=None, same=on_test, why="; ".join(filter(None, [f"{len(designs)} designs", why])))


def _on_test(designs: pandas.DataFrame) -> bool:
    return _TEST in designs and bool(np.isfinite(designs[_TEST].to_numpy(float)).all()) and not designs.empty


def _gain_of_size(side: Side, condition: Mapping[str, str]) -> Ours:
    """Return how much more accurate the best of the larger networks is."""
    designs = _designs(side)
    hidden = np.array([np.sum(getattr(side.part.model(int(t)), "hidden", 0)) for t in designs["trial"]])
    sizes = [int(text) for text in condition["sizes"].split(" to ")]
    ends = [of_column(side, best(designs[hidden == size]), ACCURACY) for size in sizes]
    if missing_sizes := [size for size, end in zip(sizes, ends, strict=True) if end.value is None]:
        return missing(f"no designs of {' and '.join(map(str, missing_sizes))} hidden neurons")
    small, large = (float(end.value or 0) for end in ends)
    return Ours(100 * (large - small), row=ends[1].row, same=ends[1].same, why=ends[1].why)


def _groups(side: Side, condition: Mapping[str, str]) -> Ours:
    """Return the accuracy on the profiles of one kind, whose classes are named after it."""
    kind = condition["kind"]
    return _share(side, lambda names: [(k, [k]) for k, x in enumerate(names) if x.startswith(kind)])


def _confused(side: Side, condition: Mapping[str, str]) -> Ours:
    """Return how often profile 5 is answered as 6 or 7, counted from 0 in the order of the scene."""
    row = _end(side, _BEST)
    scene = (
        None if row is None else scene_of(side.part, sections_of(side.part.study.folder, int(row["trial"])))
    )
    if scene is None or len(scene.motions) < 8:
        return missing("profiles are not those of a scene with eight or more")
    motions = [motion.label for motion in scene.motions]

    def taken_for(names: list[str]) -> list[tuple[int, list[int]]]:
        places = [names.index(motions[k]) for k in (5, 6, 7)]
        return [(places[0], places[1:])]

    ours = _share(side, taken_for)
    text = f"{motions[5]} as {motions[6]} or {motions[7]}"
    percent: dict[str, Any] = {x: 100 * y for x, y in vars(ours).items() if x in SPREAD and y is not None}
    return replace(ours, **percent, why="; ".join(filter(None, [text, ours.why])))


def _share(side: Side, cells: Any) -> Ours:
    """Return the fraction of the samples of some classes that got some answers.

    Args:
        side: the designs.
        cells: names of the classes -> (true class, answers) each.
    """
    row = _end(side, _BEST)
    if row is None:
        return missing("no such design")
    chosen = cells(side.part.classes(int(row["trial"])))
    matrices, on_test = side.confusions(row)
    shares = []
    for matrix in matrices:
        total = sum(matrix[k].sum() for k, _ in chosen)
        if total:
            shares.append(sum(matrix[k, answers].sum() for k, answers in chosen) / total)
    if not shares:
        return missing("no samples of these classes, which are recognised by their names")
    return replace(over_runs(shares, row), same=on_test, why="" if on_test else VALIDATION)


def _reduction(columns: Mapping[str, str], side: Side, condition: Mapping[str, str]) -> Ours:
    """Return in per cent how much less an end of the front has than the most accurate design."""
    peak, end = (_column(columns, side, {**condition, "end": name}) for name in (_BEST, condition["end"]))
    if not isinstance(peak.value, float) or not isinstance(end.value, float) or not peak.value:
        return peak if peak.value is None else end
    value = 100 * (1 - end.value / peak.value)
    return Ours(value, runs=end.runs, row=end.row, same=peak.same and end.same, why=end.why)


def _every_accuracy(side: Side, condition: Mapping[str, str]) -> Ours:
    designs = _designs(side)
    on_test = _on_test(designs)
    values = designs[_TEST if on_test else _VALIDATION].astype(float)
    if values.isna().all():
        return missing("no such design")
    return replace(of_column(side, designs.iloc[int(np.nanargmin(values))], ACCURACY), same=on_test)


OURS: Mapping[str, Measure] = {
    "accuracy": partial(_column, ACCURACY),
    "spikes": _spikes,
    "n_weights": partial(_column, {"n_weights": ""}),
    "hidden": partial(_setting, "hidden"),
    "true_rate": partial(_setting, "true_rate"),
    "accuracy_in_text": partial(_column, ACCURACY),
    "spearman": _spearman,
    "gain_of_size": _gain_of_size,
    "groups": _groups,
    "confused": _confused,
    "spikes_reduction": partial(_reduction, _S),
    "weights_reduction": partial(_reduction, {"n_weights": ""}),
    "accuracy_loss": partial(_reduction, ACCURACY),
    "every_accuracy": _every_accuracy,
}
