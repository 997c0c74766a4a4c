"""Targets of a bundle: written and run, stamped, run again elsewhere; what drifts is said."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import dse
from dse import store
from dse.base.records import Parameters
from dse.cli import main
from dse.data.recordings import RecordingError
from dse.deploy import bundle
from dse.deploy.bundle import BundleError
from dse.deploy.c import replay
from dse.deploy.verdict import Verdict
from dse.deploy.verify import Verified, export_targets, verify
from dse.testing.targets import small_bundle, small_recordings
from tests.command import document
from tests.deploy import bundles
from tests.plugins import arrays_target, with_targets
from tests.spaces import RASTER, sections


@pytest.fixture(autouse=True)
def targets(monkeypatch):
    with_targets.load(monkeypatch)


@pytest.fixture
def folder(tmp_path):
    bundle.write(small_bundle(recurrent=True, delays=(0, 2)), tmp_path / "bundle")
    return tmp_path / "bundle"


@pytest.fixture
def touch(tmp_path):
    return small_recordings(tmp_path / "touch.npz")


def content(folder):
    return {str(x.relative_to(folder)): x.read_bytes() for x in folder.rglob("*") if x.is_file()}


def other_weights(folder):
    """Put another net's weights into the target of a bundle, with checksums that agree."""
    path = folder / "targets" / "arrays" / "network.npz"
    arrays = store.load_arrays(path)
    store.save_arrays(path, arrays | {"0/weight": -arrays["0/weight"]})
    bundles.document(**{"files__targets/arrays/network.npz": store.checksum(path)})(folder)


def test_targets_are_written_run_and_stamped(folder, touch):
    before = content(folder)
    verified = export_targets(folder, ["arrays"], touch)
    verdict = verified["arrays"].verdict
    assert (verdict.kind, verdict.n_recordings, verdict.recordings) == ("faithful", 5, "touch.npz")
    assert verified["arrays"].before is None
    read = bundle.read(folder)
    assert read.targets == {"arrays": verdict}
    assert set(content(folder)) == {*before, "targets/arrays/network.npz"}
    assert content(folder)["weights.npz"] == before["weights.npz"]
    readme = (folder / "README.md").read_text()
    assert "**faithful (numpy)**; all decisions and spikes of 5 recordings (touch.npz)" in readme
    assert "`dse verify THIS_FOLDER --data RECORDINGS`" in readme and "targets/arrays/network.npz" in readme


def test_targets_that_were_written_stay_and_so_do_files_of_others(folder, touch):
    (folder / "notes.txt").write_text("mine")
    export_targets(folder, ["arrays"], touch)
    export_targets(folder, ["unread"])
    read = bundle.read(folder)
    assert [(name, x.kind) for name, x in read.targets.items()] == [
        ("arrays", "faithful"),
        ("unread", "not verified"),
    ]
    assert read.targets["unread"].reason == "no recordings were given to run it on"
    assert (folder / "notes.txt").read_text() == "mine"
    assert verify(folder, touch, ["arrays"])["arrays"].verdict.kind == "faithful"


def test_programs_that_users_compile_beside_a_target_stay_and_are_not_used(folder, touch):
    export_targets(folder, ["arrays"], touch)
    program = folder / "targets" / "arrays" / "build" / "touch"
    program.parent.mkdir()
    program.write_bytes(b"compiled")
    assert verify(folder, touch)["arrays"].verdict.kind == "faithful"
    for name in ("unread", "arrays"):
        export_targets(folder, [name], touch)
        assert bundle.read(folder).targets["arrays"].kind == "faithful"
        assert program.read_bytes() == b"compiled"
    assert "touch" not in "".join(json.loads((folder / "bundle.json").read_text())["files"])


def test_a_target_that_refuses_is_unsupported_and_has_no_files(tmp_path, touch):
    made = small_bundle()
    knn = sections({**RASTER, "model": {"kind": "knn"}})
    fitted = Parameters({"counts": np.zeros((2, 3, 6), np.int32), "target": np.arange(2)}, 6)
    other = bundle.Bundle(fitted, knn, made.classes, None, None, {}, {})
    bundle.write(other, tmp_path / "b")
    verified = export_targets(tmp_path / "b", ["arrays"])
    assert verified["arrays"].verdict == Verdict("unsupported", "arrays hold a network, and this is none")
    assert not (tmp_path / "b" / "targets").exists()
    assert bundle.read(tmp_path / "b").targets["arrays"].kind == "unsupported"
    with pytest.raises(BundleError, match=r"b: it has no targets; `dse export` writes them"):
        verify(tmp_path / "b", touch)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["array"], "unknown target 'array'; known: .* Did you mean 'arrays'"),
        (["arrays", "locked"], r"target locked: no key is installed; pip install 'dse-spiking\[key\]'"),
        (["stubborn"], "target stubborn: the disk is full"),
        (["stubborn", "locked"], "(?s)target stubborn: .*\ntarget locked: "),
    ],
)
def test_what_cannot_be_done_changes_nothing(folder, touch, names, message):
    export_targets(folder, ["arrays"], touch)
    before = content(folder)
    with pytest.raises(BundleError, match=message):
        export_targets(folder, names, touch)
    assert content(folder) == before
    assert sorted(x.name for x in folder.parent.iterdir()) == ["bundle", "touch.npz"]


def test_recordings_of_another_sensor_are_refused(folder, tmp_path):
    before = content(folder)
    np.savez(tmp_path / "other.npz", spikes=np.zeros((2, 24, 5), np.uint8))
    with pytest.raises(BundleError, match=r"other\.npz: must have 6 input channels .*, got 5"):
        export_targets(folder, ["arrays"], tmp_path / "other.npz")
    with pytest.raises(RecordingError, match=r"none\.npz"):
        export_targets(folder, ["arrays"], tmp_path / "none.npz")
    assert content(folder) == before


def test_verifying_repeats_the_run_and_changes_nothing(folder, touch, capsys):
    export_targets(folder, ["arrays"], touch)
    before = content(folder)
    printed = document(capsys, "verify", folder, "--data", touch)
    [row] = printed["rows"]
    assert (row["target"], row["verdict"], row["before"], row["recordings"]) == (
        "arrays",
        "faithful",
        "faithful",
        5,
    )
    assert (row["run_by"], row["output_f1"]) == ("numpy", 1)
    assert row["flash_bytes"] > 0 and printed["schema"] == "dse/verify/1" and printed["notes"] == []
    assert content(folder) == before


def test_drift_is_exit_code_4(folder, touch, monkeypatch, capsys):
    assert (
        document(capsys, "export", folder, "--target", "arrays", "--verify", touch)["rows"][0]["verdict"]
        == "faithful"
    )
    fired = arrays_target._fired
    monkeypatch.setattr(arrays_target, "_fired", lambda *of: [~x for x in fired(*of)])
    for _ in range(2):
        printed = document(capsys, "verify", folder, "--data", touch, code=4)
        assert printed["rows"][0]["verdict"] == "approximate" and printed["rows"][0]["spikes_differ"] > 0
        assert printed["notes"][0].startswith("target arrays was faithful and is approximate: ")


def test_files_that_are_not_those_of_the_weights_are_named_and_not_run(folder, touch, monkeypatch, capsys):
    export_targets(folder, ["arrays"], touch)
    other_weights(folder)
    monkeypatch.setattr(arrays_target, "_fired", lambda *_: pytest.fail("it was run"))
    [row] = document(capsys, "verify", folder, "--data", touch, code=2)["rows"]
    assert (row["verdict"], row["before"]) == ("not verified", "faithful")
    assert row["reason"].startswith("network.npz is not what dse ") and "`dse export`" in row["reason"]


@pytest.mark.parametrize(
    ("before", "now", "drifts"),
    [
        ("faithful", "faithful", False),
        ("faithful", "equivalent", True),
        ("equivalent", "faithful", False),
        ("equivalent", "equivalent", False),
        ("equivalent", "approximate", True),
        ("faithful", "unsupported", True),
        ("equivalent", "not verified", False),
        ("approximate", "unsupported", False),
    ],
)
def test_less_than_before_is_drift(before, now, drifts):
    assert Verified(Verdict(now), Verdict(before)).drifts is drifts
    assert not Verified(Verdict(now), None).drifts


def test_bundles_without_the_newer_words_are_read(folder, touch):
    export_targets(folder, ["arrays"], touch)
    newer = ("run_by", "output_f1", "compiler")
    bundles.document(**{f"targets__arrays__{name}": None for name in newer})(folder)
    verdict = bundle.read(folder).targets["arrays"]
    found = verdict.kind, verdict.run_by, verdict.output_f1, verdict.compiler
    assert found == ("faithful", (), None, "")


def test_what_cannot_be_run_here_is_exit_code_2(folder, touch, capsys):
    export_targets(folder, ["arrays", "unread"], touch)
    assert bundle.read(folder).targets["unread"] == Verdict("not verified", "no reader is installed")
    rows = document(capsys, "verify", folder, "--data", touch, code=2)["rows"]
    assert [(x["target"], x["verdict"], x["recordings"]) for x in rows] == [
        ("arrays", "faithful", 5),
        ("unread", "not verified", None),
    ]
    export_targets(folder, ["locked"])
    assert main(["verify", str(folder), "--data", str(touch)]) == 2
    assert capsys.readouterr().err == "target locked: no key is installed; pip install 'dse-spiking[key]'\n"
    assert main(["verify", str(folder), "--data", str(touch), "--target", "c64"]) == 2
    assert "has no target 'c64'; it has the targets arrays, unread, locked" in capsys.readouterr().err


def test_targets_are_described(capsys):
    assert main(["describe", "targets"]) == 0
    assert "arrays of numpy: The network's arrays in one file." in capsys.readouterr().out
    assert main(["describe", "targets", "arrays", "--format", "table"]) == 0
    assert "use: numpy.load('targets/arrays/network.npz')" in capsys.readouterr().out


def test_python_has_the_same_doors(folder, touch):
    export_targets(folder, ["arrays"], touch)
    [again] = dse.verify(folder, touch).values()
    assert again.verdict == again.before and not again.drifts


def test_a_pick_is_exported_with_its_targets(tmp_path, capsys):
    from tests import tiny_study

    tiny_study.write_recordings(tmp_path / "tiny.npz")
    (tmp_path / "real.yaml").write_text(tiny_study.REAL.replace("repeats: 2", "repeats: 1"))
    results = str(tmp_path / "results")
    assert main(["run", str(tmp_path / "real.yaml"), "--results", results, "--quiet", "--json"]) == 0
    capsys.readouterr()
    study, out = f"{results}/real", str(tmp_path / "bundle")
    verifying = ["--verify", str(tmp_path / "tiny.npz")]
    assert main(["pick", study, "--export", out, "--target", "locked", *verifying]) == 2
    assert not Path(out).exists()
    capsys.readouterr()
    printed = document(capsys, "pick", study, "--export", out, "--target", "arrays", *verifying)
    [row] = printed["sections"]["targets"]["rows"]
    assert (row["target"], row["verdict"], row["recordings"]) == ("arrays", "faithful", 36)
    assert bundle.read(out).targets["arrays"].kind == "faithful"
    for wrong, message in (
        (["--target", "arrays", *verifying], "--verify needs --target NAME, .*, and --export DIR"),
        (["--export", out, *verifying], "--verify needs --target NAME"),
    ):
        assert main(["pick", study, *wrong]) == 2
        assert re.search(message, capsys.readouterr().err)


def test_a_program_that_says_nothing_has_answered_nothing():
    played = replay.parsed(np.zeros(0, np.int32))
    assert played.spikes.shape == (0, 4) and played.label.shape == played.steps.shape == (0,)
