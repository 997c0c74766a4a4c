"""Section `evaluation`: what it is, and every fault that a file alone shows."""

from dse.config import load_space
from dse.config.settings import Evaluation, Groups
from tests.spaces import faults_of, write_space

SPLIT = "encoder: {kind"


def written(folder, evaluation, *changes):
    """Write the small search space with a section `evaluation`, which is line 13."""
    return write_space(folder, (SPLIT, f"evaluation: {evaluation}\n{SPLIT}"), *changes)


def test_short_and_long_forms(tmp_path):
    space = load_space(written(tmp_path, "{shifts: 4, leave_out: [speed, {column: repetition, folds: 2}]}"))
    evaluation = space.evaluation
    assert evaluation == Evaluation((4,), ("speed", Groups("repetition", 2)))
    assert evaluation.groups == (Groups("speed"), Groups("repetition", 2, seed=1))
    assert load_space(written(tmp_path, "{leave_out: speed}")).evaluation == Evaluation(None, "speed")
    (tmp_path / "again.yaml").write_text(space.to_yaml())
    assert load_space(tmp_path / "again.yaml").evaluation == evaluation
    assert load_space(write_space(tmp_path)).evaluation is None


def test_accuracies_of_the_section_are_objectives(tmp_path):
    goals = "[accuracy_shifted:max, accuracy_unseen:max]"
    path = written(tmp_path, "{shifts: [1], leave_out: speed}", ("[accuracy:max, n_weights:min]", goals))
    assert load_space(path).objectives == (("accuracy_shifted", "max"), ("accuracy_unseen", "max"))


def test_folds_of_a_cross_validation_are_its_own(tmp_path):
    split = "split:\n  train: {repetition: [0]}\n  validation: {repetition: [1]}"
    path = written(tmp_path, "{leave_out: speed}", (split, "split: {k_fold: {k: 2}}"))
    assert faults_of(path) == [
        "11: evaluation.leave_out needs a split without k_fold, whose folds the repeats are"
    ]
