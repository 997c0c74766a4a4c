"""One study of several coordinators, which share an Optuna study in a database (`execution.storage`).

Each coordinator has a study folder of its own, whose journal stays the truth about its trials. In the shared
study a trial is the claim of a design. Of a design's claims the first one holds that is not free; the
database numbers them one after the other, so all coordinators agree which that is. A claim is free once its
coordinator has ended, or sent no heartbeat for `GRACE_S`: Optuna fails the trial. A trial of a design that
failed in training has the attribute `failed`.
"""

from __future__ import annotations

import contextlib
import threading
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

import dse
from dse import store
from dse.config import ConfigError, Fault, SearchSpace
from dse.config.space import Design
from dse.native.extras import MissingExtra
from dse.seeds import design_key
from dse.study import warm
from dse.study.claim import changes_elsewhere
from dse.study.ledger import described, quiet

if TYPE_CHECKING:
    from optuna.storages import BaseStorage, RDBStorage
    from optuna.trial import FrozenTrial

HEARTBEAT_S, GRACE_S = 30, 150
_CONNECT_S = 10
_ATTEMPTS, _PAUSE_S = 5, 0.3
# Attributes of the study, and of its trials.
_SPACE, _VERSION = "search_space", "dse_version"
_KEY, _DESIGN, _COORDINATOR, _FAILED = "key", "design", "coordinator", "failed"


@dataclass(frozen=True)
class Elsewhere:
    """A design of another coordinator.

    values: its objectives; None: it is in training, or failed. violations: limit -> by how much it misses it.
    is_new: whether it was not known before.
    """

    design: Design
    values: Sequence[float] | None
    violations: Mapping[str, float]
    is_new: bool


class SharedStudy:
    """The claims of one coordinator. A context manager: at its end, what is not trained is free again.

    Raises:
        StoreError: the database cannot be reached, read or written; what is trained is in the study folder.
        MissingExtra: its driver is not installed.
        ConfigError: it holds another study of that name.
    """

    def __init__(self, space: SearchSpace, folder: Path) -> None:
        import optuna

        assert space.execution.storage is not None
        self._space = space
        self._url = space.execution.storage
        self._coordinator = store.identity(folder / store.ENVIRONMENT)
        self._most = space.search.n_trials or space.n_designs or 0
        self._open: set[int] = set()  # claims that need a heartbeat, by Optuna's id
        self._known: dict[str, object] = {}  # key of a design elsewhere -> state
        self._is_closed = threading.Event()
        with self._explained():
            self._database = _opened(self._url)
            self._storage: BaseStorage = optuna.storages.get_storage(self._database)
            ways = optuna.study.StudyDirection
            directions = [ways.MAXIMIZE if way == "max" else ways.MINIMIZE for _, way in space.objectives]
            self._study = optuna.create_study(
                storage=self._storage, study_name=space.study, directions=directions, load_if_exists=True
            )
            self._check()
            self._beat_first()
        self._thread = threading.Thread(target=self._beat_all, daemon=True)

    def _check(self) -> None:
        """Check that the shared study is of this search space and version, or make it so if it is new."""
        attributes = self._study.user_attrs
        if _SPACE not in attributes and not self._trials():
            self._study.set_metric_names([name for name, _ in self._space.objectives])
            self._study.set_user_attr(_VERSION, dse.__version__)
            self._study.set_user_attr(_SPACE, yaml.safe_load(self._space.to_yaml()))
            attributes = self._study.user_attrs
        where = f"study '{self._space.study}' in {self._url}"
        hint = "use another study name or database"
        if _SPACE not in attributes:
            texts = [f"{where} was not made by dse; {hint}"]
        else:
            now = yaml.safe_load(self._space.to_yaml())
            texts = [
                f"{key} is {new!r}, but {old!r} in {where}; {hint}"
                for key, old, new in changes_elsewhere(attributes[_SPACE], now)
            ]
            if (version := attributes.get(_VERSION)) != dse.__version__:
                texts.append(f"{where} is of dse {version}, not {dse.__version__}; {hint}")
        if texts:
            raise ConfigError([Fault(str(self._space.source), 0, text) for text in texts])

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Raise what a database may raise as one sentence."""
        import optuna
        from sqlalchemy.exc import SQLAlchemyError

        try:
            with warnings.catch_warnings(), quiet():
                warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
                yield
        except ImportError:
            raise MissingExtra(
                "execution.storage postgresql:// needs psycopg: pip install 'dse[postgresql]'"
            ) from None
        except (SQLAlchemyError, optuna.exceptions.OptunaError, RuntimeError, ValueError) as error:
            cause: BaseException = error
            while inner := getattr(cause, "orig", None) or cause.__cause__:
                cause = inner
            text = next(iter(str(cause).splitlines()), "") or type(cause).__name__
            raise store.StoreError(
                f"execution.storage {self._url}: {text}; finished runs are kept, and the same command goes on"
            ) from None

    def __enter__(self) -> SharedStudy:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closed.set()
        self._thread.join()
        with contextlib.suppress(store.StoreError), self._explained():
            self._give_back(self._open)
        with contextlib.suppress(Exception):
            self._storage.remove_session()
            self._database.engine.dispose()

    def _beat_first(self) -> None:
        """Send a heartbeat for claims whose coordinator died before it sent one: else they are never free."""
        with self._database.engine.connect() as connection:
            rows = connection.exec_driver_sql("SELECT trial_id FROM trial_heartbeats")
            with_one = {row[0] for row in rows}
        for trial in self._trials():
            if trial.state.name == "RUNNING" and trial._trial_id not in with_one:
                self._beat(trial._trial_id)

    def _beat_all(self) -> None:
        """Send heartbeats; a database that is down now may be up for the next one."""
        while not self._is_closed.wait(HEARTBEAT_S):
            for one in list(self._open):
                with contextlib.suppress(Exception):
                    self._beat(one)
        self._storage.remove_session()

    def _beat(self, trial_id: int) -> None:
        self._database.record_heartbeat(trial_id)

    def _trials(self) -> list[FrozenTrial]:
        return self._storage.get_all_trials(self._study._study_id, deepcopy=False)

    def _is_ours(self, trial: FrozenTrial) -> bool:
        return bool(trial.user_attrs.get(_COORDINATOR) == self._coordinator)

    def _claims(self) -> dict[str, FrozenTrial]:
        """Return the key of a design -> the claim that holds."""
        claims: dict[str, FrozenTrial] = {}
        for trial in self._trials():  # by number
            if _KEY in trial.user_attrs and not _is_free(trial):
                claims.setdefault(trial.user_attrs[_KEY], trial)
        return claims

    def _give_back(self, trial_ids: Iterable[int]) -> None:
        import optuna

        for one in list(trial_ids):
            with contextlib.suppress(optuna.exceptions.UpdateFinishedTrialError):
                self._storage.set_trial_state_values(one, optuna.trial.TrialState.FAIL)
            self._open.discard(one)

    def resume(self, designs: Iterable[Mapping[str, object]]) -> None:
        """Give back claims of this coordinator that its journal does not have: it died before it wrote it.

        Args:
            designs: of the journal.
        """
        import optuna

        keys = set(map(design_key, designs))
        with self._explained():
            self._give_back(
                trial._trial_id
                for trial in self._trials()
                if self._is_ours(trial)
                and trial.state == optuna.trial.TrialState.RUNNING
                and trial.user_attrs[_KEY] not in keys
            )

    def n_left(self) -> int:
        """Return the number of designs of the study that no coordinator has claimed."""
        with self._explained():
            return max(0, self._most - len(self._claims()))

    def n_in_training_elsewhere(self) -> int:
        """Return the number of designs that other coordinators train."""
        import optuna

        running = optuna.trial.TrialState.RUNNING
        with self._explained():
            return sum(x.state == running and not self._is_ours(x) for x in self._claims().values())

    def free(self) -> list[Design]:
        """Return the designs of claims that are free, after freeing those without a heartbeat."""
        import optuna

        with self._explained():
            optuna.storages.fail_stale_trials(self._study)
            claims = self._claims()
            designs = {
                x.user_attrs[_KEY]: warm.on_axes(self._space, x.user_attrs[_DESIGN])
                for x in self._trials()
                if x.user_attrs.get(_KEY, "") not in claims and _DESIGN in x.user_attrs
            }
        return [design for design in designs.values() if design is not None]

    def elsewhere(self) -> list[Elsewhere]:
        """Return the designs that other coordinators have begun or ended since the last call."""
        with self._explained():
            claims = self._claims()
        changed = []
        for key, trial in claims.items():
            if self._is_ours(trial) or self._known.get(key) == trial.state:
                continue
            design = warm.on_axes(self._space, trial.user_attrs[_DESIGN])
            if design is not None:
                changed.append(Elsewhere(design, trial.values, trial.constraints, key not in self._known))
            self._known[key] = trial.state
        return changed

    def claim(
        self, designs: Sequence[Mapping[str, object]], *, beyond_the_last: bool = False
    ) -> list[Mapping[str, object]]:
        """Claim designs; return those that no other coordinator has claimed before.

        Args:
            designs: of the search space.
            beyond_the_last: also where all coordinators together have `search.n_trials` designs already.
        """
        import optuna

        running = optuna.trial.TrialState.RUNNING
        with self._explained():
            before = self._claims()
            ours: dict[str, int] = {}
            for design in designs:
                key = design_key(design)
                if key not in before:
                    scalars, distributions = described(self._space, design)
                    template = optuna.trial.create_trial(
                        state=running,
                        params=scalars,
                        distributions=distributions,
                        user_attrs={_KEY: key, _DESIGN: dict(design), _COORDINATOR: self._coordinator},
                    )
                    ours[key] = self._storage.create_new_trial(self._study._study_id, template)
                    self._beat(ours[key])
                elif self._is_ours(before[key]):  # of a session before
                    ours[key] = before[key]._trial_id
                    if before[key].state == running:
                        self._beat(ours[key])
            claims = self._claims() if ours else before
            in_order = sorted(claims.values(), key=lambda trial: trial.number)
            place = {trial._trial_id: n for n, trial in enumerate(in_order)}
            held = {
                key: one
                for key, one in ours.items()
                if key in claims and claims[key]._trial_id == one
                if beyond_the_last or key in before or place[one] < self._most
            }
            self._give_back(one for key, one in ours.items() if key not in held)
            self._open |= {one for key, one in held.items() if claims[key].state == running}
        return [design for design in designs if design_key(design) in held]

    def report(
        self, design: Mapping[str, object], values: Sequence[float] | None, violations: Mapping[str, float]
    ) -> None:
        """Tell the other coordinators the result of a design, unless another one has claimed it by now.

        Args:
            design: that this coordinator has trained.
            values: its objectives; None if it failed.
            violations: limit -> by how much it misses it.
        """
        import optuna

        states = optuna.trial.TrialState
        for _ in range(2):  # again if the claim was freed in between
            if not self.claim([design], beyond_the_last=True):
                return
            with self._explained(), contextlib.suppress(optuna.exceptions.UpdateFinishedTrialError):
                one = self._claims()[design_key(design)]
                if one.state != states.RUNNING:
                    return
                for limit, violation in violations.items():
                    name = f"constraints:{limit}"
                    self._storage.set_trial_system_attr(one._trial_id, name, float(violation))
                if values is None:
                    self._storage.set_trial_user_attr(one._trial_id, _FAILED, True)
                state = states.FAIL if values is None else states.COMPLETE
                self._storage.set_trial_state_values(one._trial_id, state, values)
                self._open.discard(one._trial_id)
                return


def _is_free(trial: FrozenTrial) -> bool:
    return trial.state.name == "FAIL" and not trial.user_attrs.get(_FAILED)


def _opened(url: str) -> RDBStorage:
    """Return Optuna's storage in a database, with its tables."""
    from optuna.storages import RDBStorage
    from sqlalchemy.engine import make_url
    from sqlalchemy.exc import IntegrityError, OperationalError, ProgrammingError

    place = make_url(url)
    arguments: dict[str, Any] = {"timeout": 2 * GRACE_S}
    if place.drivername == "postgresql":
        place = place.set(drivername="postgresql+psycopg")
        arguments = {"connect_timeout": _CONNECT_S}
    for attempt in range(_ATTEMPTS):
        try:
            return RDBStorage(
                place.render_as_string(hide_password=False),
                {"connect_args": arguments, "pool_pre_ping": True},
                heartbeat_interval=HEARTBEAT_S,
                grace_period=GRACE_S,
            )
        except (IntegrityError, OperationalError, ProgrammingError) as error:
            if "already exists" not in str(error) or attempt == _ATTEMPTS - 1:
                raise
            time.sleep(_PAUSE_S)  # another coordinator makes the tables
    raise AssertionError
