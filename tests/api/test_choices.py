"""What is chosen from the shipped study: what its chip can run and hold, and always the same of equals."""

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import dse
from dse.api.choice import NothingFeasible
from dse.cli import main
from tests.api.test_study import SPACE, waves
from tests.command import document

EXAMPLE = Path(__file__).resolve().parents[2] / "results" / "example"


def test_random_budgets_pick_what_pandas_picks_and_it_is_on_the_front():
    study = dse.open(EXAMPLE)
    points = pd.read_parquet(EXAMPLE / "points.parquet")
    held = points[points["fits"].eq(True).fillna(False)]
    rng = np.random.default_rng(3)
    n_ties = 0
    for _ in range(10):
        chip, task = rng.choice(held["hardware"].unique()), rng.choice(held["task"].unique())
        rows = held[held["hardware"].eq(chip) & held["task"].eq(task)]
        conditions = [f"hardware == '{chip}'", f"task == '{task}'"]
        for name in rng.choice(["energy_uj", "n_weights", "latency_ms", "spikes_per_inference"], 2, False):
            limit = float(rows[name].quantile(rng.uniform(0.1, 1.0)))
            conditions.append(f"{name} <= {limit!r}")
        for condition in conditions[2:]:
            name, limit = condition.split(" <= ")
            rows = rows[rows[name] <= float(limit)]
        choice = study.pick(conditions, draws=1)
        if rows.empty:
            assert choice.row is None
            continue
        best = rows.sort_values(
            ["accuracy", "energy_uj", "n_weights", "latency_ms"], ascending=[False, True, True, True]
        ).iloc[0]
        n_ties += (rows["accuracy"] == best["accuracy"]).sum() > 1
        assert (choice["trial"], choice["point"]) == (best["trial"], best["point"])
        front = study.skyline(where=conditions).rows
        assert ((front["trial"] == best["trial"]) & (front["point"] == best["point"])).any()
    assert n_ties > 1, "no ties were tried"


def test_tables_without_runs_say_that_nothing_fits(capsys):
    """The networks of 6084 inputs have more of them than a core of Loihi has axons."""
    folder = EXAMPLE.parent / "002_texture_velocity" / "texture_profile_contrasts"
    nearest = document(capsys, "pick", str(folder), code=3)
    assert {row["fits"] for row in nearest["rows"]} <= {False}
    assert any("no design fits loihi1_silicon" in note for note in nearest["notes"])
    notes = document(capsys, "pick", str(folder), "--oversize", "--budget", "task == 'profile'")["notes"]
    assert any("holds no run" in note for note in notes)


@pytest.mark.parametrize("family", ["", "naive_bayes"])
def test_nothing_fits_and_nothing_is_feasible(family, capsys):
    where = ["--budget", f"family == '{family}'"] if family else []
    chip = ("--hardware", "xylo_imu")
    found = document(capsys, "pick", str(EXAMPLE), *chip, *where, code=3)
    front = document(
        capsys, "skyline", str(EXAMPLE), *chip, *("--where" if x == "--budget" else x for x in where)
    )
    assert front["rows"] == [] and any("xylo_imu" in note for note in front["notes"])
    if family == "naive_bayes":  # the chip cannot run it, however large it were
        assert found["rows"] == []
        assert document(capsys, "pick", str(EXAMPLE), *chip, *where, "--oversize", code=3)["rows"] == []
        return
    assert {row["fits"] for row in found["rows"]} == {False} and len(found["rows"]) == 5
    assert any("inputs, 16 at most" in note for note in found["notes"]), "the reason"
    [larger] = document(capsys, "pick", str(EXAMPLE), *chip, *where, "--oversize")["rows"]
    assert larger["family"] == "snn" and larger["fits"] is False and larger["energy_uj"] > 0
    oversize = document(capsys, "skyline", str(EXAMPLE), *chip, "--oversize")["rows"]
    assert {row["family"] for row in oversize} == {"snn"}


def test_where_some_designs_fit_only_these_are_chosen_in_python_too():
    study = dse.open(EXAMPLE)
    with pytest.raises(NothingFeasible, match="xylo_imu"):
        study.best(hardware="xylo_imu")
    assert study.skyline(hardware="xylo_imu").rows.empty
    assert len(study.skyline(hardware="xylo_imu", oversize=True).rows)
    both = study.skyline(hardware=["xylo_imu", "mcu_m4"]).rows
    assert set(both["hardware"]) == {"mcu_m4"}
    assert study.pick("family == 'mlp' and hardware == 'loihi1_silicon'").row is None


def test_the_first_objective_that_is_maximised_is_what_a_pick_maximises(tmp_path, capsys):
    data = dse.data.from_arrays(*waves(), step_ms=4, file=tmp_path / "waves")
    space = {"data": data, **SPACE, "objectives": ["n_weights:min", "recall_macro:max", "accuracy:max"]}
    study = dse.run(space, tmp_path, progress=False)
    assert study.pick().goals[0] == ("recall_macro", "max")
    assert study.pick(maximise="accuracy").goals[0] == ("accuracy", "max")
    points = study.points()
    [row] = document(capsys, "pick", str(study.folder))["rows"]
    assert row["recall_macro"] == points["recall_macro"].max()
    points.to_csv(tmp_path / "points.csv")
    [row] = document(capsys, "pick", str(tmp_path / "points.csv"))["rows"]
    assert row["accuracy"] == points["accuracy"].max()


def test_what_is_picked_is_exported_evaluated_and_shown(tmp_path):
    study = dse.open(EXAMPLE)
    choice = study.pick(["n_weights <= 20000", "task == 'texture'"], hardware="mcu_m4", draws=5)
    for wrong in ({"draws": -5}, {"draws": True}, {"oversize": "no"}):
        with pytest.raises((TypeError, ValueError), match=next(iter(wrong))):
            study.pick(**wrong)
    bundle = study.export(choice, tmp_path / "one")
    assert bundle.record["trial"] == choice["trial"] == choice.row["trial"]
    again = choice.export(tmp_path / "two")
    assert again.record == bundle.record
    assert dse.export(study, choice, tmp_path / "three").record == bundle.record
    with pytest.raises(ValueError, match="columns"):
        study.export({"accuracy": 1.0}, tmp_path / "four")
    assert study.plot.confusion(choice).data
    assert repr(choice).startswith(f"<Choice trial {choice['trial']} of example on mcu_m4: accuracy ")
    assert "\n" not in repr(choice) and "<table" in choice._repr_html_() and choice
    none = study.pick("n_weights <= 1")
    assert not none and "n_weights &lt;= 1" in none._repr_html_()
    for refused in (lambda: study.export(none, tmp_path / "five"), lambda: none.export(tmp_path / "five")):
        with pytest.raises(NothingFeasible, match="the nearest misses n_weights<=1 by 47"):
            refused()
    assert not (tmp_path / "five").exists()


def test_a_narrow_terminal_shows_the_best_offers_by_chip_and_task(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["skyline", str(EXAMPLE), "--format", "table"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {"trial", "phi", "theta", "read_out_ms"} <= set(lines[0].split())
    heads = [line.split(", ") for line in lines if line.count(", ") == 1 and line[0].isalpha()][:6]
    chips = ["mcu_m4", "loihi1_silicon", "spinnaker2"]
    assert heads == [[chip, task] for chip in chips for task in ("texture", "profile")]
    start = lines.index("loihi1_silicon, texture")
    part = [line.split() for line in lines[start + 1 : lines.index("loihi1_silicon, profile")]]
    assert any(row[4] == "0.769" and row[7] == "1076" for row in part), "the best offer"
    rows = dse.open(EXAMPLE).skyline(where="hardware == 'loihi1_silicon' and task == 'texture'").rows
    assert float(part[0][7]) == pytest.approx(rows.loc[rows["accuracy"].idxmax(), "energy_uj"], rel=1e-3), (
        "first"
    )


def test_a_pipe_gets_csv_of_the_columns_of_the_table(capsys):
    assert main(["pick", str(EXAMPLE), "--budget", "accuracy > 0.99"]) == 3
    printed = capsys.readouterr()
    table = pd.read_csv(io.StringIO(printed.out))
    assert len(table) == 5 and len(table.columns) <= 30 and "missed accuracy>0.99" in table
    assert "no design point meets accuracy > 0.99" in printed.err
    assert main(["pick", str(EXAMPLE), "--budget", "accuracy > 0.99", "--columns", "all"]) == 3
    assert len(pd.read_csv(io.StringIO(capsys.readouterr().out)).columns) > 90


@pytest.mark.parametrize(
    ("budget", "code", "told"),
    [
        ("n_wights <= 3", 2, lambda text: text.index("Did you mean 'n_weights'") < 60),
        ("n_weights =< 3", 2, lambda text: "at '=<', character 11" in text),
        ("energy_uj <= 50uJ", 2, lambda text: "at '50uJ', character 14" in text),
        ("energy_uj 50", 2, lambda text: "at '50', character 11" in text),
        ("energy_uj <=", 2, lambda text: "ends too early" in text),
        ("hardware == 'mcu_m33'", 3, lambda text: "mcu_m4" in text and "--hardware NAME" in text),
        ("task == 'speed'", 3, lambda text: "texture or profile" in text and "--hardware" not in text),
    ],
)
def test_a_wrong_budget_says_what_is_wrong(budget, code, told, capsys):
    assert main(["pick", str(EXAMPLE), "--budget", budget]) == code
    assert told(capsys.readouterr().err)
