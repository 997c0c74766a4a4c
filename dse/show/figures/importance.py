"""Which parameters matter for each objective: permutation importance of a random forest, and means per value.

The forest predicts an objective from the parameters of designs that it was not fitted to. The importance of a
parameter is by how much the explained variance (R2) falls when its values are shuffled among these designs.

Source: Breiman, Machine Learning 45, 2001.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas

from dse.base import registry
from dse.base.records import Array
from dse.base.registry import fixed, register
from dse.show.figures import Results, full_read_outs, hardware_key, of_task, on_one_chip, task_key
from dse.show.figures.front import numbers
from dse.show.figures.labels import OKABE_ITO_LIGHT, Drawing, axis_title, drawn, label, safe
from dse.skyline.admissible import honest
from dse.skyline.pareto import members_of
from dse.skyline.table import group_numbers

MIN_DESIGNS = 10
"""Fewest designs of a task that a forest is fitted to."""

MAX_DESIGNS = 400
"""Most designs of a task that it is fitted to: an even sample of more."""

MAX_SLICES = 6
"""Most values of a parameter with a mean each; more numbers are joined in bins of equal counts."""

_N_FOLDS, _N_TREES, _N_SHUFFLES = 4, 40, 3  # a served page is gathered again while its study runs
_DIGITS, _MOST_BARS = 4, 12


@dataclass(frozen=True)
class Importance:
    """The importance of parameters for an objective, the most important first.

    objective: its column. names: of the parameters. importance, se: (parameter,) of each.
    r2: explained variance of designs left out. n: number of designs.
    """

    objective: str
    names: tuple[str, ...]
    importance: Array
    se: Array
    r2: float
    n: int


@register("figures", "importance")
@dataclass(frozen=True)
class ImportanceFigure:
    """Which parameters matter for an objective: permutation importance of a random forest."""

    objective: str = fixed("", doc="column of an objective (default: the first one)")
    hardware: str = hardware_key()
    task: str = task_key()

    def gather(self, results: Results) -> Importance:
        goals = dict(results.objectives)
        objective = self.objective or next(iter(goals))
        points = of_task(on_one_chip(results.points(), self.hardware), self.task)
        if objective not in points:
            raise ValueError(f"objective must be a column of the points, got '{objective}'")
        ranked = gather_importance(points, {objective: goals.get(objective, "min")})
        if not ranked:
            raise ValueError(f"{objective} needs {MIN_DESIGNS} designs that differ in it and in a parameter")
        of = ranked[0]["parameters"][:_MOST_BARS]
        names = tuple(one["column"] for one in of)
        values = np.array([[one["importance"], one["se"]] for one in of])
        return Importance(objective, names, values[:, 0], values[:, 1], ranked[0]["r2"], ranked[0]["n"])

    def draw(self, record: Importance) -> Drawing:
        """Draw a bar per parameter with its standard error, the most important on top."""
        names = [safe(label(name)[0]) for name in record.names]
        bars = {
            "type": "bar",
            "x": record.importance,
            "y": names,
            "orientation": "h",
            "marker": {"color": OKABE_ITO_LIGHT[0]},
            "error_x": {"type": "data", "array": record.se, "thickness": 1},
        }
        share = max(0.0, record.r2)
        of = f"{axis_title(record.objective)}; all explain {share:.0%} of {record.n} designs"
        title = f"loss of explained variance of {of}"
        layout = {
            "xaxis": {"title": {"text": title}, "rangemode": "tozero"},
            "yaxis": {"autorange": "reversed", "automargin": True},
            "showlegend": False,
        }
        return drawn([bars], layout)


def gather_importance(points: pandas.DataFrame, objectives: Mapping[str, str]) -> list[dict[str, Any]]:
    """Gather the importance of each parameter for each objective, over the answers at the end of recordings.

    Args:
        points: design points.
        objectives: column -> 'max' or 'min'.

    Returns:
        task and hardware, where they matter; objective; n: number of designs; r2: explained variance of
        designs left out, the reliability of the ranking;
        parameters: column, importance with its standard error over folds, and slices: value, n, mean and
        standard error of the objective; the most important first.
    """
    parameters = [name for name in map(str, points.columns) if "." in name]
    if not parameters or "trial" not in points:
        return []
    table = full_read_outs(points)
    table = table[honest(table)]
    on_chips = registry.columns("hardware")
    found = []
    for objective in objectives:
        by = ["task", *(["hardware"] if objective in on_chips else [])]
        identity = [name for name in ("trial", "task") if name in table]
        rows = table if objective in on_chips else table.drop_duplicates(identity)
        for group in members_of(group_numbers(rows, [name for name in by if name in rows])):
            of_group = rows.iloc[group]
            about = {name: str(of_group[name].iloc[0]) for name in by if name in of_group}
            known = of_group[np.isfinite(numbers(of_group, objective))]
            if len(known) > MAX_DESIGNS:
                known = known.iloc[np.linspace(0, len(known) - 1, MAX_DESIGNS).astype(int)]
            varied = [name for name in parameters if known[name].astype(str).nunique() > 1]
            if len(known) < MIN_DESIGNS or not varied or np.ptp(numbers(known, objective)) == 0:
                continue
            found.append(about | {"objective": objective} | _ranked(known, objective, varied))
    return found


def _ranked(rows: pandas.DataFrame, objective: str, parameters: list[str]) -> dict[str, Any]:
    """Return the importance of some parameters of some designs."""
    target = numbers(rows, objective)
    if target.min() > 0 and target.max() / target.min() > 100:
        target = np.log(target)  # decades would be those of the largest design alone
    r2, drops = _forest(np.column_stack([_codes(rows[name]) for name in parameters]), target)
    order = np.argsort(-drops.mean(axis=0), kind="stable")
    return {
        "n": len(rows),
        "r2": _short(r2),
        "parameters": [
            {
                "column": parameters[k],
                "importance": _short(max(0.0, float(drops[:, k].mean()))),
                "se": _short(float(drops[:, k].std(ddof=1) / np.sqrt(len(drops)))),
                "slices": _slices(rows, parameters[k], numbers(rows, objective)),
            }
            for k in order.tolist()
        ],
    }


def _forest(inputs: Array, target: Array) -> tuple[float, Array]:
    """Return the explained variance of designs left out, and its fall, (fold, shuffled input)."""
    from sklearn.ensemble import RandomForestRegressor

    rng = np.random.default_rng(0)
    fold = rng.permutation(np.arange(len(target)) % _N_FOLDS)
    total = float(((target - target.mean()) ** 2).mean())
    predicted = np.empty(len(target))
    drops = np.zeros((_N_FOLDS, inputs.shape[1]))
    for k in range(_N_FOLDS):
        out = fold == k
        forest = RandomForestRegressor(_N_TREES, random_state=k, n_jobs=1)
        forest.fit(inputs[~out], target[~out])
        predicted[out] = forest.predict(inputs[out])
        error = float(((predicted[out] - target[out]) ** 2).mean())
        for j in range(inputs.shape[1]):
            shuffled = np.tile(inputs[out], (_N_SHUFFLES, 1))
            shuffled[:, j] = np.concatenate([rng.permutation(inputs[out, j]) for _ in range(_N_SHUFFLES)])
            errors = (forest.predict(shuffled) - np.tile(target[out], _N_SHUFFLES)) ** 2
            drops[k, j] = (float(errors.mean()) - error) / total
    return 1 - float(((predicted - target) ** 2).mean()) / total, drops


def _codes(values: pandas.Series) -> Array:
    """Return a parameter as numbers for a tree: words in their order, missing values below all others."""
    number = pandas.to_numeric(values, errors="coerce")
    if number.notna().any() and number[values.notna()].notna().all():
        coded = np.asarray(number, np.float64)
        return np.where(np.isnan(coded), np.nanmin(coded) - 1, coded)
    codes, _ = pandas.factorize(values.astype(object).map(str), sort=True)
    return np.where(values.isna(), -1, codes).astype(np.float64)


def _slices(rows: pandas.DataFrame, parameter: str, target: Array) -> list[dict[str, Any]]:
    """Return mean, standard error and count of an objective at each value or bin of a parameter."""
    values = rows[parameter]
    number = numbers(rows, parameter)
    is_bool = values.map(lambda value: isinstance(value, bool | np.bool_)).any()
    is_number = bool(np.isfinite(number[values.notna().to_numpy()]).all()) and not is_bool
    distinct = np.unique(number[np.isfinite(number)]) if is_number else np.zeros(0)
    if is_number and len(distinct) > MAX_SLICES:
        edges = np.unique(np.quantile(number[np.isfinite(number)], np.linspace(0, 1, MAX_SLICES + 1)))
        place = np.clip(np.searchsorted(edges, number, side="right") - 1, 0, len(edges) - 2)
        parts = [(np.isfinite(number) & (place == k)) for k in range(len(edges) - 1)]
        named = [
            (f"{_short(float(number[part].min())):g} to {_short(float(number[part].max())):g}", part)
            for part in parts
            if part.any()
        ]
    elif is_number:
        named = [(f"{_short(float(value)):g}", number == value) for value in distinct]
    else:
        words = values[values.notna()].map(str)
        named = [(name, np.asarray(values.map(str) == name)) for name in sorted(set(words))]
        if len(named) > 4 * MAX_SLICES:  # words that hardly repeat have no means
            named = []
    if values.isna().any():
        named.append(("none", values.isna().to_numpy()))
    return [
        {"value": name, "n": int(part.sum()), "mean": _short(float(target[part].mean()))}
        | {"se": _short(float(target[part].std(ddof=1) / np.sqrt(part.sum()))) if part.sum() > 1 else None}
        for name, part in named
    ]


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
