import itertools

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.skyline.constraints import ExpressionError
from dse.skyline.front import Draws
from dse.skyline.pick import pick, sure_pick, ties
from tests.skyline.tables import (
    DRAWN,
    GOALS,
    NAMING_OTHERS,
    POINTS,
    ROWS,
    UNCERTAIN,
    WORDS,
    energies,
    leaky,
    table,
)


def test_pick_is_the_most_accurate_within_the_budgets():
    found = pick(POINTS, ["energy_uj <= 50 and n_weights <= 150000"])
    assert found.row.name == 2  # as accurate as row 1, with less energy
    assert found.nearest.empty
    assert found.notes == [
        "row 4 excluded: accuracy is NaN",
        "2 design points have the same accuracy; the best energy_uj decides",
    ]


def test_ties_go_to_what_was_asked_for_then_to_the_first_row():
    assert pick(POINTS, ["energy_uj <= 50"], tie_breaks=[("n_weights", "min")]).row.name == 1
    assert pick(POINTS, [], tie_breaks=[("n_weights", "max")]).row.name == 0
    same = pd.concat([POINTS.iloc[[1]]] * 3, ignore_index=True)
    assert pick(same, ["energy_uj <= 50"]).row.name == 0


def test_ties_are_what_is_expected_then_other_goals_then_economy():
    frame = table(
        accuracy=[0.9],
        accuracy_corrected=[0.8],
        recall=[0.5],
        area=[1.0],
        n_weights=[1],
        energy_uj=[1.0],
        delay=[2],
    )
    asked = [
        ("area", "min"),
        ("energy_uj", "min"),
        ("accuracy", "max"),
        ("recall", "max"),
        ("n_weights", "min"),
    ]
    assert ties(frame, "accuracy", asked) == [
        ("accuracy_corrected", "max"),
        ("recall", "max"),
        ("energy_uj", "min"),
        ("n_weights", "min"),
        ("area", "min"),
    ]
    found = ties(frame.assign(latency_ms=[5.0]), "recall", [])
    assert found == [("latency_ms", "min"), ("energy_uj", "min"), ("n_weights", "min")]


def test_ties_in_every_goal_go_to_less_latency_then_energy_then_weights():
    frame = table(
        accuracy=[0.9, 0.9, 0.9, 0.8],
        latency_ms=[1000.0, 356.0, 356.0, 1.0],
        energy_uj=[1.0, 4.0, 3.0, 1.0],
        n_weights=[1, 1, 1, 1],
    )
    found = pick(frame, [])
    assert found.row.name == 2
    assert found.notes == [
        "3 design points have the same accuracy; the best latency_ms, then energy_uj decides"
    ]
    assert pick(frame, ["energy_uj <= 3.5"]).row.name == 2  # a budget is met or not, and decides nothing
    assert pick(frame, [], tie_breaks=[("energy_uj", "min")]).row.name == 0  # objectives come first
    decided = frame.rename(columns={"latency_ms": "decision_latency_ms"}).assign(latency_ms=np.nan)
    assert pick(decided, []).row.name == 2  # a chip that cannot say how long it takes


def test_ties_of_objectives_go_to_what_is_maximised_then_to_the_least_costly():
    frame = table(
        accuracy=[0.9] * 4,
        accuracy_shifted=[0.7, 0.8, 0.8, 0.8],
        n_weights=[1, 2, 3, 3],
        energy_uj=[1.0, 3.0, 2.0, 2.0],
        latency_ms=[1.0, 1.0, 9.0, 8.0],
    )
    objectives = [("n_weights", "min"), ("energy_uj", "min"), ("accuracy_shifted", "max")]
    for order in itertools.permutations(objectives):  # a search space lists them in any order
        assert [goal.column for goal in ties(frame, "accuracy", order)] == [
            *("accuracy_shifted", "energy_uj", "n_weights", "latency_ms")
        ]
        assert pick(frame, [], tie_breaks=order).row.name == 3


def test_a_row_that_lacks_a_tie_break_can_still_be_picked():
    frame = table(accuracy=[0.8, 0.9, 0.8], energy_uj=[2.0, np.nan, np.inf])
    found = pick(frame, [], tie_breaks=[("energy_uj", "min")])
    assert found.row.name == 1 and found.notes == []
    assert pick(frame.iloc[::-1], ["accuracy < 0.9"], tie_breaks=[("energy_uj", "min")]).row.name == 0


def test_another_column_can_be_maximised():
    assert pick(POINTS, ["accuracy >= 0.85"], maximise="n_weights").row.name == 0


def test_no_feasible_row_names_the_nearest_and_what_they_miss():
    found = pick(POINTS, ["energy_uj <= 10", "accuracy >= 0.96"], n_nearest=3)
    assert found.row is None
    assert found.nearest.index.tolist() == [3, 2, 1]
    assert found.nearest["missed energy_uj<=10"].tolist() == [10.0, 20.0, 30.0]
    assert found.nearest["missed accuracy>=0.96"].tolist() == pytest.approx([0.16, 0.06, 0.06])
    share = [10 / 10 + 0.16 / 0.96, 20 / 10 + 0.06 / 0.96, 30 / 10 + 0.06 / 0.96]
    assert found.nearest["shortfall"].tolist() == pytest.approx(share)


def test_a_limit_of_zero_counts_in_its_unit():
    found = pick(POINTS, ["energy_uj <= 0"])
    assert found.nearest["shortfall"].tolist() == [20.0, 30.0, 40.0, 100.0]


def test_equally_near_rows_are_ranked_by_what_is_maximised():
    frame = table(accuracy=[0.5, 0.9], energy_uj=[20.0, 20.0])
    assert pick(frame, ["energy_uj <= 10"]).nearest.index.tolist() == [1, 0]


def test_conditions_that_are_no_budget_are_never_relaxed():
    assert pick(POINTS, ["task == 'speed' and energy_uj <= 50"]).row.name == 3
    found = pick(POINTS, ["task == 'speed' and energy_uj <= 1"])
    assert found.nearest.index.tolist() == [3]
    nobody = pick(POINTS, ["task == 'joint'"])
    assert nobody.row is None
    assert nobody.nearest.empty
    assert nobody.notes == ["no row meets task == 'joint'; task is texture or speed"]


def test_strict_limits_are_not_met_by_equality():
    frame = table(accuracy=[0.9, 0.8], energy_uj=[10.0, 9.0])
    assert pick(frame, ["energy_uj < 10"]).row.name == 1
    assert pick(frame, ["energy_uj > 9 and energy_uj < 10"]).row is None


@pytest.mark.parametrize("budget", ["energy <= 5", "energy_uj", "task <= 5"])
def test_wrong_budgets_are_named(budget):
    with pytest.raises(ExpressionError):
        pick(POINTS, [budget])


@given(ROWS, st.sampled_from([0.5, 1.0, 2.0, 3.0]), st.sampled_from([10, 15, 20]))
def test_pick_is_best_and_feasible_or_nothing_is(rows, energy, weights):
    frame = pd.DataFrame(rows, columns=["accuracy", "energy_uj", "n_weights", "task"])
    frame = frame.astype({"accuracy": float, "energy_uj": float, "n_weights": int})
    found = pick(frame, [f"energy_uj <= {energy}", f"n_weights < {weights}"], n_nearest=99)
    finite = frame[np.isfinite(frame[["accuracy", "energy_uj"]]).all(axis=1)]
    feasible = finite[(finite["energy_uj"] <= energy) & (finite["n_weights"] < weights)]
    if feasible.empty:
        assert found.row is None
        assert set(found.nearest.index) == set(finite.index)
        assert (found.nearest["shortfall"] >= 0).all()
        assert found.nearest["shortfall"].is_monotonic_increasing
    else:
        assert found.row["accuracy"] == feasible["accuracy"].max()
        assert found.row.name in feasible.index


def test_the_nearest_are_different_designs():
    frame = pd.DataFrame(
        {"trial": [0, 0, 0, 1], "accuracy": [0.5, 0.6, 0.7, 0.9], "energy_uj": [5.0, 6.0, 7.0, 9.0]}
    )
    found = pick(frame, ["energy_uj<=4"])
    assert found.row is None
    assert found.nearest["trial"].tolist() == [0, 1]
    assert found.nearest["energy_uj"].tolist() == [5.0, 9.0]


def test_what_has_seen_its_labels_is_not_picked_unless_it_is_asked_for():
    found = pick(leaky(), ["size <= 1"])
    assert found.row is not None and found.row["trial"] == 2
    assert len(found.notes) == 1 and "transductive" in found.notes[0]
    for budget in ("transductive == True", "transductive", "transductive == 1"):
        asked = pick(leaky(), ["size <= 1", budget])
        assert asked.row is not None and asked.row["trial"] == 0
        assert not any("has seen the labels" in note for note in asked.notes)


def test_a_sure_pick_holds_in_so_many_draws():
    def picked(budget, confidence):
        found = sure_pick(UNCERTAIN, [budget], "accuracy", GOALS[1:], energies(DRAWN), confidence)
        return None if found.row is None else (found.row["trial"], found.row["energy_uj"])

    assert picked("energy_uj <= 20", 0.5) == (1, 20.0)  # in two of four
    assert picked("energy_uj <= 20", 0.75) == (0, 10.0)  # b only in two
    assert picked("energy_uj <= 22", 1.0) == (1, 20.0)
    assert picked("energy_uj <= 9.5", 0.9) is None
    assert picked("energy_uj >= 20 and accuracy <= 0.85", 0.5) == (2, 21.0)
    missed = sure_pick(UNCERTAIN, ["energy_uj <= 10"], "accuracy", GOALS[1:], energies(DRAWN), 1.0)
    assert missed.row is None and missed.nearest["energy_uj"].tolist()[0] == 10.0
    assert missed.nearest["missed energy_uj<=10"].tolist()[0] == 1.0, "11 in the worst draw"


def test_a_sure_pick_meets_all_budgets_at_once():
    frame = pd.DataFrame(
        {"trial": [0, 1], "accuracy": [0.9, 0.8], "energy_uj": [5.0, 5.0], "latency_ms": [5.0, 5.0]}
    )
    samples = {
        "energy_uj": np.array([[9.0, 1.0], [5.0, 1.0], [5.0, 1.0], [5.0, 1.0]]),
        "latency_ms": np.array([[5.0, 5.0], [9.0, 5.0], [5.0, 5.0], [5.0, 5.0]]),
    }
    draws = Draws(
        list(samples), lambda rows: {name: x[:, rows.index.to_numpy()] for name, x in samples.items()}
    )

    def picked(confidence, ties):
        budgets = ["energy_uj <= 6", "latency_ms <= 6"]
        return sure_pick(frame, budgets, "accuracy", ties, draws, confidence)

    goals = [("energy_uj", "min"), ("latency_ms", "min")]
    first, second = picked(0.5, goals).row, picked(0.75, goals).row
    assert first is not None and (first["trial"], first["confidence"], first["front_share"]) == (0, 0.5, 1.0)
    assert second is not None and (second["trial"], second["confidence"]) == (1, 1.0)
    alone = picked(0.5, []).row  # no goal is uncertain, the budgets are
    assert alone is not None and (alone["trial"], alone["confidence"]) == (0, 0.5)
    neither = picked(0.75, [])
    assert neither.row is None and neither.nearest["trial"].tolist() == [0]
    assert neither.notes == ["no design meets all budgets at once in more than 50% of the samples"]


def test_a_sure_pick_has_a_front_per_group():
    worse = UNCERTAIN.assign(site=["a", "b", "b"], energy_uj=[30.0, 20.0, 21.0])
    drawn = np.array([[30.0, 20, 21], [31.0, 19, 22]])
    found = {
        by: sure_pick(worse, ["accuracy <= 0.8"], "accuracy", GOALS[1:], energies(drawn), 0.9, by)
        for by in (None, "site")
    }
    assert found[None].row is None, "a design of another site is better and cheaper"
    assert found["site"].row["trial"] == 0


@pytest.mark.parametrize(("n_nearest", "trials"), [(1, [2]), (2, [2, 1]), (5, [2, 1, 0])])
def test_nearest_designs_come_by_the_share_of_samples_in_which_they_meet_all(n_nearest, trials):
    frame = pd.DataFrame({"trial": [0, 1, 2], "accuracy": [0.9, 0.8, 0.7], "energy_uj": [6.0, 5.0, 4.0]})
    drawn = np.array([[6.0, 5, 4], [9.0, 5, 4], [9.0, 8.5, 4], [9.0, 8.5, 8]])
    found = sure_pick(
        frame, ["energy_uj <= 7"], "accuracy", GOALS[1:], energies(drawn), 0.8, n_nearest=n_nearest
    )
    assert found.row is None
    assert found.nearest["trial"].tolist() == trials


def test_when_no_design_is_sure_it_is_said():
    frame = UNCERTAIN.iloc[[1, 2]].assign(accuracy=0.9)
    found = sure_pick(frame, [], "accuracy", GOALS[1:], energies(DRAWN), 0.9)
    assert found.row is None and found.nearest.empty
    assert found.notes == ["no design is non-dominated in 90% of the samples; the most certain one is in 50%"]
    condition = sure_pick(UNCERTAIN, ["trial == 7"], "accuracy", GOALS[1:], energies(DRAWN), 0.9)
    assert condition.row is None


@pytest.mark.parametrize("budget", NAMING_OTHERS)
@pytest.mark.parametrize("surely", [False, True])
def test_words_in_a_budget_let_nothing_be_picked(budget, surely):
    def picked(*budgets):
        if not surely:
            found = pick(WORDS, budgets)
        else:
            drawn = np.array([WORDS["energy_uj"], WORDS["energy_uj"]])
            found = sure_pick(WORDS, budgets, "accuracy", GOALS[1:], energies(drawn), 0.9)
        return None if found.row is None else found.row["trial"], found.notes

    assert picked(budget) == (
        2,
        [
            "1 transductive row excluded: its classifier has seen the labels",
            "1 row excluded: it does not fit chip",
        ],
    )
    assert picked(budget, "fits == False")[0] == 1
    assert picked(budget, "fits <= 0")[0] == 1
    assert picked(budget, "transductive")[0] == 0
    assert picked(budget, "transductive >= 1")[0] == 0
