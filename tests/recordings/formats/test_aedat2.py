"""AEDAT 2.0: a recorded header, files written here by the specification, and broken ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import BLOCK_EVENTS, Repairs, detect
from dse.recordings.formats.aedat2 import Aedat2
from dse.recordings.formats.checked import checked
from dse.records import Array, Block
from tests.recordings.formats.reading import events, many, peak_bytes, read, same

VERSION = b"#!AER-DAT2.0\r\n"
CHIPS = {
    "ch.unizh.ini.jaer.chip.retina.DVS128": (128, 128),
    "eu.seebetter.ini.chips.davis.DAVIS240C": (240, 180),
    "eu.seebetter.ini.chips.davis.Davis346red": (346, 260),
    "eu.seebetter.ini.chips.davis.Davis640": (640, 480),
}
DVS128, DAVIS240 = list(CHIPS)[:2]


def head(chip: str | None = DVS128, end: bytes = b"#End Of ASCII Header\r\n") -> bytes:
    named = b"" if chip is None else f"# AEChip: {chip}\r\n".encode()
    return VERSION + b"# This is a raw AE data file - do not edit\r\n" + named + end


def address(block: Block, chip: str) -> Array:
    """Return the addresses of events: jAER's chips count columns from the right and rows from the bottom."""
    width, height = CHIPS[chip]
    x, y, on = width - 1 - block.x, height - 1 - block.y, block.polarity.astype(np.int64)
    return y << 8 | x << 1 | 1 - on if chip == DVS128 else y << 22 | x << 12 | on << 11


def words(addresses: Array, t_us: Array) -> bytes:
    stamps = np.asarray(t_us) % (1 << 32)
    return np.stack([np.asarray(addresses), stamps], axis=-1).astype(">u4").tobytes()


def coded(block: Block, chip: str = DVS128) -> bytes:
    return words(address(block, chip), block.t_us)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.aedat"


def error(path: Path) -> str:
    with pytest.raises(RecordingError) as recording:
        read(Aedat2(), path)
    return str(recording.value)


def test_a_recorded_header_has_a_chip_and_no_events(shared_data):
    path = shared_data / "native_event_files" / "tonic_sample_aedat_header.aedat"
    assert detect(path) == Aedat2() and Aedat2().frame(path) == (346, 260)
    recording, notes = read(Aedat2(), path)
    assert len(recording.t_us) == 0 and notes == []
    repairs = Repairs(path.name, False)
    with pytest.raises(RecordingError, match=r"_header\.aedat: .*got none"):
        list(checked(Aedat2().blocks(path, repairs.broken), 346, 260, repairs.broken))
    repairs = Repairs(path.name, True)
    assert list(checked(Aedat2().blocks(path, repairs.broken), 346, 260, repairs.broken)) == []
    assert len(repairs.notes) == 1


@given(data=st.data(), chip=st.sampled_from(list(CHIPS)), start=st.integers(0, 1 << 28))
def test_round_trip(tmp_path_factory, data, chip, start):
    block = data.draw(events(*CHIPS[chip], longest_us=1 << 28))
    path = tmp_path_factory.getbasetemp() / "round_trip.aedat"
    t_us = (1 << 32) - start + block.t_us  # the clock wraps within a step or two
    path.write_bytes(head(chip) + words(address(block, chip), t_us))
    recording, notes = read(Aedat2(), path)
    assert notes == [] and Aedat2().frame(path) == CHIPS[chip]
    first = t_us[0] >> 32 << 32 if len(t_us) else 0
    assert same(recording, t_us - first, block.x, block.y, block.polarity)


def test_words_by_hand(path):
    # DVS128: the word's last bit is 0 for ON; the external input at bit 15 is no event
    path.write_bytes(head() + words([5 << 8 | 3 << 1, 5 << 8 | 3 << 1 | 1, 1 << 15], [10, 20, 30]))
    recording, _ = read(Aedat2(), path)
    assert same(recording, [10, 20], [124, 124], [122, 122], [1, 0])


def test_frames_inertial_samples_and_external_inputs_are_passed_over(path):
    block = many(4, 240, 180)
    pixels = address(block, DAVIS240)
    others = [1 << 31 | pixels[1], 1 << 31 | 3 << 10 | 5, pixels[2] | 1 << 10, 1 << 31 | 1 << 10]
    path.write_bytes(head(DAVIS240) + words(np.ravel([pixels, others], "F"), np.arange(8)))
    recording, notes = read(Aedat2(), path)
    assert notes == [] and same(recording, [0, 2, 4, 6], block.x, block.y, block.polarity)


def test_times_that_run_backwards_are_left_to_the_check(path):
    path.write_bytes(head() + words([0, 0, 0], [100, 40, 60]))
    assert read(Aedat2(), path)[0].t_us.tolist() == [100, 40, 60]


def test_an_event_that_begins_like_a_header_line(path):
    block = Block(*(np.array([value]) for value in (258, 239, 39, 0)))  # row 140 from the bottom
    data = coded(block, DAVIS240)
    assert data.startswith(b"#")
    for end in (b"", b"#End Of ASCII Header\r\n", b"# End of ASCII Header\r\n"):
        path.write_bytes(head(DAVIS240, end) + data)
        assert same(read(Aedat2(), path)[0], block.t_us, block.x, block.y, block.polarity)


@pytest.mark.parametrize("n", [BLOCK_EVENTS, 2 * BLOCK_EVENTS + 3])
def test_blocks_do_not_show(path, n):
    block = many(n, 128, 128)
    t_us = block.t_us + (1 << 32) - 3 * BLOCK_EVENTS  # wraps where the second block begins
    path.write_bytes(head() + words(address(block, DVS128), t_us))
    recording, _ = read(Aedat2(), path)
    assert same(recording, t_us, block.x, block.y, block.polarity)


def test_cut_in_an_event(path):
    data = head() + coded(many(3, 128, 128))
    path.write_bytes(data[:-3])
    assert error(path).startswith(f"a.aedat: the last word must have 8 bytes, got 5 at byte {len(data) - 8}")
    recording, notes = read(Aedat2(), path, repair=True)
    assert len(recording.t_us) == 2 and len(notes) == 1


def test_addresses_that_a_dvs128_does_not_have(path):
    block = many(5, 128, 128)
    addresses = address(block, DVS128)
    addresses[[1, 3]] |= 0x40000
    path.write_bytes(head() + words(addresses, block.t_us))
    at = len(head()) + 8
    assert f"the address at byte {at} must be valid for a DVS128, got 0x0004" in error(path)
    recording, notes = read(Aedat2(), path, repair=True)
    assert recording.t_us.tolist() == [0, 6, 12]
    assert notes[0].endswith("--repair drops words with an address that the chip does not have (2 in all)")


def test_a_header_without_a_chip(path):
    block = many(3, 128, 128)
    path.write_bytes(head(None) + coded(block))
    assert Aedat2().frame(path) is None
    assert error(path).startswith(
        "a.aedat: the header must name the chip in a line '# AEChip: ...', but has none"
    )
    recording, notes = read(Aedat2(), path, repair=True)
    assert same(recording, block.t_us, block.x, block.y, block.polarity)
    assert notes[0].endswith("--repair treats an unnamed camera as a DVS128")


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file must begin with the line '#!AER-DAT2.0' at byte 0, it is empty"),
        (
            b"#!AER-DAT1.0\r\n",
            "must begin with the line '#!AER-DAT2.0' at byte 0, it begins with b'#!AER-DAT1.0'",
        ),
        (
            b"#!AER-DAT2.0",
            "must begin with the line '#!AER-DAT2.0' at byte 0, it begins with b'#!AER-DAT2.0'",
        ),
        (bytes(range(64)), "must begin with the line '#!AER-DAT2.0' at byte 0, it begins with b'\\x00\\x01"),
        (head("a.b.Cochlea64"), "the header's AEChip must be a DVS128 or a DAVIS, got 'Cochlea64'"),
        (head("DavisHet640"), "the header's AEChip must be a DVS128 or a DAVIS, got 'DavisHet640'"),
    ],
)
def test_a_header_that_is_not_sound_is_refused_even_with_repair(path, data, sentence):
    path.write_bytes(data)
    assert sentence in error(path)
    with pytest.raises(RecordingError):
        read(Aedat2(), path, repair=True)


def test_version_1_is_refused_with_a_reason(path):
    path.write_bytes(b"#!AER-DAT1.0\r\n" + bytes(60))
    assert detect(path) == Aedat2()


def test_a_line_without_end_takes_no_memory(path):
    path.write_bytes(VERSION + b"#" + b"a" * (8 << 20))
    with pytest.raises(RecordingError):
        read(Aedat2(), path)


def test_memory_does_not_follow_the_length(path):
    path.write_bytes(head() + 24 * coded(many(BLOCK_EVENTS, 128, 128)))
    n, peak = peak_bytes(Aedat2(), path)
    assert n == 24 * BLOCK_EVENTS and peak < 120 * BLOCK_EVENTS
