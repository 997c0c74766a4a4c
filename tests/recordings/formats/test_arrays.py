"""Event arrays in .npz and HDF5 files: where they are found, what their values mean, and damage."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import Repairs, arrays, detect
from dse.recordings.formats.arrays import H5, Csv, Npz

T, X, Y, P = [5, 7, 7, 9], [0, 3, 1, 2], [1, 0, 2, 2], [1, 0, 0, 1]
TYPED = {"t": np.array(T), "x": np.array(X, "u2"), "y": np.array(Y, "i2"), "p": np.array(P, bool)}
DTYPE = [("x", "<u2"), ("y", "<u2"), ("timestamp", "<i8"), ("polarity", "?")]
TABLE = np.array(list(zip(X, Y, T, P, strict=True)), DTYPE)


def read(path, form, repair=False):
    repairs = Repairs(path.name, repair)
    blocks = list(form.blocks(path, repairs))
    fields = ("t_us", "x", "y", "polarity")
    return [
        np.concatenate([getattr(block, name) for block in blocks] or [np.zeros(0)]).tolist()
        for name in fields
    ], repairs.notes


def npz(folder, compressed=False, **content):
    (np.savez_compressed if compressed else np.savez)(folder / "a.npz", **content)
    return folder / "a.npz"


def write(kind, folder, content):
    """Write arrays as 'npz', 'compressed' npz or 'h5'; return the file and the class that reads it."""
    if kind != "h5":
        return npz(folder, kind == "compressed", **content), Npz
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "a.h5", "w") as file:
        for name, values in content.items():
            file.create_dataset(name, data=values, chunks=True, compression="gzip")
    return folder / "a.h5", H5


every_kind = pytest.mark.parametrize("kind", ["npz", "compressed", "h5"])


def test_a_published_decoding_is_read_as_it_is(shared_data):
    path = shared_data / "native_event_files" / "expelliarmus_evt3_sample_decoded.npz"
    assert detect(path) == Npz() and Npz().frame(path) is None
    blocks = list(Npz().blocks(path, Repairs("a", False)))
    assert len(blocks) == 4
    with np.load(path) as wanted:
        for name, key in (("t_us", "t"), ("x", "x"), ("y", "y"), ("polarity", "p")):
            assert (np.concatenate([getattr(block, name) for block in blocks]) == wanted[key]).all()


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
    path, form = write(kind, tmp_path, content)
    assert detect(path) == form() and form().frame(path) is None
    assert read(path, form()) == ([T, X, Y, P], [])


@every_kind
def test_names_that_are_given(tmp_path, kind):
    content = {"a/when": T, "a/x": X, "a/y": Y, "a/p": P, "b/t": T, "b/x": Y, "b/y": X, "b/p": P}
    path, form = write(kind, tmp_path, content)
    assert read(path, form({"t": "a/when"}))[0] == [T, X, Y, P]
    assert read(path, form({"t": "b/t"}))[0] == [T, Y, X, P]
    assert read(path, form({"t": "a/when", "x": "b/y", "y": "b/x", "p": "b/p"}))[0] == [T, X, Y, P]
    with pytest.raises(RecordingError, match=r"no array 'a/wen'; known: .*Did you mean 'a/when'"):
        form({"t": "a/wen"}).frame(path)


def test_a_taxel_is_an_address_in_a_row(tmp_path):
    assert read(npz(tmp_path, t=T, taxel=X, p=P), Npz())[0] == [T, X, [0] * 4, P]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            {"t": T, "x": X, "y": Y},
            r"a\.npz: no arrays t, x, y and p; set the key arrays; known: t, x, y$",
        ),
        ({"t": T, "x": X, "p": P}, "no arrays t, x, y and p"),
        ({"t": T, "x": X, "y": Y, "p": np.array(list("abcd"))}, "no arrays t, x, y and p"),
        (
            {"t": T, "x": X, "y": Y, "p": P, "e": TABLE},
            "events are in '' and in 'e'; set the key arrays",
        ),
        ({"image": np.zeros((3, 3))}, "known: none"),
    ],
)
def test_arrays_that_are_not_there(tmp_path, content, message):
    with pytest.raises(RecordingError, match=message):
        Npz().frame(npz(tmp_path, **content))


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
    path = npz(tmp_path, t=times, x=[0, 0], y=[0, 0], p=[0, 1])
    assert read(path, Npz(time_unit=unit))[0][0] == wanted


def test_floating_point_times_need_their_unit(tmp_path):
    path = npz(tmp_path, t=[0.5, 1.5], x=[0, 0], y=[0, 0], p=[0, 1])
    with pytest.raises(
        RecordingError, match=r"a\.npz: floating-point times need their unit .* s, ms, us, ns"
    ):
        read(path, Npz(), repair=True)


def test_values_that_are_no_numbers(tmp_path, monkeypatch):
    monkeypatch.setattr(arrays, "BLOCK_EVENTS", 2)
    path = npz(tmp_path, t=[0, 1, np.nan, 3e30, 4], x=[0, 1, 2, 3, 0.5], y=[0] * 5, p=[1] * 5)
    form = Npz(time_unit="us")
    with pytest.raises(
        RecordingError, match=r"event 2 must have a time, and whole numbers .* got t = nan, x = 2"
    ):
        read(path, form)
    found, (note,) = read(path, form, repair=True)
    assert found[0] == [0, 1] and found[1] == [0, 1]
    assert note.endswith("--repair drops events without them (3 in all)")


def test_values_beyond_the_records_are_not_wrapped_into_them(tmp_path):
    path = npz(tmp_path, t=[0, 1], x=[1 << 32, 0], y=[0, -(1 << 40)], p=[256, -7])
    _, x, y, polarity = read(path, Npz())[0]
    assert x == [2**31 - 1, 0] and y == [0, -1] and polarity == [255, 255]


@every_kind
def test_arrays_of_different_lengths(tmp_path, kind):
    path, form = write(kind, tmp_path, {"t": T, "x": X, "y": Y[:3], "p": P})
    with pytest.raises(RecordingError, match="the arrays must be of one length, got 4 t, 4 x, 3 y, 4 p"):
        read(path, form())
    found, (note,) = read(path, form(), repair=True)
    assert found == [T[:3], X[:3], Y[:3], P[:3]] and "--repair keeps the complete events" in note


@pytest.mark.parametrize("compressed", [False, True])
def test_damage_inside(tmp_path, compressed):
    rng = np.random.default_rng(0)
    path = npz(tmp_path, compressed, **{name: rng.permutation(3000) for name in "txyp"})
    whole = path.read_bytes()
    middle = whole.index(b"x.npy") + 1000
    directory = whole.index(b"PK\x01\x02") + 16  # a check sum in the directory
    for at, junk in ((middle, b"\xff" * 500), (directory, bytes([whole[directory] ^ 1]))):
        path.write_bytes(whole[:at] + junk + whole[at + len(junk) :])
        for repair in (False, True):
            with pytest.raises(RecordingError, match=r"a\.npz: .*the file cannot be read: "):
                read(path, Npz(), repair)


@every_kind
@pytest.mark.parametrize("n_bytes", [0, 10, 300])
def test_files_cut_short(tmp_path, kind, n_bytes):
    path, form = write(kind, tmp_path, TYPED)
    path.write_bytes(path.read_bytes()[:n_bytes])
    with pytest.raises(RecordingError, match=rf"{path.name}: the file (is empty|cannot be read: it is no)"):
        form().frame(path)
    assert detect(path) == form()


@given(at=st.integers(0, 1400), junk=st.binary(max_size=9))
@settings(max_examples=40)
def test_damage_is_found_and_told_in_one_line(tmp_path_factory, at, junk):
    path = npz(tmp_path_factory.mktemp("damage"), compressed=True, **TYPED)
    data = path.read_bytes()
    path.write_bytes(data[:at] + junk + data[at + len(junk) :])
    try:
        assert read(path, Npz())[0] == [T, X, Y, P]
    except RecordingError as error:
        assert "\n" not in str(error)


def test_nothing_is_unpickled(tmp_path):
    path = npz(tmp_path, t=T, x=X, y=Y, p=np.array([1, None, 2, 3], object))
    with pytest.raises(RecordingError, match="no arrays t, x, y and p"):
        Npz().frame(path)


def test_hdf5_without_its_library(tmp_path, monkeypatch):
    path = tmp_path / "a.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert detect(path) == H5()
    with pytest.raises(
        RecordingError, match=r"a\.h5: HDF5 files need h5py, which is not installed; pip install 'dse\[h5\]'"
    ):
        H5().frame(path)


@pytest.mark.parametrize("mark", [",", ";", "\t", ", "])
def test_events_of_a_table_are_read_by_the_names_in_its_first_line(tmp_path, mark):
    path = tmp_path / "a.csv"
    rows = [["Timestamp", "x", "Y", "polarity"], *zip(T, X, Y, P, strict=True)]
    path.write_text("".join(mark.join(map(str, row)) + "\r\n" for row in rows))
    assert detect(path) == Csv() and Csv().frame(path) is None
    assert read(path, Csv())[0] == [T, X, Y, P]
    assert read(path, Csv(time_unit="ms"))[0][0] == [1000 * t for t in T]


def test_a_table_of_events_names_the_line_that_is_none(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,taxel,p\n1,2,1\n2,x,0\n3,4,-1\n")
    with pytest.raises(RecordingError, match="event 1 must have a time, and whole numbers as address"):
        read(path, Csv())
    values, (note,) = read(path, Csv(), repair=True)
    assert values == [[1, 3], [2, 4], [0, 0], [1, 0]] and "drops events" in note
    path.write_text("t,x,y,p\n0.5,1,2,1\n")
    with pytest.raises(RecordingError, match="floating-point times need their unit in the key time_unit"):
        read(path, Csv())
    path.write_text("t,x,y,p\n1,2,3,1\n1,2,3,4,5,6\n")
    with pytest.raises(RecordingError, match="the file cannot be read"):
        read(path, Csv())
    path.write_text("t,pressure\n1,0.5\n")
    with pytest.raises(RecordingError, match="no arrays t, x, y and p; set the key arrays"):
        read(path, Csv())


def test_names_in_hdf5_that_are_no_text_are_one_line_or_left_out(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        for name in ("t", "x", "y", "p", "abc"):
            file[name] = np.arange(3)
    path.write_bytes(path.read_bytes().replace(b"abc\0", b"\xabbc\0"))
    try:
        assert sum(len(block.t_us) for block in H5().blocks(path, Repairs("x.h5", False))) == 3
    except RecordingError as error:
        assert str(error).startswith("x.h5: the file cannot be read") and "\n" not in str(error)
