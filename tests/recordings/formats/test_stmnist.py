"""ST-MNIST matrices: against scipy's reader of the same files, and every way a file can be damaged."""

import tracemalloc
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat, savemat

from dse.recordings import RecordingError
from dse.recordings.formats import Repairs, detect, stmnist
from dse.recordings.formats.stmnist import N_ROWS, Stmnist


def read(path, repair=False):
    """Return t_us, x, y, polarity of a file, and the notes."""
    repairs = Repairs(path.name, repair)
    blocks = list(Stmnist().blocks(path, repairs.broken))
    fields = ("t_us", "x", "y", "polarity")
    return [
        np.concatenate([getattr(block, name) for block in blocks] or [np.zeros(0)]) for name in fields
    ], repairs.notes


def matrix(n, seed=0):
    """A spike train with one to three taxels per column, its times in seconds."""
    rng = np.random.default_rng(seed)
    recording = np.zeros((N_ROWS, n))
    for _ in range(3):
        recording[rng.integers(0, 100, n), np.arange(n)] = rng.choice([-1, 1], n)
    recording[-1] = np.sort(rng.uniform(0, 2, n))
    return recording


def expected(spikes):
    column, taxel = np.nonzero(spikes[:-1].T)
    values = spikes.T[column, taxel]
    return np.rint(spikes[-1, column] * 1e6), taxel % 10, taxel // 10, values > 0


def assert_same(recording, wanted):
    for a, b in zip(recording, wanted, strict=True):
        assert len(a) == len(b) and (a == b).all()


def test_the_published_sample(shared_data):
    path = shared_data / "native_event_files" / "tonic_sample_stmnist.mat"
    assert detect(path) == Stmnist() and Stmnist().frame(path) == (10, 10)
    spikes = loadmat(path)["spiketrain"]
    assert spikes.shape == (N_ROWS, 2346)
    recording, notes = read(path)
    assert len(recording[0]) == 2346 and notes == []
    assert_same(recording, expected(spikes))
    assert [x[0].item() for x in recording[:1]] == [196626] and recording[0][-1] == 895745


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("dtype", ["f8", ">f8", "f4", "i2"])
def test_any_number_type_in_blocks(tmp_path, monkeypatch, compressed, dtype):
    monkeypatch.setattr(stmnist, "_COLUMNS", 7)
    spikes = matrix(40)
    if dtype == "i2":
        spikes[-1] = np.arange(40)
    spikes = spikes.astype(dtype)
    path = tmp_path / "a.mat"
    savemat(
        path, {"about": "other", "wide": np.ones((3, 900)), "spiketrain": spikes}, do_compression=compressed
    )
    recording, notes = read(path)
    assert notes == []
    assert_same(recording, expected(spikes.astype(np.float64)))


def test_a_long_recording_is_never_held_whole(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"spiketrain": matrix(40_000)}, do_compression=True)  # 32 MB
    tracemalloc.start()
    n = sum(len(block.t_us) for block in Stmnist().blocks(path, Repairs("a.mat", False).broken))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert n > 100_000 and peak < 12e6


@pytest.mark.parametrize("compressed", [False, True])
def test_a_file_cut_short_is_an_error_or_its_beginning(tmp_path, compressed):
    path, spikes = tmp_path / "a.mat", matrix(3000)
    savemat(path, {"spiketrain": spikes}, do_compression=compressed)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(
        RecordingError, match=r"a\.mat: truncated or damaged at byte \d+, in column \d+ of 3000"
    ) as e:
        read(path)
    assert str(e.value).endswith("--repair keeps the events before the damage")
    recording, (note,) = read(path, repair=True)
    n = len(recording[0])
    wanted = expected(spikes)
    assert len(wanted[0]) / 4 < n < len(wanted[0])
    assert_same(recording, [x[:n] for x in wanted])
    assert "truncated or damaged at byte" in note


def test_damaged_bytes_inside_the_compressed_matrix(tmp_path):
    path, spikes = tmp_path / "a.mat", matrix(3000)
    savemat(path, {"spiketrain": spikes}, do_compression=True)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 64] = bytes(64)
    path.write_bytes(data)
    with pytest.raises(
        RecordingError, match=r"a\.mat: (truncated or damaged|the checksum of spiketrain must match)"
    ):
        read(path)


@pytest.mark.parametrize("n", [1, 30, 3000])
def test_a_wrong_check_sum_is_not_overlooked(tmp_path, n):
    path, spikes = tmp_path / "a.mat", matrix(n)
    savemat(path, {"spiketrain": spikes}, do_compression=True)
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(
        RecordingError, match=r"a\.mat: (truncated or damaged|the checksum of spiketrain must match)"
    ):
        read(path)
    recording, (note,) = read(path, repair=True)
    assert_same(recording, [x[: len(recording[0])] for x in expected(spikes)])
    assert "--repair keeps " in note


@pytest.mark.parametrize("n_bytes", [0, 5, 100, 130, 136, 150, 190])
def test_a_header_cut_short(tmp_path, n_bytes):
    path = tmp_path / "a.mat"
    savemat(path, {"spiketrain": matrix(30)})
    path.write_bytes(path.read_bytes()[:n_bytes])
    for repair in (False, True):
        with pytest.raises(RecordingError, match=r"a\.mat: .*(truncated|has no matrix)"):
            read(path, repair)
    with pytest.raises(RecordingError, match=r"a\.mat: "):
        Stmnist().frame(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"other": np.ones((3, 3)), "more": "text"}, "has no matrix 'spiketrain'; it has other, more"),
        ({"spiketrain": np.ones((100, 7))}, "spiketrain must be 101 x n real numbers, got 100 x 7"),
        ({"spiketrain": np.ones((101, 7, 2))}, "got 101 x 7 x 2"),
        ({"spiketrain": np.ones((101, 7)) * 1j}, "got values of another type"),
        ({"spiketrain": "no numbers"}, "got values of another type"),
    ],
)
def test_another_matrix(tmp_path, content, message):
    path = tmp_path / "a.mat"
    savemat(path, content)
    with pytest.raises(RecordingError, match=message):
        Stmnist().frame(path)


def test_a_matrix_whose_size_contradicts_its_shape(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"spiketrain": matrix(30)})
    data = path.read_bytes()
    shape = np.array([N_ROWS, 30], "<i4").tobytes()
    path.write_bytes(data.replace(shape, np.array([N_ROWS, 31], "<i4").tobytes()))
    with pytest.raises(RecordingError, match=r"truncated or damaged at byte .* in a header"):
        Stmnist().frame(path)


@pytest.mark.parametrize("code", [0, 8, 11, 14, 99])
def test_an_unknown_type_of_the_values_is_damage(tmp_path, code):
    """One wrong byte: scipy.io.loadmat crashes the interpreter on it."""
    path = tmp_path / "a.mat"
    savemat(path, {"spiketrain": np.ones((N_ROWS, 7))})
    data = bytearray(path.read_bytes())
    data[data.index(np.ones(2).tobytes()) - 8] = code
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"truncated or damaged at byte \d+, in a header"):
        read(path)


def test_a_type_without_bytes_is_damage():
    content = [np.array([99, 0], "<u4").tobytes()]
    with pytest.raises(stmnist._Cut):
        stmnist._number(lambda n: content.pop()[:n], "<", 3)


def test_version_7_3_is_named(tmp_path):
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform".ljust(512) + b"\x89HDF\r\n\x1a\n")
    assert detect(path) == Stmnist()
    with pytest.raises(
        RecordingError, match=r"a\.mat: must be a MATLAB file of version 5 to 7, got 7\.3; save it with -v7"
    ):
        Stmnist().frame(path)


def test_columns_without_a_time(tmp_path):
    path, spikes = tmp_path / "a.mat", matrix(10)
    spikes[-1, [2, 5]] = np.nan, np.inf
    spikes[17, 8] = np.nan
    savemat(path, {"spiketrain": spikes})
    with pytest.raises(
        RecordingError, match="column 2 must hold numbers and a time in seconds, got the time nan"
    ):
        read(path)
    recording, (note,) = read(path, repair=True)
    assert_same(recording, expected(np.delete(spikes, [2, 5, 8], axis=1)))
    assert note.endswith(
        "--repair drops columns without a time or with values that are not numbers (3 in all)"
    )


def test_a_matrix_without_columns_has_no_events(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"spiketrain": np.zeros((N_ROWS, 0))})
    assert len(read(path)[0][0]) == 0


def test_a_stream_that_inflates_without_end_is_read_in_pieces(tmp_path):
    """A small file must not fill the memory: a gigabyte of zeros behind the tag of an element."""
    path = tmp_path / "a.mat"
    packer = zlib.compressobj(9)
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(64)) + packer.flush()
    savemat(path, {})
    path.write_bytes(path.read_bytes() + np.array([15, len(packed)], "<u4").tobytes() + packed)
    tracemalloc.start()
    with pytest.raises(RecordingError, match="has no matrix"):
        Stmnist().frame(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2e6


@given(at=st.integers(128, 6000), junk=st.binary(min_size=1, max_size=9), compressed=st.booleans())
def test_damage_is_told_in_one_line(tmp_path_factory, at, junk, compressed):
    path = tmp_path_factory.mktemp("damage") / "a.mat"
    savemat(path, {"other": 1, "spiketrain": matrix(7)}, do_compression=compressed)
    data = path.read_bytes()
    path.write_bytes(data[:at] + junk + data[at + len(junk) :])
    for repair in (False, True):
        try:
            Stmnist().frame(path)
            read(path, repair)
        except RecordingError as error:
            assert "\n" not in str(error)
