"""Every table of the command line at two widths of a terminal: no line is wider, no header is broken."""

import shutil
from pathlib import Path

import pytest

from dse.cli import main
from tests.cli.test_first_hour import recordings

ROOT = Path(__file__).resolve().parents[2]
TABLES = """\
describe
describe hardware
describe hardware loihi1_silicon
describe columns
describe targets
describe data
describe encoder
describe model snn
describe figures
check touch.yaml
audit touch.yaml
skyline study
skyline study other
skyline study --where n_weights<=20000 --confidence 0.5
report study
pick study --budget energy_uj<=100
pick study --budget energy_uj<=0.001
doctor study
prepare
init touch.csv --force
""".splitlines()
FEASIBLE = (0, 3)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a folder with a study, a copy of it, and recordings with their search space."""
    folder = tmp_path_factory.mktemp("widths")
    for name in ("study", "other"):
        shutil.copytree(ROOT / "results" / "example", folder / name)
    recordings().to_csv(folder / "touch.csv", index=False)
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(folder)
        assert main(["init", "touch.csv"]) == 0
    return folder


@pytest.mark.parametrize(
    ("command", "width"),
    [(command, 40) for command in TABLES] + [(command, 80) for command in TABLES[3::7]],
)
def test_no_line_is_wider_than_the_terminal(command, width, place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    monkeypatch.setenv("COLUMNS", str(width))
    words = command.split()
    form = [] if words[0] == "init" else ["--format", "table"]
    assert main([*words, *form]) in FEASIBLE
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert lines
    # A path or a name that is longer than the terminal stays whole, on a line of its own.
    wide = [line for line in lines if len(line) > width and len(line.split()) > 1]
    assert wide == []
    assert not any("…" in line for line in lines)
