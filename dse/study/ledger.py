"""Writing the journal of a study: the designs that the sampler proposes, and the results that it receives.

The journal is an Optuna journal, so `optuna-dashboard journal.log` shows it while the study runs. Its lines
are made here, for Optuna's storage would replay each that it writes. An entry is on the disk before its
design is trained. A killed process may leave a half-written last line, which is cut off. A journal with other
damage is written anew from its intact lines and from the records of finished runs; the sampler proposes again
what these do not say. The caller holds the study folder (`store.exclusive`).
"""

from __future__ import annotations

import bisect
import contextlib
import json
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from dse.config import SearchSpace
from dse.search.limits import Exclusion
from dse.search.proposals import distribution
from dse.seeds import design_key
from dse.store import StoreError, damaged, explained, read_record, run_folder
from dse.study.journal import (
    ENQUEUED,
    EXCLUDED,
    SET_INTERMEDIATE_VALUE,
    SET_SYSTEM_ATTRIBUTE,
    SET_USER_ATTRIBUTE,
    Entry,
    read_journal,
)
from dse.study.lines import CREATE_STUDY, CREATE_TRIAL, SET_TRIAL_STATE, JournalLines, Log, counted

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.storages import JournalStorage
    from optuna.trial import TrialState

_NAME = "dse"
_REFUSALS = (
    *(LookupError, ValueError, TypeError, AttributeError),
    *(AssertionError, ArithmeticError, RuntimeError),
)
"""What Optuna raises about operations."""
_NAMED = 3
_COMPARED = 5
# Where Optuna keeps the names of objectives (`Study.metric_names`).
_METRIC_NAMES = "study:metric_names"


class Ledger:
    """The journal file of one study, opened for appending.

    notes: what was damaged and is repaired, a sentence each.

    Raises:
        StoreError: the file cannot be read or written.
    """

    def __init__(self, path: Path, space: SearchSpace) -> None:
        self._path = path
        self._space = space
        self.notes: list[str] = []
        self._writer = f"{uuid.uuid4()}-0"  # as Optuna names who wrote a line
        with self._explained(), quiet():
            self._lines = JournalLines(path)
            if fault := of_another(path.parent, self._lines.logs):
                self._lines.faults, self._lines.logs = [fault], []
            if not self._lines.faults:
                self._lines.faults = lost(path.parent, self._lines.logs)
            if self._lines.faults:
                self._mend(self._lines)
            storage = self._opened()
            studies = storage.get_all_studies()
            self._study = studies[0]._study_id if studies else self._create_study(storage)
            self._name_values(storage)
            self._lines.logs.clear()
        self._entries = read_journal(path)
        self._of_batch: dict[int, list[int]] = {}
        for entry in self._entries:
            self._of_batch.setdefault(entry.batch, []).append(entry.trial)
        self._unwritten: list[Log] = []
        self._is_open = False

    def _opened(self) -> JournalStorage:
        """Return Optuna's storage of the journal; what Optuna refuses is damage."""
        try:
            return _replayed(self._lines)
        except _REFUSALS:
            self._lines.faults = drop_refused(self._lines.logs)
            self._mend(self._lines)
            return _replayed(self._lines)

    def _create_study(self, storage: JournalStorage) -> int:
        from optuna.study import StudyDirection

        directions = [
            StudyDirection.MAXIMIZE if direction == "max" else StudyDirection.MINIMIZE
            for _, direction in self._space.objectives
        ]
        return storage.create_new_study(directions, _NAME)

    def _name_values(self, storage: JournalStorage) -> None:
        """Name the objectives for readers of the journal, unless they are named."""
        names = [name for name, _ in self._space.objectives]
        if storage.get_study_system_attrs(self._study).get(_METRIC_NAMES) != names:
            storage.set_study_system_attr(self._study, _METRIC_NAMES, names)

    def _mend(self, lines: JournalLines) -> None:
        """Write a damaged journal anew."""
        apart = JournalLines(None)
        self._study = self._create_study(_replayed(apart))

        def made(trial: int, batch: int) -> Log | None:
            """Return the line that created a trial, by the record of one of its runs."""
            design = _recorded_design(self._path.parent, trial)
            if design is None:
                return None
            return self._created(batch, design)

        logs, faults, n_before, refused = lines.logs, lines.faults, _n_trials(lines.logs), [""]
        while refused:  # what follows one operation may let Optuna read another, and refuse that
            begins = [log for log in logs if log["op_code"] == CREATE_STUDY] or apart.logs
            rest = [log for log in logs if log["op_code"] != CREATE_STUDY]
            logs = [begins[0], *counted(rest, made, self._space.search.batch)]
            refused = drop_refused(logs)
            faults = faults + refused
        lines.replace(logs)
        more = f" and {len(faults) - _NAMED} more faults" if len(faults) > _NAMED else ""
        self.notes.append(
            f"{self._path}: {'; '.join(faults[:_NAMED])}{more}: the journal is written anew with "
            f"{_n_trials(lines.logs)} trials ({n_before} had intact lines, others follow from the records of "
            f"their runs); the file before it is {self._path.name}.damaged"
        )

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            with explained(self._path):
                yield
        except _REFUSALS as error:
            what = f"holds an operation that Optuna refuses ({type(error).__name__}: {error})"
            raise damaged(self._path, what) from error

    @property
    def entries(self) -> list[Entry]:
        """Every entry in the order of proposal; `trial` counts from 0."""
        return list(self._entries)

    def batch(self, number: int) -> list[Entry]:
        """Return the entries of a batch in the order of proposal."""
        return [self._entries[trial] for trial in self._of_batch.get(number, ())]

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Write everything that is appended in the block at once, at its end."""
        if self._is_open:
            yield
            return
        self._is_open = True
        try:
            yield
        finally:
            self._is_open = False
            if self._unwritten:
                with self._explained():
                    self._lines.append(self._unwritten)
                self._unwritten.clear()

    def ask(self, batch: int, designs: Sequence[Mapping[str, object]], *, enqueued: bool = False) -> None:
        """Append designs that are about to be trained; `enqueued`: the user asked for them."""
        with self.together():
            for design in designs:
                self._append(batch, design, enqueued=enqueued)

    def exclude(self, batch: int, design: Mapping[str, object], why: Exclusion) -> None:
        """Append a design that is not trained."""
        self._append(batch, design, why)

    def exclude_proposed(self, trial: int, why: Exclusion) -> None:
        """Append that a design, which was proposed, is not trained after all."""
        from optuna.trial import TrialState

        with self.together():
            about = {EXCLUDED: why.reason}
            self._unwritten.append(self._line(SET_USER_ATTRIBUTE, trial_id=trial, user_attr=about))
            self._end(trial, TrialState.PRUNED, None, why.violations)
        entry = self._entries[trial]
        self._entries[trial] = replace(entry, reported_s=time.time(), values=None, excluded=why.reason)

    def _append(
        self,
        batch: int,
        design: Mapping[str, object],
        why: Exclusion | None = None,
        *,
        enqueued: bool = False,
    ) -> None:
        with self.together():
            line = self._created(batch, design, why)
            if enqueued:
                line["user_attrs"][ENQUEUED] = True
            self._unwritten.append(line)
        written = json.loads(json.dumps(dict(design)))  # as it is read after a restart
        now = time.time()
        entry = Entry(len(self._entries), batch, written, now, enqueued=enqueued)
        if why is not None:
            entry = replace(entry, reported_s=now, excluded=why.reason)
        self._of_batch.setdefault(batch, []).append(entry.trial)
        self._entries.append(entry)

    def _created(self, batch: int, design: Mapping[str, object], why: Exclusion | None = None) -> Log:
        """Return the line that creates a trial that is about to be trained, or is not trained."""
        from optuna.distributions import distribution_to_json
        from optuna.trial import TrialState

        scalars, distributions = described(self._space, design)
        about = {"batch": batch, "design": dict(design)}
        moment = _now()
        return self._line(
            CREATE_TRIAL,
            study_id=self._study,
            datetime_start=moment,
            state=(TrialState.RUNNING if why is None else TrialState.PRUNED).value,
            value=None,
            values=None,
            **({} if why is None else {"datetime_complete": moment}),
            distributions={name: distribution_to_json(one) for name, one in distributions.items()},
            params={name: one.to_internal_repr(scalars[name]) for name, one in distributions.items()},
            user_attrs=about if why is None else about | {EXCLUDED: why.reason},
            system_attrs={} if why is None else _constraints(why.violations),
            intermediate_values={},
        )

    def _end(
        self,
        trial: int,
        state: TrialState,
        values: Sequence[float] | None,
        violations: Mapping[str, float],
    ) -> None:
        """Append by how much a trial misses each limit, where Optuna keeps its constraints, and its end."""
        for name, violation in _constraints(violations).items():
            line = self._line(SET_SYSTEM_ATTRIBUTE, trial_id=trial, system_attr={name: violation})
            self._unwritten.append(line)
        ended = {"values": None if values is None else list(map(float, values)), "datetime_complete": _now()}
        self._unwritten.append(self._line(SET_TRIAL_STATE, trial_id=trial, state=state.value, **ended))

    def _line(self, operation: int, **fields: object) -> Log:
        """Return a line as Optuna's journal holds it."""
        return {"op_code": operation, "worker_id": self._writer, **fields}

    def tell(
        self,
        trial: int,
        values: Sequence[float] | None,
        violations: Mapping[str, float] | None = None,
        at_rungs: Mapping[int, float] = MappingProxyType({}),
        *,
        stopped: bool = False,
    ) -> None:
        """Append the result of a trial: its objectives, or None for a failed trial.

        Args:
            trial: its number.
            values: its objectives, at its last rung if it stopped there.
            violations: limit -> by how much the trial misses it.
            at_rungs: epochs -> first objective there.
            stopped: whether it stopped at a rung.
        """
        from optuna.trial import TrialState

        state = TrialState.FAIL if values is None else TrialState.COMPLETE
        state = TrialState.PRUNED if stopped else state
        with self.together():
            for epochs, value in at_rungs.items():
                line = self._line(
                    SET_INTERMEDIATE_VALUE, trial_id=trial, step=epochs, intermediate_value=value
                )
                self._unwritten.append(line)
            self._end(trial, state, values, violations or {})
        objectives = None if values is None else tuple(map(float, values))
        self._entries[trial] = replace(self._entries[trial], reported_s=time.time(), values=objectives)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep Optuna from announcing what it makes."""
    import optuna

    verbosity = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(verbosity)


def described(
    space: SearchSpace, design: Mapping[str, object]
) -> tuple[dict[str, Any], dict[str, BaseDistribution]]:
    """Return the parameters of a design and their distributions, as Optuna's trials have them."""
    distributions = {
        name: distribution(axis, [_scalar(value) for value in axis.values or ()])
        for name, axis in space.axes.items()
        if name in design
    }
    return {name: _scalar(design[name]) for name in distributions}, distributions


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds")


def _constraints(violations: Mapping[str, float]) -> dict[str, float]:
    return {f"constraints:{limit}": float(violation) for limit, violation in violations.items()}


def _scalar(value: object) -> bool | float | str:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)


def _replayed(lines: JournalLines) -> JournalStorage:
    """Return Optuna's storage of a journal after it has read everything."""
    from optuna.storages import JournalStorage

    storage = JournalStorage(lines)  # type: ignore[arg-type]
    for study in storage.get_all_studies():
        storage.get_study_system_attrs(study._study_id)
    return storage


def of_another(folder: Path, logs: Sequence[Log]) -> str:
    """Return a sentence if the first trials whose runs have records have other designs there; '' if not."""
    created = [log["user_attrs"]["design"] for log in logs if log["op_code"] == CREATE_TRIAL]
    pairs = (
        (design_key(design), recorded)
        for trial, design in enumerate(created[:_COMPARED])
        if (recorded := _recorded_design(folder, trial)) is not None
    )
    same = [key == design_key(recorded) for key, recorded in pairs]
    return "it is the journal of another study" if same and not any(same) else ""


def lost(folder: Path, logs: Sequence[Log]) -> list[str]:
    """Return a sentence if lines at the end are lost: a design is written down before it is trained."""
    if (n := _n_trials(logs)) and _recorded_design(folder, n) is not None:
        return [f"lines are missing at the end: trial {n} has a run"]
    return []


def drop_refused(logs: list[Log]) -> list[str]:
    """Remove the operations that Optuna refuses; return a sentence about each."""
    reason = ""

    def is_refused(n: int) -> bool:
        nonlocal reason
        apart = JournalLines(None)
        apart.logs = logs[:n]
        try:
            _replayed(apart)
        except _REFUSALS as error:
            reason = f"{type(error).__name__}: {error}"
            return True
        return False

    faults = []
    while is_refused(len(logs)):
        n = bisect.bisect_left(range(len(logs)), True, key=is_refused)
        is_refused(n)
        faults.append(f"Optuna refuses operation {n} ({reason})")
        del logs[n - 1]
    return faults


def _n_trials(logs: Sequence[Log]) -> int:
    return sum(log["op_code"] == CREATE_TRIAL for log in logs)


def _recorded_design(folder: Path, trial: int) -> Mapping[str, object] | None:
    """Return the design of a trial by the record of one of its runs; None where none can be read."""
    for run in sorted(run_folder(folder, trial, 0).parent.glob("repeat_*")):
        with contextlib.suppress(StoreError):
            design = read_record(run).get("design")
            if isinstance(design, dict):
                return design
    return None
