"""AEDAT 3.1: files written here by the specification, and broken ones."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import BLOCK_EVENTS, Repairs, detect
from dse.recordings.formats.aedat31 import Aedat31
from dse.recordings.formats.checked import checked
from dse.records import Block
from tests.recordings.formats.reading import events, many, peak_bytes, read, same

VERSION = b"#!AER-DAT3.1\r\n"
END = b"#!END-HEADER\r\n"
SPECIAL, POLARITY, FRAME, IMU6 = range(4)
PACKET_BYTES = 28


def head(source: str = "DAVIS240C", layout: bytes = b"RAW") -> bytes:
    named = f"#Source 1: {source}\r\n".encode()
    return (
        VERSION
        + b"#Format: "
        + layout
        + b"\r\n"
        + named
        + b"#Start-Time: 2016-04-01 12:00:00 (TZ+0100)\r\n"
        + END
    )


def packet(data: bytes, count: int, kind: int = POLARITY, **fields: int) -> bytes:
    """Return a packet; `fields` overwrite those of its header."""
    header = {
        "kind": kind,
        "source": 1,
        "size": len(data) // count if count else 8,
        "time_at": 4,
        "overflow": 0,
        "capacity": count,
        "n": count,
        "valid": count,
    }
    assert set(fields) <= set(header)
    return struct.pack("<hhiiiiii", *(header | fields).values()) + data


def coded(block: Block, **fields: int) -> bytes:
    """Return the events in packets, a new one wherever the overflow counter rises."""
    recording = b""
    counters = block.t_us >> 31
    for overflow in np.unique(counters) if len(counters) else [0]:
        part = counters == overflow
        bits = 1 | block.polarity[part].astype(np.int64) << 1 | block.y[part] << 2
        pairs = np.stack([bits | block.x[part].astype(np.int64) << 17, block.t_us[part] % (1 << 31)], axis=-1)
        recording += packet(pairs.astype("<u4").tobytes(), int(part.sum()), overflow=int(overflow), **fields)
    return recording


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.aedat"


def error(path: Path) -> str:
    with pytest.raises(RecordingError) as recording:
        read(Aedat31(), path)
    return str(recording.value)


@given(
    parts=st.lists(events(240, 180, longest_us=1 << 27), max_size=4),
    start=st.integers(0, 1 << 33),
    between=st.binary(min_size=8, max_size=40),
)
def test_round_trip(tmp_path_factory, parts, start, between):
    path = tmp_path_factory.getbasetemp() / "round_trip31.aedat"
    data, times = head(), []
    for block in parts:
        times.append(block.t_us + start)
        start = int(times[-1][-1]) if len(times[-1]) else start
        data += packet(between, 1, FRAME)
        data += coded(Block(times[-1], block.x, block.y, block.polarity))
    path.write_bytes(data)
    recording, notes = read(Aedat31(), path)
    assert notes == []
    x, y, polarity = (
        np.concatenate([[], *(getattr(block, name) for block in parts)]) for name in ("x", "y", "polarity")
    )
    assert same(recording, np.concatenate([[], *times]), x, y, polarity)


def test_bytes_by_hand(path):
    # ON at column 5, row 3; then the same but marked as invalid
    data = struct.pack("<IiIi", 5 << 17 | 3 << 2 | 2 | 1, 70, 5 << 17 | 3 << 2 | 2, 71)
    path.write_bytes(head() + packet(data, 2, overflow=2, valid=1))
    assert detect(path) == Aedat31() and Aedat31().frame(path) == (240, 180)
    assert same(read(Aedat31(), path)[0], [2 * 2**31 + 70], [5], [3], [1])


@pytest.mark.parametrize(
    ("source", "frame"),
    [("DVS128", (128, 128)), ("DAVIS346B", (346, 260)), ("DYNAPSE", None), ("File", None)],
)
def test_the_frame_is_that_of_the_source(path, source, frame):
    path.write_bytes(head(source))
    assert Aedat31().frame(path) == frame


def test_sources_of_different_sizes_have_no_frame(path):
    path.write_bytes(head("DVS128").replace(END, b"#Source 2: DAVIS240B\r\n" + END))
    assert Aedat31().frame(path) is None
    path.write_bytes(head("DVS128").replace(END, b"#-Source 2: DAVIS240B\r\n#Source 3: DVS128\r\n" + END))
    assert Aedat31().frame(path) == (128, 128)


def test_other_types_other_sources_and_empty_packets_are_passed_over(path):
    first, second = many(5, 240, 180), many(7, 100, 100)
    others = packet(bytes(8 * 3), 3, SPECIAL) + packet(bytes(36 + 2000), 1, FRAME, time_at=8)
    path.write_bytes(
        head()
        + others
        + packet(b"", 0, source=3)
        + coded(first)
        + coded(second, source=2)
        + others
        + packet(b"", 0)
    )
    recording, notes = read(Aedat31(), path)
    assert notes == [] and same(recording, first.t_us, first.x, first.y, first.polarity)


def test_a_large_packet_comes_in_blocks(path):
    block = many(2 * BLOCK_EVENTS + 3, 240, 180)
    path.write_bytes(head() + coded(block))
    assert same(read(Aedat31(), path)[0], block.t_us, block.x, block.y, block.polarity)
    sizes = [len(x.t_us) for x in Aedat31().blocks(path, Repairs("a", False).broken)]
    assert sizes == [BLOCK_EVENTS, BLOCK_EVENTS, 3]


@pytest.mark.parametrize(("missing", "whole"), [(1, 2), (8, 2), (12, 1), (24, 0)])
def test_cut_in_a_packet(path, missing, whole):
    block = many(3, 240, 180)
    data = head() + coded(block) + coded(block)
    path.write_bytes(data[:-missing])
    at = len(head()) + PACKET_BYTES + 24
    assert error(path).startswith(
        f"a.aedat: the packet at byte {at} must hold 3 events of 8 bytes, but the file ends after {whole} "
        "of them"
    )
    recording, notes = read(Aedat31(), path, repair=True)
    assert recording.t_us.tolist() == [0, 3, 6, 0, 3, 6][: 3 + whole]
    assert len(notes) == 1 and (f"({3 - whole} in all)" in notes[0]) == (whole < 2)


def test_cut_in_a_packet_header(path):
    data = head() + coded(many(3, 240, 180))
    path.write_bytes(data + packet(b"", 0)[:10])
    sentence = (
        f"a.aedat: the packet header at byte {len(data)} must have 28 bytes, but the file ends after 10"
    )
    assert error(path).startswith(sentence)
    recording, notes = read(Aedat31(), path, repair=True)
    assert len(recording.t_us) == 3 and notes == [f"{sentence}; --repair drops a truncated packet header"]


@pytest.mark.parametrize(
    "fields",
    [
        {"size": -8},
        {"size": 0},
        {"size": 3},
        {"time_at": 5},
        {"time_at": -1},
        {"n": -1, "capacity": -1, "valid": -1},
        {"n": 2},
        {"capacity": 2**31 - 1},
        {"valid": 4},
        {"kind": -1},
        {"source": -5},
        {"overflow": -1},
    ],
)
def test_a_packet_header_that_is_not_sound_ends_the_reading(path, fields):
    block = many(3, 240, 180)
    good = head() + coded(block)
    bad = packet(bytes(24), 3, **fields) + coded(block)
    path.write_bytes(good + bad)
    assert f"a.aedat: the packet header at byte {len(good)} must hold sizes" in error(path)
    recording, notes = read(Aedat31(), path, repair=True)
    assert len(recording.t_us) == 3
    assert notes[0].endswith(f"--repair drops the bytes after an invalid packet header ({len(bad)} in all)")


@pytest.mark.parametrize("kind", [POLARITY, FRAME])
def test_an_absurd_packet_takes_no_memory(path, kind):
    n = 2**31 - 1
    path.write_bytes(head() + packet(bytes(80), 0, kind, size=8, capacity=n, n=n, valid=n))
    assert "must hold 2147483647 events of 8 bytes, but the file ends after 10 of them" in error(path)
    recording, notes = read(Aedat31(), path, repair=True)
    assert len(recording.t_us) == 0 and notes[0].endswith(
        f"({n - 10} in all)"
    )  # all of them marked as invalid


def test_polarity_events_of_another_layout_are_left_out(path):
    block = many(3, 240, 180)
    path.write_bytes(head() + packet(bytes(36), 3) + coded(block))
    at = len(head())
    assert f"the polarity events of the packet at byte {at} must be 8 bytes long" in error(path)
    recording, notes = read(Aedat31(), path, repair=True)
    assert same(recording, block.t_us, block.x, block.y, block.polarity) and len(notes) == 1


def test_times_after_a_reset_are_left_to_the_check(path):
    block = many(3, 240, 180)
    path.write_bytes(head() + coded(block) + coded(block))
    recording, notes = read(Aedat31(), path)
    assert recording.t_us.tolist() == [0, 3, 6, 0, 3, 6] and notes == []


def test_a_header_alone_has_no_events(path):
    path.write_bytes(head())
    repairs = Repairs("a.aedat", False)
    with pytest.raises(RecordingError, match=r"a\.aedat: .*got none"):
        list(checked(Aedat31().blocks(path, repairs.broken), 240, 180, repairs.broken))


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file must begin with the line '#!AER-DAT3.1' at byte 0, it is empty"),
        (
            b"#!AER-DAT3.0\r\n",
            "must begin with the line '#!AER-DAT3.1' at byte 0, it begins with b'#!AER-DAT3.0'",
        ),
        (
            VERSION + b"#Format: RAW\r\n",
            "the header must end with the line '#!END-HEADER', got the end of the file at",
        ),
        (VERSION + b"#Source 1: DVS128\r\n\x01\x00", "'#!END-HEADER', got b'\\x01\\x00' at byte 33"),
        (head(layout=b"SerializedTS"), "the header's Format must be RAW, got 'SerializedTS' at byte 14"),
        (b"\x00\xff" * 50, "must begin with the line '#!AER-DAT3.1' at byte 0, it begins with b'\\x00\\xff"),
    ],
)
def test_a_header_that_is_not_sound_is_refused_even_with_repair(path, data, sentence):
    path.write_bytes(data)
    assert sentence in error(path)
    with pytest.raises(RecordingError):
        read(Aedat31(), path, repair=True)


def test_version_3_0_is_refused_with_a_reason(path):
    path.write_bytes(b"#!AER-DAT3.0\r\n" + bytes(60))
    assert detect(path) == Aedat31()


@pytest.mark.parametrize("packets", [1, 24])
def test_memory_does_not_follow_the_length_of_file_or_packet(path, packets):
    block = many(24 * BLOCK_EVENTS // packets, 240, 180)
    path.write_bytes(head() + packets * coded(block))
    n, peak = peak_bytes(Aedat31(), path)
    assert n == 24 * BLOCK_EVENTS and peak < 60 * BLOCK_EVENTS
