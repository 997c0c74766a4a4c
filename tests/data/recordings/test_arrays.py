"""Named arrays of .npz, .npy, MATLAB and HDF5 files."""

import zipfile

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.time_series import TimeSeries

CUBE = np.arange(24, dtype=np.float64).reshape(2, 4, 3)
NAMES = np.array(["silk", "wool"])


def cells(*values):
    array = np.empty(len(values), object)
    array[:] = values
    return array


def save(folder, kind):
    """Write the same two recordings in a format, and return what reads them."""
    keys = {"signal": "p", "columns": {"fabric": "cloth"}, "axes": "step channel recording"}
    cube = CUBE.transpose(1, 2, 0)
    if kind == "npy":
        np.save(folder / "x.npy", CUBE)
        np.save(folder / "y.npy", NAMES)
        return TimeSeries("x.npy", 4, "array", labels="y.npy", columns={"fabric": "array"})
    if kind == "npy and csv":
        np.save(folder / "x.npy", CUBE)
        pd.DataFrame({"cloth": NAMES}).to_csv(folder / "y.csv", index=False)
        return TimeSeries("x.npy", 4, "array", labels="y.csv", columns={"fabric": "cloth"})
    if kind == "mat":
        savemat(folder / "x.mat", {"p": cube, "cloth": cells(*NAMES)})
        return TimeSeries("x.mat", 4, **keys)
    if kind == "mat 7.3":
        with h5py.File(folder / "x.mat", "w", userblock_size=512) as file:
            file["p"] = cube.T  # MATLAB is column-major
            file["p"].attrs["MATLAB_class"] = np.bytes_("double")
            for name in NAMES:
                file[f"#refs#/{name}"] = np.array([[ord(x)] for x in name], np.uint16)
                file[f"#refs#/{name}"].attrs["MATLAB_class"] = np.bytes_("char")
            references = [[file[f"#refs#/{name}"].ref for name in NAMES]]
            file.create_dataset("cloth", data=references, dtype=h5py.ref_dtype)
            file["cloth"].attrs["MATLAB_class"] = np.bytes_("cell")
        return TimeSeries("x.mat", 4, **keys)
    with h5py.File(folder / "x.h5", "w") as file:
        file["touch/p"] = cube
        file["touch/cloth"] = NAMES.astype(object)
    return TimeSeries("x.h5", 4, **{**keys, "signal": "touch/p", "columns": {"fabric": "touch/cloth"}})


@pytest.mark.parametrize("kind", ["npy", "npy and csv", "mat", "mat 7.3", "h5"])
def test_a_cube_is_the_same_in_every_format(tmp_path, kind):
    source = save(tmp_path, kind)
    assert source.check(tmp_path) == []
    signals = source.read(tmp_path)
    assert signals.values.tolist() == CUBE.reshape(8, 3).tolist() and signals.offsets.tolist() == [0, 4, 8]
    assert signals.columns["fabric"].tolist() == ["silk", "wool"]
    assert len(source.channel_positions(tmp_path)) == 3
    assert source.with_columns_found(tmp_path) == source


def test_a_cell_of_matrices_holds_recordings_of_different_lengths(tmp_path):
    savemat(tmp_path / "x.mat", {"p": cells(np.ones((3, 2)), np.zeros((2, 2))), "v": [5.0, 7.0]})
    source = TimeSeries("x.mat", 4, "p", columns={"speed": "v"})
    assert source.check(tmp_path) == [] and arrays.headers(tmp_path / "x.mat")["p"] == (2, -1, 2)
    signals = source.read(tmp_path)
    assert signals.offsets.tolist() == [0, 3, 5] and signals.columns["speed"].tolist() == [5, 7]
    savemat(tmp_path / "x.mat", {"p": cells(np.ones((3, 2)), np.zeros((2, 3))), "v": [5.0, 7.0]})
    with pytest.raises(RecordingError, match=r"x\.mat: 'p' must have as many channels in every recording"):
        source.read(tmp_path)


def test_one_channel_needs_no_axis_of_its_own(tmp_path):
    np.save(tmp_path / "x.npy", CUBE[..., 0])
    with pytest.raises(
        RecordingError, match=r"got shape \(2, 4\); data\.axes: recording step is one channel"
    ):
        TimeSeries("x.npy", 4, "array").read(tmp_path)
    signals = TimeSeries("x.npy", 4, "array", axes="recording step").read(tmp_path)
    assert signals.values.ravel().tolist() == CUBE[..., 0].ravel().tolist()
    for keys, message in (
        ({"axes": "recording time"}, "must name each axis once, among them recording and step"),
        ({"axes": "recording step step"}, "must name each axis once"),
        ({"axes": "recording step", "offsets": "o"}, "data.axes must be absent where data.offsets is given"),
    ):
        with pytest.raises(RecordingError, match=message):
            TimeSeries("x.npy", 4, "array", **keys)


@pytest.mark.parametrize("axes", ["recording step row column", "row column step recording"])
def test_frames_of_an_array_of_taxels_are_channels_in_the_order_of_the_file(tmp_path, axes):
    frames = np.arange(2 * 5 * 3 * 4).reshape(2, 5, 3, 4)
    usual = ("recording", "step", "row", "column")
    np.save(tmp_path / "x.npy", frames.transpose([usual.index(name) for name in axes.split()]))
    source = TimeSeries("x.npy", 4, "array", axes=axes)
    assert source.check(tmp_path) == [] and len(source.channel_positions(tmp_path)) == 12
    assert source.read(tmp_path).values.tolist() == frames.reshape(10, 12).tolist()


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
@pytest.mark.parametrize(
    "names",
    ["X_train X_test y_train y_test", "train_X test_X train_y test_y", "train/X test/X train/y test/y"],
)
def test_arrays_of_a_training_and_a_test_set_are_one(tmp_path, suffix, names):
    x, y = np.arange(5 * 4 * 3.0).reshape(5, 4, 3), np.array([7, 8, 7, 8, 7])
    path, names = tmp_path / f"x{suffix}", names if suffix == ".h5" else names.replace("/", "_")
    held = dict(zip(names.split(), (x[:3], x[3:], y[:3], y[3:]), strict=True))
    if suffix == ".npz":
        np.savez(path, **held, other=np.zeros(2))
    elif suffix == ".mat":
        savemat(path, held)
    else:
        with h5py.File(path, "w") as file:
            for name, array in held.items():
                file[name] = array
    assert arrays.headers(path).items() >= {"X": (5, 4, 3), "y": (5,), "split": (5,)}.items()
    source = TimeSeries(path.name, 4, "X", columns={"fabric": "y", "split": "split"})
    assert source.check(tmp_path) == []
    signals = source.read(tmp_path)
    assert signals.values.tolist() == x.reshape(20, 3).tolist()
    assert signals.columns["fabric"].tolist() == y.tolist()
    assert signals.columns["split"].tolist() == ["train"] * 3 + ["test"] * 2
    assert arrays.load(path, [names.split()[0]]).popitem()[1].shape == (3, 4, 3)
    with pytest.raises(RecordingError, match="no array 'Z'"):
        arrays.load(path, ["Z"])


def test_arrays_that_do_not_fit_together_stay_apart(tmp_path):
    np.savez(
        tmp_path / "x.npz", X_train=np.ones((3, 4, 2)), X_test=np.ones((2, 5, 2)), test=1, train=2, y_train=3
    )
    assert {*arrays.headers(tmp_path / "x.npz")} == {"X_train", "X_test", "test", "train", "y_train"}


@pytest.mark.parametrize("labels", [[[5], [9]], [[0, 0, 1], [1, 0, 0]], [[0.0, 1.0], [1.0, 0.0]]])
def test_labels_may_be_a_column_or_a_1_in_the_column_of_their_class(tmp_path, labels):
    np.savez(tmp_path / "x.npz", signal=CUBE, y=labels)
    source = TimeSeries("x.npz", 4, columns={"fabric": "y"})
    assert source.check(tmp_path) == []
    first, second = source.read(tmp_path).columns["fabric"].tolist()
    assert (first, second) in ((5, 9), (2, 0), (1, 0))


@pytest.mark.parametrize(
    "labels", [[[5, 1], [9, 1]], [[1, 1], [1, 0]], [[0.5, 0.5], [1, 0]], [["a", "b"]] * 2]
)
def test_other_matrices_are_no_labels(tmp_path, labels):
    np.savez(tmp_path / "x.npz", signal=CUBE, y=labels)
    with pytest.raises(RecordingError, match=r"x\.npz: column 'fabric' \(array 'y'\) .* got 2 columns"):
        TimeSeries("x.npz", 4, columns={"fabric": "y"}).read(tmp_path)


def test_faults_name_the_file_and_what_is_wrong(tmp_path):
    for name in ("x.npy", "x.mat", "x.h5"):
        (tmp_path / name).write_bytes(b"no such thing, but long enough" * 99)
        with pytest.raises(RecordingError, match=rf"{name}: the file cannot be read: it is not an? "):
            arrays.headers(tmp_path / name)
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(RecordingError, match=f"{name}: the file is empty"):
            arrays.load(tmp_path / name, ["array"])
    np.save(tmp_path / "x.npy", CUBE)
    np.save(tmp_path / "y.npy", NAMES[:1])
    source = TimeSeries("x.npy", 4, "array", labels="y.npy", columns={"fabric": "array"})
    assert source.check(tmp_path) == [
        "y.npy: column 'fabric' (array 'array') must have one value for each of the 2 recordings, got "
        "shape (1,)"
    ]
    assert "no array 'pressure'; known: array" in TimeSeries("x.npy", 4, "pressure").check(tmp_path)[0]
    assert "'absent.csv' not found" in TimeSeries("x.npy", 4, "array", labels="absent.csv").check(tmp_path)[0]


@pytest.mark.parametrize("name", ["x.npz", "x.npy"])
def test_lists_of_unequal_length_are_told_apart_from_damage(tmp_path, name):
    ragged = cells(CUBE[0], CUBE[1, :2])
    if name == "x.npz":
        np.savez(tmp_path / name, array=ragged)
    else:
        np.save(tmp_path / name, ragged, allow_pickle=True)
    with pytest.raises(RecordingError, match=r"array 'array' holds Python objects.*dse\.data\.from_arrays"):
        TimeSeries(name, 4, "array").read(tmp_path)


# ---- .npz


def test_compressed_arrays_and_later_versions_of_the_format_are_read(tmp_path):
    np.savez_compressed(tmp_path / "x.npz", signal=np.ones(4))
    with zipfile.ZipFile(tmp_path / "x.npz", "a") as archive, archive.open("later.npy", "w") as stream:
        np.lib.format.write_array(stream, np.arange(3), version=(2, 0))
    assert arrays.headers(tmp_path / "x.npz") == {"signal": (4,), "later": (3,)}
    assert arrays.load(tmp_path / "x.npz", ["later", "later"])["later"].tolist() == [0, 1, 2]
    with pytest.raises(RecordingError, match=r"x.npz: no array 'signl'; known: .*Did you mean 'signal'\?"):
        arrays.load(tmp_path / "x.npz", ["signl"])


@pytest.mark.parametrize("keep", [1, 30, 300, 5000])
def test_a_truncated_file_is_one_line_wherever_it_was_cut(write, keep):
    path = write("x.npz", signal=np.random.default_rng(0).random(1000))
    path.write_bytes(path.read_bytes()[:keep])
    for read in (arrays.headers, lambda p: arrays.load(p, ["signal"])):
        told = r"x.npz: .*cannot be read: it is not an .npz file, or is truncated"
        with pytest.raises(RecordingError, match=told) as error:
            read(path)
        assert "\n" not in str(error.value)
    path = write("x.npz", signal=np.zeros(1000))
    content = bytearray(path.read_bytes())
    content[4000:4016] = b"\xff" * 16
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"array 'signal' of .*Bad CRC"):
        arrays.load(path, ["signal"])


@pytest.mark.parametrize("text", [b"'shap_S]", b"'sha(pe ", b"  \n '\\x"])
@pytest.mark.parametrize("kind", ["x.npz", "x.npy"])
def test_a_header_that_is_no_text_of_python_is_one_line(tmp_path, kind, text):
    path = tmp_path / kind
    np.savez(path, array=np.zeros(4)) if kind == "x.npz" else np.save(path, np.zeros(4))
    path.write_bytes(path.read_bytes().replace(b"'shape'", text[:7].ljust(7)))
    with pytest.raises(RecordingError, match=rf"^{kind}: .*cannot be read") as error:
        arrays.headers(path)
    assert "\n" not in str(error.value)
