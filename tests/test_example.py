"""The shipped study, results/example: today's code reads it, as it was made from its search space."""

import shutil
from pathlib import Path

import dse
from tests.command import document

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "results" / "example"
MOST_BYTES = 5_600_000


def test_it_is_small():
    sizes = [
        path.stat().st_size for path in EXAMPLE.rglob("*") if path.is_file() and path.name != "page.html"
    ]
    assert 100_000 < sum(sizes) <= MOST_BYTES


def test_commands_read_it(tmp_path, monkeypatch, capsys):
    """If a format changes: make it anew, as CONTRIBUTING says."""
    shutil.copytree(EXAMPLE, tmp_path / "example")
    monkeypatch.chdir(tmp_path)

    front = document(capsys, "skyline", "example", "--draws", "5")["rows"]
    assert {row["task"] for row in front} == {"texture", "profile"}
    assert len({row["family"] for row in front}) >= 3
    (row,) = document(capsys, "pick", "example", "--budget", "family == 'snn'", "--export", "bundle")["rows"]
    assert float(str(row["accuracy"])) > 0.5 and Path("bundle/bundle.json").is_file()


def test_it_is_the_study_of_its_search_space():
    study = dse.open(EXAMPLE)
    trials = study.trials
    assert set(trials["status"]) == {"finished"}
    assert len(trials) == dse.load_space("example", {}).n_designs
    points = study.points()
    assert set(points["hardware"]) == {"mcu_m4", "loihi1_silicon", "spinnaker2"}
