"""The trials of a study as a study of Optuna, for `optuna-dashboard` and Optuna's own plots."""

from __future__ import annotations

import json
import math
import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.config import SearchSpace, load_space
from dse.search.proposals import distribution
from dse.study.ledger import Entry, read_entries

if TYPE_CHECKING:
    import optuna


def as_optuna(folder: Path, storage: str | None = None) -> optuna.Study:
    """Return the trials of a study as a study of Optuna, which is named as its folder.

    Args:
        folder: of the study.
        storage: where it is written, such as sqlite:///search.db; None: in memory.

    Raises:
        ConfigError: a component of the search space is not installed here.
        optuna.exceptions.DuplicatedStudyError: the storage has a study of this name.
    """
    import optuna

    space = load_space(folder / "search_space.yaml")
    ways = optuna.study.StudyDirection
    directions = [ways.MAXIMIZE if way == "max" else ways.MINIMIZE for _, way in space.objectives]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study = optuna.create_study(study_name=folder.absolute().name, directions=directions, storage=storage)
        study.set_metric_names([name for name, _ in space.objectives])
        study.add_trials([_trial(space, entry) for entry in read_entries(folder)])
    return study


def _trial(space: SearchSpace, entry: Entry) -> optuna.trial.FrozenTrial:
    from optuna.trial import TrialState, create_trial

    state = TrialState.FAIL if entry.is_reported else TrialState.RUNNING
    if entry.values is not None:
        state = TrialState.COMPLETE
    if entry.stopped or entry.excluded:
        state = TrialState.PRUNED
    distributions = {
        name: distribution(axis, [_scalar(value) for value in axis.values or ()])
        for name, axis in space.axes.items()
        if name in entry.design
    }
    about = {"batch": entry.batch, "design": dict(entry.design)}
    about |= {"excluded": entry.excluded} if entry.excluded else {}
    trial = create_trial(
        state=state,
        values=None if entry.values is None or not all(map(math.isfinite, entry.values)) else entry.values,
        params={name: _scalar(entry.design[name]) for name in distributions},
        distributions=distributions,
        user_attrs=about | ({"enqueued": True} if entry.enqueued else {}),
        intermediate_values=dict(entry.at_rungs),
    )
    trial.datetime_start = _moment(entry.proposed_s)
    if entry.reported_s is not None:
        trial.datetime_complete = _moment(entry.reported_s)
    return trial


def _moment(seconds: float) -> datetime:
    """Return a moment as Optuna has it: local, without a time zone."""
    return datetime.fromtimestamp(seconds, UTC).astimezone().replace(tzinfo=None)


def _scalar(value: Any) -> bool | float | str:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)
