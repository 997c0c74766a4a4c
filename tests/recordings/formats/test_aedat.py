"""AEDAT 2.0 and 3.1: a recorded header, files written here by the specification, and broken ones."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.recordings.formats import BLOCK_EVENTS, detect, named
from dse.records import Array, Block
from tests.recordings.formats.reading import events, faulty, many, peak_bytes, read, refused, same

CHIPS = {
    "ch.unizh.ini.jaer.chip.retina.DVS128": (128, 128),
    "eu.seebetter.ini.chips.davis.DAVIS240C": (240, 180),
    "eu.seebetter.ini.chips.davis.Davis346red": (346, 260),
    "eu.seebetter.ini.chips.davis.Davis640": (640, 480),
}
DVS128, DAVIS240 = list(CHIPS)[:2]
VERSION_2, VERSION_3 = b"#!AER-DAT2.0\r\n", b"#!AER-DAT3.1\r\n"
END_2, END_3 = b"#End Of ASCII Header\r\n", b"#!END-HEADER\r\n"
SPECIAL, POLARITY, FRAME = range(3)
PACKET_BYTES = 28


def head_2(chip: str | None = DVS128, end: bytes = END_2) -> bytes:
    named = b"" if chip is None else f"# AEChip: {chip}\r\n".encode()
    return VERSION_2 + b"# This is a raw AE data file - do not edit\r\n" + named + end


def address(block: Block, chip: str) -> Array:
    """Return the addresses of events: jAER's chips count columns from the right and rows from the bottom."""
    width, height = CHIPS[chip]
    x, y, on = width - 1 - block.x, height - 1 - block.y, block.polarity.astype(np.int64)
    return y << 8 | x << 1 | 1 - on if chip == DVS128 else y << 22 | x << 12 | on << 11


def words(addresses: Array, t_us: Array) -> bytes:
    stamps = np.asarray(t_us) % (1 << 32)
    return np.stack([np.asarray(addresses), stamps], axis=-1).astype(">u4").tobytes()


def head_3(source: str = "DAVIS240C", layout: bytes = b"RAW") -> bytes:
    named = f"#Source 1: {source}\r\n".encode()
    start = b"#Start-Time: 2016-04-01 12:00:00 (TZ+0100)\r\n"
    return VERSION_3 + b"#Format: " + layout + b"\r\n" + named + start + END_3


def packet(data: bytes, count: int, kind: int = POLARITY, **fields: int) -> bytes:
    """Return a packet; `fields` overwrite those of its header."""
    size = len(data) // count if count else 8
    header = {"kind": kind, "source": 1, "size": size, "time_at": 4, "overflow": 0}
    header |= {"capacity": count, "n": count, "valid": count}
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


def holds(path: Path, name: str, content: bytes, block: Block) -> bool:
    """Return whether a file is read without a note, as these events."""
    path.write_bytes(content)
    found, notes = read(named(name), path)
    return notes == [] and same(found, block.t_us, block.x, block.y, block.polarity)


# ---- AEDAT 2.0


def test_a_recorded_header_has_a_chip_and_no_events(shared_data: Path) -> None:
    path = shared_data / "native_event_files" / "tonic_sample_aedat_header.aedat"
    assert detect(path) == named("aedat2") and named("aedat2").frame(path) == (346, 260)
    found, notes = read(named("aedat2"), path)
    assert len(found.t_us) == 0 and notes == []


@given(data=st.data(), chip=st.sampled_from(list(CHIPS)), start=st.integers(0, 1 << 28))
def test_round_trip_of_words(tmp_path_factory, data, chip, start):
    block = data.draw(events(*CHIPS[chip], longest_us=1 << 28))
    path = tmp_path_factory.getbasetemp() / "round_trip.aedat"
    t_us = (1 << 32) - start + block.t_us  # the clock wraps within a step or two
    first = t_us[0] >> 32 << 32 if len(t_us) else 0
    wanted = Block(t_us - first, block.x, block.y, block.polarity)
    assert holds(path, "aedat2", head_2(chip) + words(address(block, chip), t_us), wanted)
    assert named("aedat2").frame(path) == CHIPS[chip]


def test_words_by_hand(path):
    # DVS128: the word's last bit is 0 for ON; the external input at bit 15 is no event
    path.write_bytes(head_2() + words([5 << 8 | 3 << 1, 5 << 8 | 3 << 1 | 1, 1 << 15], [10, 20, 30]))
    assert same(read(named("aedat2"), path)[0], [10, 20], [124, 124], [122, 122], [1, 0])
    block = many(4, 240, 180)
    pixels = address(block, DAVIS240)
    others = [1 << 31 | pixels[1], 1 << 31 | 3 << 10 | 5, pixels[2] | 1 << 10, 1 << 31 | 1 << 10]
    content = head_2(DAVIS240) + words(np.ravel([pixels, others], "F"), np.arange(8))
    assert holds(path, "aedat2", content, Block(np.array([0, 2, 4, 6]), block.x, block.y, block.polarity))


def test_an_event_that_begins_like_a_header_line(path):
    block = Block(*(np.array([value]) for value in (258, 239, 39, 0)))  # row 140 from the bottom
    data = words(address(block, DAVIS240), block.t_us)
    assert data.startswith(b"#")
    for end in (b"", END_2, b"# End of ASCII Header\r\n"):
        assert holds(path, "aedat2", head_2(DAVIS240, end) + data, block)


@pytest.mark.parametrize("n", [BLOCK_EVENTS, 2 * BLOCK_EVENTS + 3])
def test_blocks_of_words_do_not_show(path, n):
    block = many(n, 128, 128)
    t_us = block.t_us + (1 << 32) - 3 * BLOCK_EVENTS  # wraps where the second block begins
    wanted = Block(t_us, block.x, block.y, block.polarity)
    assert holds(path, "aedat2", head_2() + words(address(block, DVS128), t_us), wanted)


def test_faults_of_words(path):
    block = many(5, 128, 128)
    addresses = address(block, DVS128)
    content = words(addresses, block.t_us)
    sentence = f"the last word must have 8 bytes, got 5 at byte {len(head_2()) + 32}"
    faulty("aedat2", path, (head_2() + content)[:-3], 4, sentence)
    no_chip = "the header must name the chip in a line '# AEChip: ...', but has none"
    found = faulty("aedat2", path, head_2(None) + content, 5, no_chip, "an unnamed camera as a DVS128")
    assert same(found, block.t_us, block.x, block.y, block.polarity)
    assert named("aedat2").frame(path) is None
    addresses[[1, 3]] |= 0x40000
    sentence = f"the address at byte {len(head_2()) + 8} must be valid for a DVS128, got 0x0004"
    found = faulty("aedat2", path, head_2() + words(addresses, block.t_us), 3, sentence, "(2 in all)")
    assert found.t_us.tolist() == [0, 6, 12]


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file must begin with the line '#!AER-DAT2.0' at byte 0, it is empty"),
        (b"#!AER-DAT1.0\r\n", "it begins with b'#!AER-DAT1.0'"),
        (b"#!AER-DAT2.0", "it begins with b'#!AER-DAT2.0'"),
        (VERSION_2 + b"#" + b"a" * (8 << 20), ""),
        (head_2("a.b.Cochlea64"), "the header's AEChip must be a DVS128 or a DAVIS, got 'Cochlea64'"),
    ],
)
def test_a_header_of_words_that_is_not_sound_is_refused_even_with_repair(path, data, sentence):
    if sentence:
        refused("aedat2", path, data, sentence)
    path.write_bytes(b"#!AER-DAT1.0\r\n" + bytes(60))
    assert detect(path) == named("aedat2")  # with a reason


# ---- AEDAT 3.1


@given(
    parts=st.lists(events(240, 180, longest_us=1 << 27), max_size=4),
    start=st.integers(0, 1 << 33),
    between=st.binary(min_size=8, max_size=40),
)
def test_round_trip_of_packets(tmp_path_factory, parts, start, between):
    data, times = head_3(), []
    for block in parts:
        times.append(block.t_us + start)
        start = int(times[-1][-1]) if len(times[-1]) else start
        data += packet(between, 1, FRAME) + coded(Block(times[-1], block.x, block.y, block.polarity))
    names = ("x", "y", "polarity")
    columns = (np.concatenate([[], *(getattr(block, name) for block in parts)]) for name in names)
    wanted = Block(np.concatenate([[], *times]), *columns)
    assert holds(tmp_path_factory.getbasetemp() / "round_trip31.aedat", "aedat31", data, wanted)


def test_bytes_by_hand(path):
    # ON at column 5, row 3; then the same but marked as invalid
    data = struct.pack("<IiIi", 5 << 17 | 3 << 2 | 2 | 1, 70, 5 << 17 | 3 << 2 | 2, 71)
    path.write_bytes(head_3() + packet(data, 2, overflow=2, valid=1))
    assert detect(path) == named("aedat31")
    assert same(read(named("aedat31"), path)[0], [2 * 2**31 + 70], [5], [3], [1])


@pytest.mark.parametrize(
    ("header", "frame"),
    [
        (head_3("DVS128"), (128, 128)),
        (head_3("DAVIS346B"), (346, 260)),
        (head_3("DYNAPSE"), None),
        (head_3("DVS128").replace(END_3, b"#Source 2: DAVIS240B\r\n" + END_3), None),
        (head_3("DVS128").replace(END_3, b"#-Source 2: DAVIS240B\r\n" + END_3), (128, 128)),
    ],
)
def test_the_frame_is_that_of_the_source(path, header, frame):
    path.write_bytes(header)
    assert named("aedat31").frame(path) == frame


def test_other_types_other_sources_and_empty_packets_are_passed_over(path):
    first, second = many(5, 240, 180), many(7, 100, 100)
    others = packet(bytes(8 * 3), 3, SPECIAL) + packet(bytes(36 + 2000), 1, FRAME, time_at=8)
    data = others + packet(b"", 0, source=3) + coded(first) + coded(second, source=2) + others
    assert holds(path, "aedat31", head_3() + data + packet(b"", 0), first)


@pytest.mark.parametrize(("missing", "whole"), [(1, 2), (8, 2), (12, 1), (24, 0)])
def test_cut_in_a_packet(path, missing, whole):
    data = head_3() + 2 * coded(many(3, 240, 180))
    at = len(head_3()) + PACKET_BYTES + 24
    sentence = (
        f"the packet at byte {at} must hold 3 events of 8 bytes, but the file ends after {whole} of them"
    )
    found = faulty("aedat31", path, data[:-missing], 3 + whole, sentence)
    assert found.t_us.tolist() == [0, 3, 6, 0, 3, 6][: 3 + whole]  # a reset is left to the check


@pytest.mark.parametrize(
    "fields",
    [
        *({"size": -8}, {"size": 0}, {"size": 3}, {"time_at": 5}, {"time_at": -1}, {"n": 2}, {"valid": 4}),
        *({"n": -1, "capacity": -1, "valid": -1}, {"kind": -1}, {"source": -5}, {"overflow": -1}),
    ],
)
def test_a_packet_header_that_is_not_sound_ends_the_reading(path, fields):
    good = head_3() + coded(many(3, 240, 180))
    bad = packet(bytes(24), 3, **fields) + coded(many(3, 240, 180))
    sentence = f"the packet header at byte {len(good)} must hold sizes"
    faulty("aedat31", path, good + bad, 3, sentence, f"({len(bad)} in all)")


def test_other_faults_of_packets(path):
    block = many(3, 240, 180)
    good = head_3() + coded(block)
    sentence = f"the packet header at byte {len(good)} must have 28 bytes, but the file ends after 10"
    faulty("aedat31", path, good + packet(b"", 0)[:10], 3, sentence)
    sentence = f"the polarity events of the packet at byte {len(head_3())} must be 8 bytes long"
    faulty("aedat31", path, head_3() + packet(bytes(36), 3) + coded(block), 3, sentence)
    n = 2**31 - 1  # takes no memory
    absurd = packet(bytes(80), 0, POLARITY, size=8, capacity=n, n=n, valid=n)
    faulty(
        "aedat31", path, head_3() + absurd, 0, "must hold 2147483647 events of 8 bytes", f"({n - 10} in all)"
    )


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file must begin with the line '#!AER-DAT3.1' at byte 0, it is empty"),
        (b"#!AER-DAT3.0\r\n", "it begins with b'#!AER-DAT3.0'"),
        (VERSION_3 + b"#Format: RAW\r\n", "line '#!END-HEADER', got the end of the file at"),
        (VERSION_3 + b"#Source 1: DVS128\r\n\x01\x00", "'#!END-HEADER', got b'\\x01\\x00' at byte 33"),
        (head_3(layout=b"SerializedTS"), "the header's Format must be RAW, got 'SerializedTS' at byte 14"),
    ],
)
def test_a_header_of_packets_that_is_not_sound_is_refused_even_with_repair(path, data, sentence):
    refused("aedat31", path, data, sentence)


@pytest.mark.parametrize("name", ["aedat2", "aedat31"])
def test_blocks_and_memory(path, name):
    block = many(24 * BLOCK_EVENTS, 128, 128)
    content = head_3() + coded(block)
    if name == "aedat2":
        content = head_2() + words(address(block, DVS128), block.t_us)
    assert holds(path, name, content, block)
    n, peak = peak_bytes(named(name), path)
    assert n == 24 * BLOCK_EVENTS and peak < 180 * BLOCK_EVENTS
