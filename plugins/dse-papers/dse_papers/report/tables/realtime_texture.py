"""Real-time texture: accuracy and decision times by sample length, power on three platforms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.measure.decision import HUMAN_ACCURACY
from dse.show.report.designs import best, full_read_outs
from dse.show.report.rows import number
from dse_papers.report.ours import VALIDATION, Measure, Ours, Side, missing, of_column, over_runs
from dse_papers.report.papers import publication

if TYPE_CHECKING:
    import pandas

_PAPER = "000"
_NEAR = 0.02
_LOIHI = "Loihi 2"
# Platform of the paper -> how names of hardware profiles begin: of the same kind, then of the next.
_PLATFORMS = {"CPU": ("cpu",), "GPU": ("gpu",), _LOIHI: ("loihi2", "loihi1")}
_NO_LENGTH = missing("no network of this length")
_NOT_REACHED = "no setting reaches the human baseline"
_NO_DECISION = "at the end of the sample, without the decision maker"


def _row(side: Side, condition: Mapping[str, str]) -> pandas.Series[Any] | None:
    """Return the best network that was trained on samples of the printed length."""
    designs, length_ms = side.designs(), float(condition["length_ms"])
    lengths = designs["decision_latency_ms"].astype(float)
    return best(designs[(lengths - length_ms).abs() <= _NEAR * length_ms])


def _column(columns: Mapping[str, str], side: Side, condition: Mapping[str, str]) -> Ours:
    row = _row(side, condition)
    return _NO_LENGTH if row is None else of_column(side, row, columns)


def _setting(name: str, side: Side, condition: Mapping[str, str]) -> Ours:
    """Return a setting of the decision maker: each fold has its own, and their median is one of them."""
    row = _row(side, condition)
    if row is None:
        return _NO_LENGTH
    runs = side.part.arrays(int(row["trial"]), "read_out")
    each = sorted(x for run in runs if name in run and (x := number(run[name][-1])) is not None)
    if not each:
        grid = number(row.get("t_p_ms")) is not None
        return missing(_NOT_REACHED if grid else "the study has no decision grid")
    border = number(row.get("t_p_on_border")) if name.endswith("_p") else None
    why = "median over the folds" if len(each) > 1 else ""
    if border:
        why = f"{why}; " * bool(why) + f"on the border of its grid in {border:.0%} of the runs"
    return replace(over_runs(each, row), value=each[(len(each) - 1) // 2], se=None, why=why)


def _class_accuracy(side: Side, condition: Mapping[str, str]) -> Ours:
    row = _row(side, condition)
    if row is None:
        return _NO_LENGTH
    matrices, on_test = side.confusions(row)
    recalls = np.array([np.diag(matrix) / np.maximum(matrix.sum(axis=1), 1) for matrix in matrices])
    means = recalls.mean(axis=0)
    place = int(means.argmax() if condition["end"] == "best" else means.argmin())
    name = side.part.classes(int(row["trial"]))[place]
    why = name if on_test else f"{name}, {VALIDATION}"
    return replace(over_runs(recalls[:, place].tolist(), row), same=on_test, why=why)


def _theta_limit(side: Side, condition: Mapping[str, str]) -> Ours:
    row = side.chosen
    if row is None or number(row.get("t_p_ms")) is None:
        return missing("the study has no decision grid")
    limits = []
    for run in side.part.arrays(int(row["trial"]), "surface"):
        reached = run["accuracy"].max(axis=0) >= HUMAN_ACCURACY  # by some phi
        limits += [float(run["theta"][reached].max())] if reached.any() else []
    return replace(over_runs(limits, row), same=False, why=VALIDATION)


def _t_h(side: Side, condition: Mapping[str, str]) -> Ours:
    ours = _column({"t_h_test_ms": "", "t_h_ms": VALIDATION}, side, condition)
    if ours.value is None and ours.row is not None and number(ours.row.get("t_p_ms")) is not None:
        return replace(ours, why=_NOT_REACHED)
    return ours


def _least_t_h(side: Side, condition: Mapping[str, str]) -> Ours:
    several = [_t_h(side, {"length_ms": length}) for length in publication(_PAPER).table("t_h_ms")]
    known = [ours for ours in several if isinstance(ours.value, float)]
    return min(known, key=lambda ours: float(ours.value or 0)) if known else missing("no network reaches it")


def _t_h_reduction(side: Side, condition: Mapping[str, str]) -> Ours:
    least, earlier = _least_t_h(side, condition), publication(_PAPER).number("earlier_t_h")
    if not isinstance(least.value, float):
        return least
    return replace(least, value=100 * (1 - least.value / earlier), se=None, low=None, high=None)


def _on(side: Side, platform: str, column: str) -> Ours:
    """Return a column of the best design on a platform, on the profile that says most of our design.

    A profile that holds the printed power says nothing of our design; a chip of the next kind is another
    quantity.
    """
    chosen, points = side.chosen, side.part.study.points()
    if chosen is None or "hardware" not in points or column not in points:
        return missing(f"no {column} of a {platform} profile")
    full = full_read_outs(points[(points["trial"] == chosen["trial"]) & (points["task"] == side.part.task)])
    several = []
    for _, row in full.iterrows():
        name, value = str(row["hardware"]), number(row.get(column))
        prefix = next((k for k, x in enumerate(_PLATFORMS[platform]) if name.startswith(x)), None)
        if value is None or prefix is None:
            continue
        quoted = publication(_PAPER).source in side.part.study.chip(name).text
        why = f"profile {name}" + ", the printed power" * quoted + ", another chip" * (prefix > 0)
        low, high = number(row.get(f"{column}_low")), number(row.get(f"{column}_high"))
        ours = Ours(value, None, low, high, int(row["repeats"]), row, same=not (quoted or prefix), why=why)
        several.append((quoted, prefix, ours))
    return (
        min(several, key=lambda x: x[:2])[2] if several else missing(f"no {column} of a {platform} profile")
    )


def _power(side: Side, condition: Mapping[str, str]) -> Ours:
    state = condition["state"]
    ours = _on(side, condition["platform"], "power_idle_w" if state == "idle" else "power_w")
    if state != "beyond idle" or ours.row is None or ours.value is None:
        return ours
    idle = number(ours.row.get("power_idle_w"))
    if idle is None:
        return replace(missing(f"{ours.why}: no power at rest"), row=ours.row)
    return replace(ours, value=float(ours.value) - idle, low=None, high=None)


def _power_reduction(side: Side, condition: Mapping[str, str]) -> Ours:
    chip, other = (_on(side, platform, "power_w") for platform in (_LOIHI, condition["platform"]))
    if chip.value is None or other.value is None:
        return chip if chip.value is None else other
    value, why = 100 * (1 - float(chip.value) / float(other.value)), f"{chip.why}; {other.why}"
    return Ours(value, row=chip.row, runs=chip.runs, same=chip.same and other.same, why=why)


def _cores(side: Side, condition: Mapping[str, str]) -> Ours:
    ours = _on(side, condition["platform"], "n_cores")
    if "printed power" in ours.why:
        return missing(f"no n_cores of a {condition['platform']} profile")
    return replace(ours, low=None, high=None)


OURS: Mapping[str, Measure] = {
    "accuracy": partial(
        _column,
        {
            "accuracy_at_t_p_test": "",
            "accuracy_test": _NO_DECISION,
            "accuracy": f"{_NO_DECISION}, {VALIDATION}",
        },
    ),
    "t_p_ms": partial(_column, {"t_p_test_ms": "", "t_p_ms": VALIDATION}),
    "t_h_ms": _t_h,
    **{name: partial(_setting, name) for name in ("theta_p", "phi_p", "theta_h", "phi_h")},
    "recall": partial(_column, {"recall_macro_test": "", "recall_macro": VALIDATION}),
    "precision": partial(_column, {"precision_macro_test": "", "precision_macro": VALIDATION}),
    "f1": partial(_column, {"f1_macro_test": "", "f1_macro": VALIDATION}),
    "class_accuracy": _class_accuracy,
    "theta_limit": _theta_limit,
    "least_t_h_ms": _least_t_h,
    "t_h_reduction": _t_h_reduction,
    "power_w": _power,
    "power_reduction": _power_reduction,
    "n_cores": _cores,
}
