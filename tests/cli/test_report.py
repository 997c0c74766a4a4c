"""`dse report` from its arguments to exit code, stdout and stderr."""

import io
import json

import numpy as np
import pandas as pd
import pytest

from dse import store
from dse.cli import main
from dse.config import load_space
from dse.study import explore, pricing
from dse.study.results import open as open_study
from tests.command import document
from tests.installed import needs_papers
from tests.show.report.made import write
from tests.spaces import write_space

COLUMNS = [
    *("system", "figure", "task", "published", "ours", "se", "test", "runs", "family", "trial", "design"),
    *("split", "study", "hardware", "low", "high", "corrected", "corrected_low", "corrected_high"),
]


@pytest.fixture
def results(tmp_path):
    """A folder of two studies."""
    write(tmp_path / "all" / "nets", [{"accuracy": 0.9, "model.hidden": 8}])
    write(tmp_path / "all" / "windows", [{"accuracy": 0.8, "family": "knn", "macs": 4.0, "t_c_ms": 300.0}])
    (tmp_path / "all" / "notes").mkdir()
    return tmp_path / "all"


@needs_papers
def test_json_is_keyed_by_the_columns(results, capsys):
    found = document(capsys, "report", results)
    assert found["schema"] == "dse/report/1"
    assert all(list(row) == COLUMNS for row in found["rows"])
    assert {row["study"] for row in found["rows"]} == {"nets", "windows", ""}
    [accuracy] = [row for row in found["rows"] if row["figure"] == "accuracy, knn"]
    assert (accuracy["ours"], accuracy["test"], accuracy["trial"]) == (0.8, None, 0)
    assert any(note.startswith("B: rate windows with kNN") for note in found["notes"])
    assert (
        "windows, texture: train: repetition 0 1; validation: repetition 2 (train 20, validation 10)"
        in found["notes"]
    )


@needs_papers
def test_the_table_fits_a_terminal_and_shows_every_row(results, capsys):
    assert main(["report", str(results), "--format", "table"]) == 0
    text = capsys.readouterr().out
    table, _, _ = text.partition("A: real-time texture SNN")
    lines = table[table.index("\nsystem") + 1 :].splitlines()  # whether to spike comes first
    assert max(map(len, lines)) <= 160
    assert lines[0].split()[:5] == ["system", "figure", "task", "published", "ours"]
    main(["report", str(results), "--json"])
    assert len(lines) - 1 == len(json.loads(capsys.readouterr().out)["rows"]) > 20


@needs_papers
def test_systems_are_chosen_by_letter(results, capsys):
    found = document(capsys, "report", results, "--system", "b,D")
    assert {row["system"] for row in found["rows"]} == {"B", "D"}
    assert not any(note.startswith("A: ") for note in found["notes"])
    for wrong in ("Z", "BZ", " "):
        assert main(["report", str(results), "--system", wrong]) == 2
        told = capsys.readouterr()
        assert told.err == f"--system must be letters among A, B, C, D, E, F, G, e.g. DE, got '{wrong}'\n"
        assert told.out == ""
    assert main(["report", str(results), "--system", "C", "--json"]) == 1, "nothing to show"


@needs_papers
def test_a_paper_by_number_or_name(results, tmp_path, capsys):
    write(results / "elm", [{"accuracy": 0.8, "family": "elm", "macs": 4.0}])
    found = document(capsys, "report", results, "--paper", "elm_receptors")
    accuracy, *_ = found["rows"]
    assert (accuracy["printed"], accuracy["ours_value"], accuracy["study"]) == ("0.92", 0.8, "elm")
    assert (
        "nets: is of another set-up than paper 004 (elm_receptors): its models are snn, not elm"
        in found["notes"]
    )
    assert main(["report", str(results), "--paper", "004", "--format", "csv"]) == 0
    assert len(pd.read_csv(io.StringIO(capsys.readouterr().out))) == len(found["rows"])
    for paper, line in (
        ("003", "nets: is of another set-up than paper 003 (threshold_encoding): its models are snn"),
        ("7", "--paper must be one of 000 (realtime_texture), 001 ("),
    ):
        assert main(["report", str(results / "nets"), "--paper", paper]) == 2
        told = capsys.readouterr()
        assert told.out == "" and told.err.startswith(line) and told.err.count("\n") == 1
    assert main(["report", str(results), "--paper", "004", "--system", "A"]) == 2


def test_a_study_named_twice_counts_once(results, capsys):
    assert main(["report", str(results), "--format", "csv"]) == 0
    once = capsys.readouterr().out
    assert main(["report", str(results), str(results / "nets"), "--format", "csv"]) == 0
    assert capsys.readouterr().out == once


def test_what_is_no_study_is_one_line(results, tmp_path, capsys):
    for path in (results / "notes", tmp_path / "nowhere", results / "nets" / "points.parquet"):
        assert main(["report", str(path)]) == 2
        assert (
            capsys.readouterr().err
            == f"{path}: must be the folder of a study with results, or contain such folders\n"
        )
    (results / "nets" / "trials.parquet").unlink()
    assert main(["report", str(results / "nets")]) == 2
    assert "is not the folder of a study with results: there is no trials.parquet" in capsys.readouterr().err


def test_damage_is_one_line(results, capsys):
    store.run_file(results / "nets", 0, 0).unlink()
    assert main(["report", str(results)]) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1 and "00000-0.npz" in told.err
    (results / "nets" / "points.parquet").write_bytes(b"PAR1")
    assert main(["report", str(results)]) == 2
    assert "points.parquet: cannot be read" in capsys.readouterr().err


def test_a_study_that_failed_says_why_and_exits_with_1(tmp_path, capsys):
    write(tmp_path / "bad", [], failed=2)
    assert main(["report", str(tmp_path / "bad"), "--format", "table"]) == 1
    assert "bad: 2 of 2 designs failed; the first: ValueError: hidden must be kind" in capsys.readouterr().out


@needs_papers
def test_a_study_as_it_is_run(tmp_path, capsys):
    choice = "{choice: [{kind: snn, hidden: [4]}, {kind: knn, window_ms: 40}]}"
    space = write_space(
        tmp_path,
        ("[[1, 2], [1, 2, 4]]", "[[1, 2]]"),
        ("model: {kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}", f"model: {choice}"),
    )
    found = explore.run(load_space(space), tmp_path / "results", progress=False)
    rows = {row["figure"]: row for row in document(capsys, "report", found.folder)["rows"]}
    for figure, family in (("accuracy, knn", "knn"), ("best accuracy: accuracy", "snn")):
        [trial] = found.trials[found.trials["family"] == family].to_dict("records")
        assert rows[figure]["ours"] == trial["accuracy"]
        assert rows[figure]["se"] == pytest.approx(trial["accuracy_se"])
        assert rows[figure]["split"].startswith("train: repetition 0; validation: repetition 1 (train 12")
    assert rows["accuracy, 160 ms (printed: 250 ms)"]["published"] == 0.93


@needs_papers
def test_chips_are_set_against_each_other(tmp_path, capsys, monkeypatch):
    columns = {"energy_uj": 5.0, "energy_uj_low": 4.0, "energy_uj_high": 7.0, "fits": True}
    on = {"one": columns, "two": columns}
    folder = write(tmp_path / "nets", [{"accuracy": 0.9, "on": on}]).folder

    def drawn(folder, rows, columns, n_draws, hardware):
        return {name: np.full((4, len(rows)), 5.0) for name in columns}

    monkeypatch.setattr(pricing, "drawn", drawn)
    assert main(["report", str(folder), "--format", "table"]) == 0
    table, _, notes = capsys.readouterr().out.partition("A: real-time texture SNN")
    header = table[table.index("\nsystem") + 1 :].splitlines()[0].split()
    assert {"low", "high", "hardware"} <= set(header)
    [energy] = [
        line.split() for line in table.splitlines() if "accuracy: energy_uj  " in line and " one " in line
    ]
    assert energy[-3:] == ["one", "snn", "0"] and ["5", "-", "4", "7"] == energy[6:10]
    assert "at accuracy 0.9 ± 0.097, flat out: one 5 uJ (5 to 5), snn, trial 0; two 5 uJ (5 to 5)" in notes
    main(["report", str(folder), "--system", "A", "--format", "table"])
    header = capsys.readouterr().out.splitlines()[0].split()
    assert header[0] == "system" and not {"low", "high", "hardware"} & set(header), "only where told"


def test_chips_are_named_twice_or_more_and_exist(results, capsys):
    assert main(["report", str(results), "--hardware", "loihi1_silicon"]) == 2
    assert capsys.readouterr().err == "--hardware must name two profiles or more, got only 'loihi1_silicon'\n"
    folder = results / "nets"
    open_study(folder).points().assign(point=0).to_parquet(folder / "points.parquet")
    assert main(["report", str(folder), "--hardware", "loihi1_silicon", "--hardware", "lohi"]) == 2
    told = capsys.readouterr()
    assert told.out == "" and "lohi" in told.err and told.err.count("\n") == 1
