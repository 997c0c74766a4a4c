import math

import numpy as np
import pandas as pd
import pytest

from dse.skyline.rivals import odds_of, rivals, spiking


def samples(*values):
    """One column per row of a table, (draw, row)."""
    return np.array(values, float).T


def test_equal_accuracy_and_equal_cost_are_those_that_both_sides_reach():
    ours, theirs = samples([0.9, 0.9], [0.7, 0.7]), samples([0.8, 0.8], [0.6, 0.6])
    odds = odds_of("accuracy", ours, theirs, samples([50, 50], [9, 9]), samples([10, 10], [1, 1]), 0.0)
    # At 0.8 ours takes 50 and theirs 10; for 10 ours reaches 0.7 and theirs 0.8; at any cost 0.9 and 0.8.
    assert (odds.cheaper, odds.more_accurate, odds.best) == (0, 0, 1)
    assert odds.times.median == 5 and odds.gain.median == pytest.approx(-0.1)
    assert odds.most.median == pytest.approx(0.1)
    within = odds_of("accuracy", ours, theirs, samples([50, 50], [9, 9]), samples([10, 10], [1, 1]), 0.11)
    assert within.cheaper == 1 and within.times.median == 0.9  # 0.7 is as accurate as 0.8, but for 0.11


def test_probabilities_are_shares_of_the_samples_and_ties_count_half():
    ours, theirs = samples([0.9, 0.9, 0.8, 0.8]), samples([0.8, 0.9, 0.9, 0.9])
    odds = odds_of("accuracy", ours, theirs, samples([1, 1, 2, 3]), samples([2, 2, 2, 2]), 0.2)
    assert (odds.cheaper, odds.best) == ((1 + 1 + 0.5 + 0) / 4, (1 + 0.5 + 0 + 0) / 4)


def test_a_side_with_many_designs_is_not_more_accurate_for_the_luck_of_one():
    drawn = np.random.default_rng(3).normal(0.8, 0.05, (4000, 51))
    odds = odds_of("accuracy", drawn[:, 1:], drawn[:, :1], np.ones((4000, 50)), np.ones((4000, 1)), 0.05)
    assert abs(odds.best - 0.5) < 0.05 and abs(odds.most.median) < 0.01


def test_a_side_that_is_never_as_cheap_is_less_accurate_at_equal_cost():
    odds = odds_of("accuracy", samples([0.9]), samples([0.8]), samples([100]), samples([1]), 0.0)
    assert odds.more_accurate == 0 and odds.gain.median == -math.inf
    swapped = odds_of("accuracy", samples([0.8]), samples([0.9]), samples([1]), samples([100]), 0.0)
    assert swapped.more_accurate == 1 and swapped.gain.median == math.inf


def table(*rows):
    return pd.DataFrame(rows, columns=["family", "trial", "accuracy"]).assign(task="grip", hardware="m4")


POINTS = table(("snn", 0, 0.90), ("snn", 1, 0.88), ("snn", 2, 0.80), ("linear", 3, 0.92), ("linear", 4, 0.50))
SPIKES = np.array([True, True, True, False, False])


def drawn(points, error):
    """Samples two standard deviations apart, around what was measured."""
    return points["accuracy"].to_numpy() + np.array([[-error], [error]])


@pytest.mark.parametrize(("error", "trial"), [(0.01, 0), (0.03, 1), (0.11, 2)])
def test_a_finalist_is_the_cheapest_within_a_standard_error(error, trial):
    costs = np.tile([30.0, 20, 10, 5, 1], (2, 1))
    found = rivals(POINTS, SPIKES, {"accuracy": drawn(POINTS, error)}, "energy_uj", costs)
    assert [(one.family, one.trial) for one in found.finalists] == [("linear", 3), ("snn", trial)]
    assert found.finalists[1].se == pytest.approx(error)
    assert (found.task, found.hardware) == ("grip", "m4")
    unnamed = POINTS.drop(columns=["task", "hardware"])
    found = rivals(unnamed, SPIKES, {"accuracy": drawn(POINTS, error)}, "energy_uj", costs)
    assert (found.task, found.hardware) == ("", "")


@pytest.mark.parametrize(
    ("costs", "accuracies", "answer"),
    [
        ([9, 9, 9, 1, 1], [0.90, 0.88, 0.80, 0.92, 0.5], "do not spike"),
        ([1, 1, 1, 9, 9], [0.95, 0.88, 0.80, 0.92, 0.5], "spike"),
        ([9, 9, 9, 1, 1], [0.98, 0.88, 0.80, 0.92, 0.5], "spike for accuracy, not for energy"),
        ([1, 1, 1, 9, 9], [0.80, 0.78, 0.70, 0.92, 0.5], "spike for energy, not for accuracy"),
    ],
)
def test_the_answer_follows_from_the_probabilities(costs, accuracies, answer):
    points = POINTS.assign(accuracy=accuracies)
    found = rivals(
        points,
        SPIKES,
        {"accuracy": drawn(points, 0.001)},
        "energy_uj",
        np.tile(np.array(costs, float), (2, 1)),
    )
    assert found.answer == answer
    assert {row["answer"] for row in found.rows} == {answer}


def test_what_a_coin_decides_is_open():
    points = table(("snn", 0, 0.9), ("linear", 1, 0.9))
    accuracy = np.array([[0.9, 0.8], [0.8, 0.9]])
    found = rivals(points, SPIKES[[0, 4]], {"accuracy": accuracy}, "n_weights", np.array([[1.0, 2], [2, 1]]))
    assert found.answer == "it is open whether to spike" and found.odds[0].cheaper == 0.5


def test_a_chip_that_runs_one_side_says_so():
    few, accuracies = POINTS.iloc[:3], {"accuracy": drawn(POINTS.iloc[:3], 0.01)}
    found = rivals(few, SPIKES[:3], accuracies, "energy_uj", np.ones((2, 3)), ["linear"])
    assert not found.odds and found.answer.startswith("spike") and found.unable == ("linear",)


def test_accuracies_that_a_side_lacks_are_not_compared():
    moved = drawn(POINTS, 0.01)
    unseen = moved.copy()
    unseen[:, 3:] = np.nan
    accuracies = {"accuracy": moved, "accuracy_shifted": moved - 0.1, "accuracy_unseen": unseen}
    found = rivals(POINTS, SPIKES, accuracies, "energy_uj", np.ones((2, 5)))
    assert [odds.on for odds in found.odds] == ["accuracy", "accuracy_shifted"]
    assert {"spiking_cheaper", "spiking_cheaper_shifted", "spiking_best_shifted"} <= found.rows[0].keys()


def test_a_family_spikes_if_a_design_of_it_has_spikes_of_its_own():
    points = table(("snn", 0, 0.9), ("snn", 1, 0.2), ("mlp", 2, 0.9), ("unknown", 3, 0.9))
    own = points.assign(spikes_per_inference_no_input=[12.0, 0.0, 0.0, math.nan])
    assert spiking(own).tolist() == [True, True, False, False]
