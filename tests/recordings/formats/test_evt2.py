"""EVT 2.0: a real recording, round trips, and files that are not sound."""

from __future__ import annotations

import tracemalloc
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import Repairs, named, words
from tests.recordings.formats.encoders import (
    event_lists,
    events_of,
    evt2_event,
    evt2_high,
    evt2_words,
    raw,
    recording,
)

EVT2 = named("evt2")
HEADER = "% Date 2020-09-14 09:03:25\n% evt 2.0\n% geometry 640x480\n% end\n"
ONE = [(70, 3, 4, 1)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("evt2")


def read(folder, content, repair=False):
    """Return the events of a file, and the notes on its repair."""
    path = folder / "a.raw"
    path.write_bytes(content)
    repairs = Repairs(path.name, repair)
    return events_of(EVT2.blocks(path, repairs.broken)), repairs.notes


def test_a_real_recording(shared_data):
    path = shared_data / "native_event_files" / "expelliarmus_evt2_sample.raw"
    assert EVT2.frame(path) is None
    blocks = list(recording(path, EVT2, 640, 480, False, []))
    polarity = np.concatenate([block.polarity for block in blocks])
    assert (len(polarity), polarity.sum()) == (539481, 367855)
    assert (max(block.x.max() for block in blocks), max(block.y.max() for block in blocks)) == (599, 475)
    assert (blocks[0].t_us[0], blocks[-1].t_us[-1]) == (1317888, 1367888)


@given(event_lists(1 << 30, 2047), st.integers(0, (1 << 34) - 1), st.integers(1, 9))
@example(
    [(0, 1, 2, 1), (1 << 30, 5, 5, 0), (1 << 31, 5, 5, 0)], (1 << 34) - 1, 2
)  # over the 34 bits of the time
def test_round_trip_with_any_block_borders(folder, events, start, block):
    events = [(start + t - events[0][0], x, y, p) for t, x, y, p in events]
    with patch.object(words, "BLOCK_EVENTS", block):
        assert read(folder, raw(evt2_words(events), 4, HEADER)) == (events, [])


def test_triggers_and_the_words_of_others_are_skipped(folder):
    extra = [0xA << 28 | 5, 0xE << 28, 0xF << 28 | 1, *evt2_words(ONE), 0xA << 28]
    assert read(folder, raw(extra, 4, HEADER)) == (ONE, [])


def test_the_frame_is_that_of_the_header(folder):
    for header, frame in [
        (HEADER, (640, 480)),
        ("% format EVT2;height=720;width=1280\n", (1280, 720)),
        ("% evt 2.0\n", None),
        ("% evt 2.0\n% geometry 0x480\n", None),
        ("% evt 2.0\n% geometry wide\n", None),
    ]:
        path = folder / "frame.raw"
        path.write_bytes(raw(evt2_words(ONE), 4, header))
        assert EVT2.frame(path) == frame
        assert EVT2.matches(path, path.read_bytes())


@pytest.mark.parametrize("header", ["", "% Date today\n", "evt 2.0\n", "% evt\x00 2.0\n\x00"])
def test_a_header_without_the_encoding(folder, header):
    content = raw(evt2_words(ONE), 4, header)
    with pytest.raises(RecordingError, match=r"^a\.raw: the header must .* '% evt 2\.0', which is missing"):
        read(folder, content)
    events, notes = read(folder, content, repair=True)
    assert events == ONE
    assert notes[0].endswith(
        f"reads the data after {13 if 'Date' in header else 0} bytes of header as EVT 2.0"
    )


@pytest.mark.parametrize("header", ["% evt 3.0\n", "% evt 2.1\n", "% format EVT21;height=720;width=1280\n"])
def test_another_version_is_an_error_even_with_repair(folder, header):
    for repair in (False, True):
        with pytest.raises(
            RecordingError, match=r"^a\.raw: the encoding must be EVT 2\.0 .*got '% evt (3\.0|2\.1)'$"
        ):
            read(folder, raw(evt2_words(ONE), 4, header), repair)


def test_big_endian_words_are_an_error(folder):
    with pytest.raises(RecordingError, match=r"^a\.raw: endianness must be little, got 'big'$"):
        read(folder, raw([], 4, "% evt 2.0\n% endianness big\n"))


def test_a_header_without_end_is_an_error(folder):
    for repair in (False, True):
        with pytest.raises(RecordingError, match=r"^a\.raw: the header must end within 64512 bytes$"):
            read(folder, b"% evt 2.0\n" + b"% more\n" * 20_000, repair)


def test_an_endless_line_is_no_header(folder):
    with pytest.raises(RecordingError, match="which is missing"):
        read(folder, b"% " + b"a" * (1 << 20))


def test_words_that_begin_with_a_percent_sign_are_no_header(folder):
    events = [(0, 0, 37, 0), (0, 1, 37, 1)]  # 37 is '%'
    words_of_events = evt2_words(events)[1:]
    content = raw([evt2_high(0x20 << 8 | 37)], 4, HEADER) + np.array(words_of_events, dtype="<u4").tobytes()
    t_us = (0x20 << 8 | 37) << 6
    assert read(folder, content) == ([(t_us, 0, 37, 0), (t_us, 1, 37, 1)], [])
    headless = HEADER.replace("% end\n", "")
    assert read(folder, content.replace(HEADER.encode(), headless.encode()))[0][0] == (t_us, 0, 37, 0)


@pytest.mark.parametrize("cut", [1, 2, 3])
def test_a_cut_last_word(folder, cut):
    content = raw(evt2_words(ONE), 4, HEADER)
    with pytest.raises(
        RecordingError, match=rf"the last word must have 4 bytes, got {cut} at byte {len(content)}; --repair"
    ):
        read(folder, content + b"\0" * cut)
    events, notes = read(folder, content + b"\0" * cut, repair=True)
    assert events == ONE and len(notes) == 1


def test_events_before_the_first_time_high(folder):
    content = raw([evt2_event(1, 2, 3, 0), evt2_event(2, 2, 3, 1), *evt2_words(ONE)], 4, HEADER)
    with pytest.raises(
        RecordingError,
        match=rf"events must not come before the first time high, got 2 from byte {len(HEADER)} on",
    ):
        read(folder, content)
    events, notes = read(folder, content, repair=True)
    assert events == ONE
    assert notes == [
        f"a.raw: events must not come before the first time high, got 2 from byte {len(HEADER)} on; "
        "--repair drops events before the first time high (2 in all)"
    ]


def test_words_of_unknown_type(folder):
    content = raw([*evt2_words(ONE), 0x9 << 28, 0x2 << 28], 4, HEADER)
    with pytest.raises(
        RecordingError, match=rf"word type .* EVT 2\.0, got 0x9 at byte {len(HEADER) + 8}; --repair"
    ):
        read(folder, content)
    events, notes = read(folder, content, repair=True)
    assert events == ONE and notes[0].endswith("skips words of unknown type (2 in all)")


def test_a_time_that_runs_backwards_is_not_a_wrap(folder):
    path = folder / "back.raw"
    back = [(1 << 33, 1, 1, 0), (5, 2, 2, 1), ((1 << 33) + 1, 3, 3, 1)]
    path.write_bytes(raw(evt2_words(back), 4, HEADER))
    with pytest.raises(RecordingError, match="event 1 must not be earlier"):
        list(recording(path, EVT2, 640, 480, False, []))
    times = [t for t, *_ in events_of(recording(path, EVT2, 640, 480, True, []))]
    assert times == [1 << 33, 1 << 33, (1 << 33) + 1]


def test_no_events(folder):
    assert read(folder, HEADER.encode()) == ([], [])
    assert read(folder, raw([evt2_high(3)], 4, HEADER)) == ([], [])


def test_a_missing_file(tmp_path):
    for call in (EVT2.frame, lambda path: list(EVT2.blocks(path, Repairs(path.name, True).broken))):
        with pytest.raises(RecordingError, match=r"^none\.raw: cannot be read: No such file"):
            call(tmp_path / "none.raw")


def test_memory_does_not_follow_the_length(tmp_path):
    path = tmp_path / "long.raw"
    path.write_bytes(raw([evt2_high(0)], 4, HEADER))
    n = 1 << 23
    with path.open("r+b") as file:
        file.truncate(len(HEADER) + 4 * (n + 1))  # zeros: OFF events at (0, 0)
    list(recording(path, EVT2, 640, 480, True, []))[:0]  # compiled before memory is counted
    tracemalloc.start()
    assert sum(len(block.t_us) for block in recording(path, EVT2, 640, 480, False, [])) == n
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8e6
