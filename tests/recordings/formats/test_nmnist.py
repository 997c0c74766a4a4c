"""The 40-bit events of N-MNIST: a real recording, round trips, and files that are not sound."""

from __future__ import annotations

import tracemalloc
from unittest.mock import patch

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import Repairs, named, words
from tests.recordings.formats.encoders import event_lists, events_of, nmnist, recording

NMNIST = named("nmnist")
ONE = [(70, 3, 4, 1)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("nmnist")


def read(folder, content, repair=False):
    """Return the events of a file, and the notes on its repair."""
    path = folder / "a.bin"
    path.write_bytes(content)
    repairs = Repairs(path.name, repair)
    return events_of(NMNIST.blocks(path, repairs.broken)), repairs.notes


def test_a_real_recording(shared_data):
    path = shared_data / "native_event_files" / "tonic_sample_nmnist.bin"
    assert NMNIST.frame(path) == (34, 34)
    assert NMNIST.matches(path, path.read_bytes()[:4096])
    events = events_of(recording(path, NMNIST, 34, 34, False, []))
    assert len(events) == 4325
    assert (events[0], events[1], events[-1]) == ((654, 7, 15, 1), (2999, 19, 18, 0), (311175, 21, 14, 1))


@given(event_lists(1 << 19, 239), st.integers(0, (1 << 23) - 1), st.integers(1, 9))
@example(
    [(k << 19, 0, k, 1) for k in range(40)], (1 << 23) - 1, 3
)  # three times over the 23 bits of the time
def test_round_trip_with_any_block_borders(folder, events, start, block):
    events = [(start + t - events[0][0], x, y, p) for t, x, y, p in events]
    with patch.object(words, "BLOCK_EVENTS", block):
        assert read(folder, nmnist(events)) == (events, [])


@pytest.mark.parametrize("block", [1, 2, 3, 100])
def test_entries_of_row_240_add_to_the_time_and_are_no_events(folder, block):
    entries = [(5, 1, 1, 0), (6, 0, 240, 0), (7, 2, 1, 1), (8, 0, 240, 1), (8, 0, 240, 1), (9, 3, 1, 0)]
    with patch.object(words, "BLOCK_EVENTS", block):
        events, notes = read(folder, nmnist(entries))
    assert events == [(5, 1, 1, 0), (7 + 8192, 2, 1, 1), (9 + 3 * 8192, 3, 1, 0)] and notes == []


def test_a_time_that_runs_backwards_is_not_a_wrap(folder):
    path = folder / "back.bin"
    path.write_bytes(nmnist([(6 << 20, 1, 1, 0), (7, 2, 2, 1), (7 << 20, 3, 3, 1)]))
    with pytest.raises(RecordingError, match=r"event 1 must not be earlier .* got 7, 6291456;"):
        list(recording(path, NMNIST, 34, 34, False, []))
    times = [t for t, *_ in events_of(recording(path, NMNIST, 34, 34, True, []))]
    assert times == [6 << 20, 6 << 20, 7 << 20]


def test_events_outside_the_frame(folder):
    path = folder / "frame.bin"
    path.write_bytes(nmnist([(1, 33, 33, 0), (2, 34, 0, 1)]))
    assert not NMNIST.matches(path, path.read_bytes())
    with pytest.raises(
        RecordingError, match=r"event 1 must have its \(x, y\) within the frame of 34 x 34 pixels, got 34, 0;"
    ):
        list(recording(path, NMNIST, 34, 34, False, []))
    assert len(events_of(recording(path, NMNIST, 35, 34, False, []))) == 2


@pytest.mark.parametrize(
    ("events", "frame"),
    [(ONE, (34, 34)), ([], (34, 34)), ([*ONE, (71, 0, 240, 0)], (34, 34)), ([*ONE, (71, 0, 34, 0)], None)],
)
def test_the_frame_is_told_by_the_first_events(folder, events, frame):
    path = folder / "told.bin"
    path.write_bytes(nmnist(events))
    assert NMNIST.frame(path) == frame
    assert NMNIST.matches(path, nmnist(events)) == (frame is not None and bool(events))


def test_a_cut_last_event(folder):
    for cut in range(1, 5):
        with pytest.raises(
            RecordingError, match=f"last word must have 5 bytes, got {cut} at byte 5; --repair"
        ):
            read(folder, nmnist(ONE) + b"\1" * cut)
        events, notes = read(folder, nmnist(ONE) + b"\1" * cut, repair=True)
        assert events == ONE and len(notes) == 1


def test_no_events(folder):
    assert read(folder, b"") == ([], [])
    assert not NMNIST.matches(folder / "a.bin", b"")


def test_memory_does_not_follow_the_length(tmp_path):
    path = tmp_path / "long.bin"
    n = 1 << 22
    with path.open("wb") as file:
        file.truncate(5 * n)  # zeros: OFF events at (0, 0)
    tracemalloc.start()
    assert sum(len(block.t_us) for block in recording(path, NMNIST, 34, 34, False, [])) == n
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16e6
