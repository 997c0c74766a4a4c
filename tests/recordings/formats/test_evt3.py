"""EVT 3.0: a real recording, round trips with and without vectors, and files that are not sound."""

from __future__ import annotations

import tracemalloc
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import BLOCK_EVENTS, Repairs, evt3, named, words
from tests.recordings.formats.encoders import (
    event_lists,
    events_of,
    evt3_base,
    evt3_high,
    evt3_low,
    evt3_vector,
    evt3_words,
    evt3_x,
    evt3_y,
    raw,
    recording,
)

EVT3 = named("evt3")
HEADER = "% evt 3.0\n% geometry 1280x720\n"
ONE = [(70, 3, 4, 1)]
START = [evt3_high(0), evt3_low(70), evt3_y(4)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("evt3")


def read(folder, content, repair=False):
    """Return the events of a file, and the notes on its repair."""
    path = folder / "a.raw"
    path.write_bytes(content)
    repairs = Repairs(path.name, repair)
    return events_of(EVT3.blocks(path, repairs.broken)), repairs.notes


def test_a_real_recording(shared_data):
    """Addresses and polarities are those of another reader, and times but for what it adds by mistake.

    That reader takes every fall of the lower 12 bits for a carry, also where a new time high already holds it
    and where the camera stepped back without an event: 4096 us too much from each of 11 places on. The time
    high of the file rises twice, so it cannot be longer than 3 x 4096 us; the reference lasts 53857 us.
    """
    folder = shared_data / "native_event_files"
    path = folder / "expelliarmus_evt3_sample.raw"
    reference = np.load(folder / "expelliarmus_evt3_sample_decoded.npz")
    blocks = list(recording(path, EVT3, 1280, 720, False, []))
    t_us, x, y, polarity = (
        np.concatenate([getattr(block, key) for block in blocks]) for key in ("t_us", "x", "y", "polarity")
    )
    assert len(t_us) == 219596
    for ours, key in ((x, "x"), (y, "y"), (polarity, "p")):
        np.testing.assert_array_equal(ours, reference[key])
    raw_words = np.frombuffer(path.read_bytes()[166:], dtype="<u2")
    n_events = np.where(raw_words >> 12 == 0x2, 1, 0)
    for kind, wide in ((0x4, 12), (0x5, 8)):
        vector = raw_words >> 12 == kind
        n_events[vector] = np.bitwise_count(raw_words[vector] & ((1 << wide) - 1))
    lows = np.flatnonzero(raw_words >> 12 == 0x6)
    falls = lows[1:][np.diff(raw_words[lows].astype(int)) < 0]
    assert len(falls) == 11
    added = np.searchsorted(np.cumsum(n_events)[falls], np.arange(len(t_us)), side="right")
    np.testing.assert_array_equal(t_us + 4096 * added, reference["t"])


@given(
    event_lists(1 << 20, 1279), st.integers(0, (1 << 24) - 1), st.integers(1, 9), st.sampled_from([0, 8, 12])
)
@example([(k << 20, k, k, 1) for k in range(40)], 0, 3, 0)  # twice over the 24 bits of the time
@example([(0, x, 0, 1) for x in range(0, 60, 3)], 0, 1, 12)  # a vector base carried from block to block
def test_round_trip_with_any_block_borders(folder, events, start, block, wide):
    events = [(start + t - events[0][0], x, y, p) for t, x, y, p in events]
    content = raw(evt3_words(events, wide), 2, HEADER)
    with patch.object(words, "BLOCK_EVENTS", block), patch.object(evt3, "BLOCK_EVENTS", 11 + block):
        assert read(folder, content) == (events, [])


def test_every_bit_of_a_vector_is_a_column(folder):
    vectors = [
        evt3_base(10, 1),
        evt3_vector(0b100000000001, 12),
        evt3_vector(0b10000010, 8),
        evt3_vector(0, 12),
    ]
    last = [evt3_x(5, 0), evt3_vector(1, 8)]  # a single event leaves the vector base and its polarity
    columns = [(10, 1), (21, 1), (23, 1), (29, 1), (5, 0), (42, 1)]
    assert read(folder, raw([*START, *vectors, *last], 2, HEADER))[0] == [(70, x, 4, p) for x, p in columns]


def test_vectors_over_the_edge_of_the_frame(folder):
    path = folder / "edge.raw"
    path.write_bytes(
        raw(
            [*START, evt3_base(1272, 1), evt3_vector(0xFFF, 12), evt3_base(2047, 0), evt3_vector(3, 8)],
            2,
            HEADER,
        )
    )
    with pytest.raises(
        RecordingError, match=r"event 8 must have its \(x, y\) within the frame of 1280 x 720 .*got 1280, 4;"
    ):
        list(recording(path, EVT3, 1280, 720, False, []))
    notes: list[str] = []
    events = events_of(recording(path, EVT3, 1280, 720, True, notes))
    assert [x for _, x, _, _ in events] == list(range(1272, 1280))
    assert len(notes) == 1 and notes[0].endswith("drops events outside the frame (6 in all)")


def test_bits_beyond_eight_are_no_columns(folder):
    assert read(folder, raw([*START, evt3_base(0, 0), evt3_vector(0xF01, 8)], 2, HEADER))[0] == [
        (70, 0, 4, 0)
    ]


def test_time_high_repeated_keeps_the_lower_bits_and_a_new_one_clears_them(folder):
    content = [*START, evt3_high(0), evt3_x(1, 0), evt3_high(1), evt3_x(2, 0), evt3_low(5), evt3_x(3, 0)]
    assert [t for t, *_ in read(folder, raw(content, 2, HEADER))[0]] == [70, 4096, 4101]


def test_a_step_back_between_events_is_no_overflow(folder):
    content = [
        evt3_high(0),
        evt3_y(4),
        evt3_low(800),
        evt3_x(1, 0),
        evt3_low(811),
        evt3_low(801),
        evt3_x(1, 0),
    ]
    assert [t for t, *_ in read(folder, raw(content, 2, HEADER))[0]] == [800, 801]


def test_times_that_run_backwards_are_not_an_overflow(folder):
    path = folder / "back.raw"
    path.write_bytes(raw([evt3_y(0), evt3_high(2000), evt3_x(1, 0), evt3_high(3), evt3_x(2, 0)], 2, HEADER))
    with pytest.raises(RecordingError, match=r"event 1 must not be earlier .* got 12288, 8192000"):
        list(recording(path, EVT3, 1280, 720, False, []))
    assert [t for t, *_ in events_of(recording(path, EVT3, 1280, 720, True, []))] == [8192000, 8192000]


def test_triggers_continuations_and_the_words_of_others_are_skipped(folder):
    extra = [0xA001, 0x7003, 0xE123, 0xFFFF]
    assert read(folder, raw([*extra, *evt3_words(ONE), *extra], 2, HEADER)) == (ONE, [])


@pytest.mark.parametrize(
    "before",
    [
        [evt3_y(4), evt3_base(0, 1), evt3_x(1, 0), evt3_vector(0b11, 12)],  # no time high
        [evt3_high(0), evt3_low(1), evt3_base(0, 1), evt3_x(1, 0), evt3_vector(0b11, 12)],  # no row
        [evt3_high(0), evt3_y(3), evt3_vector(0b110, 12), evt3_vector(0b1, 8)],  # no vector base
    ],
)
def test_events_whose_time_row_or_column_was_never_stated(folder, before):
    content = raw([*before, *evt3_words(ONE)], 2, HEADER)
    with pytest.raises(
        RecordingError, match=r"^a\.raw: events must not come before the first time high, .* got 3 "
    ):
        read(folder, content)
    events, notes = read(folder, content, repair=True)
    assert events == ONE and notes[0].endswith("(3 in all)")


def test_words_of_unknown_type(folder):
    content = raw([*evt3_words(ONE), 0x1000, 0xD000], 2, HEADER)
    with pytest.raises(
        RecordingError, match=rf"word type .* EVT 3\.0, got 0x1 at byte {len(content) - 4}; --repair"
    ):
        read(folder, content)
    events, notes = read(folder, content, repair=True)
    assert events == ONE and notes[0].endswith("skips words of unknown type (2 in all)")


@pytest.mark.parametrize("header", ["", "% Date today\n", "evt 3.0\n"])
def test_a_header_without_the_encoding(folder, header):
    with pytest.raises(
        RecordingError, match=r"the header must state .* '% evt 3\.0', which is missing; --repair reads"
    ):
        read(folder, raw(evt3_words(ONE), 2, header))
    assert read(folder, raw(evt3_words(ONE), 2, header), repair=True)[0] == ONE


def test_another_version_is_an_error_even_with_repair(folder):
    for repair in (False, True):
        with pytest.raises(
            RecordingError, match=r"^a\.raw: the encoding must be EVT 3\.0 .*got '% evt 2\.0'$"
        ):
            read(folder, raw(evt3_words(ONE), 2, "% evt 2.0\n"), repair)


def test_a_cut_last_word(folder):
    content = raw(evt3_words(ONE), 2, HEADER)
    with pytest.raises(
        RecordingError, match=f"the last word must have 2 bytes, got 1 at byte {len(content)}; --repair"
    ):
        read(folder, content + b"\x20")
    events, notes = read(folder, content + b"\x20", repair=True)
    assert events == ONE and len(notes) == 1


def test_no_events(folder):
    assert read(folder, HEADER.encode()) == ([], [])
    assert read(folder, raw(START, 2, HEADER)) == ([], [])


def test_memory_does_not_follow_the_length(tmp_path):
    path = tmp_path / "long.raw"
    dense = np.full(1 << 19, evt3_vector(0xFFF, 12), dtype="<u2")
    dense[::100] = evt3_base(0, 1)
    path.write_bytes(raw([*START, *dense], 2, HEADER))
    with path.open("r+b") as file:
        file.truncate(1 << 26)  # then zeros: row 0, over and over

    n_events = 0
    tracemalloc.start()
    for block in recording(path, EVT3, 1280, 720, False, []):
        assert len(block.t_us) <= BLOCK_EVENTS
        n_events += len(block.t_us)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert n_events == 12 * np.count_nonzero(dense >> 12 == 0x4)
    assert peak < 12e6
