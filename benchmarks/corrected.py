"""Whether the corrected accuracy of a chosen design is what it shows on recordings it was not chosen on.

    python -m benchmarks.corrected STUDY [STUDY ...] [--budgets 400] [--splits 50]

Points are chosen as `dse pick` does: the most accurate within one or two random limits of costs, on a random
chip. Printed per task: what is shown of them less their accuracy on the test recordings, for the accuracy on
validation and for the corrected one: the mean, the largest, and how often the test accuracy lies in the
shown 90 % interval, widened by the test's own error.

Rows `halves` choose on one half of the validation and test recordings together and test on the other, for
many random halves, at the trained precision: easy recordings cancel there, and what the choice adds is left.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from dse.base.records import Array
from dse.measure.objectives.accuracy import wilson_interval, wilson_se
from dse.study import corrected, precision, resampling, results
from dse.study.record import load_records

COSTS = (
    "energy_uj",
    "latency_ms",
    "n_weights",
    "spikes_per_inference",
    "hardware_latency_ms",
    "memory_bytes",
)
SHOWN = ("accuracy", "accuracy_corrected")
_FILES = ("response.npz", "response_test.npz")
_SEED = 11


def main() -> None:
    """Choose, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("studies", nargs="+", type=Path)
    parser.add_argument("--budgets", type=int, default=400, help="choices per study and row of the table")
    parser.add_argument("--splits", type=int, default=50, help="random halves")
    options = parser.parse_args()
    columns = [f"{name.removeprefix('accuracy_')} {x}" for name in SHOWN for x in ("mean", "worst", "within")]
    table = Table("study", "task", "recordings", "picks", *columns)
    for folder in options.studies:
        picks = chosen(folder, options.budgets, options.splits)
        for (task, recordings), alike in picks.groupby(["task", "recordings"]):
            cells = [cell for name in SHOWN for cell in summary(alike, name)]
            table.add_row(folder.name, task, recordings, str(len(alike)), *cells)
    Console(width=150).print(table)


def chosen(folder: Path, n_budgets: int, n_splits: int) -> pd.DataFrame:
    """Return a row per choice: what is shown of the chosen point, and its accuracy on the test recordings."""
    points = results.open(folder).points().sort_values("trial", kind="stable")
    n = int(load_records(folder, int(points["trial"].iloc[0]))[0].samples["validation"])
    picks = []
    for _, of_task in points.groupby("task"):
        rng = np.random.default_rng(_SEED)
        picks.append(picked(of_task, rng, n_budgets, n).assign(recordings="as split"))
        trained = precision.as_trained(of_task)
        right = answers(folder, trained)
        for order in halves(rng, len(right), n_splits):
            half, other = np.array_split(right[order], 2)
            divided = divided_anew(trained, half.mean(axis=0), other.mean(axis=0), len(half))
            of_half = picked(divided, rng, n_budgets // n_splits, len(half))
            picks.append(of_half.assign(recordings="halves"))
    return pd.concat(picks)


def halves(rng: np.random.Generator, n: int, number: int) -> Iterator[Array]:
    """Yield orders of recordings; every other one exchanges the halves of the one before."""
    for _ in range(number // 2):
        order = rng.permutation(n)
        yield order
        yield np.roll(order, n // 2)


def picked(points: pd.DataFrame, rng: np.random.Generator, n_budgets: int, n: int) -> pd.DataFrame:
    """Return the most accurate point within random limits, for many of them, with intervals."""
    chips = [rows for _, rows in points.groupby("hardware")]
    best = []
    for _ in range(n_budgets):
        rows = chips[rng.integers(len(chips))]
        rows = rows[rows["fits"].astype("boolean").fillna(False) & np.isfinite(rows["energy_uj_high"])]
        for cost in rng.choice(COSTS, rng.integers(1, 3), replace=False):
            rows = rows[rows[cost] <= rows[cost].quantile(rng.uniform(0.02, 1))]
        best += [rows["accuracy"].idxmax()] if len(rows) else []
    row = points.loc[best, ["task", "accuracy_test", "accuracy", *corrected.corrected_of("accuracy")]]
    low, high = wilson_interval(row["accuracy"], n, corrected.Z)
    return row.assign(accuracy_low=low, accuracy_high=high, n=n)


def summary(picks: pd.DataFrame, name: str) -> list[str]:
    """Return the mean and largest of what is shown less the test, and how often the interval has the test."""
    shown, test = picks[name], picks["accuracy_test"]
    error = corrected.Z * wilson_se(np.rint(test * picks["n"]), picks["n"])
    low, high = (np.hypot(shown - picks[f"{name}_{end}"], error) for end in ("low", "high"))
    within = (test >= shown - low) & (test <= shown + high)
    apart = (shown - test).to_numpy()
    return [f"{apart.mean():+.3f}", f"{apart[abs(apart).argmax()]:+.3f}", f"{within.mean():.0%}"]


def divided_anew(points: pd.DataFrame, accuracy: Array, test: Array, n: int) -> pd.DataFrame:
    """Return points, sorted by trial, with other accuracies, corrected as those of a study are."""
    points = points.assign(accuracy=accuracy, accuracy_test=test)
    read = ["trial", "task", "repeats", "transductive", "accuracy"]
    parts = [
        {name: rows[name].to_numpy() for name in read} for _, rows in points.groupby("trial", sort=False)
    ]
    asked = dict.fromkeys(points["trial"], corrected.Asked(n, n))
    counted = sum((corrected.tally(part, ["accuracy"], asked) for part in parts), Counter())
    known = corrected.values(counted)
    columns = [corrected.with_corrected(part, ["accuracy"], asked, known) for part in parts]
    names = corrected.corrected_of("accuracy")
    return points.assign(**{name: np.concatenate([x[name] for x in columns]) for name in names})


def answers(folder: Path, points: pd.DataFrame) -> Array:
    """Return which recordings, of validation and then of test, each point answers right, (n, row)."""
    right = []
    for trial, rows in points.groupby("trial", sort=False):
        record = load_records(folder, int(str(trial)))[0]
        right.append(
            np.concatenate([resampling.right_answers(folder, record, rows, name)[1] for name in _FILES])
        )
    return np.concatenate(right, axis=1)


if __name__ == "__main__":
    main()
