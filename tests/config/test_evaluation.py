"""Section `evaluation`: what it is, and every fault that a file alone shows."""

from __future__ import annotations

from pathlib import Path

import pytest

from dse.config import load_space
from dse.config.settings import Evaluation, Groups
from tests.spaces import faults_of, write_space

SPLIT = "encoder: {kind"


def written(folder: Path, evaluation: str, *changes: tuple[str, str]) -> Path:
    """Write the small search space with a section `evaluation`, which is line 13."""
    return write_space(folder, (SPLIT, f"evaluation: {evaluation}\n{SPLIT}"), *changes)


def test_short_and_long_forms(tmp_path: Path) -> None:
    space = load_space(written(tmp_path, "{shifts: 4, leave_out: [speed, {column: repetition, folds: 2}]}"))
    evaluation = space.evaluation
    assert evaluation == Evaluation((4,), ("speed", Groups("repetition", 2)))
    assert evaluation is not None
    assert evaluation.groups == (Groups("speed"), Groups("repetition", 2, seed=1))
    assert load_space(written(tmp_path, "{leave_out: speed}")).evaluation == Evaluation(None, "speed")
    (tmp_path / "again.yaml").write_text(space.to_yaml())
    assert load_space(tmp_path / "again.yaml").evaluation == evaluation
    assert load_space(write_space(tmp_path)).evaluation is None


def test_accuracies_of_the_section_are_objectives(tmp_path: Path) -> None:
    goals = "[accuracy_shifted:max, accuracy_unseen:max]"
    path = written(tmp_path, "{shifts: [1], leave_out: speed}", ("[accuracy:max, n_weights:min]", goals))
    assert load_space(path).objectives == (("accuracy_shifted", "max"), ("accuracy_unseen", "max"))


@pytest.mark.parametrize(
    ("evaluation", "changes", "faults"),
    [
        ("{}", [], ["13: evaluation needs shifts or leave_out"]),
        ("{shifts: []}", [], ["13: evaluation.shifts must hold at least one shift, got []"]),
        ("{shifts: [2, 2]}", [], ["13: evaluation.shifts must hold each entry once, got 2 twice"]),
        ("{shifts: [0.5]}", [], ["13: evaluation.shifts[0] must be an integer, got 0.5"]),
        ("{leave_out: []}", [], ["13: evaluation.leave_out must hold at least one column, got []"]),
        (
            "{leave_out: [speed, {column: speed}]}",
            [],
            ["13: evaluation.leave_out must hold each entry once, got 'speed' twice"],
        ),
        (
            "{shifts: [2]}",
            [("{n_steps: 16, at: middle}", "{at: middle}")],
            ["13: evaluation.shifts needs window.n_steps: a window of a whole recording has no room to move"],
        ),
        (
            "{leave_out: [sped, fabric]}",
            [],
            [
                "13: evaluation.leave_out must be among data.columns, got 'sped'; known: fabric, speed, "
                "repetition. Did you mean 'speed'?",
                "13: evaluation.leave_out must not be the target, got 'fabric', which task.target predicts",
            ],
        ),
        (
            "{leave_out: speed}",
            [("{target: fabric}", "{target: {choice: [fabric, {column: speed, abs: true}]}}")],
            ["13: evaluation.leave_out must not be the target, got 'speed', which task.target predicts"],
        ),
        (
            "{leave_out: {column: speed, folds: 1}}",
            [],
            ["13: evaluation.leave_out.folds must be >= 2, got 1"],
        ),
        (
            "{shifts: [2]}",
            [("accuracy:max", "accuracy_unseen:max"), ("n_weights:min", "accuracy_shifted:max")],
            ["19: objective 'accuracy_unseen' needs leave_out in section 'evaluation', got none"],
        ),
        (
            "{shifts: [2]}",
            [("{epochs: 1, batch_size: 8}", "{epochs: 1, crops: 3}")],
            ["16: training.crops needs window.jitter_steps > 0, got 0"],
        ),
    ],
)
def test_faults(tmp_path: Path, evaluation: str, changes: list[tuple[str, str]], faults: list[str]) -> None:
    assert faults_of(written(tmp_path, evaluation, *changes)) == faults


def test_folds_of_a_cross_validation_are_its_own(tmp_path: Path) -> None:
    split = "split:\n  train: {repetition: [0]}\n  validation: {repetition: [1]}"
    path = written(tmp_path, "{leave_out: speed}", (split, "split: {k_fold: {k: 2}}"))
    assert faults_of(path) == [
        "11: evaluation.leave_out needs a split without k_fold, whose folds the repeats are"
    ]
