"""Public recordings in their authors' layout become what the search spaces read, byte for byte."""

import hashlib
import json
import sys
import zipfile

import numpy as np
import pandas as pd
import pytest

from dse.cli.command_line import main
from dse.data.recordings import RecordingError
from dse.data.recordings.prepare import CARD, digest, prepare, sets
from dse.store import checksum
from tests.command import document

FIGURES = "Raw Texture data/Rigid prosthetic finger raw texture data"
COLUMNS = "timestamp, proximity1, proximity2, " + ", ".join(f"channel{i}" for i in range(1, 17))


def icub(folder, n=3, *, signal=None, label=None):
    """Write files as the authors do: every number says where it is from."""
    folder.mkdir(exist_ok=True)
    where = np.arange(n * 6 * 10 * 75, dtype=np.float32).reshape(n, 6, 10, 75)
    np.save(folder / "icub_test.npy", where if signal is None else signal)
    np.save(folder / "labels_test.npy", np.arange(n)[::-1] if label is None else label)
    return folder


def slide(folder, name, start, signal, proximity=7, header=COLUMNS):
    """Write a recording as the finger's logger does."""
    folder.mkdir(parents=True, exist_ok=True)
    times = start if np.ndim(start) else start + 28 * np.arange(len(signal))
    near = np.broadcast_to(proximity, len(signal))
    rows = np.column_stack([times, near, np.full(len(signal), 50000), signal])
    with (folder / name).open("w") as file:
        file.write(f"{header}\n")
        pd.DataFrame(rows.astype(int)).to_csv(file, header=False, index=False)


def grasp(folder, part, number, label, spikes):
    """Write a grasp."""
    (folder / "Ev-Objects" / part).mkdir(parents=True, exist_ok=True)
    np.save(folder / "Ev-Objects" / part / f"{number}_label_{label}.npy", spikes)


def draws(folder, spikes, labels, members):
    """Write ten draws of a pool as PyTorch's data sets."""
    torch = pytest.importorskip("torch")
    folder.mkdir(parents=True, exist_ok=True)
    for draw, held in enumerate(members.T):
        tensors = torch.tensor(spikes[held]).float(), torch.tensor(labels[held]).long()
        torch.save(torch.utils.data.TensorDataset(*tensors), folder / f"ds_val_{draw}.pt")
    return folder


def figures(folder, names, adc):
    """Write a figure per texture: axes of nine lines, among other things of a figure."""
    from scipy.io import savemat

    inside = folder / FIGURES
    inside.mkdir(parents=True)
    for name, counts in zip(names, adc, strict=True):
        volts = np.where(counts < 0, np.nan, counts * 5 / 1024)
        children = [
            {"type": "graph2d.lineseries", "properties": {"YData": line[None]}, "children": []}
            for line in volts.T
        ]
        text = {"type": "text", "properties": {"String": "time"}, "children": []}
        axes = {"type": "axes", "properties": {"XLim": [0.0, 1.0]}, "children": [*children, text]}
        figure = {"type": "figure", "properties": {"Name": ""}, "children": [axes]}
        with (inside / f"{name}_50_Bionic_touch_figure.fig").open("wb") as file:
            savemat(file, {"hgS_070000": figure})
    return folder


def _first_bits(sample):
    return int.from_bytes(hashlib.sha256(sample.tobytes()).digest()[:4], "big")


def members(archive):
    with zipfile.ZipFile(archive) as opened:
        return [(name, opened.read(name)) for name in opened.namelist()]


def shipped(shared_data, name):
    """The set among the public recordings, and its path."""
    path = shared_data / sets()[name].file
    if not path.is_file():
        pytest.skip(f"{sets()[name].file} is not among the public recordings")
    return np.load(path), path


def made_from(name, source, tmp_path):
    """Convert; return the path that search spaces read, and assert that it is as in the published results."""
    path, published = next(iter(prepare(name, source, tmp_path / "data").items()))
    assert published and path == tmp_path / "data" / sets()[name].file
    return path


def test_a_taxel_is_a_place_of_the_patch_and_its_card_has_all_checksums(tmp_path, capsys):
    source = icub(tmp_path / "source")
    assert main(["prepare", "icub", str(source), "--out", str(tmp_path / "data")]) == 0
    path = tmp_path / "data" / sets()["icub"].file
    out = capsys.readouterr().out
    assert str(path) in out and "no, other recordings" in out
    made = np.load(path)
    assert made["signal"].dtype == np.float32 and made["signal"].shape == (3, 75, 60)
    recording, row, column, step = 2, 4, 7, 31
    assert (
        made["signal"][recording, step, 10 * row + column]
        == ((recording * 6 + row) * 10 + column) * 75 + step
    )
    assert made["label"].tolist() == [2, 1, 0]
    card = json.loads(path.with_name(f"{path.name}{CARD}").read_text())
    names = (path, source / "icub_test.npy", source / "labels_test.npy")
    assert {x["@id"]: x["sha256"] for x in card["distribution"]} == {x.name: checksum(x) for x in names}
    assert card["sameAsPublishedResults"] is False
    assert "none stated" in card["license"] and "a745c42" in card["isBasedOn"]
    shapes = {x["name"]: (x["dataType"], x["arrayShape"]) for x in card["recordSet"][0]["field"]}
    assert shapes == {
        "signal": ("sc:Float", "3,75,60"),
        "label": ("sc:Integer", "3"),
    }
    prepare("icub", source, tmp_path / "data")  # again: the same
    other = icub(tmp_path / "other", label=[0, 0, 0])
    with pytest.raises(RecordingError, match="is another file than is made from"):
        prepare("icub", other, tmp_path / "data")


def test_icub_is_made_byte_for_byte(shared_data, tmp_path):
    known, path = shipped(shared_data, "icub")
    patch = known["signal"].transpose(0, 2, 1).reshape(-1, 6, 10, 75)
    source = icub(tmp_path / "source", signal=patch, label=known["label"].astype(np.int64))
    made = made_from("icub", source, tmp_path)
    assert members(made) == members(path), "the archive's own header depends on the release of Python"


def test_slides_are_ordered_by_what_their_names_say_and_the_third_repetition_stays_apart(tmp_path):
    slides, board = tmp_path / "data" / "fabric", tmp_path / "data" / "board"
    for number, name in enumerate(
        ("Denim_F120_V-20mmps_1", "Denim_F120_V-100mmps_0", "Canvas_F90_V10mmps_0", "Denim_F120_V-20mmps_2")
    ):
        slide(slides, f"{name}.csv", 1000 * number, np.full((number + 1, 16), number) + np.arange(16))
    (slides / "zero-calibration.csv").write_text("not a slide\n")
    slide(board, "Board2mm_F150_V-5mmps_0.csv", 5, np.ones((2, 16)), proximity=[8, 9])
    written = prepare("fabric_slide", tmp_path, tmp_path / "out")
    assert [(path.name, published) for path, published in written.items()] == [
        ("fabric_slide_train_val.npz", False),
        ("fabric_slide_test.npz", None),
        ("gratings_board.npz", None),
    ]
    made, rest, gratings = map(np.load, written)
    assert made["class_names"].tolist() == ["Canvas", "Denim"] and made["label"].tolist() == [0, 1, 1]
    assert made["velocity_mm_s"].tolist() == [10, -100, -20] and made["force_setting"].tolist() == [
        90,
        120,
        120,
    ]
    assert made["repetition"].tolist() == [0, 0, 1] and made["offsets"].tolist() == [0, 3, 5, 6]
    assert made["start_timestamp_ms"].tolist() == [2000, 1000, 0]
    assert made["t_ms"].tolist() == [0, 28, 56, 0, 28, 0]
    assert made["signal"].dtype == np.uint16 and made["signal"][:, 2].tolist() == [4, 4, 4, 3, 3, 2]
    assert rest["repetition"].tolist() == [2] and rest["offsets"].tolist() == [0, 4]
    assert gratings["proximity1"].tolist() == [8, 9] and gratings["class_names"].tolist() == ["Board2mm"]


def test_fabrics_and_gratings_are_made_byte_for_byte(shared_data, tmp_path):
    for folder, name in (("fabric", "fabric_slide_train_val"), ("board", "gratings_board")):
        path = shared_data / "fabric_slide" / f"{name}.npz"
        if not path.is_file():
            pytest.skip(f"{path.name} is not among the public recordings")
        known = dict(np.load(path))
        for i, start in enumerate(known["start_timestamp_ms"]):
            part = slice(*known["offsets"][i : i + 2])
            words = known["class_names"][known["label"][i]], known["force_setting"][i]
            title = f"{words[0]}_F{words[1]}_V{known['velocity_mm_s'][i]}mmps_{known['repetition'][i]}.csv"
            times, near = start + known["t_ms"][part].astype(np.int64), known["proximity1"][part]
            slide(tmp_path / "data" / folder, title, times, known["signal"][part], near)
    made = sets()["fabric_slide"].convert(tmp_path).parts
    assert digest(made["fabric_slide_train_val.npz"]) == sets()["fabric_slide"].digest
    for name, arrays in made.items():  # types, shapes, order and numbers are all that the archive holds
        known = np.load(shared_data / "fabric_slide" / name)
        assert digest(arrays) == digest({key: known[key] for key in known.files})


def test_grasps_are_ordered_by_number_in_both_parts(tmp_path):
    spikes = np.zeros((39, 2, 250))
    for part, number, label in (("train", 10, 3), ("train", 2, 5), ("test", 0, 35)):
        spikes[number, 1, 9] = 1
        grasp(tmp_path, part, number, label, spikes)
    (path,) = prepare("evtouch", tmp_path / "Ev-Objects", tmp_path / "out")  # either folder
    made = np.load(path)
    assert made["split"].tolist() == ["train", "train", "test"] and made["label"].tolist() == [5, 3, 35]
    assert made["source_index"].tolist() == [2, 10, 0] and made["shape"].tolist() == [3, 39, 2, 250]
    unpacked = np.unpackbits(made["spikes_packed"], axis=-1)[..., :250]
    assert unpacked.sum(axis=(1, 2, 3)).tolist() == [2, 1, 3] and unpacked[1, 10, 1, 9] == 1


def test_grasps_are_made_byte_for_byte(shared_data, tmp_path):
    known, path = shipped(shared_data, "evtouch")
    spikes = np.unpackbits(known["spikes_packed"], axis=-1)[..., :250]
    for row in zip(known["split"], known["source_index"], known["label"], spikes, strict=True):
        grasp(tmp_path, *row)
    assert members(made_from("evtouch", tmp_path, tmp_path)) == members(path)


def test_a_letter_of_several_draws_is_one_and_unknown_ones_are_a_file_of_their_own(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    spikes, labels = rng.random((3, 256, 12)) < 0.2, np.array([4, 0, 6])
    held = np.zeros((3, 10), bool)
    held[[0, 2], :] = True
    held[1, 3] = True
    names = [_first_bits(sample) for sample in np.packbits(spikes, axis=1)]
    table = np.array(sorted([(names[1], True), (names[2], False)]), [("name", "<u4"), ("validates", "?")])
    np.save(tmp_path / "braille.npy", table)
    script = sys.modules[type(sets()["braille"]).__module__]
    monkeypatch.setattr(script, "__file__", str(tmp_path / "braille.py"))
    source = draws(tmp_path / "source", spikes, labels, held)
    known, rest = map(np.load, prepare("braille", source, tmp_path / "out"))
    assert known["label"].tolist() == [6, 0] and known["split"].tolist() == ["train", "val"]
    assert rest["label"].tolist() == [4] and rest["split"].tolist() == ["test"]
    assert (np.unpackbits(rest["spikes_packed"], axis=1)[0] == spikes[0]).all()
    assert known["val_fold_membership"].tolist() == held[[2, 1]].tolist()
    (source / "ds_val_7.pt").write_bytes(b"no data set")
    with pytest.raises(RecordingError, match=r"ds_val_7\.pt: is no TensorDataset"):
        prepare("braille", source, tmp_path / "out")
    (source / "ds_val_7.pt").unlink()
    with pytest.raises(RecordingError, match="has 9 of them"):
        prepare("braille", source, tmp_path / "out")


def test_letters_are_made_byte_for_byte(shared_data, tmp_path):
    known, path = shipped(shared_data, "braille")
    spikes = np.unpackbits(known["spikes_packed"], axis=1)[:, :256]
    source = draws(tmp_path / "source", spikes, known["label"], known["val_fold_membership"])
    assert members(made_from("braille", source, tmp_path)) == members(path)


def test_lines_of_a_figure_are_taken_in_the_order_that_gives_the_known_recordings(shared_data, tmp_path):
    known, path = shipped(shared_data, "sankar")
    tail = np.concatenate([known["adc"], known["adc"][:, :5]], axis=1)
    source = figures(tmp_path / "source", known["class_names"], tail[:, :, ::-1])
    made = made_from("sankar", source, tmp_path)
    assert members(made) == members(path)
    assert np.load(made.with_name("sankar_rigid_finger_test.npz"))["adc"].shape == (26, 5, 9)
    one = next((source / FIGURES).glob("Flat*.fig"))
    one.write_bytes((source / FIGURES / "Sine_3_50_Bionic_touch_figure.fig").read_bytes())
    with pytest.raises(RecordingError, match="no order of the figures' lines gives the recordings"):
        prepare("sankar", source, tmp_path / "other")
    one.write_bytes(b"version https://git-lfs.github.com/spec/v1\n" * 9)
    with pytest.raises(RecordingError, match="is no figure of MATLAB"):
        prepare("sankar", source, tmp_path / "other")
    one.unlink()
    with pytest.raises(RecordingError, match=r"must have 26 figures .*, has 25; sankar needs"):
        prepare("sankar", source, tmp_path / "other")
    assert not (tmp_path / "other").exists()


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
        prepare("icub", icub(tmp_path / "source", **changes), tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_what_no_recording_of_a_slide_or_grasp_can_be_is_refused(tmp_path):
    good = "Denim_F120_V-20mmps_0.csv"
    for name, arguments, text in (
        ("Denim_F120_V-20mmps_x.csv", {}, "must be named FABRIC_F<force>"),
        (good, {"header": "time, a, b"}, "must have samples of columns timestamp"),
        (good, {"signal": np.full((2, 16), -1)}, "counts from 0 to 65535"),
        (good, {"signal": np.full((2, 16), 2**16)}, "counts from 0 to 65535"),
        (good, {"start": np.array([9, 8])}, "times that do not fall"),
        (good, {"signal": np.ones((2, 15))}, "must have samples of columns"),
    ):
        source = tmp_path / text[:9]
        slide(source, name, **{"start": 0, "signal": np.ones((2, 16)), **arguments})
        with pytest.raises(RecordingError, match=text):
            prepare("fabric_slide", source, tmp_path / "out")
        (source / name).unlink()
    slide(tmp_path / "third", "Denim_F120_V-20mmps_2.csv", 0, np.ones((2, 16)))
    with pytest.raises(RecordingError, match="has none of the recordings that search spaces read"):
        prepare("fabric_slide", tmp_path / "third", tmp_path / "out")
    for part in ("train", "test"):
        grasp(tmp_path, part, 0, 1, np.full((39, 2, 250), 2))
    with pytest.raises(RecordingError, match="must hold 0 and 1 of shape"):
        prepare("evtouch", tmp_path, tmp_path / "out")
    grasp(tmp_path, "train", "none", 1, np.zeros((39, 2, 250)))
    with pytest.raises(RecordingError, match="must be named <number>_label_<class>"):
        prepare("evtouch", tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_is_missing_or_unknown_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("DSE_DATA", raising=False)
    (tmp_path / "icub_test.npy").write_bytes(b"no array")
    here = str(tmp_path)
    for arguments, text in (
        (["icub", here, "--out", here], "has no temp_data/labels_test.npy; icub needs"),
        (["icubs", here, "--out", here], "unknown set 'icubs'; known: braille, evtouch, fabric_slide"),
        (["sankar", here, "--out", here], "needs Raw Texture data/Rigid"),
        (["braille", here, "--out", here], "has no data/braille_splitted/ds_val_[0-9].pt; braille needs"),
        (["icub", f"{here}/none", "--out", here], "is no folder; icub needs temp_data/icub_test.npy"),
        (["icub"], "needs SOURCE"),
        (["icub", here], "needs --out DIR, or DSE_DATA"),
    ):
        assert main(["prepare", *arguments]) == 2
        assert text in " ".join(capsys.readouterr().err.split())
    (tmp_path / "labels_test.npy").write_bytes(b"no array")
    assert main(["prepare", "icub", here, "--out", here]) == 2
    assert "icub_test.npy: is no array" in capsys.readouterr().err
    assert {row["set"] for row in document(capsys, "prepare")["rows"]} == set(sets())
