"""Runs -> a study's table of one row per design point, and what the points cost on any hardware.

A trial has many points: a full read-out, one for every (phi, theta), and one for every earlier read-out. Each
is stored with its mean work, so costs on hardware are computed for the table, not in training.
Numbers are means over a trial's runs, as in `dse.study.trials`.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import dse
from dse import store
from dse.base import registry
from dse.base.records import Array, Ints, Operations, Workload
from dse.config import SearchSpace
from dse.measure.hardware.profile import Figures, Profile
from dse.measure.numbers import Numbers
from dse.measure.objectives.accuracy_unseen import merged, unseen_columns, unseen_name
from dse.measure.on_chips import columns_on, drawn_on
from dse.study import corrected, held, precision
from dse.study import trials as tables
from dse.study.record import RunRecord

if TYPE_CHECKING:
    import pandas

Part = dict[str, Array]
"""Columns of some rows of a trial on one chip."""
Made = dict[int, tuple[str, list[Part]]]
"""Trial -> a digest of its runs, and the parts that follow from them."""


class PointsTable:
    """The design points of a study's finished trials, on every hardware profile.

    The first row of each trial and profile is the full read-out, which answers at the end of the window: its
    phi, theta and read_out_ms are NaN, and nothing is undecided. Rows with phi and theta answer when the
    decision maker does, rows with read_out_ms after that much of the input. A joint net has the rows of each
    of its heads, under the head's task, so that they compete with nets of one task. Column `point` numbers
    the rows of a trial, the same on every profile.

    Args:
        space: the search space of the study.
        folder: of the study.
        profiles: hardware to price the points on; not necessarily that of the study.
    """

    def __init__(self, space: SearchSpace, folder: Path, profiles: Sequence[Profile]) -> None:
        self.space, self.folder, self.profiles = space, folder, profiles
        self._made: Made = {}  # what the last file was written of

    def table(self, trials: Mapping[int, Sequence[RunRecord]]) -> pandas.DataFrame:
        """Return one row per design point; trials: number -> records of the runs."""
        return self._whole(self._parts(trials, dict.fromkeys(map(str, trials), ""), {}), trials)

    def write(
        self, path: Path, trials: Mapping[int, Sequence[RunRecord]], digests: Mapping[str, str]
    ) -> None:
        """Write the table as Parquet, unless the file is that table already.

        Args:
            path: the file.
            trials: trial number -> records of its runs.
            digests: of the trials' runs (`dse.study.held.digests`).
        """
        made_from = {"common": _digest(self.space, self.profiles), "digests": digests}
        before = json.loads(store.made_from(path) or "{}")
        rows = before.pop("rows", {})
        if before == made_from and sum(rows.values()) == held.n_rows(path):  # else it is not what was written
            return
        parts = self._parts(trials, digests, self._made)
        rows = Counter[str]()
        for part in parts:
            rows[str(int(part["trial"][0]))] += len(part["trial"])
        with store.noted(path) as temporary:
            store.write_table(temporary, self._whole(parts, trials), json.dumps({**made_from, "rows": rows}))

    def _whole(self, parts: Sequence[Part], trials: Mapping[int, Sequence[RunRecord]]) -> pandas.DataFrame:
        """Return the table of parts, with the corrected accuracies that follow from all of them."""
        names, by_trial = corrected.names(self.space), corrected.asked(self.space, trials)
        counted = sum((corrected.tally(part, names, by_trial) for part in parts), Counter())
        known = corrected.values(counted)
        return _table([corrected.with_corrected(part, names, by_trial, known) for part in parts], self.space)

    def _parts(
        self, trials: Mapping[int, Sequence[RunRecord]], digests: Mapping[str, str], made: Made
    ) -> list[Part]:
        """Return the columns of all trials on every profile; of unchanged runs those in `made`."""
        for trial, runs in sorted(trials.items()):
            digest = digests[str(trial)]
            if trial in made and made[trial][0] == digest:
                continue
            if not all(record.finished for record in runs):
                made.pop(trial, None)
                continue
            try:
                made[trial] = digest, [*self._of_trial(trial, runs)]
            except (LookupError, ValueError, TypeError) as error:
                place = store.run_file(self.folder, trial, runs[0].repeat)
                text = f"its arrays cannot be evaluated ({type(error).__name__}: {error})"
                raise store.StoreError(
                    f"{place}: {text}; without this file, `dse run` trains it again"
                ) from error
        return [part for trial in sorted(trials.keys() & made.keys()) for part in made[trial][1]]

    def _of_trial(self, trial: int, runs: Sequence[RunRecord]) -> Iterator[Part]:
        answered = answers(self.folder, runs)
        rows = columns_of(answered)
        n = len(rows["accuracy"])
        about = tables.named(self.space, trial, runs[0].design, len(runs))
        design = {name: _repeated(value, n) for name, value in about.items()} | {"point": np.arange(n)}
        chips: list[Profile | None] = [*self.profiles] or [None]
        for chip in chips:
            costs = {"hardware": _repeated(chip.name, n)} | priced(answered, chip) if chip else {}
            for name, column in (rows | costs).items():
                if column.shape != (n,) or column.dtype.kind == "c":
                    raise ValueError(f"{name} has shape {column.shape} of {column.dtype}, not {n} rows")
            yield design | rows | costs


def _digest(space: SearchSpace, profiles: Sequence[Profile]) -> str:
    """Return a digest of all that the rows of any trial follow from: search space, chips and code."""
    settings = {k: x for k, x in space.to_plain().items() if k not in ("search", "execution")}
    plain = [settings, registry.named_plugins(), [chip.text for chip in profiles]]
    return hashlib.sha256(_code() + json.dumps(plain, default=store.plain).encode()).hexdigest()


@functools.cache
def _code() -> bytes:
    """Return a digest of the code of `dse`: other code may make another table of the same runs."""
    home = Path(dse.__file__).parent
    files = sorted(home.rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).digest()


def _table(parts: Sequence[Mapping[str, Array]], space: SearchSpace) -> pandas.DataFrame:
    """Return the columns of parts one after the other; NaN where a part has no such column."""
    import pandas

    names = dict.fromkeys(name for part in parts for name in part)
    frame = pandas.DataFrame(
        {
            name: np.concatenate([part.get(name, np.full(len(part["trial"]), np.nan)) for part in parts])
            for name in names
        }
    )
    claims = [name for name in names if any(part[name].dtype == bool for part in parts if name in part)]
    # A chip that no design can run on has no energies; fronts of the study's objectives still look for them.
    lacking = {} if frame.empty else {name: np.nan for name, _ in space.objectives if name not in frame}
    return frame.astype(dict.fromkeys(claims, "boolean")).assign(**lacking)


def priced(answers: Sequence[Answered], profile: Profile) -> dict[str, Array]:
    """Return the hardware columns of a trial's points, means over runs; empty if the chip cannot run them."""
    pieces = [_averaged([columns_on(profile, load) for load in piece.work]) for piece in answers]
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def drawn(
    answers: Sequence[Answered], profile: Profile, figures: Figures, columns: Sequence[str], rows: Array
) -> dict[str, Array]:
    """Return hardware columns of some points of a trial for samples of a chip's numbers, (draw, row) each.

    The points are row numbers of the answers; the samples are the same for all trials that are compared. NaN
    stands where the chip cannot run a point.
    """
    n_draws = len(next(iter(figures.values())))
    samples = {name: np.full((n_draws, len(rows)), np.nan) for name in columns}
    start = 0
    for piece in answers:
        here = np.flatnonzero((rows >= start) & (rows < start + len(piece)))
        of_piece = rows[here] - start
        start += len(piece)
        if len(here):
            runs = [drawn_on(profile, _part(load, of_piece), figures) for load in piece.work]
            for name in columns:
                if all(name in run for run in runs):
                    samples[name][:, here] = np.mean([run[name] for run in runs], axis=0)
    return samples


_KEY = ("weight_bits", "pruned_after", "phi", "theta", "read_out_ms")
"""What a point of a task is known by."""

# Columns of read-outs that belong to one decision setting: the surface has a row for each setting.
_OF_SETTINGS = (
    *("phi_p", "theta_p", "phi_h", "theta_h"),
    *("accuracy_best", "accuracy_best_strict", "t_p_strict_ms", "t_h_strict_ms"),
)


@dataclass(frozen=True)
class Answered:
    """Rows of a trial from one kind of read-out: their columns, and each run's work on them.

    design: columns that all rows of the same design and head share.
    """

    design: dict[str, object]
    columns: dict[str, Array]
    work: list[Workload | Operations]

    def __len__(self) -> int:
        return len(self.columns["accuracy"])


def answers(
    folder: Path, records: Sequence[RunRecord], settings: Sequence[precision.Setting] | None = None
) -> list[Answered]:
    """Return the answers of a trial at the trained precision, then at other precisions.

    Args:
        folder: of the study.
        records: runs of the trial.
        settings: other precisions, in this order; None: those at which all its runs were evaluated, by bits
            and then by pruned fraction.

    Raises:
        StoreError: an artefact is damaged, or a run was not evaluated at such a precision.
    """
    runs = [store.run_file(folder, record.trial, record.repeat) for record in records]
    pieces = _of_runs(precision.AS_TRAINED, [*zip(runs, records, strict=True)])
    evaluated = {} if settings is not None and not settings else precision.common(runs)
    for setting in evaluated if settings is None else settings:
        if setting not in evaluated:
            bits, pruned = setting
            lack = f"has no evaluation at {bits} bits with {pruned:g} pruned; run the study again"
            raise store.StoreError(f"{runs[0]}: {lack}")
        pieces += _of_runs(setting, evaluated[setting])
    return pieces


def _of_runs(setting: precision.Setting, runs: Sequence[precision.RunFile]) -> list[Answered]:
    """Return, head by head, the full read-out, the surface if there is one, and earlier read-outs."""
    heads: list[str | None] = [*runs[0][1].measured.of_heads] or [None]
    return [piece for head in heads for piece in _of_head(setting, runs, head)]


def _of_head(
    setting: precision.Setting, runs: Sequence[precision.RunFile], head: str | None
) -> list[Answered]:
    suffix = f"_{head}.npz" if head else ".npz"
    numbers = [record.measured.of_head(head) for _, record in runs]
    read_outs = [store.load_arrays(run / f"read_out{suffix}") for run, _ in runs]
    name = f"surface{suffix}"
    surfaces = [store.load_arrays(run / name) for run, record in runs if name in record.files]
    loads = [store.work_of(arrays) for arrays in read_outs]
    about: dict[str, object] = {}
    if isinstance(loads[0], Workload):  # other classifiers have no precision
        about = {"weight_bits": setting[0], "pruned_after": setting[1]}
    full = {**about, **({"task": head} if head else {}), **tables.summary(numbers, None)}
    end = {"phi": np.nan, "theta": np.nan, "accuracy_strict": full["accuracy"], "undecided": 0.0}
    first = full | (end if surfaces else {}) | {"read_out_ms": np.nan}
    declared = registry.columns()
    design = {
        name: value
        for name, value in first.items()
        if name not in _KEY[2:]
        and not name.startswith("accuracy_unseen")
        and (name not in declared or declared[name].of_design)
    }
    last = [load.mapped(lambda x: x[-1:]) for load in loads]
    pieces = [Answered(design, {name: _repeated(value, 1) for name, value in first.items()}, last)]
    if surfaces:
        # Where each run has phi up to what its own outputs reach, the shared ones come first.
        phi, theta = min((x["phi"] for x in surfaces), key=len), surfaces[0]["theta"]
        grid = {"phi": np.repeat(phi, len(theta)), "theta": np.tile(theta, len(phi))}
        grid |= _averaged([_measured(x, slice(len(phi))) for x in surfaces]) | _unseen(numbers, surfaces)
        of_grid = [store.work_of(x).mapped(lambda x: _flat(x[: len(phi)])) for x in surfaces]
        pieces.append(Answered(design, grid, of_grid))
    earlier = _averaged([_measured(x, slice(None)) for x in read_outs])
    earlier = {"read_out_ms": earlier["decision_latency_ms"]} | earlier | _unseen(numbers, read_outs)
    before = [load.mapped(lambda x: x[:-1]) for load in loads]
    pieces.append(Answered(design, {name: x[:-1] for name, x in earlier.items()}, before))
    return pieces


def columns_of(answers: Sequence[Answered]) -> dict[str, Array]:
    """Return the columns of all answers, one after the other; every row has the columns of its design."""
    names = dict.fromkeys(name for piece in answers for name in piece.columns)
    return {name: _column(answers, name) for name in names}


def _column(answers: Sequence[Answered], name: str) -> Array:
    """Return a column of all answers; NaN if neither the answers nor their design have it."""
    parts = [
        _repeated(piece.design.get(name, np.nan), len(piece)) if column is None else column
        for piece in answers
        for column in [piece.columns.get(name)]
    ]
    return np.concatenate(parts)


def places(answers: Sequence[Answered], rows: pandas.DataFrame) -> Ints:
    """Return the row numbers of design points among the answers of their trial, (row,); -1 for no match.

    The identity of a point is its precision, phi, theta, read-out time and, of a joint net, its task.

    Args:
        answers: of the trial.
        rows: some of its points, on any hardware.
    """
    import pandas

    is_joint = any("task" in piece.design for piece in answers)
    evaluated = pandas.DataFrame({name: _column(answers, name) for name in (*_KEY, "task")})

    def keys(frame: pandas.DataFrame) -> pandas.MultiIndex:
        values = [
            frame[name].to_numpy(np.float64, na_value=-1.0) if name in frame else np.full(len(frame), -1.0)
            for name in _KEY
        ]
        tasks = frame["task"].to_numpy(object) if is_joint else np.zeros(len(frame))
        return pandas.MultiIndex.from_arrays([tasks, *(np.where(np.isnan(x), -1.0, x) for x in values)])

    return np.asarray(keys(evaluated).get_indexer(keys(rows)), np.int64)


def _part(load: Workload | Operations, rows: Array) -> Workload | Operations:
    """Return the work of some points."""
    return load.mapped(lambda counts: counts[rows])


def _flat(counts: Array) -> Array:
    """Return counts (phi, theta, ...) with one axis of design points, theta fastest."""
    return counts.reshape(-1, *counts.shape[2:])


def _measured(arrays: Mapping[str, Array], rows: slice) -> dict[str, Array]:
    """Return some rows of the columns of an .npz, without their work and what belongs to one setting."""
    apart = ("phi", "theta", *_OF_SETTINGS)
    return {name: x[rows] for name, x in arrays.items() if "/" not in name and name not in apart}


def _unseen(runs: Sequence[Numbers], arrays: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the columns of accuracy on unseen groups of all points; none where a run has no such arrays.

    Args:
        runs: numbers of each.
        arrays: of each, a file of its points.
    """
    of_runs = []
    for numbers, of_run in zip(runs, arrays, strict=True):
        names = (unseen_name(i) for i in itertools.count())
        named = {column: {fold: next(names) for fold in folds} for column, folds in numbers.unseen.items()}
        if not all(name in of_run for folds in named.values() for name in folds.values()):
            return {}
        of_runs.append({c: {fold: of_run[name] for fold, name in x.items()} for c, x in named.items()})
    return {name: x.ravel() for name, x in unseen_columns(merged(of_runs)).items()}


def _averaged(runs: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the columns of points of several runs (`dse.study.trials.over_runs`), (row,) each."""
    return {name: x.ravel() for name, x in tables.over_runs(runs).items()}


def _repeated(value: object, n: int) -> Array:
    """Return one value n times."""
    return np.full(n, value, dtype=object if value is None or isinstance(value, str) else None)
