"""Racing against the full grid: what is trained, and what of the front is lost.

    python -m benchmarks.racing SPACE [--set KEY=VALUE ...] [--results DIR] [--rungs 5 10 20]

The first call trains every design of the grid to its end and keeps what it was at each rung. Then races are
replayed on these records, in seconds, with the code that `dse run` races with. Printed per choice of rungs
and `eta`: designs that stopped, epochs trained as a percentage of the grid's, and the hypervolume of what
finished as a percentage of the grid's, over full read-outs and over all design points; the smallest over
tasks, families and chips. Hypervolumes are those of the objectives, each from 0 (best of the grid) to 1
(worst), with the reference 1.01.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import itertools
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from dse import store
from dse.config import SearchSpace, load_space
from dse.config.search import Racing
from dse.measure.hardware.profile import load_all
from dse.skyline.pareto import hypervolume
from dse.skyline.table import checked_goals, costs_of
from dse.study import checkpoints, explore
from dse.study.ledger import Entry, read_entries
from dse.study.precision import GROUPS
from dse.study.progress import Progress
from dse.study.racing import Race
from dse.study.record import RunRecord, load_records

KEPT = "at_rungs"
ETAS = (1.5, 2.0, 3.0, 4.0)


class Keeper:
    """In place of a race: every design pauses at every rung, where it is copied, and trains to its end."""

    def __init__(self, space: SearchSpace, folder: Path, _: object, runs: Any, __: object) -> None:
        assert space.search.racing is not None
        self._rungs, self._folder, self._runs = space.search.racing.rungs, folder, runs

    def complete(self, _: int, entries: Sequence[Entry], after_each: Callable[[], None]) -> None:
        """Train a batch."""
        for rung in self._rungs:
            self._runs.complete(entries, 1, after_each, rung)
            place = checkpoints.rung_folder(self._folder, rung)
            if place.is_dir():
                shutil.copytree(place, checkpoints.rung_folder(self._folder / KEPT, rung), dirs_exist_ok=True)
        self._runs.complete(entries, 1, after_each)

    def audit(self, *_: object) -> list[str]:
        """Nothing has stopped."""
        return []


class Replay:
    """In place of the runs of a study: what they were at each rung and at the end, and what a race trains."""

    def __init__(self, folder: Path, finished: Mapping[int, RunRecord], epochs: int) -> None:
        self._folder, self._all, self._epochs = folder, finished, epochs
        self.ended: dict[int, list[RunRecord]] = {}
        self.trained: dict[int, int] = {}

    def recall(self, _: Sequence[Entry]) -> None:
        """There was no earlier session."""

    def of(self, trial: int) -> list[RunRecord]:
        """Return what has ended."""
        return self.ended.get(trial, [])

    def trials(self) -> dict[int, list[RunRecord]]:
        """Return all that has ended."""
        return dict(self.ended)

    def paused(self, trial: int, _: int, epochs: int) -> list[RunRecord] | None:
        """Return a design at a rung."""
        record = at_rung(self._folder, trial, 0, epochs)
        return None if record is None or trial in self.ended else [record]

    def stop(self, trial: int, records: Sequence[RunRecord], epochs: int, reason: str) -> None:
        """Note that a design stopped."""
        stopped = dataclasses.replace(records[0], numbers=None, stopped_at_epoch=epochs, reason=reason)
        self.ended[trial] = [stopped]

    def complete(self, entries: Iterable[Entry], _: int, __: object = None, until: int | None = None) -> None:
        """Note what is trained."""
        for trial in (entry.trial for entry in entries):
            self.trained[trial] = max(self.trained.get(trial, 0), until or self._epochs)
            if until is None or at_rung(self._folder, trial, 0, until) is None:
                self.ended.setdefault(trial, [self._all[trial]])


def kept(space: SearchSpace, results: Path) -> Path:
    """Return the folder of a study whose designs are all kept at every rung; train those that are not."""
    folder = results / space.study
    if not (folder / KEPT).is_dir() or not (folder / "points.parquet").exists():
        with mock.patch.object(explore, "Race", Keeper):
            explore.run(space, results)
    if not (folder / KEPT / store.RUNS).exists():
        (folder / KEPT / store.RUNS).symlink_to(folder.resolve() / store.RUNS)
    return folder


def shares(points: pd.DataFrame, trials: set[int], space: SearchSpace) -> float:
    """Return the smallest share of a group's hypervolume that some trials have."""
    goals, least = checked_goals(space.objectives), 1.0
    for _, rows in points.groupby([name for name in GROUPS if name in points], observed=True):
        costs = costs_of(rows, goals)
        ok = np.isfinite(costs).all(axis=1)
        costs = (costs - costs[ok].min(axis=0)) / (np.ptp(costs[ok], axis=0) + 1e-300)
        here = ok & rows["trial"].isin(trials).to_numpy()
        reference = np.full(costs.shape[1], 1.01)
        whole = hypervolume(costs[ok], reference)
        least = min(least, hypervolume(costs[here], reference) / whole if here.any() else 0.0)
    return least


at_rung = functools.cache(checkpoints.at_rung)


def replayed(space: SearchSpace, folder: Path, entries: Sequence[Entry], racing: Racing) -> list[float]:
    """Return stopped designs, share of epochs, and shares of hypervolume of full read-outs and of points."""
    space = dataclasses.replace(space, search=dataclasses.replace(space.search, racing=racing))
    epochs = int(space.parts["training"].values["epochs"])
    shutil.rmtree(folder / KEPT / "racing", ignore_errors=True)
    runs: Any = Replay(
        folder / KEPT, {entry.trial: finished(folder, entry.trial) for entry in entries}, epochs
    )
    race = Race(space, folder / KEPT, load_all(space.hardware, space.source.parent), runs, Progress())
    for number in sorted({entry.batch for entry in entries}):
        race.complete(number, [e for e in entries if e.batch == number], lambda: None)
    ended = {trial for trial, of in runs.ended.items() if of[0].finished}
    points = pd.read_parquet(folder / "points.parquet")
    full = points[points["phi"].isna() & points["read_out_ms"].isna()]
    stopped = sum(of[0].stopped_at_epoch is not None for of in runs.ended.values())
    trained = sum(runs.trained.values()) / (epochs * len(entries))
    return [stopped, trained, shares(full, ended, space), shares(points, ended, space)]


@functools.cache
def finished(folder: Path, trial: int) -> RunRecord:
    """Return the record of a design at its end."""
    return load_records(folder, trial)[0]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("space", type=Path)
    parser.add_argument(
        "--set", nargs="*", default=[], metavar="KEY=VALUE", help="changes of the search space"
    )
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--rungs", type=int, nargs="+", default=[5, 10, 20])
    arguments = parser.parse_args()
    space = load_space(arguments.space, dict(pair.split("=", 1) for pair in arguments.set))
    search = dataclasses.replace(space.search, racing=Racing(rungs=tuple(arguments.rungs)))
    folder = kept(dataclasses.replace(space, search=search), arguments.results)
    entries = read_entries(folder)
    names = ("stopped", "epochs", "hypervolume", "of all points")
    table = Table("rungs", "eta", *names, box=None, title=f"{len(entries)} designs")
    choices = [
        rungs
        for k in range(1, min(3, len(arguments.rungs)) + 1)
        for rungs in itertools.combinations(arguments.rungs, k)
    ]
    for rungs, eta in itertools.product(choices, ETAS):
        stopped, trained, full, every = replayed(space, folder, entries, Racing(rungs=rungs, eta=eta))
        cells = [f"{stopped:.0f}", f"{trained:.1%}", f"{full:.2%}", f"{every:.2%}"]
        table.add_row(str(list(rungs)), str(eta), *cells)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
