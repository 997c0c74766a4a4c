"""Event Stream, N-MNIST, NeuTouch and ST-MNIST: recorded files, round trips, and broken files."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.io import loadmat, savemat

from dse.recordings import RecordingError, formats
from dse.recordings.formats import BLOCK_EVENTS, detect, es, named, neutouch
from dse.recordings.formats.stmnist import N_ROWS
from dse.records import Block
from tests.recordings.formats.encoders import event_lists, events_of, nmnist, recording
from tests.recordings.formats.reading import events, faulty, many, peak_bytes, read, refused, same, tuples

WIDTH, HEIGHT = 300, 260
DVS, ATIS = 1, 2
ONE = [(70, 3, 4, 1)]


def holds(path: Path, name: str, content: bytes, wanted: list) -> bool:
    path.write_bytes(content)
    found, notes = read(named(name), path)
    return notes == [] and tuples(found) == wanted


# ---- Event Stream


def head(
    kind: int = DVS, version: bytes = b"\x02\x00\x01", width: int = WIDTH, height: int = HEIGHT
) -> bytes:
    size = width.to_bytes(2, "little") + height.to_bytes(2, "little")
    return b"Event Stream" + version + bytes([kind]) + (b"" if kind == 0 else size)


def coded(block: Block, kind: int = DVS) -> bytes:
    """Return the bytes of the events: elapsed time beyond a byte's range goes before the event."""
    full, most = 255 >> kind, (1 << kind) - 1
    recording, before = bytearray(), 0
    for t, x, y, polarity in tuples(block):
        steps, rest = divmod(t - before, full)
        while steps:
            recording.append(full << kind | min(steps, most))
            steps -= min(steps, most)
        recording.append(rest << kind | polarity << (kind - 1))
        recording += x.to_bytes(2, "little") + (HEIGHT - 1 - y).to_bytes(2, "little")
        before = t
    return bytes(recording)


def test_a_recorded_event_stream(shared_data):
    path = shared_data / "native_event_files" / "faery_dvs.es"
    assert detect(path) == named("es") and named("es").frame(path) == (320, 240)
    found, notes = read(named("es"), path)
    assert notes == [] and len(found.t_us) == 473225 and found.polarity.sum() == 270001
    assert (found.t_us[-1], found.x[-1], found.y[-1]) == (999000, 38, 193)
    sums = [zlib.crc32(a.astype(np.int64).tobytes()) for a in (found.t_us, found.x, found.y)]
    assert sums == [4149783995, 2153943521, 3035768722]  # as two other readers decode it
    with pytest.raises(RecordingError, match=r"byte 15 must be DVS or ATIS.*, got generic events"):
        named("es").frame(path.with_name("faery_generic.es"))


@given(block=events(WIDTH, HEIGHT), kind=st.sampled_from([DVS, ATIS]), size=st.integers(1, 9))
def test_round_trip_of_event_stream(tmp_path_factory, block, kind, size):
    path = tmp_path_factory.getbasetemp() / "round_trip.es"
    with patch.object(es, "BLOCK_EVENTS", size):
        assert holds(path, "es", head(kind) + coded(block, kind), tuples(block))
    assert named("es").frame(path) == (WIDTH, HEIGHT)


def test_event_stream_by_hand(tmp_path):
    # 127 us, a reset, 127 us, then 5 us: ON at column 258, row 1 from the bottom
    content = head() + bytes([0xFF, 0xFE, 0xFF, 5 << 1 | 1, 2, 1, 1, 0])
    assert holds(tmp_path / "a.es", "es", content, [(259, 258, HEIGHT - 2, 1)])
    # 2 x 63 us, a threshold crossing after 4 us, a change (OFF) after 1 us
    content = head(ATIS) + bytes([0xFE, 4 << 2 | 3, 9, 0, 9, 0, 1 << 2, 7, 0, 0, 0])
    assert holds(tmp_path / "a.es", "es", content, [(131, 7, HEIGHT - 1, 0)])
    assert holds(tmp_path / "a.es", "es", head() + b"\xff" * 500_000, [])


@pytest.mark.parametrize("left", [1, 4])
def test_event_stream_cut_in_an_event(tmp_path, left):
    content = (head() + coded(many(3, WIDTH, HEIGHT)))[: 30 + left]
    sentence = f"the event at byte 30 must have 5 bytes, but the file ends after {left}"
    faulty("es", tmp_path / "a.es", content, 2, sentence)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "the file must begin with 'Event Stream' at byte 0, it is empty"),
        (b"Event Strea", "it begins with b'Event Strea'"),
        (head(version=b"\x01\x00\x00"), "the version at byte 12 must be 2.0, got 1.0.0"),
        (head(version=b"\x02\x01\x00"), "the version at byte 12 must be 2.0, got 2.1.0"),
        (head(4), "the type at byte 15 must be DVS or ATIS, whose events have addresses, got colour events"),
        (head(77), "whose events have addresses, got 77 events"),
        (head()[:19], "the header must be 20 bytes long, got 19"),
        (head()[:13], "the header must be 20 bytes long, got 13"),
        (head(height=0), "the frame at byte 16 must be at least 1 x 1, got 300 x 0"),
    ],
)
def test_a_header_of_event_stream_that_is_not_sound_is_refused_even_with_repair(tmp_path, content, sentence):
    refused("es", tmp_path / "a.es", content, sentence)


# ---- N-MNIST


def test_a_recorded_nmnist(shared_data):
    path = shared_data / "native_event_files" / "tonic_sample_nmnist.bin"
    assert named("nmnist").frame(path) == (34, 34) and named("nmnist").matches(path, path.read_bytes()[:4096])
    found = events_of(recording(path, named("nmnist"), 34, 34, False, []))
    assert len(found) == 4325
    assert (found[0], found[1], found[-1]) == ((654, 7, 15, 1), (2999, 19, 18, 0), (311175, 21, 14, 1))


@given(event_lists(1 << 19, 239), st.integers(0, (1 << 23) - 1), st.integers(1, 9))
@example([(k << 19, 0, k, 1) for k in range(40)], (1 << 23) - 1, 3)  # three wraps
def test_round_trip_of_nmnist(tmp_path_factory, events, start, block):
    events = [(start + t - events[0][0], x, y, p) for t, x, y, p in events]
    with patch.object(formats, "BLOCK_EVENTS", block):
        assert holds(tmp_path_factory.getbasetemp() / "a.bin", "nmnist", nmnist(events), events)


def test_entries_of_row_240_add_to_the_time_and_are_no_events(tmp_path):
    entries = [(5, 1, 1, 0), (6, 0, 240, 0), (7, 2, 1, 1), (8, 0, 240, 1), (8, 0, 240, 1), (9, 3, 1, 0)]
    wanted = [(5, 1, 1, 0), (7 + 8192, 2, 1, 1), (9 + 3 * 8192, 3, 1, 0)]
    for block in (1, 2, 3, 100):
        with patch.object(formats, "BLOCK_EVENTS", block):
            assert holds(tmp_path / "a.bin", "nmnist", nmnist(entries), wanted)


def test_the_frame_of_nmnist_is_told_by_the_first_events(tmp_path):
    path = tmp_path / "a.bin"
    for given_events, frame in ((ONE, (34, 34)), ([], (34, 34)), ([*ONE, (71, 0, 34, 0)], None)):
        path.write_bytes(nmnist(given_events))
        assert named("nmnist").frame(path) == frame
        is_one = frame is not None and bool(given_events)
        assert named("nmnist").matches(path, path.read_bytes()) == is_one
    for cut in range(1, 5):
        faulty(
            "nmnist", path, nmnist(ONE) + b"\1" * cut, 1, f"last word must have 5 bytes, got {cut} at byte 5"
        )


# ---- NeuTouch

LINES = ["0 44 1606029303.0246768", "1 3 1606029303.024703", "0 0 1606029303.1", "0 60 1606029303.2"]
LINES.append("1 79 1606029305")


@pytest.mark.parametrize(("name", "n"), [("sponge", 11099), ("stiff_block", 5386)])
def test_the_recorder_s_files_are_the_packed_recordings(shared_data, name, n):
    path = shared_data / "native_event_files" / f"neutouch_{name}_trial1_5.tact"
    assert detect(path) == named("neutouch") and named("neutouch").frame(path) == (80, 1)
    found, notes = read(named("neutouch"), path)
    assert len(found.t_us) == n and notes == [] and not found.y.any() and found.t_us[0] == 0
    with np.load(shared_data / "neutouch_objects" / "neutouch_objects.npz") as packed:
        is_one = packed["class_names"][packed["label"]] == name
        is_one &= (packed["session"] == "class_test/trial1") & (packed["iteration"] == 5)
        part = slice(*packed["offsets"][np.flatnonzero(is_one).item() :][:2])
        assert (found.x == packed["taxel"][part]).all()
        assert (found.polarity == packed["polarity"][part]).all()
        # Both round to the microsecond, from two zeros of time.
        times = packed["t_us"][part].astype(np.int64)
        assert np.abs(found.t_us - (times - times[0])).max() <= 1


@pytest.mark.parametrize("end", ["\n", "\r\n", "\n\n"])
@pytest.mark.parametrize("chunk", [1, 1 << 16])
def test_neutouch_by_hand(tmp_path, monkeypatch, end, chunk):
    monkeypatch.setattr(neutouch, "BLOCK_EVENTS", chunk)
    wanted = [(0, 44, 0, 1), (26, 3, 0, 0), (1975323, 79, 0, 0)]
    assert holds(tmp_path / "a.tact", "neutouch", end.join(LINES).encode(), wanted)
    assert holds(tmp_path / "a.tact", "neutouch", b"", [])
    assert not named("neutouch").matches(tmp_path / "a.txt", LINES[0].encode())
    assert not named("neutouch").matches(tmp_path / "a.tact", b"1606029300 75273990 1 1 3 3 0 0 3 0 \n")


@pytest.mark.parametrize(
    "line", ["2 44 1.5", "0 44", "0 -4 1.5", "0 44 nan", "0 44 1.5 7", "0,44,1.5", "\x00\xff", "7" * 5000]
)
def test_a_line_that_is_no_event(tmp_path, line):
    content = "\n".join([*LINES[:2], line, LINES[-1], line]).encode()
    sentence = "line 3 must be a sign (0 or 1), a taxel and a time, got "
    faulty(
        "neutouch", tmp_path / "a.tact", content, 3, sentence, "skips lines that are not events (2 in all)"
    )


# ---- ST-MNIST


def matrix(n: int, seed: int = 0) -> Any:
    """Return a spike train with one to three taxels per column, its times in seconds."""
    rng = np.random.default_rng(seed)
    recording = np.zeros((N_ROWS, n))
    for _ in range(3):
        recording[rng.integers(0, 100, n), np.arange(n)] = rng.choice([-1, 1], n)
    recording[-1] = np.sort(rng.uniform(0, 2, n))
    return recording


def is_of(found: Block, spikes: Any) -> bool:
    column, taxel = np.nonzero(spikes[:-1].T)
    values = spikes.T[column, taxel]
    return same(found, np.rint(spikes[-1, column] * 1e6), taxel % 10, taxel // 10, values > 0)


def test_the_published_sample_of_stmnist(shared_data):
    path = shared_data / "native_event_files" / "tonic_sample_stmnist.mat"
    assert detect(path) == named("stmnist") and named("stmnist").frame(path) == (10, 10)
    found, notes = read(named("stmnist"), path)
    assert notes == [] and len(found.t_us) == 2346 and is_of(found, loadmat(path)["spiketrain"])
    assert (found.t_us[0], found.t_us[-1]) == (196626, 895745)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("dtype", ["f8", ">f8", "f4", "i2"])
def test_any_number_type_of_stmnist(tmp_path, compressed, dtype):
    spikes = matrix(40)
    spikes[-1] = np.arange(40) if dtype == "i2" else spikes[-1]
    content = {"about": "other", "wide": np.ones((3, 900)), "spiketrain": spikes.astype(dtype)}
    savemat(tmp_path / "a.mat", content, do_compression=compressed)
    found, notes = read(named("stmnist"), tmp_path / "a.mat")
    assert notes == [] and is_of(found, spikes.astype(dtype).astype(np.float64))


@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_stmnist_is_refused(tmp_path, compressed):
    path = tmp_path / "a.mat"
    savemat(path, {"spiketrain": np.ones((N_ROWS, 70))}, do_compression=compressed)
    whole = path.read_bytes()
    for n_bytes in (0, 5, 100, 130, 190, len(whole) // 2):
        refused("stmnist", path, whole[:n_bytes], "")
    if compressed:
        half = len(whole) // 2
        refused("stmnist", path, whole[:half] + bytes(64) + whole[half + 64 :], "cannot be read")
        refused("stmnist", path, whole[:-1] + bytes([whole[-1] ^ 1]), "cannot be read")
    else:  # one wrong byte: scipy.io.loadmat crashes the interpreter on it
        at = whole.index(np.ones(2).tobytes()) - 8
        refused("stmnist", path, whole[:at] + bytes([99]) + whole[at + 1 :], "cannot be read")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"other": np.ones((3, 3)), "more": "text"}, "no array 'spiketrain'; known: other, more"),
        (
            {"spiketrain": np.ones((100, 7))},
            "spiketrain must be 101 x n real numbers, got float64 of shape (100",
        ),
        ({"spiketrain": np.ones((101, 7)) * 1j}, "must be 101 x n real numbers, got complex128"),
        ({"spiketrain": "no numbers"}, "must be 101 x n real numbers, got <U"),
    ],
)
def test_another_matrix(tmp_path, content, sentence):
    savemat(tmp_path / "b.mat", content)
    refused("stmnist", tmp_path / "a.mat", (tmp_path / "b.mat").read_bytes(), sentence)


def test_columns_without_a_time(tmp_path):
    spikes = matrix(10)
    spikes[-1, [2, 5]] = np.nan, np.inf
    spikes[17, 8] = np.nan
    savemat(tmp_path / "b.mat", {"spiketrain": spikes})
    wanted = np.delete(spikes, [2, 5, 8], axis=1)
    found = faulty(
        "stmnist", tmp_path / "a.mat", (tmp_path / "b.mat").read_bytes(), np.count_nonzero(wanted[:-1]),
        "column 2 must hold numbers and a time in seconds, got the time [nan]", "(3 in all)",
    )  # fmt: skip
    assert is_of(found, wanted)
    savemat(tmp_path / "a.mat", {"spiketrain": np.zeros((N_ROWS, 0))})
    assert len(read(named("stmnist"), tmp_path / "a.mat")[0].t_us) == 0


@pytest.mark.parametrize("name", ["es", "nmnist"])
def test_memory_does_not_follow_the_length(tmp_path, name):
    path, block = tmp_path / "a.bin", many(BLOCK_EVENTS, 200, 239)
    path.write_bytes(24 * nmnist(tuples(block)) if name == "nmnist" else head() + 24 * coded(block))
    n, peak = peak_bytes(named(name), path)
    assert n == 24 * BLOCK_EVENTS and peak < 480 * BLOCK_EVENTS
