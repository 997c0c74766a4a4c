"""The corrected accuracy: one number per design point in every command, and why a table has none."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import dse
from dse.cli import main
from dse.config import load_space
from dse.skyline.pick import pick
from dse.skyline.posterior import expected
from dse.study import corrected, explore
from dse.study.record import load_records
from tests import tiny_study
from tests.command import document

EXAMPLE = Path(__file__).resolve().parents[2] / "results" / "example"
COLUMNS = ["accuracy_corrected", "accuracy_corrected_low", "accuracy_corrected_high"]


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    folder = tmp_path_factory.mktemp("read") / "example"
    shutil.copytree(EXAMPLE, folder)
    return folder


def printed(capsys, *arguments):
    assert main([*arguments, "--format", "table"]) == 0
    return capsys.readouterr().out


def test_every_command_shows_the_number_of_the_table(example, capsys):
    points = dse.open(example).points()
    keys = ["trial", "point", "hardware"]
    of_point = points.set_index(keys)[COLUMNS]
    for task in ("texture", "profile"):
        where = f"task == '{task}' and hardware == 'loihi1_silicon'"
        rows = document(capsys, "skyline", str(example), "--where", where)["rows"]
        rows += document(capsys, "pick", str(example), "--budget", where, "--draws", "20")["rows"]
        for row in rows:
            assert [row[name] for name in COLUMNS] == of_point.loc[tuple(row[key] for key in keys)].tolist()
    full = points[(points["hardware"] == "mcu_m4") & points[["phi", "read_out_ms"]].isna().all(axis=1)]
    of_design = full.set_index("trial")
    report = document(capsys, "report", str(example))
    assert report["notes"][0].startswith("texture on mcu_m4: spike for accuracy, not for energy")
    rows = [row for row in report["rows"] if row["figure"] == "accuracy, mlp"]
    assert len(rows) == 2
    for row in rows:
        assert row["corrected"] == of_design.loc[row["trial"], "accuracy_corrected"]
        assert row["corrected_low"] < row["corrected"] <= row["ours"]


def test_the_best_of_many_points_loses_what_others_keep(example):
    points = dse.open(example).points()
    luck = points["accuracy"] - points["accuracy_corrected"]
    assert (luck >= 0).all() and points[COLUMNS].notna().all(axis=None)
    assert (points["accuracy_corrected_low"] < points["accuracy_corrected"]).all()
    assert (points["accuracy_corrected_high"] <= 1).all()
    profile = points["task"] == "profile"
    assert luck[points["accuracy"][profile].idxmax()] > 0.005 > 5 * luck[profile].median()
    assert luck.max() > 0.03, "among many that are about as good"
    on_chips = points.groupby(["trial", "point"])["accuracy_corrected"].nunique()
    assert (on_chips == 1).all(), "a chip changes costs, not accuracies"


def test_luck_grows_with_the_number_of_points_and_shrinks_with_recordings():
    rng = np.random.default_rng(3)

    def lost(n_points, n):
        """Return what the best of equal points loses; all of what it has above 0.8 is luck."""
        accuracy, number = np.unique(rng.binomial(n, 0.8, n_points) / n, return_counts=True)
        return float(accuracy[-1] - expected(accuracy, np.full(len(accuracy), n), number)[-1])

    many, few, long = lost(2000, 100), lost(10, 100), lost(2000, 5000)
    assert many > 0.09 and many > 1.5 * few and long < many / 4
    assert expected(np.array([0.9]), np.array([1000]), np.array([1]))[0] == pytest.approx(0.9, abs=0.005)


def test_folds_have_their_own_recordings_and_repeats_the_same(tmp_path):
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    cases = {"stratified: {validation: 0.5}": (18, 36), "k_fold: {k: 3}": (36, 36)}
    for split, (recordings, answers) in cases.items():
        text = tiny_study.REAL.replace("stratified: {validation: 0.5}", split).replace(
            "epochs: 4", "epochs: 1"
        )
        text = text.replace("repeats: 2", f"repeats: {2 if 'strat' in split else 3}")
        (tmp_path / "real.yaml").write_text(text)
        space = load_space(tmp_path / "real.yaml")
        study = explore.run(space, tmp_path / split[:6], progress=False)
        of = corrected.asked(space, {0: load_records(study.folder, 0)})
        assert of[0] == (recordings, answers), split


def test_a_table_without_recordings_says_that_it_has_none(tmp_path, capsys):
    table = pd.DataFrame({"trial": [0, 1], "accuracy": [0.9, 0.8], "energy_uj": [2.0, 1.0]})
    table.to_csv(tmp_path / "points.csv", index=False)
    objectives = ("--objectives", "accuracy:max,energy_uj:min")
    for command in (
        ("skyline", str(tmp_path / "points.csv"), *objectives),
        ("pick", str(tmp_path / "points.csv")),
    ):
        found = document(capsys, *command)
        assert all("accuracy_corrected" not in row for row in found["rows"])
        assert any(note.startswith("no accuracy_corrected") for note in found["notes"])


def test_an_open_interval_is_its_low_end_and_both_energies_are_shown(example, capsys):
    budget = ("--budget", "hardware == 'spinnaker2' and task == 'texture'")
    found, _, _ = printed(capsys, "pick", str(example), *budget).partition("\n\n")  # the answer follows
    lines = dict(line.split(maxsplit=1) for line in found.splitlines())
    row = document(capsys, "pick", str(example), *budget)["rows"][0]
    assert row["energy_uj_high"] > 100 * row["energy_uj_low"]
    assert lines["energy_uj"] == f"at least {row['energy_uj_low']:.4g}"
    assert lines["energy_throttled_uj"].startswith("at least ")
    low, value, high = (row[f"accuracy_corrected{end}"] for end in ("_low", "", "_high"))
    assert lines["accuracy_corrected"] == f"{value:.3f} ({low:.3f}-{high:.3f})"
    assert list(lines)[:3] == ["accuracy_corrected", "accuracy", "accuracy_test"]
    budget = ("--budget", "hardware == 'mcu_m4' and task == 'texture'")
    on_mcu = document(capsys, "pick", str(example), *budget)["rows"][0]
    text = printed(capsys, "pick", str(example), *budget)
    assert f"{on_mcu['energy_uj']:.0f}" in text and f"{on_mcu['energy_throttled_uj']:.0f}" in text
    front = printed(capsys, "skyline", str(example), "--where", "hardware == 'spinnaker2'")
    assert " accuracy_corrected   accuracy " in front
    waiting = document(capsys, "skyline", str(example), "--where", "hardware == 'loihi1_silicon'")
    times = max(row["energy_throttled_uj"] / row["energy_uj"] for row in waiting["rows"])
    assert times > 1000 and any(f"{times:.0f} times as much" in note for note in waiting["notes"])
    assert "at least" in front


def columns(accuracy, **places):
    n = len(accuracy)
    missing = {key: np.full(n, np.nan) for key in ("phi", "theta", "read_out_ms", "weight_bits")}
    return {"accuracy": np.array(accuracy, float), **missing, **{k: np.array(x) for k, x in places.items()}}


def excess(part, n=30):
    return corrected.unsupported(part, "accuracy", np.ones(len(part["accuracy"]), bool), n)


def test_a_lone_peak_is_supported_least():
    time_ms = [10.0, 20, 30, 40, 50, 60, np.nan]
    found = excess(columns([0.5, 0.6, 0.9, 0.7, 0.9, 0.9, 0.9], read_out_ms=time_ms))
    assert found[2] > 2 * found[4] > 4 * found[6] >= 0  # all measured 0.9; the whole window comes last
    assert found.argmax() == 2 and found[3] == 0  # what is below its neighbours loses nothing
    level = excess(columns([0.8] * 7, read_out_ms=time_ms))
    np.testing.assert_allclose(level, 0, atol=1e-12)
    many = excess(columns([0.5, 0.6, 0.9, 0.7, 0.9, 0.9, 0.9], read_out_ms=time_ms), n=10**9)
    np.testing.assert_allclose(many, 0, atol=1e-6)  # of so many recordings nothing is luck


def test_neighbours_lie_in_time_or_in_phi_and_theta_in_any_order_of_the_rows():
    rng = np.random.default_rng(0)
    phi, theta = (x.ravel() for x in np.meshgrid(np.arange(6.0), [0.2, 0.4, 0.6], indexing="ij"))
    peak = np.full((6, 3), 0.5)
    peak[3, 1] = 1.0
    accuracy = np.concatenate([peak.ravel(), [0.5, 0.5, 0.9]])
    places = {
        "phi": np.append(phi, [np.nan] * 3),
        "theta": np.append(theta, [np.nan] * 3),
        "read_out_ms": np.append([np.nan] * 18, [10.0, 20.0, np.nan]),
    }
    found = excess(columns(accuracy, **places))
    assert found[:18].reshape(6, 3).argmax() == 3 * 3 + 1 and (found[:18] > 0).sum() == 1
    assert found[18:].argmax() == 2  # a read-out is no neighbour of a decision
    order = rng.permutation(21)
    np.testing.assert_allclose(
        excess(columns(accuracy[order], **{k: x[order] for k, x in places.items()})), found[order]
    )
    twice = {k: np.tile(x, 2) for k, x in places.items()}
    bits = np.repeat([8.0, 4.0], 21)
    np.testing.assert_allclose(
        excess(columns(np.tile(accuracy, 2), **twice, weight_bits=bits)), np.tile(found, 2)
    )


def test_of_equal_points_that_is_picked_which_its_neighbours_support():
    table = pd.DataFrame(
        {"accuracy": [0.9, 0.9, 0.8], "accuracy_corrected": [0.85, 0.86, 0.8], "energy_uj": [1.0, 5.0, 0.1]}
    )
    found = pick(table, [], tie_breaks=[("energy_uj", "min")])
    assert found.row is not None and found.row["energy_uj"] == 5.0
    assert found.notes == ["2 design points have the same accuracy; the best accuracy_corrected decides"]
    alone = pick(table.drop(columns="accuracy_corrected"), [], tie_breaks=[("energy_uj", "min")])
    assert alone.row is not None and alone.row["energy_uj"] == 1.0
