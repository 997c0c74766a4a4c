"""Which columns of design points a terminal shows."""

import io
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dse.cli import main
from dse.cli.fronts import MOST_COLUMNS, RIVALS, columns, front_answer
from dse.skyline.table import Goal
from tests.command import document
from tests.skyline.tables import NAMING_OTHERS, WORDS

EXAMPLE = Path(__file__).resolve().parents[2] / "results" / "example"
GOALS = [("accuracy", "max"), ("n_weights", "min")]


def mixed():
    """Return points of two families with axes of their own."""
    return pd.DataFrame(
        {
            "trial": [0, 1],
            "task": ["texture"] * 2,
            "family": ["knn", "snn"],
            "model.kind": ["knn", "snn"],
            "model.knn.k": [3.0, np.nan],
            "model.snn.hidden": [np.nan, 8.0],
            "encoder.gain": [1.0, 2.0],
            "encoder.order": [1, 1],
            "accuracy": [0.8, 0.9],
            "accuracy_test": [np.nan, np.nan],
            "n_weights": [10, 20],
            "read_out_ms": [np.nan, 250.0],
        }
    )


def test_a_front_of_several_families_shows_what_all_of_them_have():
    shown = columns(mixed(), GOALS)
    assert shown == ["trial", "task", "family", "read_out_ms", "accuracy", "n_weights", "encoder.gain"]
    assert "model.kind" in columns(mixed().drop(columns="family"), GOALS)
    assert "encoder.gain" not in columns(mixed().iloc[1:], GOALS)


def test_a_view_has_at_most_30_columns_unless_more_are_asked_for():
    many = {f"encoder.axis_{n}": [0, n] for n in range(1, 40)}
    measured = dict.fromkeys(
        ("energy_uj", "energy_uj_low", "energy_uj_high", "latency_ms", "peak_state"), 1.0
    )
    points = mixed().assign(**many, **measured)
    asked = [f"encoder.axis_{n}" for n in range(5, 35)]
    assert len(columns(points, GOALS)) == MOST_COLUMNS
    assert not {"peak_state", "accuracy_test"} & {*columns(points, GOALS)}
    assert {*asked, "trial", "accuracy"} <= {*columns(points, GOALS, asked)}


@pytest.mark.parametrize("empty", [False, True])
def test_the_view_of_a_study_is_the_same_at_a_pipe_and_as_csv(empty, capsys):
    where = "accuracy > 2" if empty else "ties >= 0"
    printed = []
    for options in ([], ["--format", "csv"], ["--columns", "all"]):
        assert main(["skyline", str(EXAMPLE), "--where", where, *options]) == 0
        printed.append(pd.read_csv(io.StringIO(capsys.readouterr().out)).columns.tolist())
    assert printed[0] == printed[1]
    assert {"trial", "task", "family", "hardware", "accuracy_corrected_low", "energy_uj_high"} < {*printed[0]}
    assert len(printed[0]) <= MOST_COLUMNS and ("ties" in printed[0]) != empty
    assert len(printed[2]) == len(printed[0]) if empty else len(printed[2]) > 3 * MOST_COLUMNS


def test_equal_points_of_a_trial_are_one_row_with_their_number():
    latency = [900.0, 356.0, 1000.0, 10.0]
    points = mixed().iloc[[1, 1, 1, 0]].assign(phi=[1, 2, 3, 4], latency_ms=latency).reset_index(drop=True)
    answer = front_answer(points, [Goal(*pair) for pair in GOALS], ["a note"])
    assert [(row["trial"], row["phi"], row["points"]) for row in answer.table or ()] == [(1, 2, 3), (0, 4, 1)]
    assert len(answer.rows) == 4 and "points" in answer.columns and "points" not in answer.rows[0]
    assert answer.notes[0] == "a note" and answer.notes[1].startswith("points: how many points of a trial")
    alone = front_answer(points.iloc[2:], [Goal(*pair) for pair in GOALS], ["a note"])
    assert "points" not in alone.columns and list(alone.notes) == ["a note"]


def test_an_empty_front_says_so_and_has_a_header(tmp_path, capsys):
    mixed().to_csv(tmp_path / "points.csv", index=False)
    options = ["--objectives", "accuracy:max", "--where", "n_weights < 0"]
    assert main(["skyline", str(tmp_path / "points.csv"), *options, "--format", "csv"]) == 0
    printed = capsys.readouterr()
    assert "no design point is left" in printed.err
    assert list(pd.read_csv(io.StringIO(printed.out)).columns)[:3] == ["trial", "task", "family"]


def test_a_missed_budget_is_no_axis():
    missed = mixed().assign(**{"missed n_weights<=0.5": [1.0, 2.0]})
    assert columns(missed, GOALS) == columns(mixed(), GOALS)


def test_a_pick_shows_its_own_design(tmp_path, capsys):
    mixed().to_csv(tmp_path / "points.csv", index=False)
    assert main(["pick", str(tmp_path / "points.csv"), "--format", "table"]) == 0
    shown = capsys.readouterr().out.splitlines()[0].split()
    assert shown == [
        "accuracy",
        "trial",
        "family",
        "model.snn.hidden",
        "encoder.gain",
        "encoder.order",
        "read_out_ms",
    ]


@pytest.mark.parametrize("condition", NAMING_OTHERS)
def test_words_in_a_condition_let_no_leaking_or_misfitting_design_through(condition, tmp_path, capsys):
    path = tmp_path / "points.csv"
    WORDS.to_csv(path, index=False)

    def trials(*arguments):
        return [row["trial"] for row in document(capsys, arguments[0], path, *arguments[1:])["rows"]]

    front = ("skyline", "--objectives", "accuracy:max,energy_uj:min", "--where")
    assert trials(*front, condition) == [2]
    assert trials(*front, f"({condition}) and transductive") == [0]
    assert trials("pick", "--budget", condition) == [2]
    assert trials("pick", "--budget", condition, "--budget", "not fits") == [1]


def test_a_pick_across_tasks_says_so_unless_a_condition_names_the_column(tmp_path, capsys):
    path = tmp_path / "points.csv"
    WORDS.assign(**{"task": ["a", "a", "b"], "task.target": "task", "fits": True}).to_csv(path, index=False)
    for budget, n_notes in (("task.target == 'task'", 1), ("task != 'c'", 0)):
        notes = document(capsys, "pick", path, "--budget", budget)["notes"]
        assert sum(note.startswith("this is the best over the tasks") for note in notes) == n_notes


def test_a_pick_says_whether_to_spike(capsys):
    asked = ["pick", str(EXAMPLE), "--hardware", "mcu_m4", "--budget", "task == 'profile'"]
    section = document(capsys, *asked)["sections"][RIVALS]
    assert {row["family"]: row["spikes"] for row in section["rows"]} == {
        "mlp": False,
        "naive_bayes": False,
        "snn": True,
    }
    assert {row["answer"] for row in section["rows"]} == {"do not spike"}
    assert all(0 <= row["spiking_cheaper"] <= 1 and row["task"] == "profile" for row in section["rows"])
    assert main([*asked, "--budget", "family == 'snn'", "--json"]) == 0  # it has no rival within the budgets
    assert "sections" not in json.loads(capsys.readouterr().out)
