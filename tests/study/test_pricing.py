"""Hardware as a free axis on the command line: other chips, draws of their figures, sure picks."""

import re
import shutil

import numpy as np
import pytest

import dse
from dse import store
from dse.cli import main
from dse.measure.hardware.profile import load
from dse.study import pricing, resampling
from dse.study.record import load_records
from dse.study.results import open as open_study
from tests.command import document
from tests.page_data import held
from tests.rewriting import damage_part
from tests.spaces import write_space


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The folder of a study of two designs on one chip."""
    folder = tmp_path_factory.mktemp("study")
    goals = "[accuracy:max, n_weights:min, energy_uj:min]"
    changes = ("[[1, 2], [1, 2, 4]]", "[[1, 2]]"), ("[4, 8, 12]", "[4, 40]")
    space = write_space(folder, *changes, ("[accuracy:max, n_weights:min]", goals))
    assert main(["run", str(space), "--results", str(folder / "results"), "--quiet", "--json"]) == 0
    return folder / "results" / "tiny"


def test_a_front_on_hardware_that_the_study_was_not_run_with(results, capsys):
    own = document(capsys, "skyline", str(results))["rows"]
    assert {row["hardware"] for row in own} == {"loihi1_silicon"}
    both = document(
        capsys, "skyline", str(results), "--hardware", "op_4.6_0.9", "--hardware", "loihi1_silicon"
    )["rows"]
    assert [row["hardware"] for row in both][:1] == ["op_4.6_0.9"]
    on_chip = [row for row in both if row["hardware"] == "loihi1_silicon"]
    # Figures are those of the same profile: the same front, whatever else is compared beside it.
    assert [(r["trial"], r["point"], r["energy_uj"]) for r in on_chip] == [
        (r["trial"], r["point"], r["energy_uj"]) for r in own
    ]
    assert open_study(results).points()["hardware"].unique().tolist() == ["loihi1_silicon"]


def test_a_front_on_a_chip_of_ones_own(results, tmp_path, capsys):
    text = load("loihi1_silicon").text.replace("name: loihi1_silicon", "name: mine")
    (tmp_path / "mine.yaml").write_text(text.replace("static_mw: {value: 104.0", "static_mw: {value: 50.0"))
    rows = document(capsys, "skyline", str(results), "--hardware", str(tmp_path / "mine.yaml"))["rows"]
    assert {row["hardware"] for row in rows} == {"mine"}
    own = document(capsys, "skyline", str(results))["rows"]
    assert min(row["energy_uj"] for row in rows) < min(row["energy_uj"] for row in own)
    chip = ("--hardware", str(tmp_path / "mine.yaml"))
    drawn = document(capsys, "skyline", str(results), *chip, *chip, "--draws", "20")["rows"]
    assert [row["energy_uj"] for row in drawn] == [row["energy_uj"] for row in rows]
    assert max(row["front_share"] for row in drawn) == 1.0
    [sure] = document(capsys, "pick", str(results), *chip, "--confidence", "0.9")["rows"]
    assert sure["hardware"] == "mine" and sure["front_share"] >= 0.9


def test_a_copy_of_an_older_profile_is_one_line_and_is_repaired(results, tmp_path, capsys):
    folder = shutil.copytree(results, tmp_path / "old")
    own = document(capsys, "skyline", str(folder))["rows"]
    stored = folder / "hardware" / "loihi1_silicon.yaml"
    lines = load("loihi1_silicon").text.replace("static_mw:", "rest_mw:").replace("value: 104.0", "value: 9")
    store.write_text(stored, lines)
    assert main(["skyline", str(folder), "--draws", "9"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{stored}: another version of dse wrote this profile (static_mw is required")
    assert "dse doctor" in line and main(["doctor", str(folder), "--repair"]) == 0
    assert main(["doctor", str(folder)]) == 0
    assert document(capsys, "skyline", str(folder))["rows"] == own


def test_a_page_has_the_shares_of_the_skyline(results, tmp_path, capsys):
    rows = document(capsys, "skyline", str(results), "--draws", "50")["rows"]
    page = tmp_path / "page.html"
    assert main(["dashboard", str(results), "--html", str(page), "--draws", "50"]) == 0
    columns = {name: column["values"] for name, column in held(page)["columns"].items()}
    shown = {
        (trial, point): share
        for trial, point, share in zip(
            columns["trial"], columns["point"], columns["front_share"], strict=True
        )
    }
    assert [shown[row["trial"], row["point"]] for row in rows] == [row["front_share"] for row in rows]
    other = ("--hardware", "mcu_m4", "--hardware", "op_4.6_0.9")
    assert main(["dashboard", str(results), "--html", str(page), *other]) == 0
    shown_on = held(page)
    assert set(shown_on["columns"]["hardware"]["values"]) == {"mcu_m4", "op_4.6_0.9"}
    assert shown_on["budgets"]["hardware"] == ["mcu_m4", "op_4.6_0.9"], (
        "the command that it offers names them"
    )
    assert main(["dashboard", str(results), "--hardware", "none_such"]) == 2
    bare = write_space(tmp_path, ("[loihi1_silicon]", "[]"), ("[[1, 2], [1, 2, 4]]", "[[1, 2]]"))
    study = dse.run(bare, results=tmp_path / "results", progress=False).folder
    assert main(["dashboard", str(study), "--html", str(page), "--draws", "5"]) == 0, "recordings are drawn"
    assert 0 < max(held(page)["columns"]["front_probability"]["values"]) <= 1


def test_a_pick_with_confidence(results, capsys):
    [plain] = document(capsys, "pick", str(results))["rows"]
    budget = f"energy_uj <= {plain['energy_uj'] * 1.001}"
    [bold] = document(capsys, "pick", str(results), "--budget", budget)["rows"]
    assert (bold["trial"], bold["point"]) == (plain["trial"], plain["point"])
    [sure] = document(capsys, "pick", str(results), "--budget", budget, "--confidence", "0.95")["rows"]
    assert sure["front_share"] >= 0.95
    assert (sure["trial"], sure["point"]) != (bold["trial"], bold["point"]), "its range reaches beyond"
    assert sure["energy_uj_low"] < sure["energy_uj"] < bold["energy_uj"]
    none = document(
        capsys, "pick", str(results), "--budget", "energy_uj <= 1e-9", "--confidence", "0.5", code=3
    )
    assert none["notes"][0] == "no design point meets energy_uj <= 1e-9 in 50% of the samples"
    assert all(row["missed energy_uj<=1e-09"] > 0 for row in none["rows"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["skyline", "FOLDER", "--hardware", "loihi3"], "loihi3: no such hardware profile; known"),
        (["skyline", "FOLDER", "--draws", "0"], "must be in [1, 100000], got 0"),
        (["skyline", "FOLDER", "--draws", "9999999"], "must be in [1, 100000], got 9999999"),
        (["skyline", "FOLDER", "--contacts-per-hour", "-1"], "must be >= 0, got -1"),
        (["pick", "TABLE", "--contacts-per-hour", "1"], "--contacts-per-hour needs the column"),
        (["pick", "FOLDER", "--confidence", "1.5"], "must be in (0, 1], got 1.5"),
        (["pick", "FOLDER", "--confidence", "sure"], "must be a number, got 'sure'"),
        (["skyline", "FOLDER", "--draws", "9", "--objectives", "n_weights:min"], "nothing to sample"),
        (
            ["skyline", "TABLE", "--hardware", "loihi1_silicon", "--objectives", "accuracy:max"],
            "--hardware needs the folder of a study",
        ),
        (["skyline", "TABLE", "--draws", "9", "--objectives", "energy_uj:min"], "sampling needs the folder"),
        (["pick", "TABLE", "--confidence", "0.9"], "sampling needs the folder of a study"),
    ],
)
def test_what_cannot_be_asked(results, tmp_path, capsys, arguments, message):
    table = tmp_path / "points.csv"
    table.write_text("trial,accuracy,energy_uj\n0,0.5,1\n")
    places = {"FOLDER": str(results), "TABLE": str(table)}
    try:
        code = main([places.get(text, text) for text in arguments])
    except SystemExit as error:
        code = int(str(error.code))
    assert code == 2
    assert message in capsys.readouterr().err


def test_a_wrong_chip_is_found_before_any_work(tmp_path, capsys):
    text = load("loihi1_silicon").text.replace("name: loihi1_silicon", "name: mine")
    (tmp_path / "mine.yaml").write_text(text.replace("unit: mW", "unit: W"))
    space = write_space(tmp_path, ("hardware: [loihi1_silicon]", "hardware: [loihi1_silicon, mine.yaml]"))
    for command in (["check"], ["run", "--results", str(tmp_path / "results"), "--quiet"]):
        assert main([command[0], str(space), *command[1:]]) == 2
        assert "static_mw.unit must be 'mW', got 'W'" in capsys.readouterr().err
    assert not (tmp_path / "results").exists()


def test_mean_power_of_a_study_s_designs(results, capsys):
    asked = ("--contacts-per-hour", "60", "--hardware", "loihi1_silicon")
    goals = ("--objectives", "accuracy:max,power_mw:min")
    for row in document(capsys, "skyline", str(results), *asked, *goals)["rows"]:
        share = 60 * max(row["decision_latency_ms"], row["hardware_latency_ms"]) / 3.6e6
        assert row["idle_mw"] == 104
        assert row["power_mw"] == pytest.approx(60 * row["energy_throttled_uj"] / 3.6e6 + (1 - share) * 104)
    [row] = document(capsys, "pick", str(results), *asked, "--budget", "power_mw <= 104.1")["rows"]
    assert row["power_mw"] <= 104.1
    never = document(capsys, "pick", str(results), *asked, "--budget", "power_mw <= 9", code=3)
    assert all(row["missed power_mw<=9"] > 89 for row in never["rows"])


def test_designs_of_a_study_on_a_schedule(tmp_path, capsys):
    text = "schedule: {contacts_per_hour: 60, battery_mwh: 240}\nobjectives: [accuracy:max, power_mw:min"
    space = dse.load_space(write_space(tmp_path, ("objectives: [accuracy:max", text)))
    study = dse.run(space, tmp_path / "results", progress=False)
    points, trials = study.points(), study.trials
    assert trials["power_mw"].notna().all()
    asked = pricing.at_rate(points, 60)
    for name in ("power_mw", "energy_per_hour_mj"):
        np.testing.assert_allclose(points[name], asked[name], rtol=1e-12)
    np.testing.assert_allclose(points["battery_days"], 10 / points["power_mw"])
    again = pricing.points(study.folder, ["mcu_m4"])
    np.testing.assert_allclose(again["battery_days"], 10 / again["power_mw"])
    front = document(capsys, "skyline", str(study.folder))["rows"]
    assert all(row["power_mw"] > 0 for row in front)
    row = document(capsys, "skyline", str(study.folder), "--contacts-per-hour", "0")["rows"][0]
    assert "battery_days" not in row and row["power_mw"] == row["idle_mw"]


def test_mean_power_that_is_not_known(results, capsys):
    notes = document(
        capsys,
        *("skyline", str(results), "--contacts-per-hour", "60", "--hardware", "odin", "--oversize"),
        *("--objectives", "accuracy:max,power_mw:min"),
    )["notes"]
    assert any("power_mw is NaN" in note for note in notes), "nobody published what it draws when idle"
    crowded = document(capsys, "skyline", str(results), "--contacts-per-hour", "1e9")["rows"]
    assert all(row["power_mw"] is None for row in crowded), "contacts overlap"


def test_single_answers_of_a_run_average_to_the_accuracies_of_its_points(results):
    points = open_study(results).points()
    for trial, rows in points.groupby("trial"):
        [record] = load_records(results, int(str(trial)))
        index, right = resampling.right_answers(results, record, rows)
        assert len(index) == record.samples["validation"]
        np.testing.assert_allclose(right.mean(axis=0), rows["accuracy"].to_numpy())


def test_probabilities_of_the_front_and_the_corrected_accuracy_are_printed(results, capsys):
    rows = document(capsys, "skyline", str(results), "--draws", "200")["rows"]
    assert all(0 <= row["front_probability"] <= 1 for row in rows)
    assert len({row["front_probability"] for row in rows}) > 1
    plain = document(capsys, "skyline", str(results))["rows"]
    added = ("front_share", "front_probability")  # drawn only if that is asked for
    assert plain == [{name: x for name, x in row.items() if name not in added} for row in rows]
    share = max(row["front_probability"] for row in rows)
    likely = [row for row in rows if row["front_probability"] >= share]
    assert 0 < len(likely) < len(rows)
    for asked in (
        ("--confidence", f"{share}"),
        ("--where", f"front_probability >= {share} and accuracy >= 0"),
    ):
        assert document(capsys, "skyline", str(results), *asked)["rows"] == likely
    study = dse.open(results)
    for drawn, options in ((plain, {}), (rows, {"draws": 200}), (likely, {"confidence": share})):
        assert list(study.skyline(**options).rows) == list(drawn[0]), "the columns of the command line"
        assert len(study.skyline(**options).rows) == len(drawn)
    picked = document(capsys, "pick", str(results))
    [row] = picked["rows"]
    low, value, high = (row[f"accuracy_corrected{end}"] for end in ("_low", "", "_high"))
    assert 0 <= low < value <= row["accuracy"] and value < high <= 1
    [sure] = document(capsys, "pick", str(results), "--confidence", "0.5", "--budget", "energy_uj <= 1e9")[
        "rows"
    ]
    assert 0.5 <= sure["confidence"] <= sure["front_share"]


def test_a_study_without_its_answers_says_why_there_are_no_probabilities(results, tmp_path, capsys):
    shutil.copytree(results, tmp_path / "copy")
    for path in (tmp_path / "copy" / "runs").glob("*.npz"):
        damage_part(path, "response.npz")
    asked = ("--draws", "9", "--objectives", "accuracy:max,n_weights:min")
    answer = document(capsys, "skyline", tmp_path / "copy", *asked)
    assert any(note.startswith("no front_probability: ") for note in answer["notes"])
    assert "front_probability" not in answer["rows"][0]


def test_a_profile_that_has_gained_numbers_says_what_costs_may_differ(tmp_path):
    chip = load("mcu_m4")
    kept = tmp_path / "hardware" / "mcu_m4.yaml"
    kept.parent.mkdir()
    before = re.sub(r"(?m)^tally_step_cycles:.*\n(?:[ ]+.*\n)*", "", chip.text)
    assert before != chip.text
    store.write_text(kept, before)
    [note] = pricing.check([chip], tmp_path)
    assert "lacks 1 numbers that mcu_m4 has now" in note
    pricing.keep([chip], tmp_path)
    assert pricing.check([chip], tmp_path) == []
