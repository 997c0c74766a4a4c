"""A study as Optuna reads it, in memory and from a storage, as optuna-dashboard does."""

from __future__ import annotations

import optuna
import pytest
from optuna.trial import TrialState

from dse import store
from dse.config import load_space
from dse.search.limits import Exclusion
from dse.search.space import design_at
from dse.study.as_optuna import as_optuna
from dse.study.ledger import Ledger, read_entries
from tests.spaces import write_space


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of an excluded, a finished, a failed and an open trial."""
    folder = tmp_path_factory.mktemp("study")
    space = load_space(write_space(folder))
    store.write_text(folder / store.SPACE, space.to_yaml())
    with store.Book(folder, writes=True) as book:
        ledger = Ledger(book)
        ledger.exclude(0, design_at(space, 5), Exclusion("cannot meet it", ("n_weights <= 60",)))
        ledger.ask(0, [design_at(space, place) for place in (0, 1, 2)])
        ledger.tell(1, (0.75, 42.0), {3: 0.5})
        ledger.tell(2, None)
    return folder


def test_optuna_has_the_trials_of_the_study(folder):
    study = as_optuna(folder)
    assert study.metric_names == ["accuracy", "n_weights"]
    excluded, finished, failed, running = study.trials
    states = TrialState.PRUNED, TrialState.COMPLETE, TrialState.FAIL, TrialState.RUNNING
    assert tuple(trial.state for trial in study.trials) == states
    assert finished.params == {"encoder.thresholds": "[1.0, 2.0]", "model.hidden": 4}
    assert (finished.values, finished.intermediate_values) == ([0.75, 42.0], {3: 0.5})
    assert excluded.user_attrs["excluded"] == "cannot meet it"
    assert failed.values is None
    assert running.user_attrs["design"]["model.hidden"] == 12
    assert [trial.number for trial in study.best_trials] == [1]
    for trial, entry in zip(study.trials, read_entries(folder), strict=True):
        assert trial.datetime_start.timestamp() == pytest.approx(entry.proposed_s, abs=1e-5)
        assert (trial.datetime_complete is None) == (entry.reported_s is None)


def test_a_storage_has_the_same_trials(folder, tmp_path):
    place = f"sqlite:///{tmp_path}/optuna.db"
    as_optuna(folder, place)
    read = optuna.load_study(study_name=folder.name, storage=place)
    here = as_optuna(folder)
    assert [x.state for x in read.trials] == [x.state for x in here.trials]
    assert [x.params for x in read.trials] == [x.params for x in here.trials]
    assert (read.directions, read.metric_names) == (here.directions, here.metric_names)
