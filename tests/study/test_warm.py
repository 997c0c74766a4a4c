"""Warm start from earlier studies, and searches that stop: with models that take no time."""

import pytest

from dse import store
from dse.config import ConfigError
from dse.search.space import design_at
from dse.store import read_record, run_file
from dse.study import explore
from dse.study.doctor import examine
from dse.study.ledger import Entry
from dse.study.results import Study
from dse.study.runs import Runs
from dse.study.warm import Takeover, earlier_trials
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


def model(*hidden):
    return {"kind": "fake", "hidden": {"choice": [[n] for n in hidden]}, "true_rate": {"choice": [0.2, 0.8]}}


def rows(study):
    return sorted(study.trials[COLUMNS].to_numpy().tolist())


def taken(study):
    records = (read_record(run_file(study.folder, trial, 0)) for trial in study.trials["trial"])
    return [record.get("taken_from") for record in records]


def test_equal_designs_are_taken_over_and_not_trained_again(search, tmp_path):
    search("first", model=model(4, 8))
    warm = search("second", model=model(4, 16), search={"sampler": "grid", "from": ["results/first"]})
    assert [x and (x["study"], x["trial"]) for x in taken(warm)] == [("first", 0), ("first", 1), None, None]
    store.load_run(run_file(warm.folder, 1, 0))  # whole, by its checksums
    assert examine(warm.folder) == []
    assert rows(search("alone", model=model(4, 16))) == rows(warm)


def test_what_is_not_equal_is_trained_again(search, tmp_path):
    search("first", model=model(4))

    def taken_over(**changes):
        settings = {"sampler": "grid", "from": ["results/first"]}
        space = make_space(tmp_path, study="second", **{"model": model(4), "search": settings} | changes)
        takeover = Takeover(space, tmp_path / "second", earlier_trials(space))
        n = takeover.over(Entry(0, 0, design_at(space, 0), proposed_s=0.0))
        store.remove(tmp_path / "second")
        return n

    assert taken_over() == 1
    assert taken_over(seed=8) == 0
    assert taken_over(training={"epochs": 3}) == 0
    assert taken_over(split={"stratified": {"validation": 0.25}}) == 0
    assert taken_over(decision={"phi": [0], "theta": [0.5]}) == 0
    assert taken_over(hardware=["loihi2_board"]) == 0
    with pytest.raises(ConfigError, match=r"holds no design with the axes model\.hidden of this space"):
        taken_over(model={"kind": "fake", "hidden": {"choice": [[4], [8]]}})
    with pytest.raises(ConfigError, match=r"search\.from: .*none/search_space\.yaml: is missing"):
        taken_over(search={"sampler": "grid", "from": ["results/none"]})


def test_a_search_stops_and_goes_on(search, monkeypatch):
    monkeypatch.setattr(Runs, "train_s", lambda runs: 3600.0 * runs.count())
    settings = {"sampler": "grid", "batch": 2, "stop": {"cpu_hours": 1}}
    stopped = search("stopped", search=settings)
    n = len(stopped.trials)
    assert n == 2
    assert any("search.stop.cpu_hours 1 is reached" in text for text in stopped.warnings)
    with pytest.raises(ConfigError, match=r"cpu_hours 1 is reached.*raise it to go on"):
        search("stopped", search=settings)
    assert len(Study(stopped.folder).trials) == n
    whole = search("stopped", search={"sampler": "grid", "batch": 2})
    assert not [text for text in whole.warnings if text.startswith("the search stopped")]
    assert rows(whole) == rows(search("alone", search={"sampler": "grid", "batch": 2}))


def test_time_ends_a_search_which_goes_on(search, monkeypatch):
    """No job begins that cannot end, and what ended is in the tables."""
    ended = []
    clock = Runs._clock
    settings = {"sampler": "grid", "stop": {"minutes": 5}}
    with monkeypatch.context() as patch:
        patch.setattr(Runs, "_clock", lambda runs, job: (ended.append(job), clock(runs, job)))
        patch.setattr(Workers, "left_s", property(lambda _: 0.0 if len(ended) >= 2 else 100.0))
        stopped = search("timed", search=settings)
    assert len(ended) == len(stopped.trials) == 2
    assert any("search.stop.minutes" in text for text in stopped.warnings)
    whole = search("timed", search=settings)
    assert not [text for text in whole.warnings if text.startswith("the search stopped")]
    assert rows(whole) == rows(search("alone", search={"sampler": "grid"}))
