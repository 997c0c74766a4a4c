"""The journal of a study, as `optuna.load_study` and optuna-dashboard's own API over HTTP read it."""

from __future__ import annotations

import json
import threading
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, make_server

import optuna
import optuna_dashboard
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from dse.config import load_space
from dse.search.limits import Exclusion
from dse.search.space import design_at
from dse.study.ledger import Ledger
from tests.spaces import write_space

LIMIT = "n_weights <= 60"


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A journal of an excluded, a finished, a failed and an open trial."""
    folder = tmp_path_factory.mktemp("journal")
    space = load_space(write_space(folder))
    path = folder / "journal.log"
    ledger = Ledger(path, space)
    ledger.exclude(0, design_at(space, 5), Exclusion("cannot meet it", (LIMIT,), {LIMIT: 0.25}))
    ledger.ask(0, [design_at(space, place) for place in (0, 1, 2)])
    ledger.tell(1, (0.75, 42.0), {LIMIT: 0.0})
    ledger.tell(2, None)
    return path


def test_optuna_loads_the_study(journal: Path) -> None:
    study = optuna.load_study(study_name="dse", storage=JournalStorage(JournalFileBackend(str(journal))))
    assert study.metric_names == ["accuracy", "n_weights"]
    excluded, finished, failed, running = study.trials
    states = TrialState.PRUNED, TrialState.COMPLETE, TrialState.FAIL, TrialState.RUNNING
    assert tuple(trial.state for trial in study.trials) == states
    assert finished.params == {"encoder.thresholds": "[1.0, 2.0]", "model.hidden": 4}
    assert finished.values == [0.75, 42.0]
    assert (finished.constraints, excluded.constraints) == ({LIMIT: 0.0}, {LIMIT: 0.25})
    assert excluded.user_attrs["excluded"] == "cannot meet it"
    assert failed.values is None
    assert running.user_attrs["design"]["model.hidden"] == 12
    assert [trial.number for trial in study.best_trials] == [1]


class _Silent(WSGIRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def served(journal: Path) -> Iterator[str]:
    app = optuna_dashboard.wsgi(JournalStorage(JournalFileBackend(str(journal))))
    with make_server("127.0.0.1", 0, app, handler_class=_Silent) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def answer(url: str) -> Any:
    with urllib.request.urlopen(url, timeout=120) as response:
        return json.load(response)


def test_the_dashboard_serves_the_study(served: str) -> None:
    (summary,) = answer(f"{served}/api/studies")["study_summaries"]
    assert summary["study_name"] == "dse"
    assert summary["directions"] == ["maximize", "minimize"]
    study = answer(f"{served}/api/studies/{summary['study_id']}")
    trials = study["trials"]
    assert [trial["state"] for trial in trials] == ["Pruned", "Complete", "Fail", "Running"]
    assert study["objective_names"] == ["accuracy", "n_weights"]
    assert trials[1]["values"] == [0.75, 42.0]
    assert {x["name"]: x["param_external_value"] for x in trials[1]["params"]}["model.hidden"] == "4"
    assert [trial["number"] for trial in study["best_trials"]] == [1]
