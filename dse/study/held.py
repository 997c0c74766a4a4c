"""What the tables of a study hold of its runs: every table notes a digest of the runs of each trial in it.

A study that was killed leaves tables that are older than its runs, and somebody may remove a run. All readers
take the tables from here: rows of a trial whose runs are missing are left out, and `remarks` says so.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from dse import store
from dse.study import precision

if TYPE_CHECKING:
    import pandas

TRIALS, POINTS = "trials.parquet", "points.parquet"
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # in C, where PyYAML has it: ten times as fast
_NAMED = 3


class Behind(NamedTuple):
    """The trials of which a table does not hold what the study's folder does.

    lacking: it has no rows of them. changed: their runs have changed since. lost: their runs are missing.
    """

    lacking: Sequence[int] = ()
    changed: Sequence[int] = ()
    lost: Sequence[int] = ()


def digests(folder: Path, runs: Mapping[int, Collection[int]]) -> dict[str, str]:
    """Return trial -> a digest of its runs and their evaluations at other precisions, of the book's digests.

    Args:
        folder: of the study.
        runs: trial -> its repeats.
    """
    known = store.digests(folder)
    of_trial = {}
    for trial, repeats in sorted(runs.items()):
        digest = hashlib.sha256()
        for run in (store.run_file(folder, trial, repeat) for repeat in repeats):
            for path in (run, *precision.files_of(run)):
                name = path.relative_to(folder).as_posix()
                with contextlib.suppress(OSError):  # a run that is lost is in memory yet
                    digest.update(
                        f"{name} {known[name][0] if name in known else store.checksum(path)}".encode()
                    )
        of_trial[str(trial)] = digest.hexdigest()
    return of_trial


def behind(table: Path) -> Behind:
    """Return how a table of a study is behind its runs; not at all where it notes nothing."""
    before = json.loads(store.made_from(table) or "{}").get("digests")
    if before is None:
        return Behind()
    now = digests(table.parent, store.runs_in(table.parent))
    return Behind(
        [int(x) for x in now if x not in before],
        [int(x) for x in now if x in before and now[x] != before[x]],
        [int(x) for x in before if x not in now],
    )


def remarks(folder: Path) -> list[str]:
    """Return a sentence if the tables of a study are older than its runs, and one if runs are missing."""
    if not (folder / POINTS).is_file():
        return []
    try:
        rows = _repeats(folder / POINTS)
    except (OSError, ValueError):  # who reads the table says what is wrong with it
        return []
    runs, found, texts = store.runs_in(folder), behind(folder / POINTS), []
    lost = sorted({*found.lost, *rows["trial"][~_is_whole(rows, runs)].tolist()})
    if older := sorted({*found.lacking, *found.changed} - {*lost}):
        who = "the run" if store.is_held(folder) else f"`dse run`, or `dse doctor {folder} --repair`,"
        texts.append(
            f"{folder}: the tables hold {len(runs) - len(older)} of the {len(runs)} trials that have ended, "
            f"not {named(older)}; {who} writes them again"
        )
    if lost and not runs:
        texts.append(f"{folder}: holds no run, only tables: what needs the runs is left out")
    elif lost:
        why = "a run is missing, or was told, which `dse run` trains again"
        texts.append(f"{folder}: {named(lost)} is left out: {why}")
    return texts


def named(trials: Collection[int]) -> str:
    """Return the first of some trials in words."""
    more = " and others" if len(trials) > _NAMED else ""
    return f"trial {', '.join(map(str, list(trials)[:_NAMED]))}{more}"


def without_lost(folder: Path, table: pandas.DataFrame) -> pandas.DataFrame:
    """Return a table without the rows of trials that lack a run; all rows where the folder has no run."""
    runs = store.runs_in(folder)
    if not runs or not {"trial", "repeats"} <= set(table):
        return table
    is_whole = _is_whole(table, runs)
    return table if is_whole.all() else table[is_whole].reset_index(drop=True)


def _is_whole(table: pandas.DataFrame, runs: Mapping[int, Collection[int]]) -> pandas.Series[bool]:
    """Return which rows are of trials that have all the runs that the rows are means over.

    Rows that `dse tell` of an earlier version made count as lacking theirs.
    """
    n_runs = table["trial"].map({trial: len(repeats) for trial, repeats in runs.items()})
    is_whole = n_runs.fillna(0) >= table["repeats"]
    return is_whole & table["origin"].ne("told") if "origin" in table else is_whole


def read(table: Path) -> pandas.DataFrame:
    """Read a table of a study.

    Raises:
        Damaged: it is missing, or not what was written.
        StoreError: it cannot be read now.
    """
    import pandas

    store.verify(table)
    try:
        return pandas.read_parquet(table)
    except OSError as error:
        raise store.unreadable(table, error) from error
    except Exception as error:  # Arrow raises errors of many kinds
        raise store.damaged(table, f"cannot be read: {str(error).splitlines()[0]}") from error


def counted(table: pandas.DataFrame) -> Counter[int]:
    """Return trial -> number of its rows in a table, of trials that have runs."""
    return Counter(table["trial"][table["repeats"] > 0].tolist())


def _repeats(table: Path) -> pandas.DataFrame:
    """Return trial, number of runs and origin of each row of a table; no rows without the first two."""
    import pandas
    import pyarrow.parquet

    names = pyarrow.parquet.read_schema(table).names
    columns = ["trial", "repeats", *(["origin"] if "origin" in names else ())]
    is_said = set(columns) <= set(names)
    return pandas.read_parquet(table, columns=columns) if is_said else pandas.DataFrame(columns=columns)


def n_rows(table: Path) -> int:
    """Return the number of rows of a table."""
    import pyarrow.parquet

    return int(pyarrow.parquet.read_metadata(table).num_rows)


def plain_space(path: Path) -> dict[str, Any]:
    """Return a written search space as plain data.

    Raises:
        StoreError: it is missing or damaged.
    """
    try:
        space = yaml.load(store.read_text(path), LOADER)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise store.damaged(path, f"cannot be read: {' '.join(str(error).split())}") from error
    if not isinstance(space, dict) or not space:
        raise store.damaged(path, "is no search space")
    return space
