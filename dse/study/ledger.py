"""Writing the journal of a study: the designs that the sampler proposes, and the results that it receives.

The journal is an Optuna journal, so `optuna-dashboard journal.log` shows it while the study runs. An entry is
on the disk before its design is trained. A killed process may leave a half-written last line, which is cut
off. The caller holds the study folder (`store.exclusive`), so a lock file beside the journal belongs to a
process that has died.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from dse.config import SearchSpace
from dse.search.limits import Exclusion
from dse.search.proposals import distribution
from dse.store import StoreError, explained
from dse.study.journal import EXCLUDED, Entry, read_journal

_NAME = "dse"


class Ledger:
    """The journal file of one study, opened for appending.

    Raises:
        StoreError: the file is damaged before its last line, or cannot be written.
    """

    def __init__(self, path: Path, space: SearchSpace) -> None:
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend
        from optuna.study import StudyDirection

        self._path = path
        self._axes = space.axes
        with self._explained(), _quiet():
            _repair(path)
            self._storage = JournalStorage(JournalFileBackend(str(path)))
            studies = self._storage.get_all_studies()
            self._study = (
                studies[0]._study_id
                if studies
                else self._storage.create_new_study(
                    [
                        StudyDirection.MAXIMIZE if direction == "max" else StudyDirection.MINIMIZE
                        for _, direction in space.objectives
                    ],
                    _NAME,
                )
            )
        self._entries = read_journal(path)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            with explained(self._path):
                yield
        except (KeyError, ValueError) as error:
            raise StoreError(f"{self._path}: the journal is damaged: {error}") from error

    @property
    def entries(self) -> list[Entry]:
        """Every entry in the order of proposal; `trial` counts from 0."""
        return list(self._entries)

    def ask(self, batch: int, designs: Sequence[Mapping[str, object]]) -> None:
        """Append designs that are about to be trained."""
        for design in designs:
            self._append(batch, design)

    def exclude(self, batch: int, design: Mapping[str, object], why: Exclusion) -> None:
        """Append a design that is not trained."""
        self._append(batch, design, why)

    def exclude_proposed(self, trial: int, why: Exclusion) -> None:
        """Append that a design, which was proposed, is not trained after all."""
        from optuna.trial import TrialState

        with self._explained():
            number = self._storage.get_trial_id_from_study_id_trial_number(self._study, trial)
            self._storage.set_trial_user_attr(number, EXCLUDED, why.reason)
            self._constrain(number, why.violations)
            self._storage.set_trial_state_values(number, TrialState.PRUNED, None)
        entry = self._entries[trial]
        self._entries[trial] = replace(entry, reported_s=time.time(), values=None, excluded=why.reason)

    def _append(self, batch: int, design: Mapping[str, object], why: Exclusion | None = None) -> None:
        from optuna.trial import TrialState, create_trial

        about: dict[str, object] = {"batch": batch, "design": dict(design)}
        template = create_trial(
            state=TrialState.RUNNING if why is None else TrialState.PRUNED,
            params={name: _scalar(value) for name, value in design.items()},
            distributions={
                name: distribution(axis, [_scalar(value) for value in axis.values or ()])
                for name, axis in self._axes.items()
                if name in design
            },
            user_attrs=about if why is None else about | {EXCLUDED: why.reason},
            constraints=None if why is None else dict(why.violations),
        )
        with self._explained():
            self._storage.create_new_trial(self._study, template)
        written = json.loads(json.dumps(dict(design)))  # as it is read after a restart
        now = time.time()
        entry = Entry(len(self._entries), batch, written, now)
        if why is not None:
            entry = replace(entry, reported_s=now, excluded=why.reason)
        self._entries.append(entry)

    def _constrain(self, number: int, violations: Mapping[str, float]) -> None:
        """Append by how much a trial misses each limit, where Optuna keeps its constraints."""
        for limit, violation in violations.items():
            self._storage.set_trial_system_attr(number, f"constraints:{limit}", float(violation))

    def tell(
        self, trial: int, values: Sequence[float] | None, violations: Mapping[str, float] | None = None
    ) -> None:
        """Append the result of a trial: its objectives, or None for a failed trial.

        Args:
            trial: its number.
            values: its objectives.
            violations: limit -> by how much the trial misses it.
        """
        from optuna.trial import TrialState

        state = TrialState.FAIL if values is None else TrialState.COMPLETE
        with self._explained():
            number = self._storage.get_trial_id_from_study_id_trial_number(self._study, trial)
            self._constrain(number, violations or {})
            self._storage.set_trial_state_values(number, state, values)
        objectives = None if values is None else tuple(map(float, values))
        self._entries[trial] = replace(self._entries[trial], reported_s=time.time(), values=objectives)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep Optuna from announcing the journal."""
    import optuna

    verbosity = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(verbosity)


def _scalar(value: object) -> bool | float | str:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)


def _repair(path: Path) -> None:
    for lock in path.parent.glob(f"{path.name}.lock*"):
        lock.unlink(missing_ok=True)
    if not path.exists():
        return
    content = path.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    last = whole[whole.rfind(b"\n", 0, -1) + 1 :]
    try:
        json.loads(last or b"{}")
    except ValueError:
        whole = whole[: -len(last)]
    if len(whole) < len(content):
        with path.open("r+b") as file:
            file.truncate(len(whole))
            os.fsync(file.fileno())
