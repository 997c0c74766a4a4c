"""The folder about a paper, from studies whose every number is chosen."""

from pathlib import Path

import pandas as pd
import pytest

from dse.cli import main
from dse.study.held import plain_space
from tests.show.report.made import write

SECTIONS = {
    "data": {"kind": "time_series", "file": "ridges.npz", "step_ms": 10},
    "encoder": {"kind": "receptors", "spikes_per_step": 1},
}
WHOLE = {"design": {}, "seed": 1, "heads": {}, "data": "", "columns": {}, "hardware": {}}
NAMES = ("README.md", "compared.csv", "fig_11_ridges_texture.png", "fig_14_ridges_texture.png", "ridges")


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study of paper 004 in the working folder; images hold what they show, without a browser."""
    monkeypatch.chdir(tmp_path)
    designs = [
        {"family": "elm", "accuracy": 0.8, "accuracy_test": 0.75, "transductive": True, "train_s": 1800.0},
        {"family": "elm", "accuracy": 0.5, "accuracy_test": 0.25, "transductive": True, "train_s": 1800.0},
    ]
    write(tmp_path / "ridges", designs, SECTIONS, reason="", **WHOLE)
    trials = pd.DataFrame(designs).assign(
        trial=range(2), task="texture", status="finished", repeats=1, decision_latency_ms=1000.0
    )
    trials.to_parquet(tmp_path / "ridges" / "trials.parquet")

    def image(figure, form, **options):
        return bytes(figure.to_json(), "utf-8")

    monkeypatch.setattr("dse_papers.report.folder.static_image", image)
    return tmp_path / "ridges"


def made(*more):
    return main(["report", "ridges", "--paper", "004", "--out", "paper", "--format", "csv", *more])


def test_it_holds_the_comparison_the_figures_and_the_tables(study):
    assert made() == 0
    assert {path.name for path in Path("paper").iterdir()} >= set(NAMES)
    compared = pd.read_csv("paper/compared.csv")
    row = compared[(compared["kind"] == "result") & (compared["quantity"] == "accuracy")].iloc[0]
    assert (row["printed_value"], row["ours_value"], row["trial"]) == (0.92, 0.75, 0)
    text = Path("paper/README.md").read_text()
    [line] = [x for x in text.splitlines() if x.startswith("| IV-A | accuracy")]
    assert "| 0.92 | 0.75 |" in line
    assert "| ridges | texture | 2 | 2 | 1 |" in text  # designs, trainings, hours
    assert "](fig_11_ridges_texture.png)" in text and "Fig. 8, ridges, texture: not drawn, for" in text


def test_what_it_keeps_of_a_study_can_be_read(study, capsys):
    assert made() == 0
    kept = Path("paper/ridges")
    assert sorted(path.name for path in kept.iterdir()) == [
        *("points.parquet", "search_space.yaml", "trials.parquet")
    ]
    assert pd.read_parquet(kept / "points.parquet").equals(pd.read_parquet(study / "points.parquet"))


def test_it_names_no_folder_of_this_machine(study):
    space = study / "search_space.yaml"
    plugin = study.parent / "finger.py"
    space.write_text(f"plugins: [{plugin}]\n{space.read_text()}")
    assert made() == 0
    kept = plain_space(Path("paper/ridges/search_space.yaml"))
    assert kept.pop("plugins") == ["finger.py"]
    written = plain_space(space)
    assert written.pop("plugins") == [str(plugin)]
    assert kept == written


def test_it_replaces_no_other_folder(study, capsys):
    Path("paper").mkdir()
    Path("paper/thesis.tex").write_text("mine")
    assert made() == 2
    assert "paper: exists and is not the folder of a paper" in capsys.readouterr().err
    assert [path.name for path in Path("paper").iterdir()] == ["thesis.tex"]


def test_a_folder_is_about_a_paper(study, capsys):
    assert main(["report", "ridges", "--out", "paper"]) == 2
    assert "--out must be with --paper" in capsys.readouterr().err
    assert not Path("paper").exists()
