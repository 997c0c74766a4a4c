"""From a folder of event files to a trained classifier, and what `--repair` changes on the way."""

import json

import numpy as np
import pytest

from dse.cli import main
from tests.command import document

SPACE = """\
study: folders
seed: 1
data:
  kind: event_files
  folder: touches
  pattern: "**/*.tact"
  label_from: folder
  columns: {cloth: folder, part: folder2}
task: {target: cloth}
window: {n_steps: 20, at: start}
split:
  train: {part: [train]}
  validation: {part: [held]}
preprocessing: {bin_ms: 10, pool: 4}
model: {kind: snn, hidden: 8}
training: {epochs: 2, batch_size: 4}
objectives: [accuracy:max, n_weights:min]
"""


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


def write(folder):
    """Two cloths, each moving other taxels; six recordings of each to learn from and two to answer on."""
    rng = np.random.default_rng(0)
    for part, n in (("train", 6), ("held", 2)):
        for cloth, first in (("silk", 1), ("wool", 41)):
            place = folder / "touches" / part / cloth
            place.mkdir(parents=True)
            for k in range(n):
                t_s = 1_600_000_000 + np.append(0, np.sort(rng.uniform(0, 0.25, 300)))
                t_s[-1] = t_s[0] + 0.25
                lines = zip(rng.integers(0, 2, 301), rng.integers(first, first + 12, 301), t_s, strict=True)
                (place / f"{k}.tact").write_text("".join(f"{p} {x} {t:.6f}\n" for p, x, t in lines))
    path = folder / "folders.yaml"
    path.write_text(SPACE, encoding="utf-8")
    return path


@pytest.fixture
def space(tmp_path):
    return write(tmp_path)


def damage(space):
    with (space.parent / "touches" / "train" / "wool" / "3.tact").open("a") as file:
        file.write("0 99 1600000000.26\n0 41\n")
    (space.parent / "touches" / "train" / "silk" / "5.tact").write_bytes(b"")


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A search space whose study is finished."""
    space = write(tmp_path_factory.mktemp("trained"))
    assert main(["run", str(space), "--results", str(space.parent / "results"), "--quiet", "--json"]) == 0
    return space


def test_a_folder_of_events_is_trained_on(trained, capsys):
    capsys.readouterr()
    (row,) = document(capsys, "check", trained)["rows"]
    assert (row["train"], row["validation"], row["classes"]) == (12, 4, ["silk", "wool"])
    assert row["data"] == str(trained.parent / "touches")
    assert main(["run", str(trained), "--results", str(trained.parent / "results"), "--json", "--quiet"]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    found = json.loads(captured.out)
    assert max(row["accuracy"] for row in found["rows"]) == 1
    assert not [note for note in found["notes"] if "--repair" in note]


def test_a_damaged_file_stops_the_run_and_repair_goes_on(space, capsys):
    damage(space)
    arguments = [str(space), "--results", str(space.parent / "results"), "--json", "--quiet"]
    assert main(["check", str(space)]) == 0  # no header shows it
    capsys.readouterr()
    assert main(["run", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.splitlines()) == 1
    assert captured.err.startswith(("train/silk/5.tact: must have events", "train/wool/3.tact: "))
    assert "; --repair " in captured.err
    assert main(["run", *arguments, "--repair"]) == 0
    found = json.loads(capsys.readouterr().out)
    notes = [note for note in found["notes"] if "--repair" in note]
    assert len(notes) == 3
    assert any("train/silk/5.tact: must have events, got none; --repair skips the file" in x for x in notes)
    assert any("train/wool/3.tact: event 301 must have its (x, y) within the frame" in x for x in notes)
    assert any("train/wool/3.tact: line 303 must be a sign" in x for x in notes)
    assert max(row["accuracy"] for row in found["rows"]) == 1


def test_check_names_headers_that_are_wrong(space, capsys):
    (space.parent / "touches" / "train" / "silk" / "9.mat").write_bytes(b"MATLAB 5.0 MAT-file, and no more")
    everything = ["--set", "data.pattern='**/*'"]
    assert main(["check", str(space), *everything]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.splitlines()) == 1
    assert "train/silk/9.mat: must be a MATLAB v5 file" in captured.err
    assert captured.err.endswith("--repair skips the file\n")
    (row,) = document(capsys, "check", space, *everything, "--repair")["rows"]
    assert row["train"] == 12
    (note,) = row["repairs"]
    assert note.startswith("train/silk/9.mat: must be a MATLAB v5 file")


def test_repair_of_data_that_have_no_such_key(space, capsys):
    space.write_text(SPACE.replace("event_files", "events"), encoding="utf-8")
    assert main(["check", str(space), "--repair"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert any(line.startswith("--set data.repair: unknown key 'data.repair'; known: ") for line in lines)


def test_new_recordings_are_repaired_too(trained, tmp_path, capsys):
    new = write(tmp_path).parent / "touches" / "held"
    study, bundle = trained.parent / "results" / "folders", tmp_path / "bundle"
    assert main(["pick", str(study), "--budget", "accuracy>=0.5", "--export", str(bundle), "--json"]) == 0
    (new / "wool" / "5.tact").write_text("about\n0 41 1.5\n0 44 1.8\n")
    capsys.readouterr()
    arguments = ["evaluate", str(bundle), "--data", str(new), "--json"]
    assert main(arguments) == 2
    assert capsys.readouterr().err.startswith("wool/5.tact: line 1 must be a sign")
    assert main([*arguments, "--repair"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["rows"][0]["recordings"] == found["rows"][0]["labelled"] == 5
    assert found["notes"][-1].startswith("warning: wool/5.tact: line 1 must be a sign")
    assert (
        document(capsys, "evaluate", bundle, "--data", new / "wool" / "0.tact")["rows"][0]["recordings"] == 1
    )
