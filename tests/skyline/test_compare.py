"""Two tables side by side, by hand: who is on the joint front, hypervolumes, gains within budgets."""

import pandas as pd
import pytest

from dse.skyline.compare import compare

GOALS = [("accuracy", "max"), ("energy_uj", "min")]


def table(*rows, task="texture", se=0.03):
    frame = pd.DataFrame(rows, columns=["trial", "accuracy", "energy_uj"])
    return frame.assign(task=task, hardware="chip", accuracy_se=se)


FIRST = table((0, 0.5, 1.0), (1, 0.8, 3.0))
SECOND = table((0, 0.7, 2.0), (1, 0.7, 3.0), (2, 1.0, 5.0), se=0.04)


def test_joint_front_hypervolumes_and_gains():
    result = compare({"a": FIRST, "b": SECOND}, GOALS)
    a, b = result.summary.to_dict("records")
    assert [a["points"], a["trials"], a["on_front"], a["on_joint_front"]] == [2, 2, 2, 2]
    assert [b["points"], b["trials"], b["on_front"], b["on_joint_front"]] == [3, 3, 2, 2]
    # Costs over both tables' ranges: a (1, 0), (0.4, 0.5); b (0.6, 0.25), (0, 1).
    assert a["hypervolume"] == pytest.approx(0.6 * 0.5)
    assert b["hypervolume"] == pytest.approx(0.4 * 0.75)
    assert a["hypervolume_joint"] == b["hypervolume_joint"] == pytest.approx(0.4 * 0.25 + 0.6 * 0.5)
    assert list(zip(result.front["study"], result.front["trial"], strict=True)) == [
        ("b", 2), ("a", 1), ("b", 0), ("a", 0),
    ]  # fmt: skip
    gains = result.gains.set_index("budget")
    assert list(gains.index) == ["energy_uj <= 2", "energy_uj <= 3", "energy_uj <= 5"]
    assert gains["gain"].tolist() == pytest.approx([0.2, -0.1, 0.2])
    assert gains["gain_se"].tolist() == pytest.approx([0.05] * 3)
    assert gains.loc["energy_uj <= 2", ["accuracy a", "accuracy b"]].tolist() == [0.5, 0.7]


def test_tasks_are_apart_and_a_budget_that_only_one_meets_has_no_gain():
    other = table((0, 0.9, 7.0), task="speed")
    second = table((0, 0.7, 2.0), (1, 0.75, 2.5), (2, 1.0, 5.0))
    result = compare(
        {"a": pd.concat([FIRST, other]), "b": pd.concat([second, other])}, GOALS, "accuracy > 0.6"
    )
    assert result.summary.groupby("task")["on_joint_front"].sum().to_dict() == {"speed": 2, "texture": 4}
    texture = result.gains.query("task == 'texture'").set_index("budget")
    assert pd.isna(texture.loc["energy_uj <= 2.5", "gain"])
    assert result.summary.query("task == 'speed'")["hypervolume"].tolist() == [1.0, 1.0]


def test_without_a_row_or_a_column_to_maximise_nothing_is_gained():
    assert compare({"a": FIRST, "b": SECOND}, GOALS, "accuracy > 2").summary.empty
    assert compare({"a": FIRST, "b": SECOND}, GOALS[1:]).gains.empty
