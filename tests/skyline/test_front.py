import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.skyline.front import (
    Draws,
    ExpressionError,
    TableError,
    front_ends,
    front_share,
    parse_objectives,
    pick,
    read,
    skyline,
    sure_pick,
)
from dse.skyline.pareto import non_dominated

OBJECTIVES = [("accuracy", "max"), ("energy_uj", "min")]


def table(**columns):
    return pd.DataFrame(columns)


ROWS = st.lists(
    st.tuples(
        st.sampled_from([0.5, 0.7, 0.9, np.nan, np.inf]),
        st.sampled_from([1.0, 2.0, 3.0, np.nan, -np.inf]),
        st.sampled_from([10, 20]),
        st.sampled_from(["texture", "speed"]),
    ),
    max_size=12,
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
    assert notes == [
        "trials 5, 6 left out: accuracy is NaN",
        "trials 6, 7 left out: energy_uj is infinite",
    ]


def test_only_rows_in_question_are_named():
    frame = table(accuracy=[0.9, np.nan], energy_uj=[1.0, 1.0])
    assert skyline(frame, OBJECTIVES, where="accuracy > 0.5").notes == []


def test_many_rows_are_named_in_short():
    frame = table(trial=[1, 1, *range(2, 9)], accuracy=[np.nan] * 9, energy_uj=[1.0] * 9)
    assert skyline(frame, OBJECTIVES).notes == [
        "trials 1, 2, 3, 4, 5 and 3 more (9 rows) left out: accuracy is NaN"
    ]
    assert skyline(frame.drop(columns="trial").iloc[:1], OBJECTIVES).notes == [
        "row 0 left out: accuracy is NaN"
    ]


def test_missing_values_of_nullable_columns_are_nan():
    frame = table(accuracy=pd.array([1, None], dtype="Int64"), energy_uj=[1.0, 2.0])
    assert skyline(frame, OBJECTIVES).notes == ["row 1 left out: accuracy is NaN"]


def test_the_table_stays_as_it_was():
    frame = table(accuracy=[0.9, np.nan], energy_uj=[1.0, 2.0])
    before = frame.copy(deep=True)
    skyline(frame, OBJECTIVES)
    pick(frame, ["energy_uj <= 0.5"])
    pd.testing.assert_frame_equal(frame, before)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"objectives": []}, "at least one column"),
        ({"objectives": [("accuracy", "up")]}, "'accuracy' must be followed by :max or :min, got 'up'"),
        ({"objectives": [("accuracy", "max"), ("accuracy", "min")]}, "'accuracy' is named twice"),
        ({"objectives": [("acuracy", "max")]}, "unknown column 'acuracy'; .*Did you mean 'accuracy'"),
        ({"objectives": [("task", "max")]}, "column 'task' must hold numbers"),
        ({"objectives": OBJECTIVES[:1], "by": "tsk"}, "unknown column 'tsk'"),
        ({"objectives": OBJECTIVES[:1], "where": "accuracy >"}, "must read like"),
    ],
)
def test_wrong_requests_are_named(arguments, message):
    with pytest.raises(ExpressionError, match=message):
        skyline(table(accuracy=[0.9], task=["a"]), **arguments)


def test_objectives_are_read_from_text():
    assert parse_objectives("accuracy:max, energy_uj:min") == OBJECTIVES
    with pytest.raises(ExpressionError, match="'accuracy' must be followed by :max or :min, got ''"):
        parse_objectives("accuracy")
    with pytest.raises(ExpressionError, match="'' must be followed"):
        parse_objectives("accuracy:max,")


POINTS = table(
    accuracy=[0.95, 0.9, 0.9, 0.8, np.nan],
    energy_uj=[100.0, 40.0, 30.0, 20.0, 1.0],
    n_weights=[200_000, 90_000, 120_000, 50_000, 1],
    task=["texture", "texture", "texture", "speed", "texture"],
)


def test_pick_is_the_most_accurate_within_the_budgets():
    found = pick(POINTS, ["energy_uj <= 50 and n_weights <= 150000"])
    assert found.row.name == 2  # as accurate as row 1, with less of the first budget
    assert found.nearest.empty
    assert found.notes == ["row 4 left out: accuracy is NaN"]


def test_ties_go_to_what_was_asked_for_then_to_the_first_row():
    assert pick(POINTS, ["energy_uj <= 50"], tie_breaks=[("n_weights", "min")]).row.name == 1
    assert pick(POINTS, [], tie_breaks=[("n_weights", "max")]).row.name == 0
    same = pd.concat([POINTS.iloc[[1]]] * 3, ignore_index=True)
    assert pick(same, ["energy_uj <= 50"]).row.name == 0


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
    assert nobody.notes == ["no row meets task == 'joint'"]


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


@pytest.mark.parametrize("suffix", ["csv", "parquet", "json", "rows.json"])
def test_tables_survive_every_format(tmp_path, suffix):
    frame = table(trial=[1, 2], accuracy=[0.5, 0.25], task=["a", "b"])
    file = tmp_path / f"points.{suffix}"
    if suffix == "csv":
        frame.to_csv(file, index=False)
    elif suffix == "parquet":
        frame.to_parquet(file)
    else:
        rows = frame.to_dict("records")
        document = {"schema": "dse/skyline/1", "rows": rows, "notes": []}
        file.write_text(json.dumps(rows if suffix == "rows.json" else document))
    pd.testing.assert_frame_equal(read(file), frame, check_dtype=False)


def test_a_folder_is_a_study(tmp_path):
    frame = table(accuracy=[0.5])
    frame.to_parquet(tmp_path / "points.parquet")
    pd.testing.assert_frame_equal(read(tmp_path), frame)


def test_what_is_no_table_is_named(tmp_path):
    def written(name, content):
        file = tmp_path / name
        file.write_bytes(content)
        return file

    with pytest.raises(TableError, match=r"none\.csv: no such file"):
        read(tmp_path / "none.csv")
    with pytest.raises(TableError, match=r"points\.parquet: no such file"):
        read(tmp_path)
    for file in (
        written("torn.parquet", b"PAR1 and no more"),
        written("torn.json", b'{"rows": ['),
        written("empty.csv", b""),
        written("binary.csv", b"a,b\n\xff\xfe,1\n"),
    ):
        with pytest.raises(TableError, match=rf"{file.name}: no readable table: \S"):
            read(file)
    with pytest.raises(TableError, match="the table has no rows"):
        read(written("header.csv", b"a,b\n"))
    with pytest.raises(TableError, match=r"points\.txt: must be \.csv"):
        read(written("points.txt", b"a"))
    with pytest.raises(TableError, match="an object with 'rows'"):
        read(written("other.json", b"{}"))


def test_the_nearest_are_different_designs() -> None:
    frame = pd.DataFrame(
        {"trial": [0, 0, 0, 1], "accuracy": [0.5, 0.6, 0.7, 0.9], "energy_uj": [5.0, 6.0, 7.0, 9.0]}
    )
    found = pick(frame, ["energy_uj<=4"])
    assert found.row is None
    assert found.nearest["trial"].tolist() == [0, 1]
    assert found.nearest["energy_uj"].tolist() == [5.0, 9.0]


def published():
    return table(
        trial=[0, 1, 2, 3, 4, 5],
        task=["texture", "texture", "texture", "texture", "profile", "profile"],
        accuracy=[0.87, 0.95, 0.68, 0.66, 0.83, 0.83],
        spikes_per_inference=[0.75, 9.07, 0.13, 0.13, 1.7, 1.6],
        n_weights=[15, 259, 15, 14, 274, 274],
    )


def test_the_ends_of_a_front_with_ties_broken_by_accuracy():
    found = front_ends(published(), by="task", design=["trial"])
    assert found.notes == []
    assert list(found.rows) == ["task", "end", "accuracy", "spikes_per_inference", "n_weights", "trial"]
    assert found.rows["end"].tolist() == ["best accuracy", "least spikes", "least weights"] * 2
    assert found.rows["trial"].tolist() == [1, 2, 3, 5, 5, 5]
    assert found.rows.index.tolist() == [1, 2, 3, 5, 5, 5]
    together = front_ends(published().drop(index=3), design=["trial"]).rows
    assert together["trial"].tolist() == [1, 2, 0]  # of equal W_t, the better accuracy
    assert "task" not in together


def test_ends_leave_out_what_cannot_be_compared_and_what_saw_its_labels():
    frame = published().assign(transductive=[False, True, False, False, False, False])
    frame.loc[2, "spikes_per_inference"] = np.nan
    found = front_ends(frame, by="task")
    assert found.rows["accuracy"].tolist() == [0.87, 0.66, 0.66, 0.83, 0.83, 0.83]
    assert len(found.notes) == 2 and "spikes_per_inference is NaN" in found.notes[1]
    nothing = front_ends(frame.iloc[:0], by="task")
    assert nothing.rows.empty and list(nothing.rows)[:2] == ["task", "end"]
    with pytest.raises(ExpressionError, match="size"):
        front_ends(frame, weights="size")


@given(
    st.lists(
        st.tuples(st.sampled_from([0.5, 0.7, 0.9]), st.sampled_from([1.0, 2.0]), st.sampled_from([10, 20])),
        min_size=1,
        max_size=12,
    )
)
def test_ends_are_on_the_front(rows):
    frame = pd.DataFrame(rows, columns=["accuracy", "spikes_per_inference", "n_weights"])
    objectives = [("accuracy", "max"), ("spikes_per_inference", "min"), ("n_weights", "min")]
    ends = front_ends(frame).rows
    assert set(ends.index) <= set(skyline(frame, objectives).rows.index)
    assert ends["accuracy"].iloc[0] == frame["accuracy"].max()
    assert ends["spikes_per_inference"].iloc[1] == frame["spikes_per_inference"].min()
    assert ends["n_weights"].iloc[2] == frame["n_weights"].min()


def leaky() -> pd.DataFrame:
    """Return three points of which the best has seen its labels, and one that does not say."""
    frame = pd.DataFrame({"trial": [0, 1, 2, 3], "accuracy": [1.0, 0.8, 0.7, 0.9], "size": [1, 2, 1, 3]})
    return frame.assign(transductive=pd.array([True, False, False, None], "boolean"))


def test_what_has_seen_its_labels_is_on_no_front_unless_it_is_asked_for():
    found = skyline(leaky(), [("accuracy", "max"), ("size", "min")])
    assert found.rows["trial"].tolist() == [3, 1, 2]
    assert found.notes == ["1 transductive row left out: what answers has seen the labels"]
    asked = skyline(leaky(), [("accuracy", "max")], where="transductive == True or transductive == False")
    assert asked.rows["trial"].tolist() == [0] and asked.notes == []
    assert skyline(leaky().iloc[1:], [("accuracy", "max")]).notes == []


def test_what_has_seen_its_labels_is_not_picked_unless_it_is_asked_for():
    found = pick(leaky(), ["size <= 1"])
    assert found.row is not None and found.row["trial"] == 2
    assert len(found.notes) == 1 and "transductive" in found.notes[0]
    for budget in ("transductive == True", "transductive", "transductive == 1"):
        asked = pick(leaky(), ["size <= 1", budget])
        assert asked.row is not None and asked.row["trial"] == 0
        assert not any("has seen the labels" in note for note in asked.notes)


# Three designs: a is cheap, b dear and accurate, c beaten by b unless the figures say otherwise.
UNCERTAIN = pd.DataFrame(
    {
        "trial": [0, 1, 2],
        "accuracy": [0.8, 0.9, 0.85],
        "energy_uj": [10.0, 20.0, 21.0],
        "n_weights": [1, 2, 3],
    }
)
DRAWN = np.array([[9.0, 18, 19], [11.0, 22, 21], [10.0, 20, 22], [10.0, 21, 20]])
GOALS = [("accuracy", "max"), ("energy_uj", "min")]


def energies(drawn: np.ndarray) -> Draws:
    """Return draws of energy_uj, (draw, row of the whole table)."""
    return Draws(("energy_uj",), lambda rows: {"energy_uj": drawn[:, rows.index]})


def test_how_sure_a_front_is() -> None:
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
def test_shares_are_those_of_every_draw_on_its_own(n_rows: int, n_draws: int, seed: int) -> None:
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


def test_no_draw_is_made_for_what_no_draw_can_save() -> None:
    asked: list[int] = []

    def of(rows: pd.DataFrame) -> dict[str, np.ndarray]:
        asked.extend(rows.index)
        return {"energy_uj": DRAWN[:, rows.index]}

    ranged = UNCERTAIN.assign(energy_uj_low=[9.0, 18, 22.5], energy_uj_high=[11.0, 22, 30])
    assert front_share(ranged, GOALS, Draws(("energy_uj",), of)).tolist() == [1.0, 1.0, 0.0]
    assert asked == [0, 1], "the third costs more than the second at its dearest"


def test_a_sure_pick_holds_in_so_many_draws() -> None:
    def picked(budget: str, confidence: float) -> object:
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


def test_when_no_design_is_sure_it_is_said() -> None:
    frame = UNCERTAIN.iloc[[1, 2]].assign(accuracy=0.9)
    found = sure_pick(frame, [], "accuracy", GOALS[1:], energies(DRAWN), 0.9)
    assert found.row is None and found.nearest.empty
    assert found.notes == ["no design is non-dominated in 90% of the draws; the surest is in 50%"]
    condition = sure_pick(UNCERTAIN, ["trial == 7"], "accuracy", GOALS[1:], energies(DRAWN), 0.9)
    assert condition.row is None


# Two designs on two chips: the better one does not fit chip y, and nothing fits chip z.
CHIPS = pd.DataFrame(
    {
        "trial": [0, 1, 0, 1, 0, 1],
        "hardware": ["x", "x", "y", "y", "z", "z"],
        "fits": pd.array([True, True, False, True, False, False], dtype="boolean"),
        "accuracy": [0.9, 0.8] * 3,
        "n_weights": [10, 20] * 3,
        "energy_uj": [2.0, 1.0, 5.0, 9.0, 3.0, 4.0],
    }
)


def test_costs_on_different_hardware_have_fronts_of_their_own() -> None:
    found = skyline(CHIPS, GOALS)
    kept = [(row["hardware"], row["trial"]) for _, row in found.rows.iterrows()]
    assert kept == [("x", 0), ("x", 1), ("y", 1), ("z", 0)]
    assert found.notes == [
        "1 row left out: it does not fit y",
        "no design fits z: its costs are as if it went on",
    ]
    assert skyline(CHIPS, GOALS, by="hardware").rows.index.tolist() == found.rows.index.tolist()


def test_what_has_no_answer_where_others_have_one_cannot_run_there() -> None:
    other = CHIPS.assign(trial=[2, 3] * 3, fits=pd.array([None] * 6, dtype="boolean"), accuracy=0.99)
    goals = [("accuracy", "max"), ("n_weights", "min")]
    found = skyline(pd.concat([CHIPS, other], ignore_index=True), goals, by="hardware")
    kept = [(row["hardware"], row["trial"]) for _, row in found.rows.iterrows()]
    assert kept == [("x", 0), ("y", 1), ("z", 2)]  # nothing fits z: all of it is as if it went on
    assert skyline(other, goals, by="hardware").rows["trial"].tolist() == [2, 2, 2]
    assert pick(pd.concat([CHIPS, other]), ["hardware == 'x'"]).row["trial"] == 0


@pytest.mark.parametrize("fits", [["yes", "no"], [0.93, 0.4], [2, 3], ["", None]])
def test_a_users_column_of_that_name_is_not_about_hardware(fits):
    frame = pd.DataFrame({"trial": [1, 2], "accuracy": [0.9, 0.8], "energy_uj": [3.0, 2.0], "fits": fits})
    goals = [("accuracy", "max"), ("energy_uj", "min")]
    assert skyline(frame, goals).rows["trial"].tolist() == [1, 2]
    assert pick(frame, ["energy_uj <= 2"]).row["trial"] == 2
    named = frame.assign(transductive=fits)
    assert skyline(named, goals).rows["trial"].tolist() == [1, 2]


def test_what_fits_does_not_depend_on_limits() -> None:
    best = CHIPS[CHIPS["hardware"] == "y"]["accuracy"].max()
    limits = f"hardware == 'y' and accuracy >= {best}"
    found = skyline(CHIPS, GOALS, limits)
    assert found.rows.empty and found.notes[:1] == ["1 row left out: it does not fit y"]
    assert pick(CHIPS, [limits]).row is None


def test_what_does_not_fit_is_there_when_it_is_named() -> None:
    named = skyline(CHIPS, GOALS, "fits == False")
    assert [(row["hardware"], row["trial"]) for _, row in named.rows.iterrows()] == [("y", 0), ("z", 0)]
    assert skyline(CHIPS.assign(fits=pd.NA), GOALS, "hardware == 'y'").rows["trial"].tolist() == [0]
    assert pick(CHIPS, ["hardware == 'y'"]).row["trial"] == 1
    assert pick(CHIPS, ["hardware == 'y'", "fits == False"]).row["trial"] == 0
    assert pick(CHIPS, ["hardware == 'z'"]).notes == ["no design fits z: its costs are as if it went on"]


def test_rows_of_tables_without_hardware_fit() -> None:
    bare = pd.DataFrame({"trial": [7], "accuracy": [0.95], "energy_uj": [0.5]})
    mixed = pd.concat([CHIPS, bare], ignore_index=True)
    found = skyline(mixed, GOALS, by="hardware")
    assert found.rows["trial"].tolist() == [0, 1, 1, 0, 7]
    weights = [("accuracy", "max"), ("trial", "min")]
    assert len(skyline(pd.concat([bare, CHIPS], ignore_index=True), weights).rows) == 4
    alone = skyline(CHIPS.drop(columns="hardware"), GOALS)
    assert alone.notes == ["3 rows left out: they do not fit the chip"]


def test_what_no_hardware_changes_is_told_once() -> None:
    weights = [("accuracy", "max"), ("n_weights", "min")]
    found = skyline(CHIPS, weights)
    assert found.rows.index.tolist() == [0]
    assert found.notes == ["points on x: no objective depends on hardware"]
    assert skyline(CHIPS, weights, "hardware == 'y'").rows.index.tolist() == [3]
    assert skyline(CHIPS, weights, by="hardware").rows.index.tolist() == [0, 3, 4]
