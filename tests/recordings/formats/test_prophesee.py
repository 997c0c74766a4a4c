"""DAT, EVT 2.0 and EVT 3.0: real recordings, round trips, and files that are not sound."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dse.recordings import RecordingError, formats
from dse.recordings.formats import named, prophesee
from tests.recordings.formats.encoders import (
    dat,
    event_lists,
    events_of,
    evt2_event,
    evt2_high,
    evt2_words,
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
from tests.recordings.formats.reading import faulty, peak_bytes, read, refused, tuples

ONE = [(70, 3, 4, 1)]
EVT2 = "% Date 2020-09-14 09:03:25\n% evt 2.0\n% geometry 640x480\n% end\n"
EVT3 = "% evt 3.0\n% geometry 1280x720\n"
START = [evt3_high(0), evt3_low(70), evt3_y(4)]
FILES: dict[str, Callable[..., bytes]] = {
    "dat": lambda events, header="% Version 2\n": dat(events, header),
    "evt2": lambda events, header=EVT2: raw(evt2_words(events), 4, header),
    "evt3": lambda events, header=EVT3: raw(evt3_words(events), 2, header),
}
WORD_BYTES = {"dat": 8, "evt2": 4, "evt3": 2}
every_format = pytest.mark.parametrize("name", list(FILES))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("prophesee") / "a.raw"


def found(name: str, path: Path, content: bytes) -> list[tuple[int, int, int, int]]:
    path.write_bytes(content)
    events, notes = read(named(name), path)
    assert notes == []
    return tuples(events)


def test_real_recordings(shared_data: Path) -> None:
    folder = shared_data / "native_event_files"
    path = folder / "tonic_sample_ncars.dat"
    assert named("dat").frame(path) is None
    events = events_of(recording(path, named("dat"), 78, 42, False, []))
    assert len(events) == 2009
    assert (events[0], events[1], events[-1]) == ((0, 25, 8, 0), (35, 67, 35, 0), (99952, 75, 28, 1))
    path = folder / "expelliarmus_evt2_sample.raw"
    blocks = list(recording(path, named("evt2"), 640, 480, False, []))
    polarity = np.concatenate([block.polarity for block in blocks])
    assert (len(polarity), polarity.sum()) == (539481, 367855)
    assert (max(block.x.max() for block in blocks), max(block.y.max() for block in blocks)) == (599, 475)
    assert (blocks[0].t_us[0], blocks[-1].t_us[-1]) == (1317888, 1367888)


def test_a_real_recording_of_evt3(shared_data: Path) -> None:
    """Addresses and polarities are those of another reader, and times but for what it adds by mistake.

    That reader takes every fall of the lower 12 bits for a carry, also where a new time high already holds it
    and where the camera stepped back without an event: 4096 us too much from each of 11 places on. The time
    high of the file rises twice, so it cannot be longer than 3 x 4096 us; the reference lasts 53857 us.
    """
    folder = shared_data / "native_event_files"
    path = folder / "expelliarmus_evt3_sample.raw"
    reference = np.load(folder / "expelliarmus_evt3_sample_decoded.npz")
    events, _ = read(named("evt3"), path)
    assert len(events.t_us) == 219596
    for ours, key in ((events.x, "x"), (events.y, "y"), (events.polarity, "p")):
        np.testing.assert_array_equal(ours, reference[key])
    words = np.frombuffer(path.read_bytes()[166:], dtype="<u2")
    n_events = np.where(words >> 12 == 0x2, 1, 0)
    for kind, wide in ((0x4, 12), (0x5, 8)):
        vector = words >> 12 == kind
        n_events[vector] = np.bitwise_count(words[vector] & ((1 << wide) - 1))
    lows = np.flatnonzero(words >> 12 == 0x6)
    falls = lows[1:][np.diff(words[lows].astype(int)) < 0]
    assert len(falls) == 11
    added = np.searchsorted(np.cumsum(n_events)[falls], np.arange(len(events.t_us)), side="right")
    np.testing.assert_array_equal(events.t_us + 4096 * added, reference["t"])


def round_trip(name: str, path: Path, events: list, start: int, period: int, block: int, content) -> None:
    """Check that events with any first time are read back, whatever the size of a block is."""
    first = start % period
    events = [(first + t - events[0][0], x, y, p) for t, x, y, p in events]
    with patch.object(formats, "BLOCK_EVENTS", block), patch.object(prophesee, "BLOCK_EVENTS", block):
        assert found(name, path, content(events)) == events


starts = st.integers(0, (1 << 34) - 1)


@given(event_lists(1 << 28, (1 << 14) - 1), starts, st.integers(1, 9))
@example([(k << 28, 0, k, 1) for k in range(40)], (1 << 32) - 1, 3)  # three wraps
def test_round_trip_of_dat(path, events, start, block):
    round_trip("dat", path, events, start, 1 << 32, block, FILES["dat"])


@given(event_lists(1 << 30, 2047), starts, st.integers(1, 9))
@example([(0, 1, 2, 1), (1 << 30, 5, 5, 0), (1 << 31, 5, 5, 0)], (1 << 34) - 1, 2)
def test_round_trip_of_evt2(path, events, start, block):
    round_trip("evt2", path, events, start, 1 << 34, block, FILES["evt2"])


@given(event_lists(1 << 20, 1279), starts, st.integers(1, 9), st.sampled_from([0, 8, 12]))
@example([(k << 20, k, k, 1) for k in range(40)], 0, 3, 0)  # twice over the 24 bits of the time
@example([(0, x, 0, 1) for x in range(0, 60, 3)], 0, 1, 12)  # a vector base carried from block to block
def test_round_trip_of_evt3(path, events, start, block, wide):
    content = lambda events: raw(evt3_words(events, wide), 2, EVT3)  # noqa: E731
    round_trip("evt3", path, events, start, 1 << 24, block, content)


@every_format
def test_no_events_and_a_cut_last_word(path: Path, name: str) -> None:
    assert found(name, path, FILES[name]([])) == []
    content = FILES[name](ONE)
    for cut in range(1, WORD_BYTES[name]):
        sentence = f"last word must have {WORD_BYTES[name]} bytes, got {cut} at byte {len(content)}"
        assert tuples(faulty(name, path, content + b"\1" * cut, 1, sentence)) == ONE


@every_format
def test_times_that_run_backwards_are_no_wrap(path: Path, name: str) -> None:
    back, ahead = [(6000, 1, 1, 0), (7, 2, 2, 1)], {"dat": 1 << 30, "evt2": 1 << 33, "evt3": 1 << 22}[name]
    events = [(t + ahead * (k == 0), *rest) for k, (t, *rest) in enumerate(back)]
    path.write_bytes(FILES[name](events))
    with pytest.raises(RecordingError, match=rf"event 1 must not be earlier .* got 7, {6000 + ahead}"):
        list(recording(path, named(name), 10, 10, False, []))
    mended = events_of(recording(path, named(name), 10, 10, True, []))
    assert [t for t, *_ in mended] == [6000 + ahead] * 2


@pytest.mark.parametrize(
    ("name", "header", "frame"),
    [
        ("evt2", EVT2, (640, 480)),
        ("evt2", "% format EVT2;height=720;width=1280\n", (1280, 720)),
        ("evt2", "% evt 2.0\n% geometry 0x480\n", None),
        ("evt2", "% evt 2.0\n% geometry wide\n", None),
        ("evt3", "% evt 3.0\n", None),
        (
            "dat",
            "% Data file containing Event2D events.\n% Version 2\n% Height 240\n% Width 304\n",
            (304, 240),
        ),
        ("dat", "% Version 2\n% Width 304\n", None),
    ],
)
def test_the_frame_is_that_of_the_header(path, name, header, frame):
    content = FILES[name](ONE, header)
    assert found(name, path, content) == ONE
    assert named(name).frame(path) == frame and named(name).matches(path, content)


@pytest.mark.parametrize("header", ["", "% Date today\n", "evt 2.0\n", "% evt\x00 2.0\n\x00"])
def test_a_header_without_the_encoding(path, header):
    n_bytes = 13 if "Date" in header else 0
    for name, version in (("evt2", "2.0"), ("evt3", "3.0")):
        content = FILES[name](ONE, header.replace("2.0", version) + "\0" * (len(header) % WORD_BYTES[name]))
        if (len(content) - n_bytes) % WORD_BYTES[name]:
            continue
        sentence = f"reads the data after {n_bytes} bytes of header as EVT {version}"
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=rf"must state the encoding in a line '% evt {version}'"):
            read(named(name), path)
        assert any(note.endswith(sentence) for note in read(named(name), path, repair=True)[1])
    for header in ("", "% Width 304\n"):
        text = f"'% Version 2', which is missing; --repair reads the data after {len(header)} bytes"
        faulty("dat", path, dat(ONE, header), 1, text)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("evt2", FILES["evt2"](ONE, "% evt 3.0\n"), "must be EVT 2.0 for this reader, got '% evt 3.0'"),
        ("evt2", FILES["evt2"](ONE, "% format EVT21;height=7;width=9\n"), "got '% evt 2.1'"),
        ("evt3", FILES["evt3"](ONE, "% evt 2.0\n"), "must be EVT 3.0 for this reader, got '% evt 2.0'"),
        ("evt2", FILES["evt2"](ONE, "% evt 2.0\n% endianness big\n"), "endianness must be little, got 'big'"),
        ("evt2", b"% evt 2.0\n" + b"% more\n" * 20_000, "the header must end within 64512 bytes"),
        ("dat", dat(ONE, "% Version 3\n"), "the version of a DAT file must be 2, got '3'"),
        ("dat", dat([], mark=b"\x0e\x08"), "bytes 12 and 13 must be the event type 0 or 12 and the event"),
        ("dat", dat([], mark=b"\x00\x10"), "got 0 and 16"),
        ("dat", dat([], mark=b""), "got the end of the file"),
    ],
)
def test_another_version_or_header_is_an_error_even_with_repair(path, name, content, sentence):
    refused(name, path, content, sentence)


def test_words_that_begin_with_a_percent_sign_are_no_header(path):
    words = evt2_words([(0, 0, 37, 0), (0, 1, 37, 1)])[1:]  # 37 is '%'
    content = raw([evt2_high(0x20 << 8 | 37)], 4, EVT2) + np.array(words, dtype="<u4").tobytes()
    t_us = (0x20 << 8 | 37) << 6
    assert found("evt2", path, content) == [(t_us, 0, 37, 0), (t_us, 1, 37, 1)]
    headless = content.replace(EVT2.encode(), EVT2.replace("% end\n", "").encode())
    assert found("evt2", path, headless)[0] == (t_us, 0, 37, 0)


def test_other_words_are_skipped_and_unknown_ones_are_a_fault(path):
    extra = [0xA << 28 | 5, 0xE << 28, 0xF << 28 | 1, *evt2_words(ONE), 0xA << 28]
    assert found("evt2", path, raw(extra, 4, EVT2)) == ONE
    extra = [0xA001, 0x7003, 0xE123, 0xFFFF]
    assert found("evt3", path, raw([*extra, *evt3_words(ONE), *extra], 2, EVT3)) == ONE
    content = raw([*evt2_words(ONE), 0x9 << 28, 0x2 << 28], 4, EVT2)
    sentence = f"one of EVT 2.0, got 0x9 at byte {len(EVT2) + 8}"
    faulty("evt2", path, content, 1, sentence, "skips words of unknown type (2 in all)")
    content = raw([*evt3_words(ONE), 0x1000, 0xD000], 2, EVT3)
    faulty("evt3", path, content, 1, f"one of EVT 3.0, got 0x1 at byte {len(content) - 4}", "(2 in all)")


@pytest.mark.parametrize(
    ("name", "before", "n"),
    [
        ("evt2", [evt2_event(1, 2, 3, 0), evt2_event(2, 2, 3, 1)], 2),
        ("evt3", [evt3_y(4), evt3_base(0, 1), evt3_x(1, 0), evt3_vector(0b11, 12)], 3),  # no time high
        (
            "evt3",
            [evt3_high(0), evt3_low(1), evt3_base(0, 1), evt3_x(1, 0), evt3_vector(0b11, 12)],
            3,
        ),  # no row
        ("evt3", [evt3_high(0), evt3_y(3), evt3_vector(0b110, 12), evt3_vector(0b1, 8)], 3),  # no vector base
    ],
)
def test_events_whose_time_row_or_column_was_never_stated(path, name, before, n):
    words, size, header = {"evt2": (evt2_words, 4, EVT2), "evt3": (evt3_words, 2, EVT3)}[name]
    sentence = f"got {n} from byte {len(header)} on; --repair drops events before the first time high"
    content = raw([*before, *words(ONE)], size, header)
    assert tuples(faulty(name, path, content, 1, sentence, f"({n} in all)")) == ONE


def test_every_bit_of_a_vector_is_a_column(path):
    vectors = [
        evt3_base(10, 1),
        evt3_vector(0b100000000001, 12),
        evt3_vector(0b10000010, 8),
        evt3_vector(0, 12),
    ]
    last = [evt3_x(5, 0), evt3_vector(1, 8)]  # a single event leaves the vector base and its polarity
    columns = [(10, 1), (21, 1), (23, 1), (29, 1), (5, 0), (42, 1)]
    assert found("evt3", path, raw([*START, *vectors, *last], 2, EVT3)) == [(70, x, 4, p) for x, p in columns]
    eight = raw([*START, evt3_base(0, 0), evt3_vector(0xF01, 8)], 2, EVT3)
    assert found("evt3", path, eight) == [(70, 0, 4, 0)]


def test_vectors_over_the_edge_of_the_frame(path):
    words = [*START, evt3_base(1272, 1), evt3_vector(0xFFF, 12), evt3_base(2047, 0), evt3_vector(3, 8)]
    path.write_bytes(raw(words, 2, EVT3))
    with pytest.raises(RecordingError, match=r"event 8 must have its \(x, y\) within .*got 1280, 4;"):
        list(recording(path, named("evt3"), 1280, 720, False, []))
    notes: list[str] = []
    events = events_of(recording(path, named("evt3"), 1280, 720, True, notes))
    assert [x for _, x, _, _ in events] == list(range(1272, 1280))
    assert len(notes) == 1 and notes[0].endswith("drops events outside the frame (6 in all)")


def test_time_high_repeated_keeps_the_lower_bits_and_a_new_one_clears_them(path):
    words = [*START, evt3_high(0), evt3_x(1, 0), evt3_high(1), evt3_x(2, 0), evt3_low(5), evt3_x(3, 0)]
    assert [t for t, *_ in found("evt3", path, raw(words, 2, EVT3))] == [70, 4096, 4101]
    words = [evt3_high(0), evt3_y(4), evt3_low(800), evt3_x(1, 0), evt3_low(811), evt3_low(801), evt3_x(1, 0)]
    assert [t for t, *_ in found("evt3", path, raw(words, 2, EVT3))] == [800, 801]  # no overflow


def test_other_polarities_of_dat_are_a_fault(path):
    path.write_bytes(dat([(1, 0, 0, 9)]))
    with pytest.raises(RecordingError, match="event 0 must have polarity 0 or 1, got 9; --repair"):
        list(recording(path, named("dat"), 10, 10, False, []))
    assert found("dat", path, dat(ONE, mark=b"\x00\x08")) == ONE


@every_format
def test_memory_does_not_follow_the_length(path, name):
    n = 1 << 21
    path.write_bytes(FILES[name]([(0, 0, 0, 0)]))
    if name == "evt3":
        dense = np.full(n // 12, evt3_vector(0xFFF, 12), dtype="<u2")
        dense[::100] = evt3_base(0, 1)
        path.write_bytes(raw([*START, *dense], 2, EVT3))
    else:
        with path.open("r+b") as file:
            file.truncate(path.stat().st_size + WORD_BYTES[name] * n)  # zeros: OFF events at (0, 0)
    n_events, peak = peak_bytes(named(name), path)
    assert n_events > 0.9 * n and peak < 16e6
