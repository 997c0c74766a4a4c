"""DAT version 2: a real recording, round trips, and files that are not sound."""

from __future__ import annotations

import tracemalloc
from unittest.mock import patch

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import Repairs, named, words
from tests.recordings.formats.encoders import dat, event_lists, events_of, recording

DAT = named("dat")
ONE = [(70, 3, 4, 1)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("dat")


def read(folder, content, repair=False):
    """Return the events of a file, and the notes on its repair."""
    path = folder / "a.dat"
    path.write_bytes(content)
    repairs = Repairs(path.name, repair)
    return events_of(DAT.blocks(path, repairs.broken)), repairs.notes


def test_a_real_recording(shared_data):
    path = shared_data / "native_event_files" / "tonic_sample_ncars.dat"
    assert DAT.frame(path) is None
    events = events_of(recording(path, DAT, 78, 42, False, []))
    assert len(events) == 2009
    assert (events[0], events[1], events[-1]) == ((0, 25, 8, 0), (35, 67, 35, 0), (99952, 75, 28, 1))
    assert (max(x for _, x, _, _ in events), max(y for _, _, y, _ in events)) == (77, 41)


@given(event_lists(1 << 28, (1 << 14) - 1), st.integers(0, (1 << 32) - 1), st.integers(1, 9))
@example(
    [(k << 28, 0, k, 1) for k in range(40)], (1 << 32) - 1, 3
)  # three times over the 32 bits of the time
def test_round_trip_with_any_block_borders(folder, events, start, block):
    events = [(start + t - events[0][0], x, y, p) for t, x, y, p in events]
    with patch.object(words, "BLOCK_EVENTS", block):
        assert read(folder, dat(events)) == (events, [])


@pytest.mark.parametrize("mark", [b"\x00\x08", b"\x0c\x08"])
def test_both_event_types(folder, mark):
    assert read(folder, dat(ONE, mark=mark)) == (ONE, [])
    assert DAT.matches(folder / "a", dat(ONE, mark=mark))


def test_the_frame_is_that_of_the_header(folder):
    path = folder / "frame.dat"
    path.write_bytes(
        dat(ONE, "% Data file containing Event2D events.\n% Version 2\n% Height 240\n% Width 304\n")
    )
    assert DAT.frame(path) == (304, 240)
    path.write_bytes(dat(ONE, "% Version 2\n% Width 304\n"))
    assert DAT.frame(path) is None


def test_a_header_without_the_version(folder):
    with pytest.raises(
        RecordingError, match=r"^a\.dat: the header must state .* '% Version 2', which is missing; --repair"
    ):
        read(folder, dat(ONE, "% Width 304\n"))
    for header in ("", "% Width 304\n"):
        events, notes = read(folder, dat(ONE, header), repair=True)
        assert events == ONE and notes[0].endswith(
            f"reads the data after {len(header)} bytes of header as version 2"
        )


@pytest.mark.parametrize("version", ["1", "3", "two"])
def test_another_version_is_an_error_even_with_repair(folder, version):
    for repair in (False, True):
        with pytest.raises(
            RecordingError, match=rf"^a\.dat: the version of a DAT file must be 2, got '{version}'$"
        ):
            read(folder, dat(ONE, f"% Version {version}\n"), repair)


@pytest.mark.parametrize(
    ("mark", "got"),
    [(b"\x0e\x08", "14 and 8"), (b"\x00\x10", "0 and 16"), (b"", "the end of the file"), (b"\0", "0")],
)
def test_other_events_are_an_error_even_with_repair(folder, mark, got):
    for repair in (False, True):
        with pytest.raises(
            RecordingError, match=f"bytes 12 and 13 must be the event type 0 or 12 .* got {got}$"
        ):
            read(folder, dat([], mark=mark), repair)


def test_a_cut_last_event(folder):
    content = dat(ONE)
    for cut in range(1, 8):
        with pytest.raises(
            RecordingError, match=f"last word must have 8 bytes, got {cut} at byte {len(content)}; --repair"
        ):
            read(folder, content + b"\1" * cut)
        events, notes = read(folder, content + b"\1" * cut, repair=True)
        assert events == ONE and len(notes) == 1


@pytest.mark.parametrize("border", [1, 2])
def test_a_time_that_runs_backwards_is_not_a_wrap(folder, border):
    path = folder / "back.dat"
    path.write_bytes(dat([(5 << 28, 1, 1, 0), (7, 2, 2, 1)]))
    with patch.object(words, "BLOCK_EVENTS", border):
        with pytest.raises(RecordingError, match=r"event 1 must not be earlier .* got 7, 1342177280;"):
            list(recording(path, DAT, 10, 10, False, []))
        assert [t for t, *_ in events_of(recording(path, DAT, 10, 10, True, []))] == [5 << 28, 5 << 28]


def test_other_polarities_are_a_fault(folder):
    path = folder / "pole.dat"
    path.write_bytes(dat([(1, 0, 0, 9)]))
    with pytest.raises(RecordingError, match="event 0 must have polarity 0 or 1, got 9; --repair"):
        list(recording(path, DAT, 10, 10, False, []))


def test_no_events(folder):
    assert read(folder, dat([])) == ([], [])
    path = folder / "a.dat"
    with pytest.raises(RecordingError, match=r"^a\.dat: must have events, got none; --repair"):
        list(recording(path, DAT, 10, 10, False, []))


def test_memory_does_not_follow_the_length(tmp_path):
    path = tmp_path / "long.dat"
    path.write_bytes(dat([]))
    n = 1 << 22
    with path.open("r+b") as file:
        file.truncate(14 + 8 * n)  # zeros: OFF events at (0, 0)
    tracemalloc.start()
    assert sum(len(block.t_us) for block in recording(path, DAT, 10, 10, False, [])) == n
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 12e6
