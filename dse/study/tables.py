"""Writing the two tables of a study: trials.parquet, a row per trial, and points.parquet, one per point."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from dse import store
from dse.base.seeds import design_key
from dse.config import SearchSpace, load_space
from dse.measure.hardware.profile import of_space
from dse.study import held, pricing
from dse.study import trials as of_trials
from dse.study.held import plain_space
from dse.study.ledger import Entry, read_entries
from dse.study.points import PointsTable
from dse.study.record import RunRecord, load_record


def write(of_points: PointsTable, runs: Mapping[int, Sequence[RunRecord]], entries: Sequence[Entry]) -> None:
    """Write the tables of a study, and the profiles that price them.

    Args:
        of_points: its design points; the caller has locked its folder.
        runs: trial -> records of its runs, repeat 0 first.
        entries: of its book; excluded designs have a row too, unless they have been trained since.
    """
    folder = of_points.folder
    pricing.keep(of_points.profiles, folder)
    trained = {design_key(entry.design) for entry in entries if not entry.excluded}
    excluded = [x for x in entries if x.excluded and design_key(x.design) not in trained]
    table = of_trials.trials_table(of_points.space, runs, excluded)
    digests = held.digests(folder, {trial: [one.repeat for one in of] for trial, of in runs.items()})
    with store.noted(folder / held.TRIALS) as path:
        store.write_table(path, table, json.dumps({"digests": digests}))
    of_points.write(folder / held.POINTS, runs, digests)


def n_held(space: SearchSpace, folder: Path) -> str:
    """Return how many trials of a search the tables of its study hold, in a sentence."""
    n_designs = sum(not entry.excluded for entry in read_entries(folder))
    n_trials = max(n_designs, space.search.n_trials or space.n_designs or 0)
    try:
        n = len(held.counted(held.read(folder / held.TRIALS)))
    except (store.StoreError, KeyError):  # there is none yet, or it is damaged
        n = 0
    return f"the tables hold {n} of {n_trials} trials"


def write_again(folder: Path) -> None:
    """Write the tables of a study from the files in its folder.

    Args:
        folder: of the study, which the caller has locked.

    Raises:
        ConfigError, StoreError: the search space, a profile or a run cannot be read.
    """
    plain_space(folder / store.SPACE)  # raises if it is not what was written
    space = load_space(folder / store.SPACE)
    entries = read_entries(folder)
    runs = {
        trial: [record for x in repeats if (record := load_record(store.run_file(folder, trial, x)))]
        for trial, repeats in store.runs_in(folder).items()
        if trial < len(entries)
    }
    write(PointsTable(space, folder, of_space(space)), runs, entries)
