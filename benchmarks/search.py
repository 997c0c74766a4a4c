"""Which sampler reaches the front of a study with the fewest training steps: samplers replayed on its table.

    python -m benchmarks.search RESULTS/STUDY [--seeds 5] [--batch 4] [--limit "n_weights <= 2000"]

The study has trained every design of its grid. A sampler asks for designs, and is told what the table says,
so a search takes seconds. Printed: the share of the grid's hypervolume after 5 to 50 % of its training steps,
and the training steps to 95 and 99 %, medians over seeds, as percentages of the grid's. Objectives are those
of the study, weights and energies on a logarithmic scale, each from 0 (best of the grid) to 1 (worst); the
reference point is 1.05.

Without seeds of its own, `grid` is one order, that of the file: the smallest networks first, or last.

`optuna, usual`: one objective, the first; default sampler; every axis a category; MedianPruner on the
training accuracy after each epoch, the only curve that a study stores; designs that are proposed again are
trained again. With `--limit`, samplers know it before they propose, and `optuna, usual` is told after
training; the hypervolume counts designs within the limit alone.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import moocore
import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from dse import store
from dse.base import registry, seeds
from dse.base.records import Bools, Floats
from dse.config import SearchSpace, load_space
from dse.search.limits import Exclusion
from dse.search.proposals import Sampler, limited
from dse.skyline.constraints import matches
from dse.study.ledger import read_entries

SAMPLERS = ("grid", "random", "sobol", "tpe", "nsga2", "nsga3", "gp")
USUAL = "optuna, usual"
SHARES = (0.05, 0.1, 0.15, 0.25, 0.5)
TARGETS = (0.95, 0.99)
REFERENCE = 1.05


@dataclass(frozen=True)
class Grid:
    """An exhaustively trained grid.

    place: key of a design -> its row. values: (row, objective), NaN of a failed design.
    costs: (row, objective), all minimised, 0 to 1. curves: training accuracy (row, epoch).
    allowed: (row,) within the limit.
    """

    space: SearchSpace
    designs: list[dict[str, Any]]
    place: dict[str, int]
    values: Floats
    costs: Floats
    curves: Floats
    allowed: Bools

    def hypervolume(self, rows: Sequence[int]) -> float:
        """Return the hypervolume of some designs as a share of the grid's."""
        return self._volume(np.asarray(rows, int)) / self._volume(np.arange(len(self.costs)))

    def _volume(self, rows: np.ndarray) -> float:
        rows = rows[self.allowed[rows] & np.isfinite(self.costs[rows]).all(axis=1)]
        if not rows.size:
            return 0.0
        return float(moocore.hypervolume(self.costs[rows], ref=[REFERENCE] * self.costs.shape[1]))


def read(folder: Path, limit: str) -> Grid:
    """Return the grid of a study."""
    space = load_space(folder / "search_space.yaml")
    entries = [entry for entry in read_entries(folder) if not entry.excluded]
    table = pd.read_parquet(folder / "trials.parquet").set_index("trial")
    table = table.loc[[entry.trial for entry in entries]]
    names = [name for name, _ in space.objectives]
    values = np.where(
        (table["status"] == "finished").to_numpy()[:, None], table[names].to_numpy(float), np.nan
    )
    costs = values.copy()
    for column, (name, direction) in enumerate(space.objectives):
        x = np.log10(values[:, column]) if name.startswith(("n_weights", "energy")) else values[:, column]
        x = x if direction == "min" else -x
        costs[:, column] = (x - np.nanmin(x)) / (np.nanmax(x) - np.nanmin(x))
    curves = []
    for entry in entries:
        path = store.run_file(folder, entry.trial, 0) / "history.npz"
        curves.append(np.load(path)["accuracy_train"] if path.exists() else np.array([]))
    n_epochs = max(map(len, curves))
    padded = np.array([np.pad(x, (0, n_epochs - len(x)), constant_values=np.nan) for x in curves])
    allowed = matches(limit, table.reset_index()) if limit else np.ones(len(table), bool)
    designs = [dict(entry.design) for entry in entries]
    place = {seeds.design_key(design): row for row, design in enumerate(designs)}
    return Grid(space, designs, place, values, costs, padded, allowed)


Trace = list[tuple[float, int]]
"""Training steps of a design in epochs, and its row, in the order of training."""


def replayed(grid: Grid, name: str, seed: int, batch: int, limit: str) -> Trace:
    """Return what a sampler of `dse` trains, until the grid is trained."""
    search = dataclasses.replace(grid.space.search, sampler=name, batch=batch)
    space = dataclasses.replace(grid.space, seed=seed, search=search)
    cls: Any = registry.known("search.samplers")[name]
    sampler: Sampler = cls().start(space, [direction for _, direction in space.objectives])
    if limit:

        def check(design: Any) -> Exclusion | None:
            is_allowed = grid.allowed[grid.place[seeds.design_key(design)]]
            return None if is_allowed else Exclusion("beyond the limit", (), {limit: 1.0})

        sampler = limited(sampler, check)
    n_epochs = grid.curves.shape[1]
    trace: Trace = []
    most = 40 if name == "gp" else len(grid.designs)  # a Gaussian process takes seconds per design
    while len(trace) < most and (designs := sampler.ask(batch)):
        rows = [grid.place[seeds.design_key(design)] for design in designs]
        trace += [(n_epochs, row) for row in rows]
        values = [
            None if np.isnan(grid.values[row]).any() else tuple(grid.values[row].tolist()) for row in rows
        ]
        sampler.tell(designs, values)
    return trace


def usual(grid: Grid, seed: int, limit: str) -> Trace:
    """Return what Optuna trains with one objective, categories and its pruner."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    direction = "maximize" if grid.space.objectives[0][1] == "max" else "minimize"
    study = optuna.create_study(direction=direction, sampler=optuna.samplers.TPESampler(seed=seed))
    axes = {name: axis.values or () for name, axis in grid.space.axes.items()}
    trace: Trace = []
    n_epochs = grid.curves.shape[1]
    for _ in range(len(grid.designs)):
        trial = study.ask()
        design = {name: xs[trial.suggest_categorical(name, range(len(xs)))] for name, xs in axes.items()}
        row = grid.place[seeds.design_key(design)]
        value, steps = grid.values[row, 0], 0
        pruned = False
        for epoch, accuracy in enumerate(grid.curves[row]):
            if np.isnan(accuracy):
                break
            steps += 1
            trial.report(float(accuracy), epoch)
            if pruned := epoch < n_epochs - 1 and trial.should_prune():
                break
        if limit:
            trial.set_constraint(limit, 0.0 if grid.allowed[row] else 1.0)
        if pruned:
            study.tell(trial, state=optuna.trial.TrialState.PRUNED)
        elif np.isnan(value):
            study.tell(trial, state=optuna.trial.TrialState.FAIL)
        else:
            study.tell(trial, float(value))
        trace.append((steps, -1 if pruned else row))
    return trace


def growth(grid: Grid, trace: Trace) -> tuple[Floats, Floats]:
    """Return training steps, as shares of the grid's, and the share of its hypervolume after each design."""
    total = grid.curves.shape[1] * len(grid.designs)
    steps = np.cumsum([steps for steps, _ in trace]) / total
    rows = [row for _, row in trace]
    best, volumes, trained = 0.0, [], []
    for row in rows:
        if row >= 0 and row not in trained:
            trained.append(row)
            best = grid.hypervolume(trained)
        volumes.append(best)
    return steps, np.array(volumes)


def searched(grid: Grid, name: str, seed: int, batch: int, limit: str) -> Trace:
    """Return what a sampler trains, by its name in the table."""
    if name == USUAL:
        return usual(grid, seed, limit)
    return replayed(grid, name, seed, batch, limit)


def row_of(grid: Grid, traces: Sequence[Trace]) -> list[str]:
    """Return the cells of a sampler: medians over its searches."""
    after, until = [], []
    for trace in traces:
        steps, volumes = growth(grid, trace)
        reached = np.concatenate([[0.0], volumes])
        places = [np.searchsorted(steps, share + 1e-9) for share in SHARES]
        ended = steps[-1] + 0.02  # a search that was cut off says nothing of what follows
        after.append(
            [reached[i] if share <= ended else np.nan for i, share in zip(places, SHARES, strict=True)]
        )
        until.append([steps[np.argmax(volumes >= x)] if (volumes >= x).any() else np.inf for x in TARGETS])
    cells = [f"{x:.3f}" if np.isfinite(x) else "-" for x in np.median(after, axis=0)]
    return cells + [f"{x:.0%}" if np.isfinite(x) else "never" for x in np.median(until, axis=0)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--batch", type=int, default=4)
    parser.add_argument("--limit", default="")
    parser.add_argument("--samplers", nargs="*", default=[*SAMPLERS, USUAL])
    arguments = parser.parse_args()
    grid = read(arguments.folder, arguments.limit)
    shares = [f"after {share:.0%}" for share in SHARES] + [f"to {x:.0%}" for x in TARGETS]
    title = f"{len(grid.designs)} designs, {grid.allowed.sum()} within the limit"
    table = Table("sampler", *shares, "CPU s per search", box=None, title=title)
    for name in arguments.samplers:
        began = time.process_time()
        n_seeds = 1 if name == "grid" else arguments.seeds
        traces = [searched(grid, name, seed, arguments.batch, arguments.limit) for seed in range(n_seeds)]
        seconds = (time.process_time() - began) / n_seeds
        table.add_row(name, *row_of(grid, traces), f"{seconds:.2f}")
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
