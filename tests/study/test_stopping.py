"""Searches that stop, and go on: with models that take no time."""

import pytest

from dse.models.snn.family import SNN
from dse.study import explore
from dse.study.training import Training
from dse.study.workers import Workers
from tests.tiny_study import make_space

COLUMNS = ["model.hidden", "model.true_rate", "accuracy", "n_weights", "energy_uj"]


@pytest.fixture
def search(tmp_path, monkeypatch):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))

    def run(study, **changes):
        space = make_space(tmp_path, study=study, execution={"jobs": 1}, **changes)
        return explore.run(space, tmp_path / "results", progress=False)

    yield run


def rows(study):
    return sorted(study.trials[COLUMNS].to_numpy().tolist())


def test_time_ends_a_search_which_goes_on(search, monkeypatch):
    """No job begins that cannot end, and what ended is in the tables."""
    ended = []
    clock = Training._clock
    settings = {"sampler": "grid", "stop": {"minutes": 5}}
    with monkeypatch.context() as patch:
        patch.setattr(Training, "_clock", lambda runs, job: (ended.append(job), clock(runs, job)))
        patch.setattr(Workers, "left_s", property(lambda _: 0.0 if len(ended) >= 2 else 100.0))
        stopped = search("timed", search=settings)
    assert len(ended) == len(stopped.trials) == 2
    assert any("search.stop.minutes" in text for text in stopped.warnings)
    whole = search("timed", search=settings)
    assert not [text for text in whole.warnings if text.startswith("the search stopped")]
    assert rows(whole) == rows(search("alone", search={"sampler": "grid"}))


def test_what_trains_alone_is_in_the_tables_before_networks(tmp_path, monkeypatch):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(SNN, "cost", lambda *_: 100.0)
    network = {"kind": "snn", "hidden": {"choice": [4, 8]}}
    space = make_space(
        tmp_path,
        model={"choice": [network, {"kind": "linear", "window_ms": 20}]},
        execution={"jobs": 1},
        search={"sampler": "grid"},
    )
    order = []
    explore.run(space, tmp_path / "results", progress=False, on_trial=lambda row: order.append(row["family"]))
    assert order == ["linear", "snn", "snn"]
