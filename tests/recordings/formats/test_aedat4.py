"""AEDAT 4: a recorded file, files written here by the specification, and broken ones."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import BLOCK_EVENTS, Repairs, aedat4, detect
from dse.recordings.formats.aedat4 import Aedat4
from dse.records import Block
from tests.recordings.formats.reading import events, faulty, many, part, peak_bytes, read, refused, same

VERSION = b"#!AER-DAT4.0\r\n"
NONE, LZ4, LZ4_HIGH, ZSTD, ZSTD_HIGH = range(5)
COMPRESS: dict[int, Callable[[bytes], bytes]] = {
    NONE: bytes,
    LZ4: lz4.frame.compress,
    LZ4_HIGH: lambda data: lz4.frame.compress(data, compression_level=9),
    ZSTD: zstandard.ZstdCompressor().compress,
    ZSTD_HIGH: zstandard.ZstdCompressor(level=15, write_content_size=False).compress,
}
STREAMS = (("EVTS", (320, 240)), ("FRME", (320, 240)), ("IMUS", None))


def prefixed(kind: bytes, table: bytes) -> bytes:
    """Return a size-prefixed flatbuffer; `table`, which begins at byte 12 of it, says where its root is."""
    root = 12 + struct.unpack_from("<H", table)[0]
    root += -root % 4
    data = struct.pack("<I", root - 4) + kind + table
    return struct.pack("<I", len(data)) + data


def head(compression: int = LZ4, end: int = -1, streams: tuple = STREAMS) -> bytes:
    attr = '<attr key="{}" type="{}">{}</attr>'.format
    nodes = ""
    for i, (kind, size) in enumerate(streams):
        sides = zip(("sizeX", "sizeY"), size or (), strict=False)
        info = "".join(attr(key, "int", side) for key, side in sides)
        nodes += (
            f'<node name="{i}">{attr("typeIdentifier", "string", kind)}<node name="info">{info}</node></node>'
        )
    text = f'<dv version="2.0"><node name="outInfo">{nodes}</node></dv>'.encode()
    return VERSION + described(text, compression, end)


def described(text: bytes, compression: int, end: int) -> bytes:
    lookup = struct.pack("<5H2x", 10, 20, 4, 12, 8)  # compression, end, text within the table
    table = struct.pack("<iiIq", 12, compression, 12, end)
    return prefixed(b"IOHE", lookup + table + struct.pack("<I", len(text)) + text + b"\x00")


def content(block: Block, kind: bytes = b"EVTS") -> bytes:
    rows = np.zeros(len(block.t_us), np.dtype("<i8, <i2, <i2, u1, 3V"))
    rows["f0"], rows["f1"], rows["f2"], rows["f3"] = block.t_us, block.x, block.y, block.polarity
    table = struct.pack("<3H2xiI", 6, 8, 4, 8, 4)
    return prefixed(kind, table + struct.pack("<I", len(rows)) + rows.tobytes())


def packet(data: bytes, stream: int = 0, size: int | None = None) -> bytes:
    return struct.pack("<ii", stream, len(data) if size is None else size) + data


def coded(block: Block, compression: int = LZ4) -> bytes:
    return packet(COMPRESS[compression](content(block)))


BLOCK = many(1000, 320, 240)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.aedat4"


def test_a_recorded_file(shared_data):
    path = shared_data / "native_event_files" / "tonic_sample.aedat4"
    assert detect(path) == Aedat4() and Aedat4().frame(path) == (320, 240)
    recording, notes = read(Aedat4(), path)
    assert notes == [] and len(recording.t_us) == 111954 and recording.polarity.sum() == 55023
    assert (recording.t_us[0], recording.t_us[-1]) == (1605537493718345, 1605537494308262)
    assert (recording.x[0], recording.y[0], recording.x[-1], recording.y[-1]) == (154, 204, 88, 237)
    sums = [zlib.crc32(a.astype(np.int64).tobytes()) for a in (recording.t_us, recording.x, recording.y)]
    assert sums == [1231361461, 828355067, 2444565237]  # as three other readers decode it


@given(
    parts=st.lists(events(320, 240), max_size=4),
    compression=st.sampled_from(list(COMPRESS)),
    end=st.booleans(),
)
def test_round_trip(tmp_path_factory, parts, compression, end):
    path = tmp_path_factory.getbasetemp() / "round_trip.aedat4"
    imu = packet(COMPRESS[compression](prefixed(b"IMUS", bytes(40))), 2)
    data = b"".join(coded(block, compression) + imu for block in parts)
    table = b"a table of packets"
    header = head(compression)
    path.write_bytes(head(compression, len(header + data)) + data + table if end else header + data)
    recording, notes = read(Aedat4(), path)
    assert notes == [] and Aedat4().frame(path) == (320, 240)
    columns = {
        name: np.concatenate([[], *(getattr(block, name) for block in parts)])
        for name in ("t_us", "x", "y", "polarity")
    }
    assert same(recording, **columns)


def test_the_first_stream_of_events_is_taken(path):
    streams = (("TRIG", None), ("EVTS", (64, 48)), ("EVTS", (320, 240)))
    data = [COMPRESS[LZ4](content(part(BLOCK, slice(i, i + 10)))) for i in range(3)]
    path.write_bytes(head(streams=streams) + b"".join(packet(x, i) for i, x in enumerate(data)))
    assert Aedat4().frame(path) == (64, 48)
    assert read(Aedat4(), path)[0].t_us.tolist() == BLOCK.t_us[1:11].tolist()


def test_a_stream_without_size_has_no_frame(path):
    path.write_bytes(head(streams=(("EVTS", None),)) + coded(BLOCK))
    assert Aedat4().frame(path) is None
    assert len(read(Aedat4(), path)[0].t_us) == 1000


def test_a_large_packet_comes_in_blocks(path):
    block = many(2 * BLOCK_EVENTS + 3, 320, 240)
    path.write_bytes(head() + coded(block))
    assert same(read(Aedat4(), path)[0], block.t_us, block.x, block.y, block.polarity)
    sizes = [len(x.t_us) for x in Aedat4().blocks(path, Repairs("a", False).broken)]
    assert sizes == [BLOCK_EVENTS, BLOCK_EVENTS, 3]


def damaged(path: Path, bad: bytes, *sentences: str, compression: int = LZ4) -> None:
    """Check that a packet between two good ones is a fault, and that repair reads those."""
    first, last = (coded(part(BLOCK, x), compression) for x in (slice(0, 400), slice(400, 1000)))
    good = head(compression) + first
    found = faulty("aedat4", path, good + bad + last, 1000, f"the packet at byte {len(good)} ", *sentences)
    assert same(found, BLOCK.t_us, BLOCK.x, BLOCK.y, BLOCK.polarity)


def broken_frame() -> bytes:
    data = bytearray(coded(BLOCK))
    data[40:60] = bytes(x ^ 0xFF for x in data[40:60])
    return bytes(data)


def too_many_events() -> bytes:
    data = bytearray(content(BLOCK))
    data[28:32] = b"\xff\xff\xff\xff"
    return packet(COMPRESS[LZ4](bytes(data)))


@pytest.mark.parametrize(
    ("bad", "sentence", "repair"),
    [
        (broken_frame(), "must be an LZ4 frame: ", "drops invalid packets"),
        (packet(COMPRESS[ZSTD](content(BLOCK))), "must be an LZ4 frame: ", "drops invalid packets"),
        (packet(content(BLOCK)), "must be an LZ4 frame: ", "drops invalid packets"),
        (packet(b""), "must hold a flatbuffer of its own length, got 0 bytes", "drops invalid packets"),
        (packet(COMPRESS[LZ4](content(BLOCK, b"IMUS"))), "must hold a flatbuffer EVTS, got b'IMUS'", ""),
        (too_many_events(), "must hold 4294967295 items of 16 bytes, got 16000 bytes", ""),
        (packet(b"abc", 77), "must be of a stream in the header (0, 1, 2), got stream 77", "unknown streams"),
    ],
)
def test_a_bad_packet_among_good_ones(path, bad, sentence, repair):
    damaged(path, bad, sentence, repair)


def test_frames_of_another_compression(path):
    damaged(path, coded(BLOCK, LZ4), "must be a Zstandard frame: ", compression=ZSTD)
    damaged(path, coded(BLOCK, LZ4), "must hold a flatbuffer", compression=NONE)
    for compression in (LZ4, ZSTD):
        data = COMPRESS[compression](content(BLOCK))
        damaged(path, packet(data[: len(data) // 2]), compression=compression)


def test_a_packet_of_no_events(path):
    none = part(BLOCK, slice(0))
    path.write_bytes(head() + coded(none) + coded(BLOCK) + coded(none))
    recording, notes = read(Aedat4(), path)
    assert notes == [] and len(recording.t_us) == 1000


@given(data=st.data())
def test_damaged_places_within_a_flatbuffer(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "damaged.aedat4"
    whole = bytearray(content(part(BLOCK, slice(0, 3))))
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, 31))] = data.draw(st.integers(0, 255))
    path.write_bytes(head(NONE) + packet(bytes(whole)) + coded(BLOCK, NONE))
    recording, notes = read(Aedat4(), path, repair=True)
    assert len(recording.t_us) >= 1000 and len(notes) <= 1
    assert recording.t_us[-1000:].tolist() == BLOCK.t_us.tolist()


@pytest.mark.parametrize("compression", [LZ4, ZSTD, ZSTD_HIGH])
def test_a_packet_that_grows_without_end_or_is_too_long(path, compression, monkeypatch):
    monkeypatch.setattr(aedat4, "_MOST_BYTES", 1 << 15)
    bad = packet(COMPRESS[compression](bytes(1 << 22)))
    damaged(path, bad, "must hold at most 32768 bytes after decompression, got more", compression=compression)
    damaged(
        path, packet(bytes(40000)), "must be at most 32768 bytes long, got 40000", compression=compression
    )


@pytest.mark.parametrize("size", [2**31 - 1, -1, -(2**31)])
def test_an_absurd_length_ends_the_reading(path, size):
    good = head() + coded(BLOCK)
    bad = packet(b"abc", 0, size) + coded(BLOCK)
    got = f"{len(good)} must end within the {len(bad)} bytes left, got a length of {size} bytes"
    faulty("aedat4", path, good + bad, 1000, got, f"({len(bad)} in all)")


@pytest.mark.parametrize("left", [3, 8, 100])
def test_cut_in_a_packet(path, left):
    good = head() + coded(BLOCK)
    sentence = f"the packet at byte {len(good)} must end within the {left} bytes left, got "
    faulty("aedat4", path, good + coded(BLOCK)[:left], 1000, sentence, f"({left} in all)")


def test_cut_between_packets_shows_by_the_missing_table(path):
    length = len(head() + 2 * coded(BLOCK))
    sentence = f"byte {len(head() + coded(BLOCK))}, got byte {length}; --repair reads the packets that are"
    faulty("aedat4", path, head(end=length) + coded(BLOCK), 1000, "the table of packets must begin", sentence)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file must begin with the line '#!AER-DAT4.0' at byte 0, it is empty"),
        (b"#!AER-DAT4.1\r\n", "it begins with b'#!AER-DAT4.1'"),
        (VERSION, "the header at byte 14 must state its length within the 0 bytes left, got 0"),
        (VERSION + b"\xff\xff\xff\x7fabc", "must state its length within the 7 bytes left, got 2147483647"),
        (head()[:200], "the header at byte 14 must state its length within the 186 bytes left, got "),
        (VERSION + struct.pack("<I", 40) + bytes(40), "must hold a flatbuffer IOHE, got b'"),
        (VERSION + described(b"<dv>", 1, -1), "must describe the streams in XML: no element"),
        (VERSION + described(b"", 1, -1), "must describe the streams in XML: no element"),
        (head(streams=(("EVTS", (320, 0)),)), "in XML: a stream must be at least 1 x 1, got 320 x 0"),
        (head(streams=(("EVTS", ("a", 9)),)), "must describe the streams in XML: invalid literal"),
        (head(7), "must state a compression from 0 (none) to 4, got 7"),
        (head(-1), "must state a compression from 0 (none) to 4, got -1"),
        (head(streams=(("IMUS", None),)), "must describe a stream of type EVTS, got 0 of type IMUS"),
        (head(streams=()), "must describe a stream of type EVTS, got none"),
    ],
)
def test_a_header_that_is_not_sound_is_refused_even_with_repair(path, data, sentence):
    refused("aedat4", path, data, sentence)
    with pytest.raises(RecordingError):
        Aedat4().frame(path)


@given(damage=st.lists(st.tuples(st.integers(0, 59), st.integers(0, 255)), min_size=1, max_size=4))
def test_a_damaged_header_gives_a_sentence_or_is_read(tmp_path_factory, damage):
    path = tmp_path_factory.getbasetemp() / "damaged_head.aedat4"
    data = bytearray(head() + coded(BLOCK))
    for place, value in damage:
        data[place] = value
    path.write_bytes(bytes(data))
    try:
        read(Aedat4(), path, repair=True)
    except RecordingError as recording:
        assert str(recording).startswith("damaged_head.aedat4: ")


def test_memory_does_not_follow_the_length(path):
    path.write_bytes(head() + 24 * coded(many(BLOCK_EVENTS, 320, 240)))
    n, peak = peak_bytes(Aedat4(), path)
    assert n == 24 * BLOCK_EVENTS and peak < 120 * BLOCK_EVENTS
