"""What `dse check` finds before `dse run` meets it, each fault with file and line."""

import numpy as np
import pytest

from dse.cli import main

SPACE = """\
data:
  kind: time_series
  file: touch.npz
  step_ms: 4
  offsets: offsets
  columns: {fabric: fabric, one: one}
task: {target: fabric}
window: {at: middle}
split: {stratified: {validation: 0.3}}
encoder: {kind: send_on_delta, thresholds: [0.1]}
model: {kind: snn, hidden: [8]}
"""


@pytest.fixture
def space(tmp_path):
    signal = np.random.default_rng(0).normal(size=(95, 1))
    offsets = np.append(np.arange(0, 91, 10), 95)
    labels = {"fabric": np.arange(10) % 2, "one": np.zeros(10, int)}
    np.savez(tmp_path / "touch.npz", signal=signal, offsets=offsets, **labels)
    path = tmp_path / "touch.yaml"
    path.write_text(SPACE)
    return path


@pytest.mark.parametrize(
    ("before", "after", "faults"),
    [
        ("", "", ["8: window.n_steps is required because recordings differ in length"]),
        (
            "target: fabric",
            "target: one",
            ["7: task.target must have two classes or more", "8: window.n_steps is required"],
        ),
        ("at: middle", "n_steps: 6", ["8: a window of 6 steps does not fit recording 9"]),
        (
            "validation: 0.3",
            "validation: 0.3, test: 0.3, group: one",
            ["8: window.n_steps is required", "9: split.stratified: class '0' has 1 groups of column 'one'"],
        ),
        ("fabric: fabric", "cloth: fabric", ["7: task.target: no column 'fabric' among data.columns"]),
    ],
)
def test_all_faults_have_their_lines(space, before, after, faults, capsys):
    space.write_text(SPACE.replace(before, after, 1))
    assert main(["check", str(space)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(faults)
    for line, fault in zip(lines, faults, strict=True):
        assert line.startswith(f"{space}:{fault}"), line


def test_a_network_that_no_machine_holds(space, capsys):
    space.write_text(SPACE.replace("at: middle", "n_steps: 5").replace("[8]", "[300000, 90000]"))
    assert main(["check", str(space)]) == 2
    assert (
        f"{space}:11: model: the smallest design has 27000780000 weights, and its" in capsys.readouterr().err
    )
    space.write_text(space.read_text().replace("hidden: [300000, 90000]", "hidden: {choice: [8, 300000]}"))
    assert main(["check", str(space)]) == 0  # one of the designs can be trained


def test_what_is_sound_stays_so(space, capsys):
    space.write_text(SPACE.replace("at: middle", "n_steps: 5"))
    assert main(["check", str(space)]) == 0 and capsys.readouterr().err == ""
    assert main(["check", str(space), "--set", "window.n_steps=6"]) == 2
    assert capsys.readouterr().err.startswith("--set window.n_steps: a window of 6 steps does not fit")
