"""Public recordings in their authors' layout become what the search spaces read, byte for byte."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest

from dse.cli.command_line import main
from dse.recordings import RecordingError
from dse.recordings.prepare import RECORD, SETS, prepare
from dse.store import checksum


def published(folder, n=3, *, signal=None, label=None):
    """Write files as the authors do: every number says where it is from."""
    folder.mkdir(exist_ok=True)
    where = np.arange(n * 6 * 10 * 75, dtype=np.float32).reshape(n, 6, 10, 75)
    np.save(folder / "icub_test.npy", where if signal is None else signal)
    np.save(folder / "labels_test.npy", np.arange(n)[::-1] if label is None else label)
    return folder


def test_a_taxel_is_a_place_of_the_patch_and_the_record_has_both_checksums(tmp_path, capsys):
    source = published(tmp_path / "source")
    assert main(["prepare", "icub", str(source), "--out", str(tmp_path / "data")]) == 0
    path = tmp_path / "data" / SETS["icub"].file
    assert str(path) in capsys.readouterr().out
    made = np.load(path)
    assert made["signal"].dtype == np.float32 and made["signal"].shape == (3, 75, 60)
    recording, row, column, step = 2, 4, 7, 31
    assert (
        made["signal"][recording, step, 10 * row + column]
        == ((recording * 6 + row) * 10 + column) * 75 + step
    )
    assert made["label"].tolist() == [2, 1, 0]
    record = json.loads(path.with_name(f"{path.name}{RECORD}").read_text())
    assert record["result_sha256"] == {path.name: checksum(path)}
    assert record["source_sha256"] == {name: checksum(source / name) for name in SETS["icub"].files}
    assert "none stated" in record["licence"] and "a745c42" in record["origin"]
    prepare("icub", source, tmp_path / "data")  # again: the same
    other = published(tmp_path / "other", label=[0, 0, 0])
    with pytest.raises(RecordingError, match="is another file than is made from"):
        prepare("icub", other, tmp_path / "data")


def members(archive):
    with zipfile.ZipFile(archive) as opened:
        return [(name, opened.read(name)) for name in opened.namelist()]


def test_the_recordings_of_the_search_space_are_made_byte_for_byte(shared_data, tmp_path):
    path = shared_data / SETS["icub"].file
    if not path.is_file():
        pytest.skip(f"{SETS['icub'].file} is not among the public recordings")
    shipped = np.load(path)
    patch = shipped["signal"].transpose(0, 2, 1).reshape(-1, 6, 10, 75)
    source = published(tmp_path / "source", signal=patch, label=shipped["label"].astype(np.int64))
    made = prepare("icub", source, tmp_path / "data")
    assert members(made) == members(path), "the archive's own header depends on the release of Python"


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"signal": np.zeros((3, 60, 75), np.float32)}, r"shape \(recordings, 6, 10, 75\), got float32"),
        ({"signal": np.zeros((3, 6, 10, 75), int)}, "must hold floats"),
        ({"label": [0, 1]}, "one whole number for each of 3 recordings"),
        ({"label": [0.5, 1, 2]}, "one whole number"),
        ({"label": [-1, 1, 2]}, "one whole number"),
    ],
)
def test_another_layout_is_refused_and_nothing_is_written(tmp_path, changes, text):
    with pytest.raises(RecordingError, match=text):
        prepare("icub", published(tmp_path / "source", **changes), tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_what_is_missing_unknown_or_without_a_layout_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("DSE_DATA", raising=False)
    (tmp_path / "icub_test.npy").write_bytes(b"no array")
    for arguments, text in (
        (["icub", str(tmp_path), "--out", str(tmp_path)], "has no labels_test.npy"),
        (["icubs", str(tmp_path), "--out", str(tmp_path)], "unknown set 'icubs'; known: icub, fabric_slide"),
        (["sankar", str(tmp_path), "--out", str(tmp_path)], "is not documented, so they are not converted"),
        (["icub"], "needs SOURCE"),
        (["icub", str(tmp_path)], "needs --out DIR, or DSE_DATA"),
    ):
        assert main(["prepare", *arguments]) == 2
        assert text in capsys.readouterr().err
    (tmp_path / "labels_test.npy").write_bytes(b"no array")
    assert main(["prepare", "icub", str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "icub_test.npy: is no array" in capsys.readouterr().err
    assert main(["prepare", "--json"]) == 0
    assert {row["set"] for row in json.loads(capsys.readouterr().out)["rows"]} == set(SETS)
