"""Event arrays in .npz, HDF5 and .csv files: where they are found, what their values mean, and damage."""

import sys

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.data.recordings import RecordingError
from dse.data.recordings.formats import arrays, detect
from dse.data.recordings.formats.arrays import H5, Csv, Npz
from tests.data.recordings.formats.reading import faulty, refused, tuples
from tests.data.recordings.formats.reading import read as read_block

T, X, Y, P = [5, 7, 7, 9], [0, 3, 1, 2], [1, 0, 2, 2], [1, 0, 0, 1]
EVENTS = list(zip(T, X, Y, P, strict=True))
TYPED = {"t": np.array(T), "x": np.array(X, "u2"), "y": np.array(Y, "i2"), "p": np.array(P, bool)}
DTYPE = [("x", "<u2"), ("y", "<u2"), ("timestamp", "<i8"), ("polarity", "?")]
TABLE = np.array(list(zip(X, Y, T, P, strict=True)), DTYPE)
KINDS = {"npz": Npz, "compressed": Npz, "h5": H5}
every_kind = pytest.mark.parametrize("kind", KINDS)


def read(path, form):
    events, notes = read_block(form, path)
    assert notes == []
    return tuples(events)


def write(folder, kind="npz", **content):
    """Write arrays as 'npz', 'compressed' npz or 'h5'; return the file."""
    path = folder / ("a.h5" if kind == "h5" else "a.npz")
    if kind == "h5":
        with h5py.File(path, "w") as file:
            for name, values in content.items():
                file.create_dataset(name, data=values, chunks=True, compression="gzip")
    else:
        (np.savez_compressed if kind == "compressed" else np.savez)(path, **content)
    return path


@pytest.mark.parametrize(
    "content",
    [
        TYPED,
        {"events/t": T, "events/x": X, "events/y": Y, "events/p": P, "frames/t": [1, 2]},
        {"Timestamps": T, "xs": X, "ys": Y, "Polarity": P, "image": np.zeros((4, 4))},
        {"events": TABLE, "t": [3, 4]},
        {"t": np.array(T, ">u8"), "x": np.array(X, "f4"), "y": Y, "p": np.array([1, -1, -1, 1])},
    ],
)
@every_kind
def test_usual_names_and_types(tmp_path, monkeypatch, kind, content):
    monkeypatch.setattr(arrays, "BLOCK_EVENTS", 3)
    path, form = write(tmp_path, kind, **content), KINDS[kind]()
    assert detect(path) == form and form.frame(path) is None
    assert read(path, form) == EVENTS


@every_kind
def test_names_that_are_given(tmp_path, kind):
    content = {"a/when": T, "a/x": X, "a/y": Y, "a/p": P, "b/t": T, "b/x": Y, "b/y": X, "b/p": P}
    path, form = write(tmp_path, kind, **content), KINDS[kind]
    turned = [(t, y, x, p) for t, x, y, p in EVENTS]
    assert read(path, form({"t": "a/when"})) == EVENTS and read(path, form({"t": "b/t"})) == turned
    assert read(path, form({"t": "a/when", "x": "b/y", "y": "b/x", "p": "b/p"})) == EVENTS
    with pytest.raises(RecordingError, match=r"no array 'a/wen'; known: .*Did you mean 'a/when'"):
        form({"t": "a/wen"}).frame(path)


@pytest.mark.parametrize(
    ("unit", "times", "wanted"),
    [
        ("s", [0.0000051, 1.5], [5, 1500000]),
        ("ms", [0.25, 2], [250, 2000]),
        ("us", [4.4, 4.6], [4, 5]),
        ("ns", np.array([1400, 2600]), [1, 3]),
        ("ms", np.array([3, 4]), [3000, 4000]),
    ],
)
def test_units_of_time(tmp_path, unit, times, wanted):
    path = write(tmp_path, t=times, x=[0, 0], y=[0, 0], p=[0, 1])
    assert [t for t, *_ in read(path, Npz(time_unit=unit))] == wanted
    if np.asarray(times).dtype.kind == "f":
        refused(
            Npz(), path, "floating-point times need their unit in the key time_unit, one of s, ms, us, ns"
        )


def test_a_taxel_is_an_address_in_a_row_and_large_values_are_not_wrapped(tmp_path):
    path = write(tmp_path, t=T, taxel=X, p=P)
    assert read(path, Npz()) == [(t, x, 0, p) for t, x, _, p in EVENTS]
    path = write(tmp_path, t=[0, 1], x=[1 << 32, 0], y=[0, -(1 << 40)], p=[256, -7])
    assert read(path, Npz()) == [(0, 2**31 - 1, 0, 255), (1, 0, -1, 255)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"t": T, "x": X, "y": Y}, "no arrays t, x, y and p; set the key arrays; known: t, x, y"),
        ({"t": T, "x": X, "p": P}, "no arrays t, x, y and p"),
        ({"t": T, "x": X, "y": Y, "p": np.array(list("abcd"))}, "no arrays t, x, y and p"),
        ({"t": T, "x": X, "y": Y, "p": np.array([1, None, 2, 3], object)}, "no arrays t, x, y and p"),
        ({"t": T, "x": X, "y": Y, "p": P, "e": TABLE}, "events are in '' and in 'e'; set the key arrays"),
        ({"image": np.zeros((3, 3))}, "known: none"),
    ],
)
def test_arrays_that_are_not_there(tmp_path, content, message):
    path = write(tmp_path, **content)
    refused(Npz(), path, message)
    with pytest.raises(RecordingError, match="set the key arrays"):
        Npz().frame(path)


@every_kind
def test_values_that_are_none_and_arrays_of_different_lengths(tmp_path, monkeypatch, kind):
    path, form = write(tmp_path, kind, **{**TYPED, "y": Y[:3]}), KINDS[kind]
    told = "the arrays must be of one length, got 4 t, 4 x, 3 y, 4 p"
    assert tuples(faulty(form(), path, 3, told, "keeps the complete events")) == EVENTS[:3]
    monkeypatch.setattr(arrays, "BLOCK_EVENTS", 2)
    path = write(tmp_path, kind, t=[0, 1, np.nan, 3e30, 4], x=[0, 1, 2, 3, 0.5], y=[0] * 5, p=[1] * 5)
    told = "event 2 must have a time, and whole numbers as address and polarity, got t = nan, x = 2"
    left = faulty(form(time_unit="us"), path, 2, told, "drops events without them (3 in all)")
    assert tuples(left) == [(0, 0, 0, 1), (1, 1, 0, 1)]


def test_damage_inside(tmp_path):
    for kind in ("npz", "compressed"):
        rng = np.random.default_rng(0)
        path = write(tmp_path, kind, **{name: rng.permutation(3000) for name in "txyp"})
        whole = path.read_bytes()
        middle = whole.index(b"x.npy") + 1000
        directory = whole.index(b"PK\x01\x02") + 16  # a check sum in the directory
        for at, junk in ((middle, b"\xff" * 500), (directory, bytes([whole[directory] ^ 1]))):
            path.write_bytes(whole[:at] + junk + whole[at + len(junk) :])
            refused(Npz(), path, "the file cannot be read: ")


@every_kind
@pytest.mark.parametrize("n_bytes", [0, 10, 300])
def test_files_cut_short(tmp_path, kind, n_bytes):
    path, form = write(tmp_path, kind, **TYPED), KINDS[kind]()
    path.write_bytes(path.read_bytes()[:n_bytes])
    refused(form, path, "the file cannot be read: it is no" if n_bytes else "the file is empty")
    assert detect(path) == form


@given(at=st.integers(0, 1400), junk=st.binary(max_size=9))
def test_damage_is_found_and_told_in_one_line(tmp_path_factory, at, junk):
    path = write(tmp_path_factory.mktemp("damage"), "compressed", **TYPED)
    data = path.read_bytes()
    path.write_bytes(data[:at] + junk + data[at + len(junk) :])
    try:
        assert read(path, Npz()) == EVENTS
    except RecordingError as error:
        assert "\n" not in str(error)


def test_hdf5_without_its_library_and_with_names_that_are_no_text(tmp_path, monkeypatch):
    path = write(tmp_path, "h5", **TYPED, abc=[1])
    path.write_bytes(path.read_bytes().replace(b"abc\0", b"\xabbc\0"))
    try:
        assert read(path, H5()) == EVENTS
    except RecordingError as error:
        assert str(error).startswith("a.h5: the file cannot be read") and "\n" not in str(error)
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert detect(path) == H5()
    refused(H5(), path, "HDF5 files need h5py, which is not installed; pip install 'dse-spiking[h5]'")


@pytest.mark.parametrize("mark", [",", ";", "\t", ", "])
def test_events_of_a_table_are_read_by_the_names_in_its_first_line(tmp_path, mark):
    path = tmp_path / "a.csv"
    rows = [["Timestamp", "x", "Y", "polarity"], *EVENTS]
    path.write_text("".join(mark.join(map(str, row)) + "\r\n" for row in rows))
    assert detect(path) == Csv() and Csv().frame(path) is None
    assert read(path, Csv()) == EVENTS
    assert read(path, Csv(time_unit="ms")) == [(1000 * t, *rest) for t, *rest in EVENTS]


def test_a_table_of_events_names_the_line_that_is_none(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,taxel,p\n1,2,1\n2,x,0\n3,4,-1\n")
    told = "event 1 must have a time, and whole numbers as address"
    assert tuples(faulty(Csv(), path, 2, told, "drops events")) == [(1, 2, 0, 1), (3, 4, 0, 0)]
    for text, told in {
        "t,x,y,p\n0.5,1,2,1\n": "floating-point times need their unit in the key time_unit",
        "t,x,y,p\n1,2,3,1\n1,2,3,4,5,6\n": "the file cannot be read",
        "t,pressure\n1,0.5\n": "no arrays t, x, y and p; set the key arrays",
    }.items():
        path.write_text(text)
        refused(Csv(), path, told)
