"""A study as Optuna reads it, and as optuna-dashboard's own API over HTTP serves it."""

from __future__ import annotations

import json
import threading
import urllib.request
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, make_server

import optuna
import optuna_dashboard
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


class _Silent(WSGIRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def served(folder, tmp_path):
    place = f"sqlite:///{tmp_path}/optuna.db"
    as_optuna(folder, place)
    app = optuna_dashboard.wsgi(optuna.storages.RDBStorage(place))
    with make_server("127.0.0.1", 0, app, handler_class=_Silent) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def answer(url):
    with urllib.request.urlopen(url, timeout=120) as response:
        return json.load(response)


def test_the_dashboard_serves_the_study(served, folder):
    (summary,) = answer(f"{served}/api/studies")["study_summaries"]
    assert summary["study_name"] == folder.name
    assert summary["directions"] == ["maximize", "minimize"]
    study = answer(f"{served}/api/studies/{summary['study_id']}")
    trials = study["trials"]
    assert [trial["state"] for trial in trials] == ["Pruned", "Complete", "Fail", "Running"]
    assert study["objective_names"] == ["accuracy", "n_weights"]
    assert trials[1]["values"] == [0.75, 42.0]
    assert {x["name"]: x["param_external_value"] for x in trials[1]["params"]}["model.hidden"] == "4"
    assert [trial["number"] for trial in study["best_trials"]] == [1]
