"""Event Stream: a recorded file, files written here by the specification, and broken ones."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import BLOCK_EVENTS, Repairs, detect
from dse.recordings.formats.checked import checked
from dse.recordings.formats.es import EventStream
from dse.records import Block
from tests.recordings.formats.reading import events, many, peak_bytes, read, same

WIDTH, HEIGHT = 300, 260
DVS, ATIS = 1, 2


def head(
    kind: int = DVS, version: bytes = b"\x02\x00\x01", width: int = WIDTH, height: int = HEIGHT
) -> bytes:
    size = width.to_bytes(2, "little") + height.to_bytes(2, "little")
    return b"Event Stream" + version + bytes([kind]) + (b"" if kind == 0 else size)


def coded(block: Block, kind: int = DVS) -> bytes:
    """Return the bytes of the events: elapsed time beyond a byte's range goes before the event."""
    full = 255 >> kind
    most = (1 << kind) - 1
    recording, before = bytearray(), 0
    for t, x, y, polarity in zip(block.t_us, block.x, block.y, block.polarity, strict=True):
        steps, rest = divmod(int(t) - before, full)
        while steps:
            recording.append(full << kind | min(steps, most))
            steps -= min(steps, most)
        recording.append(rest << kind | int(polarity) << (kind - 1))
        recording += int(x).to_bytes(2, "little") + (HEIGHT - 1 - int(y)).to_bytes(2, "little")
        before = int(t)
    return bytes(recording)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.es"


def error(path: Path) -> str:
    with pytest.raises(RecordingError) as recording:
        read(EventStream(), path)
    return str(recording.value)


def test_a_recorded_file(shared_data):
    path = shared_data / "native_event_files" / "faery_dvs.es"
    assert detect(path) == EventStream() and EventStream().frame(path) == (320, 240)
    recording, notes = read(EventStream(), path)
    assert notes == [] and len(recording.t_us) == 473225 and recording.polarity.sum() == 270001
    assert (recording.t_us[0], recording.x[0], recording.y[0]) == (0, 0, 0)
    assert (recording.t_us[-1], recording.x[-1], recording.y[-1]) == (999000, 38, 193)
    sums = [zlib.crc32(a.astype(np.int64).tobytes()) for a in (recording.t_us, recording.x, recording.y)]
    assert sums == [4149783995, 2153943521, 3035768722]  # as two other readers decode it


def test_generic_events_are_refused_by_name(shared_data):
    path = shared_data / "native_event_files" / "faery_generic.es"
    with pytest.raises(RecordingError, match=r"byte 15 must be DVS or ATIS.*, got generic events"):
        EventStream().frame(path)


@given(block=events(WIDTH, HEIGHT), kind=st.sampled_from([DVS, ATIS]))
def test_round_trip(tmp_path_factory, block, kind):
    path = tmp_path_factory.getbasetemp() / "round_trip.es"
    path.write_bytes(head(kind) + coded(block, kind))
    recording, notes = read(EventStream(), path)
    assert notes == [] and same(recording, block.t_us, block.x, block.y, block.polarity)
    assert EventStream().frame(path) == (WIDTH, HEIGHT)


def test_bytes_by_hand(path):
    # 127 us, a reset, 127 us, then 5 us: ON at column 258, row 1 from the bottom
    path.write_bytes(head() + bytes([0xFF, 0xFE, 0xFF, 5 << 1 | 1, 2, 1, 1, 0]))
    recording, _ = read(EventStream(), path)
    assert same(recording, [259], [258], [HEIGHT - 2], [1])


def test_atis_threshold_crossings_pass_time_only(path):
    # 2 x 63 us, a threshold crossing after 4 us, a change (OFF) after 1 us
    path.write_bytes(head(ATIS) + bytes([0xFE, 4 << 2 | 3, 9, 0, 9, 0, 1 << 2, 7, 0, 0, 0]))
    recording, _ = read(EventStream(), path)
    assert same(recording, [131], [7], [HEIGHT - 1], [0])


@pytest.mark.parametrize("n", [BLOCK_EVENTS - 1, BLOCK_EVENTS, 2 * BLOCK_EVENTS + 3])
def test_blocks_do_not_show(path, n):
    block = many(n, WIDTH, HEIGHT)
    path.write_bytes(head() + b"\xff\xff" + coded(block))  # no event begins where a block does
    recording, _ = read(EventStream(), path)
    assert same(recording, block.t_us + 254, block.x, block.y, block.polarity)
    sizes = [len(x.t_us) for x in EventStream().blocks(path, Repairs("a", False).broken)]
    assert max(sizes) <= BLOCK_EVENTS


@pytest.mark.parametrize("left", [1, 4])
def test_cut_in_an_event(path, left):
    data = head() + coded(many(3, WIDTH, HEIGHT))
    path.write_bytes(data[: 30 + left])
    sentence = f"a.es: the event at byte 30 must have 5 bytes, but the file ends after {left}"
    assert error(path).startswith(sentence)
    recording, notes = read(EventStream(), path, repair=True)
    assert len(recording.t_us) == 2 and notes == [f"{sentence}; --repair drops a truncated event"]


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "a.es: the file must begin with 'Event Stream' at byte 0, it is empty"),
        (
            b"Event Strea",
            "a.es: the file must begin with 'Event Stream' at byte 0, it begins with b'Event Strea'",
        ),
        (head(version=b"\x01\x00\x00"), "a.es: the version at byte 12 must be 2.0, got 1.0.0"),
        (head(version=b"\x02\x01\x00"), "a.es: the version at byte 12 must be 2.0, got 2.1.0"),
        (
            head(4),
            "a.es: the type at byte 15 must be DVS or ATIS, whose events have addresses, got colour events",
        ),
        (
            head(77),
            "a.es: the type at byte 15 must be DVS or ATIS, whose events have addresses, got 77 events",
        ),
        (head()[:19], "a.es: the header must be 20 bytes long, got 19"),
        (head()[:13], "a.es: the header must be 20 bytes long, got 13"),
        (head(height=0), "a.es: the frame at byte 16 must be at least 1 x 1, got 300 x 0"),
    ],
)
def test_a_header_that_is_not_sound_is_refused_even_with_repair(path, data, sentence):
    path.write_bytes(data)
    assert error(path) == sentence
    with pytest.raises(RecordingError):
        read(EventStream(), path, repair=True)


def test_a_header_alone_has_no_events(path):
    path.write_bytes(head())
    blocks = EventStream().blocks(path, Repairs("a.es", False).broken)
    with pytest.raises(RecordingError, match=r"a\.es: .*got none"):
        list(checked(blocks, WIDTH, HEIGHT, Repairs("a.es", False).broken))


def test_memory_does_not_follow_the_length(path):
    path.write_bytes(head() + 24 * coded(many(BLOCK_EVENTS, WIDTH, HEIGHT)))
    n, peak = peak_bytes(EventStream(), path)
    assert n == 24 * BLOCK_EVENTS and peak < 60 * BLOCK_EVENTS
