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
from dse.recordings.formats.checked import checked
from dse.records import Block
from tests.recordings.formats.reading import events, many, peak_bytes, read, same

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


def part(block: Block, of: slice) -> Block:
    return Block(block.t_us[of], block.x[of], block.y[of], block.polarity[of])


BLOCK = many(1000, 320, 240)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.aedat4"


def error(path: Path) -> str:
    with pytest.raises(RecordingError) as recording:
        read(Aedat4(), path)
    return str(recording.value)


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


def damaged(path: Path, bad: bytes, lost: int = 0) -> tuple[str, list[str]]:
    """Write a packet, `bad` and a packet; check that repair reads both; return the error and the notes."""
    first, last = part(BLOCK, slice(0, 400)), part(BLOCK, slice(400, 1000))
    path.write_bytes(head() + coded(first) + bad + coded(last))
    sentence = error(path)
    assert f"the packet at byte {len(head() + coded(first))} " in sentence
    recording, notes = read(Aedat4(), path, repair=True)
    assert same(recording, BLOCK.t_us, BLOCK.x, BLOCK.y, BLOCK.polarity)
    return sentence, notes


def test_a_damaged_lz4_frame(path):
    data = bytearray(coded(BLOCK))
    for i in range(40, 60):
        data[i] ^= 0xFF
    sentence, notes = damaged(path, bytes(data))
    assert "must be an LZ4 frame: " in sentence
    assert len(notes) == 1 and notes[0].endswith("--repair drops invalid packets")


def test_frames_of_another_compression(path):
    data = content(BLOCK)
    assert "must be an LZ4 frame: " in damaged(path, packet(COMPRESS[ZSTD](data)))[0]
    assert "must be an LZ4 frame: " in damaged(path, packet(data))[0]
    path.write_bytes(head(ZSTD) + coded(BLOCK, LZ4))
    assert "must be a Zstandard frame: " in error(path)
    path.write_bytes(head(NONE) + coded(BLOCK, LZ4))
    assert "must hold a flatbuffer" in error(path)


@pytest.mark.parametrize("compression", [LZ4, ZSTD])
def test_half_a_frame(path, compression):
    data = COMPRESS[compression](content(BLOCK))
    path.write_bytes(head(compression) + packet(data[: len(data) // 2]))
    assert "a.aedat4: the packet at byte " in error(path)
    recording, notes = read(Aedat4(), path, repair=True)
    assert len(recording.t_us) == 0 and len(notes) == 1


def test_a_packet_of_no_bytes(path):
    assert "must hold a flatbuffer of its own length, got 0 bytes" in damaged(path, packet(b""))[0]


def test_a_packet_of_no_events(path):
    none = part(BLOCK, slice(0))
    path.write_bytes(head() + coded(none) + coded(BLOCK) + coded(none))
    recording, notes = read(Aedat4(), path)
    assert notes == [] and len(recording.t_us) == 1000


def test_a_packet_of_an_unknown_stream(path):
    sentence, notes = damaged(path, packet(b"abc", 77))
    assert "must be of a stream in the header (0, 1, 2), got stream 77" in sentence
    assert notes[0].endswith("--repair drops packets of unknown streams")


def test_a_flatbuffer_of_another_type(path):
    data = packet(COMPRESS[LZ4](content(BLOCK, b"IMUS")))
    assert "must hold a flatbuffer EVTS, got b'IMUS'" in damaged(path, data)[0]


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


def test_a_claim_of_too_many_events_takes_no_memory(path):
    data = bytearray(content(BLOCK))
    data[28:32] = b"\xff\xff\xff\xff"
    sentence, _ = damaged(path, packet(COMPRESS[LZ4](bytes(data))))
    assert "must hold 4294967295 items of 16 bytes, got 16000 bytes" in sentence


@pytest.mark.parametrize("compression", [LZ4, ZSTD, ZSTD_HIGH])
def test_a_packet_that_grows_without_end(path, compression, monkeypatch):
    monkeypatch.setattr(aedat4, "_MOST_BYTES", 1 << 16)
    path.write_bytes(head(compression) + packet(COMPRESS[compression](bytes(1 << 22))))
    assert "must hold at most 65536 bytes after decompression, got more" in error(path)


def test_a_packet_that_is_too_long_is_passed_over(path, monkeypatch):
    monkeypatch.setattr(aedat4, "_MOST_BYTES", 1 << 15)
    assert "must be at most 32768 bytes long, got 40000" in damaged(path, packet(bytes(40000)))[0]


@pytest.mark.parametrize("size", [2**31 - 1, -1, -(2**31)])
def test_an_absurd_length_ends_the_reading(path, size):
    good = head() + coded(BLOCK)
    bad = packet(b"abc", 0, size) + coded(BLOCK)
    path.write_bytes(good + bad)
    assert error(path).startswith(
        f"a.aedat4: the packet at byte {len(good)} must end within the {len(bad)} bytes left, "
        f"got a length of {size} bytes"
    )
    recording, notes = read(Aedat4(), path, repair=True)
    assert len(recording.t_us) == 1000
    assert notes[0].endswith(f"--repair drops the bytes of an unfinished packet ({len(bad)} in all)")


@pytest.mark.parametrize("left", [3, 8, 100])
def test_cut_in_a_packet(path, left):
    good = head() + coded(BLOCK)
    path.write_bytes(good + coded(BLOCK)[:left])
    sentence = f"a.aedat4: the packet at byte {len(good)} must end within the {left} bytes left, got "
    assert error(path).startswith(sentence)
    recording, notes = read(Aedat4(), path, repair=True)
    assert len(recording.t_us) == 1000 and notes[0].endswith(f"({left} in all)")


def test_cut_between_packets_shows_by_the_missing_table(path):
    length = len(head() + 2 * coded(BLOCK))
    path.write_bytes(head(end=length) + coded(BLOCK))
    assert error(path).startswith(
        f"a.aedat4: the table of packets must begin between byte {len(head())} and the end of the file at "
        f"byte {len(head() + coded(BLOCK))}, got byte {length}"
    )
    recording, notes = read(Aedat4(), path, repair=True)
    assert len(recording.t_us) == 1000 and notes[0].endswith("--repair reads the packets that are present")


def test_a_header_alone_has_no_events(path):
    path.write_bytes(head())
    repairs = Repairs("a.aedat4", False)
    with pytest.raises(RecordingError, match=r"a\.aedat4: .*got none"):
        list(checked(Aedat4().blocks(path, repairs.broken), 320, 240, repairs.broken))


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file must begin with the line '#!AER-DAT4.0' at byte 0, it is empty"),
        (
            b"#!AER-DAT4.1\r\n",
            "must begin with the line '#!AER-DAT4.0' at byte 0, it begins with b'#!AER-DAT4.1'",
        ),
        (VERSION, "the header at byte 14 must state its length within the 0 bytes left, got 0"),
        (VERSION + b"\xff\xff\xff\x7fabc", "must state its length within the 7 bytes left, got 2147483647"),
        (head()[:200], "the header at byte 14 must state its length within the 186 bytes left, got "),
        (
            VERSION + struct.pack("<I", 40) + bytes(40),
            "the header at byte 14 must hold a flatbuffer IOHE, got b'",
        ),
        (
            VERSION + described(b"<dv>", 1, -1),
            "the header at byte 14 must describe the streams in XML: no element",
        ),
        (
            VERSION + described(b"", 1, -1),
            "the header at byte 14 must describe the streams in XML: no element",
        ),
        (head(streams=(("EVTS", (320, 0)),)), "in XML: a stream must be at least 1 x 1, got 320 x 0"),
        (head(streams=(("EVTS", ("a", 9)),)), "must describe the streams in XML: invalid literal"),
        (head(7), "the header's compression must be from 0 (none) to 4, got 7"),
        (head(-1), "the header's compression must be from 0 (none) to 4, got -1"),
        (head(streams=(("IMUS", None),)), "must describe a stream of type EVTS, got 0 of type IMUS"),
        (head(streams=()), "the header must describe a stream of type EVTS, got none"),
    ],
)
def test_a_header_that_is_not_sound_is_refused_even_with_repair(path, data, sentence):
    path.write_bytes(data)
    assert sentence in error(path)
    with pytest.raises(RecordingError):
        read(Aedat4(), path, repair=True)
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
