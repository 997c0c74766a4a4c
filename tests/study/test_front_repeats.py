"""Repeats where membership of the front is undecided: who gets them, the bounds, and interruptions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pandas.testing import assert_frame_equal

from dse import store
from dse.cli.command_line import main
from dse.study import explore
from dse.study.resampling import front_probabilities
from dse.study.results import Study
from dse.study.workers import Workers
from tests import tiny_study
from tests.study.test_racing import in_process


@pytest.fixture(scope="module", autouse=True)
def fake_model() -> Iterator[None]:
    tiny_study.register()
    yield
    tiny_study.unregister()


@pytest.fixture(autouse=True)
def without_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Workers, "stream", in_process)


def run(folder: Path, **search: Any) -> Study:
    # Right in a share of `true_rate`: 0.1 is hopeless, 0.9 is on the front, 0.6 and 0.65 may be the smaller.
    folder.mkdir(exist_ok=True)
    space = tiny_study.make_space(
        folder,
        model={
            "kind": "curve",
            "true_rate": {"choice": [0.1, 0.6, 0.65, 0.9]},
            "hidden": {"choice": [[8], [9]]},
        },
        training={"epochs": 30},
        objectives=["accuracy:max", "n_weights:min"],
        search={"sampler": "grid", "repeats_on_front": 4, "front_undecided": [0.02, 0.98], **search},
        execution={"jobs": 1},
    )
    return explore.run(space, folder / "results", progress=False)


def test_only_undecided_designs_are_repeated_and_rounds_survive_an_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run(tmp_path / "whole")
    rounds = store.document(whole.folder, "front_repeats")
    repeats = whole.trials.set_index("trial")["repeats"]
    last: dict[int, int] = {}
    for one in rounds:
        for trial, n in one["repeats"].items():
            assert 0.02 <= one["probability"][trial] <= 0.98
            assert n == last.get(int(trial), 1) + 1
            last[int(trial)] = n
    assert repeats.to_dict() == {trial: last.get(trial, 1) for trial in repeats.index}
    assert repeats.max() <= 4 and (repeats == 1).any() and (repeats > 1).any()
    probability = front_probabilities(whole.folder, whole.points(), whole.objectives)
    for trial, p in probability.items():
        assert not 0.02 <= p <= 0.98 or repeats[trial] == 4
    left = len(repeats) + 2

    def interrupted(_: object) -> None:
        nonlocal left
        left -= 1
        if not left:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(explore._Tables, "refresh", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path / "killed")
    again = run(tmp_path / "killed")
    assert store.document(again.folder, "front_repeats") == rounds
    for one, other in ((whole.trials, again.trials), (whole.points(), again.points())):
        assert_frame_equal(one.drop(columns="train_s"), other.drop(columns="train_s"))


def test_the_total_is_bounded(tmp_path: Path) -> None:
    found = run(tmp_path / "bounded", front_trainings=2)
    assert (found.trials["repeats"] - 1).sum() == 2


@pytest.mark.parametrize(
    ("search", "fault"),
    [
        ("{repeats_on_front: 3, front_undecided: [0.9, 0.1]}", "must be two probabilities, rising"),
        ("{front_undecided: [0.1, 0.9]}", "needs search.repeats_on_front above search.repeats, 1"),
        ("{repeats_on_front: 3, front_trainings: 5}", "search.front_trainings needs search.front_undecided"),
        ("{repeats_on_front: 3, front_undecided: [0.1, 1.5]}", "search.front_undecided"),
    ],
)
def test_bad_bounds_are_faults(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], search: str, fault: str
) -> None:
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    path = tmp_path / "space.yaml"
    path.write_text(
        "study: bad\n"
        "data: {kind: raster, file: tiny.npz, step_ms: 5.0, columns: {fabric: label}}\n"
        "task: {target: fabric}\n"
        "split: {stratified: {validation: 0.5}}\n"
        "model: {kind: snn}\n"
        "objectives: [accuracy:max]\n"
        f"search: {search}\n"
    )
    assert main(["check", str(path)]) == 2
    error = capsys.readouterr().err
    assert f"{path}:7: " in error and fault in error
