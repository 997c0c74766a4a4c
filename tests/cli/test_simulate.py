"""`dse simulate`: what it writes is what the simulator makes, whole or not at all; every mistake is told."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from dse.cli import main
from dse.data.recordings.events import EventFile
from dse.data.recordings.scene import COLUMNS, Trials
from dse.scene import simulate
from dse.scene.load import load_scene
from dse.show.dashboard import trial as dashboard
from tests.command import document
from tests.spaces import FINGERTIP, SPACE
from tests.waiting import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]

SCENE = FINGERTIP + "forces_n: [1.0, 1.5]\ntrials: 2\n"


@pytest.fixture
def scene(tmp_path):
    """A scene of 16 short trials of a tip with 7 pins: trials 0 to 7 on denim, 8 to 15 on satin."""
    path = tmp_path / "fingertip.yaml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def test_the_file_holds_what_the_simulator_makes(scene, tmp_path, capsys):
    out = tmp_path / "touch.npz"
    note = document(capsys, "simulate", scene, "--out", out, "--trials", "3:11", "--quiet")["notes"][-1]
    section = yaml.safe_load(note[note.index("data: ") :])["data"]
    assert section.pop("kind") == "events"
    found = EventFile(**section).read(tmp_path / "elsewhere")
    loaded = load_scene(scene)
    labels = Trials(loaded).columns
    assert found.n_recordings == 8
    for i, k in enumerate(range(3, 11)):
        made, (read,) = simulate.events(loaded, k), found.blocks(i)
        assert len(made.t_us) > 100
        for name in ("t_us", "x", "y", "polarity"):
            assert np.array_equal(getattr(made, name), getattr(read, name))
        assert [found.columns[name][i] for name in COLUMNS] == [labels[name][k] for name in COLUMNS]
    assert found.columns["texture"].tolist() == ["denim"] * 5 + ["satin"] * 3
    assert found.columns["speed_mm_s"].tolist() == [20.0] + [50.0] * 4 + [20.0] * 3


def test_one_row_per_texture(scene, tmp_path, capsys):
    out = tmp_path / "touch.npz"
    found = document(capsys, "simulate", scene, "--out", out, "--trials", "6:9", "--quiet")
    assert found["schema"] == "dse/simulate/1"
    made = [simulate.simulated(load_scene(scene), k) for k in (6, 7, 8)]
    for row, mine in zip(found["rows"], (made[:2], made[2:]), strict=True):
        n_events = sum(len(block.t_us) for block, _ in mine)
        assert row["events"] == n_events
        assert row["touch_s"] == pytest.approx(0.15 * len(mine))
        assert row["million_events_per_s"] == pytest.approx(n_events / row["touch_s"] / 1e6)
        assert row["refractory_drops"] == sum(flags.refractory_drops for _, flags in mine)
        assert row["x_real_time"] > 0
    assert [(row["texture"], row["trials"]) for row in found["rows"]] == [("denim", 2), ("satin", 1)]


def test_flags_are_counted(scene, tmp_path, capsys):
    out = "--out", tmp_path / "touch.npz", "--trials", ":4", "--quiet"
    (row,) = document(capsys, "simulate", scene, *out, "--set", "forces_n=[1.0, 40.0]")["rows"]
    assert row["contact_saturated"] == 2


def test_jobs_change_no_byte(scene, tmp_path):
    files = []
    for jobs in ("1", "3"):
        files.append(tmp_path / f"jobs{jobs}.npz")
        arguments = ["simulate", str(scene), "--out", str(files[-1]), "--jobs", jobs, "--quiet"]
        assert main(arguments) == 0
    assert files[0].read_bytes() == files[1].read_bytes()


def test_progress_is_on_stderr(scene, tmp_path, capsys):
    out = tmp_path / "touch.npz"
    assert main(["simulate", str(scene), "--out", str(out), "--trials", ":2", "--format", "table"]) == 0
    captured = capsys.readouterr()
    assert [line.split(",")[0] for line in captured.err.splitlines()] == [
        "1/2 trial 0: denim",
        "2/2 trial 1: denim",
    ]
    assert captured.out.split()[0] == "texture"


def test_the_pasted_section_is_a_search_space(scene, tmp_path, capsys):
    out = tmp_path / "touch.npz"
    note = document(capsys, "simulate", scene, "--out", out, "--quiet")["notes"][-1]
    head, rest = SPACE.split("data:\n")
    _, tail = rest.split("task: {target: fabric}\n")
    tail = tail.replace("encoder: {kind: send_on_delta, thresholds: {choice: [[1, 2], [1, 2, 4]]}}\n", "")
    steps = "task: {target: texture}\npreprocessing: {bin_ms: 5, pool: 8, stride: 8}\n"
    space = tmp_path / "space.yaml"
    space.write_text(f"{head}{note[note.index('data: ') :]}\n{steps}{tail}", encoding="utf-8")
    (row,) = document(capsys, "check", space)["rows"]
    assert row["classes"] == ["denim", "satin"]


def test_warnings_of_the_scene_are_notes(scene, tmp_path, capsys):
    page = str(tmp_path / "page.html")
    blind = ["--set", "camera.threshold=3", "--set", "camera.noise_hz=0"]
    found = document(capsys, "simulate", scene, "--figure", page, *blind, "--quiet")
    assert found["rows"][0]["events"] == 0
    assert found["notes"][0].startswith("no pixel can send an event")
    out = "--out", tmp_path / "touch.npz", *blind, "--trials", ":3", "--quiet"
    assert "3 of 3 trials sent no event" in document(capsys, "simulate", scene, *out)["notes"][1]


def test_the_page_shows_the_trial_that_is_asked_for(scene, tmp_path, capsys, monkeypatch):
    shown = []
    monkeypatch.setattr(dashboard, "write_trial_page", lambda view, path: shown.append(view) or path)
    page = ["--figure", str(tmp_path / "page.html"), "--quiet"]
    (row,) = document(capsys, "simulate", scene, *page, "--trial", "9")["rows"]
    assert (row["texture"], row["trials"]) == ("satin", 1)
    assert main(["simulate", str(scene), *page, "--trials", "4:6", "--out", str(tmp_path / "t.npz")]) == 0
    assert [view.name for view in shown] == [
        "fingertip, trial 9: satin, constant_20, 1 N, repetition 1",
        "fingertip, trial 4: denim, constant_50, 1 N, repetition 0",
    ]
    assert len(np.load(tmp_path / "t.npz")["offsets"]) == 3
    loaded = load_scene(scene)
    view, block = shown[0], simulate.events(loaded, 9)
    assert view.n_events == len(block.t_us)
    # 0.15 s at the physics' 0.1 ms are 1500 steps; every second one is a moment, so none is left over.
    assert view.raster.sum() == len(block.t_us)
    assert view.px.shape == (751, 7, 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "needs --out FILE.npz, --figure PAGE.html, or both"),
        (["--out", "{folder}/touch.h5"], "--out {folder}/touch.h5: must end in .npz"),
        (["--out", "{folder}/is.npz"], "must be a file, got a folder"),
        (["--out", "{folder}/no/touch.npz"], "must be in a folder that exists, got '{folder}/no'"),
        (["--figure", "{folder}/page.png"], "--figure {folder}/page.png: must end in .html"),
        (["--out", "{folder}/t.npz", "--trials", "3:2"], "--trials 3:2: must be FIRST:END with 0 <= FIRST <"),
        (["--out", "{folder}/t.npz", "--trials", "0:17"], "END <= 16, the trials of the scene"),
        (["--out", "{folder}/t.npz", "--trials", "4"], "--trials 4: must be FIRST:END"),
        (["--out", "{folder}/t.npz", "--trials=-1:2"], "--trials -1:2: must be FIRST:END"),
        (["--out", "{folder}/t.npz", "--trials", "a:b"], "--trials a:b: must be FIRST:END"),
        (["--out", "{folder}/t.npz", "--trial", "1"], "--trial 1: needs --figure"),
        (["--figure", "{folder}/p.html", "--trial", "16"], "--trial 16: must be one of the trials 0 to 15"),
        (["--figure", "{folder}/p.html", "--trial", "x"], "--trial x: must be one of the trials 0 to 15"),
        (["--out", "{folder}/t.npz", "--set", "trials"], "--set trials: must be KEY=VALUE"),
        (["--out", "{folder}/t.npz", "--set", "trials=0"], "trials must be >= 1, got 0"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(scene, tmp_path, capsys, arguments, message):
    (tmp_path / "is.npz").mkdir()
    before = sorted(tmp_path.iterdir())
    given = [argument.format(folder=tmp_path) for argument in arguments]
    assert main(["simulate", str(scene), *given]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert message.format(folder=tmp_path) in captured.err
    assert sorted(tmp_path.iterdir()) == before


def test_every_fault_is_told_at_once(scene, tmp_path, capsys):
    arguments = ["--out", str(tmp_path / "t"), "--figure", str(tmp_path), "--trials", "9:9"]
    assert main(["simulate", str(scene), *arguments]) == 2
    assert [line.split()[0] for line in capsys.readouterr().err.splitlines()] == [
        "--out",
        "--figure",
        "--trials",
    ]


def test_an_unknown_scene(capsys):
    assert main(["simulate", "quickstrat", "--out", "t.npz"]) == 2
    assert "Did you mean 'quickstart'?" in capsys.readouterr().err


def test_a_page_that_cannot_be_written(scene, tmp_path, capsys, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(dashboard, "write_trial_page", full)
    page = str(tmp_path / "page.html")
    assert main(["simulate", str(scene), "--figure", page, "--quiet"]) == 2
    assert capsys.readouterr().err == f"--figure {page}: cannot be written: No space left on device\n"


def start(arguments):
    code = f"import sys; from dse.cli import main; sys.exit(main({['simulate', *arguments]!r}))"
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_stopped_half_way_leaves_what_was_there(scene, tmp_path, how):
    folder = tmp_path / "out"
    folder.mkdir()
    out = folder / "touch.npz"
    out.write_bytes(b"an older file")
    with start([str(scene), "--out", str(out), "--set", "trials=5000"]) as process:
        while not process.stderr.readline().startswith("5/"):
            assert process.poll() is None
        process.send_signal(how)
        stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert stdout == ""
    assert out.read_bytes() == b"an older file"
    assert list(folder.iterdir()) == [out]
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert stderr.splitlines()[-1] == "stopped; no incomplete file was written"
    else:
        assert process.returncode == -how


def test_a_full_disk_is_one_sentence(scene, tmp_path, capsys):
    resource = pytest.importorskip("resource")
    folder = tmp_path / "out"
    folder.mkdir()
    path = folder / "touch.npz"
    arguments = ["simulate", str(scene), "--out", str(path), "--quiet"]
    assert main([*arguments, "--trials", ":1"]) == 0  # compiled code is kept in files of its own
    before = path.read_bytes()
    capsys.readouterr()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        assert main(arguments) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == f"{path}: cannot be written: File too large; no partial file remains\n"
    assert list(folder.iterdir()) == [path]
    assert path.read_bytes() == before
