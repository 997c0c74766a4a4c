import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.skyline.admissible import admissible
from dse.skyline.constraints import ExpressionError
from dse.skyline.front import Draws, front_mask, front_share, skyline
from dse.skyline.pareto import non_dominated
from dse.skyline.pick import pick, sure_pick
from dse.skyline.table import group_numbers
from tests.skyline.tables import (
    CHIPS,
    DRAWN,
    GOALS,
    NAMING_OTHERS,
    OBJECTIVES,
    ROWS,
    UNCERTAIN,
    WORDS,
    energies,
    leaky,
    table,
)


@given(ROWS)
def test_agrees_with_a_loop_over_pairs(rows):
    frame = pd.DataFrame(rows, columns=["accuracy", "energy_uj", "n_weights", "task"])
    found = skyline(frame, OBJECTIVES, where="n_weights < 20", by="task").rows
    allowed = [
        (i, a, e, task)
        for i, (a, e, weights, task) in enumerate(rows)
        if weights < 20 and np.isfinite(a) and np.isfinite(e)
    ]
    expected = {
        i
        for i, a, e, task in allowed
        if not any(b >= a and f <= e and (b, f) != (a, e) and task == other for _, b, f, other in allowed)
    }
    assert set(found.index) == expected
    assert len(found) == len(expected)
    pd.testing.assert_frame_equal(found.sort_index(), frame.loc[sorted(expected)])


@given(ROWS, st.randoms(use_true_random=False))
def test_the_order_of_the_table_does_not_matter(rows, random):
    frame = pd.DataFrame(rows, columns=["accuracy", "energy_uj", "n_weights", "task"])
    order = list(range(len(rows)))
    random.shuffle(order)
    first = skyline(frame, OBJECTIVES, by="task").rows
    assert set(skyline(frame.iloc[order], OBJECTIVES, by="task").rows.index) == set(first.index)


def test_equal_points_stand_together_in_the_order_of_the_table():
    frame = table(accuracy=[0.9, 0.8, 0.9, 0.7, 0.8], energy_uj=[5.0, 2.0, 5.0, 3.0, 2.0])
    assert skyline(frame, OBJECTIVES).rows.index.tolist() == [0, 2, 1, 4]


def test_groups_come_one_after_the_other_in_the_order_of_the_table():
    frame = table(accuracy=[0.5, 0.9, 0.6, 0.4], energy_uj=[9.0, 1.0, 9.0, 1.0], task=["b", "a", "b", None])
    assert skyline(frame, OBJECTIVES, by="task").rows.index.tolist() == [2, 1, 3]


def test_what_cannot_be_compared_is_named():
    frame = table(
        trial=[4, 5, 6, 6, 7],
        accuracy=[0.9, np.nan, 0.8, np.nan, 0.7],
        energy_uj=[1.0, 1.0, np.inf, 1.0, -np.inf],
    )
    rows, notes = skyline(frame, OBJECTIVES)
    assert rows["trial"].tolist() == [4]
    assert notes == ["trials 5, 6 excluded: accuracy is NaN", "trials 6, 7 excluded: energy_uj is infinite"]


def test_only_rows_in_question_are_named():
    frame = table(accuracy=[0.9, np.nan], energy_uj=[1.0, 1.0])
    assert skyline(frame, OBJECTIVES, where="accuracy > 0.5").notes == []


def test_many_rows_are_named_in_short():
    frame = table(trial=[1, 1, *range(2, 9)], accuracy=[np.nan] * 9, energy_uj=[1.0] * 9)
    assert skyline(frame, OBJECTIVES).notes == [
        "trials 1, 2, 3, 4, 5 and 3 more (9 rows) excluded: accuracy is NaN"
    ]
    assert skyline(frame.drop(columns="trial").iloc[:1], OBJECTIVES).notes == [
        "row 0 excluded: accuracy is NaN"
    ]


def test_missing_values_of_nullable_columns_are_nan():
    frame = table(accuracy=pd.array([1, None], dtype="Int64"), energy_uj=[1.0, 2.0])
    assert skyline(frame, OBJECTIVES).notes == ["row 1 excluded: accuracy is NaN"]


def test_the_table_stays_as_it_was():
    frame = table(accuracy=[0.9, np.nan], energy_uj=[1.0, 2.0])
    before = frame.copy(deep=True)
    skyline(frame, OBJECTIVES)
    pick(frame, ["energy_uj <= 0.5"])
    pd.testing.assert_frame_equal(frame, before)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"goals": []}, "at least one column"),
        ({"goals": [("accuracy", "up")]}, "'accuracy' must be followed by :max or :min, got 'up'"),
        ({"goals": [("accuracy", "max"), ("accuracy", "min")]}, "'accuracy' is named twice"),
        ({"goals": [("acuracy", "max")]}, "unknown column 'acuracy'. Did you mean 'accuracy'. Known: "),
        ({"goals": [("task", "max")]}, "column 'task' must hold numbers"),
        ({"goals": OBJECTIVES[:1], "by": "tsk"}, "unknown column 'tsk'"),
        ({"goals": OBJECTIVES[:1], "where": "accuracy >"}, "must read like"),
    ],
)
def test_wrong_requests_are_named(arguments, message):
    with pytest.raises(ExpressionError, match=message):
        skyline(table(accuracy=[0.9], task=["a"]), **arguments)


def test_what_has_seen_its_labels_is_on_no_front_unless_it_is_asked_for():
    found = skyline(leaky(), [("accuracy", "max"), ("size", "min")])
    assert found.rows["trial"].tolist() == [3, 1, 2]
    assert found.notes == ["1 transductive row excluded: its classifier has seen the labels"]
    asked = skyline(leaky(), [("accuracy", "max")], where="transductive == True or transductive == False")
    assert asked.rows["trial"].tolist() == [0] and asked.notes == []
    assert skyline(leaky().iloc[1:], [("accuracy", "max")]).notes == []


def test_how_sure_a_front_is():
    share = front_share(UNCERTAIN, GOALS, energies(DRAWN))
    assert share.tolist() == [1.0, 1.0, 0.5]
    assert front_share(UNCERTAIN, GOALS, Draws((), lambda rows: {})).tolist() == [1.0, 1.0, 0.0]
    apart = UNCERTAIN.assign(task=["x", "x", "y"])
    assert front_share(apart, GOALS, energies(DRAWN), "task").tolist() == [1.0, 1.0, 1.0]
    silent = energies(np.array([[9.0, np.nan, 19], [11.0, np.nan, 21]]))
    assert front_share(UNCERTAIN, GOALS, silent).tolist() == [1.0, 0.0, 1.0]
    assert front_share(UNCERTAIN.iloc[:0], GOALS, energies(DRAWN)).tolist() == []
    best = front_share(UNCERTAIN, [("accuracy", "max"), ("n_weights", "min")], energies(DRAWN))
    assert best.tolist() == [1.0, 1.0, 0.0], "nothing drawn is an objective"


@given(st.integers(1, 30), st.integers(1, 12), st.integers(0, 2**31))
def test_shares_are_those_of_every_draw_on_its_own(n_rows, n_draws, seed):
    rng = np.random.default_rng(seed)
    frame = pd.DataFrame({"accuracy": rng.integers(0, 4, n_rows) / 4, "energy_uj": np.ones(n_rows)})
    drawn = rng.integers(1, 9, n_rows) * rng.uniform(0.5, 2.0, (n_draws, 1)) + rng.integers(
        0, 3, (n_draws, 1)
    )
    drawn = drawn + rng.integers(0, 2, (n_draws, n_rows))
    found = front_share(frame, GOALS, energies(drawn))
    alone = [non_dominated(np.column_stack([-frame["accuracy"], drawn[draw]])) for draw in range(n_draws)]
    assert found.tolist() == np.mean(alone, axis=0).tolist()
    ranges = {"energy_uj_low": drawn.min(axis=0), "energy_uj_high": drawn.max(axis=0)}
    assert front_share(frame.assign(**ranges), GOALS, energies(drawn)).tolist() == found.tolist()


def test_no_draw_is_made_for_what_no_draw_can_save():
    asked = []

    def of(rows):
        asked.extend(rows.index)
        return {"energy_uj": DRAWN[:, rows.index]}

    ranged = UNCERTAIN.assign(energy_uj_low=[9.0, 18, 22.5], energy_uj_high=[11.0, 22, 30])
    assert front_share(ranged, GOALS, Draws(("energy_uj",), of)).tolist() == [1.0, 1.0, 0.0]
    assert asked == [0, 1], "the third costs more than the second at its dearest"


def test_costs_on_different_hardware_have_fronts_of_their_own():
    found = skyline(CHIPS, GOALS)
    kept = [(row["hardware"], row["trial"]) for _, row in found.rows.iterrows()]
    assert kept == [("x", 0), ("x", 1), ("y", 1)]
    assert found.notes == [
        "1 row excluded: it does not fit y",
        "no design fits z; --oversize (oversize=True) prices them as if it were larger",
    ]
    assert skyline(CHIPS, GOALS, by="hardware").rows.index.tolist() == found.rows.index.tolist()


def test_what_does_not_fit_is_priced_as_on_a_larger_chip_if_that_is_asked_for():
    found = skyline(CHIPS, GOALS, oversize=True)
    kept = [(row["hardware"], row["trial"]) for _, row in found.rows.iterrows()]
    assert kept == [("x", 0), ("x", 1), ("y", 0), ("z", 0)]
    assert found.notes == ["1 row priced as if y were larger", "2 rows priced as if z were larger"]
    assert pick(CHIPS, ["hardware == 'z'"], oversize=True).row["trial"] == 0


def test_where_no_design_fits_nothing_is_feasible_and_the_nearest_are_named():
    found = pick(CHIPS, ["hardware == 'z'", "energy_uj <= 3.5"])
    assert found.row is None and found.nearest["trial"].tolist() == [0, 1]
    assert found.nearest["missed energy_uj<=3.5"].tolist() == [0.0, 0.5]
    assert found.notes == ["no design fits z; --oversize (oversize=True) prices them as if it were larger"]
    for confidence in (0.1, 1.0):
        drawn = energies(np.ones((2, len(CHIPS))))
        sure = sure_pick(CHIPS, ["hardware == 'z'"], "accuracy", GOALS[1:], drawn, confidence)
        assert sure.row is None and sure.nearest["trial"].tolist() == [0, 1]


def test_what_has_no_answer_where_others_have_one_cannot_run_there():
    other = CHIPS.assign(trial=[2, 3] * 3, fits=pd.array([None] * 6, dtype="boolean"), accuracy=0.99)
    goals = [("accuracy", "max"), ("n_weights", "min")]
    both = pd.concat([CHIPS, other], ignore_index=True)
    for oversize, expected in ((False, [("x", 0), ("y", 1)]), (True, [("x", 0), ("y", 0), ("z", 0)])):
        found = skyline(both, goals, by="hardware", oversize=oversize)
        assert [(row["hardware"], row["trial"]) for _, row in found.rows.iterrows()] == expected
    assert pick(both, ["hardware == 'x'"]).row["trial"] == 0
    alone = pick(both, ["hardware == 'x'", "trial in [2, 3]"])  # conditions do not change what can run
    assert alone.row is None and alone.nearest["trial"].tolist() == []
    assert skyline(both, goals, "trial in [2, 3]", "hardware").rows.empty
    assert skyline(both, goals, "hardware == 'x' and not fits").rows.empty
    # Hardware without limits, where no row has an answer:
    assert skyline(other, goals, by="hardware").rows["trial"].tolist() == [2, 2, 2]


def test_what_has_no_energy_on_its_hardware_cannot_run_there():
    unable = CHIPS.assign(fits=pd.array([None] * 6, dtype="boolean"), energy_uj_high=np.nan)
    goals = [("accuracy", "max"), ("n_weights", "min")]
    found = skyline(unable, goals, by="hardware")
    assert found.rows.empty and found.notes[0] == "x can run none of these designs"
    assert pick(unable, ["hardware == 'x'"]).row is None
    interval = unable.assign(energy_uj_high=7.0)  # the chip runs them, its energy is known within bounds
    assert skyline(interval, goals, by="hardware").rows["trial"].tolist() == [0, 0, 0]
    assert len(skyline(unable.assign(hardware=None), goals).rows) == 3  # no hardware was asked


@pytest.mark.parametrize("fits", [["yes", "no"], [0.93, 0.4], [2, 3], ["", None]])
def test_a_users_column_of_that_name_is_not_about_hardware(fits):
    frame = pd.DataFrame({"trial": [1, 2], "accuracy": [0.9, 0.8], "energy_uj": [3.0, 2.0], "fits": fits})
    goals = [("accuracy", "max"), ("energy_uj", "min")]
    assert skyline(frame, goals).rows["trial"].tolist() == [1, 2]
    assert pick(frame, ["energy_uj <= 2"]).row["trial"] == 2
    named = frame.assign(transductive=fits)
    assert skyline(named, goals).rows["trial"].tolist() == [1, 2]


def test_what_fits_does_not_depend_on_limits():
    best = CHIPS[CHIPS["hardware"] == "y"]["accuracy"].max()
    limits = f"hardware == 'y' and accuracy >= {best}"
    found = skyline(CHIPS, GOALS, limits)
    assert found.rows.empty and found.notes[:1] == ["1 row excluded: it does not fit y"]
    assert pick(CHIPS, [limits]).row is None


def test_what_does_not_fit_is_there_when_it_is_named():
    named = skyline(CHIPS, GOALS, "fits == False")
    assert [(row["hardware"], row["trial"]) for _, row in named.rows.iterrows()] == [("y", 0), ("z", 0)]
    assert skyline(CHIPS.assign(fits=pd.NA), GOALS, "hardware == 'y'").rows["trial"].tolist() == [0]
    assert pick(CHIPS, ["hardware == 'y'"]).row["trial"] == 1
    assert pick(CHIPS, ["hardware == 'y'", "fits == False"]).row["trial"] == 0
    assert pick(CHIPS, ["hardware == 'z'", "not fits"]).row["trial"] == 0


def test_rows_of_tables_without_hardware_fit():
    bare = pd.DataFrame({"trial": [7], "accuracy": [0.95], "energy_uj": [0.5]})
    mixed = pd.concat([CHIPS, bare], ignore_index=True)
    found = skyline(mixed, GOALS, by="hardware")
    assert found.rows["trial"].tolist() == [0, 1, 1, 7]
    weights = [("accuracy", "max"), ("trial", "min")]
    assert len(skyline(pd.concat([bare, CHIPS], ignore_index=True), weights).rows) == 3
    alone = skyline(CHIPS.drop(columns="hardware"), GOALS)
    assert alone.notes == ["3 rows excluded: they do not fit the chip"]


def test_what_no_hardware_changes_is_told_once():
    weights = [("accuracy", "max"), ("n_weights", "min")]
    found = skyline(CHIPS, weights)
    assert found.rows.index.tolist() == [0]
    assert found.notes == ["points on x: no objective depends on hardware"]
    assert skyline(CHIPS, weights, "hardware == 'y'").rows.index.tolist() == [3]
    assert skyline(CHIPS, weights, by="hardware").rows.index.tolist() == [0, 3]
    misfit = CHIPS.assign(fits=CHIPS["fits"] & (CHIPS["hardware"] != "x"))
    assert skyline(misfit, weights).notes[0] == "points on y: no objective depends on hardware"


@pytest.mark.parametrize("where", NAMING_OTHERS)
def test_words_in_a_condition_let_nothing_onto_the_front(where):
    found = skyline(WORDS, GOALS, where)
    assert found.rows["trial"].tolist() == [2]
    assert found.notes == [
        "1 transductive row excluded: its classifier has seen the labels",
        "1 row excluded: it does not fit chip",
    ]
    assert skyline(WORDS, GOALS, f"({where}) and fits == False").rows["trial"].tolist() == [1]
    assert skyline(WORDS, GOALS, f"({where}) and transductive").rows["trial"].tolist() == [0]


def test_a_word_in_a_condition_does_not_make_it_depend_on_hardware():
    named = CHIPS.assign(family="hardware")
    goals = [("accuracy", "max"), ("n_weights", "min")]
    assert skyline(named, goals, "family == 'hardware'").rows["hardware"].tolist() == ["x"]


@pytest.mark.parametrize("family", ["fits", "transductive"])
def test_the_front_of_a_group_among_rows_that_may_be_compared(family):
    frame = pd.concat([WORDS.assign(family=family), WORDS.assign(family="snn")], ignore_index=True)
    frame.loc[5, "energy_uj"] = np.nan
    on_front = front_mask(frame, GOALS, group_numbers(frame, ["family", "hardware"]), admissible(frame))
    assert on_front.tolist() == [False, False, True, False, False, False]
    assert front_mask(frame, GOALS).tolist() == [True, False, False, True, False, False]
    assert front_mask(frame.iloc[:0], GOALS).tolist() == []
    words = frame.assign(energy_uj=["1", "x", None, 2, 3.0, "0.5"])
    assert front_mask(words, [("energy_uj", "min")]).tolist() == [False] * 5 + [True]
    with pytest.raises(ExpressionError, match="unknown column 'energy'"):
        front_mask(frame, [("energy", "min")])
