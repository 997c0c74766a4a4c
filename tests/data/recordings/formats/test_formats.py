"""Every binary format: recorded files, bytes written by the specification, files that are not sound."""

import tracemalloc
import zlib
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.io import loadmat, savemat

from dse.data.recordings import RecordingError, formats
from dse.data.recordings.formats import (
    BLOCK_EVENTS,
    Repairs,
    aedat4,
    checked,
    detect,
    es,
    named,
    neutouch,
    prophesee,
)
from dse.data.recordings.formats.stmnist import N_ROWS
from tests.data.recordings.formats import aedat_files as dv
from tests.data.recordings.formats.encoders import (
    coded_es,
    dat,
    event_lists,
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
    head_es,
    nmnist,
    raw,
)
from tests.data.recordings.formats.reading import RECORDED, faulty, many, read, refused, tuples

ONE = [(70, 3, 4, 1)]
EVT2 = "% Date 2020-09-14 09:03:25\n% evt 2.0\n% geometry 640x480\n% end\n"
EVT3 = "% evt 3.0\n% geometry 1280x720\n"
START = [evt3_high(0), evt3_low(70), evt3_y(4)]
LINES = ["0 44 1606029303.0246768", "1 3 1606029303.024703", "0 0 1606029303.1", "0 60 1606029303.2"]
LINES.append("1 79 1606029305")

WRITE = {
    "dat": dat,
    "evt2": lambda events, header=EVT2: raw(evt2_words(events), 4, header),
    "evt3": lambda events, header=EVT3: raw(evt3_words(events), 2, header),
    "evt3 by 12": lambda events: raw(evt3_words(events, 12), 2, EVT3),
    "evt3 by 8": lambda events: raw(evt3_words(events, 8), 2, EVT3),
    "nmnist": nmnist,
    "es": lambda events: head_es() + coded_es(events),
    "es atis": lambda events: head_es(2) + coded_es(events, 2),
    "aedat2": lambda events: dv.head_2() + dv.words(events),
    "aedat2 davis": lambda events: dv.head_2(dv.DAVIS240) + dv.words(events, dv.DAVIS240),
    **{
        f"aedat4 {name}": lambda events, name=name: dv.head_4(name) + dv.coded(events, name)
        for name in dv.COMPRESS
    },
}
"""Name, and variant, of a format -> the bytes of a file of events."""
FRAMES = {
    "dat": None,
    "evt2": (640, 480),
    "evt3": (1280, 720),
    "nmnist": (34, 34),
    "es": (300, 260),
    "aedat2": (128, 128),
    "aedat4": (320, 240),
}
PERIODS = {"dat": 1 << 32, "evt2": 1 << 34, "evt3": 1 << 24, "nmnist": 1 << 23, "aedat2": 1 << 32}
"""Of the clocks that wrap, in us."""
WORD_BYTES = {"dat": 8, "evt2": 4, "evt3": 2, "nmnist": 5, "aedat2": 8, "es": 5}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("formats") / "a.file"


def found(name, path, content):
    """Return the events of a file that is read without a note."""
    path.write_bytes(content)
    events, notes = read(named(name), path)
    assert notes == []
    return tuples(events)


# ---- recorded files


@pytest.mark.parametrize("file", RECORDED)
def test_recorded_files(shared_data, tmp_path, file):
    path = shared_data / "native_event_files" / file
    name, frame, n, n_on, first, last, sums = RECORDED[file]
    assert detect(path) == named(name) and named(name).frame(path) == frame
    events, notes = read(named(name), path)
    assert notes == [] and len(events.t_us) == n
    assert n_on is None or events.polarity.sum() == n_on
    columns = (events.t_us, events.x, events.y, events.polarity)
    for k, wanted in ((0, first), (-1, last)):
        assert tuple(int(column[k]) for column in columns[: len(wanted)]) == wanted
    assert sums in (None, [zlib.crc32(a.astype(np.int64).tobytes()) for a in columns[:3]])
    if name not in ("neutouch", "nmnist"):  # nothing in their bytes says what they are
        (tmp_path / "other.name").write_bytes(path.read_bytes()[: 1 << 16])
        assert detect(tmp_path / "other.name") == named(name)


def test_events_without_addresses_are_refused(shared_data):
    with pytest.raises(RecordingError, match=r"byte 15 must be DVS or ATIS.*, got generic events"):
        named("es").frame(shared_data / "native_event_files" / "faery_generic.es")


def test_a_recording_of_evt3(shared_data):
    """Addresses and polarities are those of another reader, and times but for what it adds by mistake.

    That reader takes every fall of the lower 12 bits for a carry, also where a new time high already holds it
    and where the camera stepped back without an event: 4096 us too much from each of 11 places on. The time
    high of the file rises twice, so it cannot be longer than 3 x 4096 us; the reference lasts 53857 us.
    """
    folder = shared_data / "native_event_files"
    path = folder / "expelliarmus_evt3_sample.raw"
    reference = np.load(folder / "expelliarmus_evt3_sample_decoded.npz")
    events, _ = read(named("evt3"), path)
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


@pytest.mark.parametrize("name", ["sponge", "stiff_block"])
def test_the_files_of_neutouch_are_the_packed_recordings(shared_data, name):
    found, _ = read(named("neutouch"), shared_data / "native_event_files" / f"neutouch_{name}_trial1_5.tact")
    with np.load(shared_data / "neutouch_objects" / "neutouch_objects.npz") as packed:
        is_one = packed["class_names"][packed["label"]] == name
        is_one &= (packed["session"] == "class_test/trial1") & (packed["iteration"] == 5)
        part = slice(*packed["offsets"][np.flatnonzero(is_one).item() :][:2])
        assert (found.x == packed["taxel"][part]).all() and not found.y.any()
        assert (found.polarity == packed["polarity"][part]).all()
        times = packed["t_us"][part].astype(np.int64)  # both round to the microsecond, from two zeros of time
        assert np.abs(found.t_us - (times - times[0])).max() <= 1


# ---- files written here


@pytest.mark.parametrize("variant", WRITE)
@given(data=st.data(), start=st.integers(0, 1 << 34), block=st.integers(1, 9))
@example(None, (1 << 34) - 1, 2)
def test_round_trip(path, variant, data, start, block):
    name = variant.split()[0]
    period = PERIODS.get(name, 1 << 33)
    most = {"nmnist": 33, "aedat2": 127, "aedat4": 239, "es": 259}.get(name, 1279)
    longest = min(period >> 4, 1 << 16) if name == "es" else period >> 4
    if data is None:  # several wraps, or a run of one row and time
        events = [(k * longest, k % 9, k % 2, 1) for k in range(40)] if longest > 1 << 17 else [(0, 3, 4, 1)]
    else:
        events = data.draw(event_lists(longest, most))
    first = start % period if name in PERIODS else start % (1 << 12)
    events = [(first + t - events[0][0], x, y, p) for t, x, y, p in events]
    content = WRITE[variant](events)
    with (
        patch.object(formats, "BLOCK_EVENTS", block),
        patch.object(prophesee, "BLOCK_EVENTS", block),
        patch.object(es, "BLOCK_EVENTS", block),
    ):
        assert found(name, path, content) == events
    assert variant != name or named(name).frame(path) == FRAMES[name]
    assert found(name, path, WRITE[variant]([])) == []


PIXEL, DAVIS_PIXEL = 5 << 8 | 3 << 1, 7 << 22 | 5 << 12 | 1 << 11
LOWER = [evt3_low(800), evt3_x(1, 0), evt3_low(811), evt3_low(801), evt3_x(1, 0)]
HIGHS = [evt3_high(0), evt3_x(1, 0), evt3_high(1), evt3_x(2, 0), evt3_low(5), evt3_x(3, 0)]
BY_HAND = {
    # 127 us, a reset, 127 us, then 5 us: ON at column 258, row 1 from the bottom
    "es": ("es", head_es() + bytes([0xFF, 0xFE, 0xFF, 5 << 1 | 1, 2, 1, 1, 0]), [(259, 258, 258, 1)]),
    # 2 x 63 us, a threshold crossing after 4 us, a change (OFF) after 1 us
    "es atis": (
        "es",
        head_es(2) + bytes([0xFE, 4 << 2 | 3, 9, 0, 9, 0, 1 << 2, 7, 0, 0, 0]),
        [(131, 7, 259, 0)],
    ),
    "es of time alone": ("es", head_es() + b"\xff" * 50_000, []),
    "nmnist: row 240 adds to the time": (
        "nmnist",
        nmnist([(5, 1, 1, 0), (6, 0, 240, 0), (7, 2, 1, 1), (8, 0, 240, 1), (8, 0, 240, 1), (9, 3, 1, 0)]),
        [(5, 1, 1, 0), (7 + 8192, 2, 1, 1), (9 + 3 * 8192, 3, 1, 0)],
    ),
    "neutouch": ("neutouch", "\n".join(LINES).encode(), [(0, 44, 0, 1), (26, 3, 0, 0), (1975323, 79, 0, 0)]),
    "neutouch, other ends of lines": (
        "neutouch",
        "\r\n\r\n".join(LINES[:2]).encode(),
        [(0, 44, 0, 1), (26, 3, 0, 0)],
    ),
    # The word's last bit is 0 for ON; the external input at bit 15 is no event.
    "aedat2": (
        "aedat2",
        dv.head_2() + dv.stamped([PIXEL, PIXEL | 1, 1 << 15], [10, 20, 30]),
        [(10, 124, 122, 1), (20, 124, 122, 0)],
    ),
    "aedat2 of a davis: frames, inertial samples and inputs": (
        "aedat2",
        dv.head_2(dv.DAVIS240)
        + dv.stamped([DAVIS_PIXEL, 1 << 31 | 5, 1 << 31 | 3 << 10, 9 << 12 | 1 << 10], range(4)),
        [(0, 234, 172, 1)],
    ),
    "aedat4: the first stream of events": (
        "aedat4",
        dv.head_4(streams=(("TRIG", None), ("EVTS", (64, 48)), ("EVTS", (320, 240))))
        + dv.packet_4(b"", 0)
        + dv.coded(ONE, stream=1)
        + dv.coded([(71, 1, 1, 1)], stream=2),
        ONE,
    ),
    "aedat4: a packet of no events": ("aedat4", dv.head_4() + dv.coded([]) + dv.coded(ONE), ONE),
    "aedat4 with a table of packets": (
        "aedat4",
        dv.head_4(end=len(dv.head_4() + dv.coded(ONE))) + dv.coded(ONE) + b"a table",
        ONE,
    ),
    "dat of old cameras": ("dat", dat(ONE, mark=b"\x00\x08"), ONE),
    "evt2: other words": (
        "evt2",
        raw([0xA << 28 | 5, 0xE << 28, 0xF << 28 | 1, *evt2_words(ONE), 0xA << 28], 4, EVT2),
        ONE,
    ),
    "evt3: other words": (
        "evt3",
        raw([0xA001, 0x7003, 0xE123, 0xFFFF, *evt3_words(ONE), 0xA001, 0x7003], 2, EVT3),
        ONE,
    ),
    # A single event leaves the vector base and its polarity.
    "evt3: every bit of a vector is a column": (
        "evt3",
        raw(
            [
                *START,
                evt3_base(10, 1),
                evt3_vector(0b100000000001, 12),
                evt3_vector(0b10000010, 8),
                evt3_vector(0, 12),
                evt3_x(5, 0),
                evt3_vector(1, 8),
            ],
            2,
            EVT3,
        ),
        [(70, x, 4, p) for x, p in [(10, 1), (21, 1), (23, 1), (29, 1), (5, 0), (42, 1)]],
    ),
    "evt3: a vector of 8 has 8 bits": (
        "evt3",
        raw([*START, evt3_base(0, 0), evt3_vector(0xF01, 8)], 2, EVT3),
        [(70, 0, 4, 0)],
    ),
    "evt3: a time high repeated keeps the lower bits, a new one clears them": (
        "evt3",
        raw([*START, *HIGHS], 2, EVT3),
        [(70, 1, 4, 0), (4096, 2, 4, 0), (4101, 3, 4, 0)],
    ),
    "evt3: lower bits may fall": (
        "evt3",
        raw([evt3_high(0), evt3_y(4), *LOWER], 2, EVT3),
        [(800, 1, 4, 0), (801, 1, 4, 0)],
    ),
}


@pytest.mark.parametrize("case", BY_HAND)
@pytest.mark.parametrize("block", [1, 3, BLOCK_EVENTS])
def test_bytes_by_hand(path, monkeypatch, case, block):
    for module in (formats, prophesee, es, neutouch):
        monkeypatch.setattr(module, "BLOCK_EVENTS", block)
    name, content, wanted = BY_HAND[case]
    assert found(name, path, content) == wanted


def test_what_begins_like_a_header_is_none(path):
    words = evt2_words([(0, 0, 37, 0), (0, 1, 37, 1)])[1:]  # 37 is '%'
    content = raw([evt2_high(0x20 << 8 | 37)], 4, EVT2) + np.array(words, dtype="<u4").tobytes()
    t_us = (0x20 << 8 | 37) << 6
    for header in (EVT2, EVT2.replace("% end\n", "")):
        assert found("evt2", path, content.replace(EVT2.encode(), header.encode()))[0] == (t_us, 0, 37, 0)
    event = [(258, 239, 39, 0)]  # row 140 from the bottom is '#'
    for end in (b"", dv.END_2, b"# End of ASCII Header\r\n"):
        assert found("aedat2", path, dv.head_2(dv.DAVIS240, end) + dv.words(event, dv.DAVIS240)) == event


@pytest.mark.parametrize(
    ("name", "content", "frame"),
    [
        ("evt2", raw([], 4, "% format EVT2;height=720;width=1280\n"), (1280, 720)),
        ("evt2", raw([], 4, "% evt 2.0\n% geometry 0x480\n"), None),
        ("evt2", raw([], 4, "% evt 2.0\n% geometry wide\n"), None),
        ("evt3", raw([], 2, "% evt 3.0\n"), None),
        ("dat", dat([], "% Data file of Event2D.\n% Version 2\n% Height 240\n% Width 304\n"), (304, 240)),
        ("dat", dat([], "% Version 2\n% Width 304\n"), None),
        ("nmnist", b"", (34, 34)),
        ("nmnist", nmnist([*ONE, (71, 0, 34, 0)]), None),
        ("aedat2", dv.head_2(None), None),
        *(("aedat2", dv.head_2(chip), size) for chip, size in dv.CHIPS.items()),
        ("aedat4", dv.head_4(streams=(("EVTS", None),)), None),
    ],
)
def test_the_frame_is_that_of_the_header(path, name, content, frame):
    path.write_bytes(content)
    assert named(name).frame(path) == frame


def test_names_that_decide(path):
    assert not named("neutouch").matches(path.with_suffix(".txt"), LINES[0].encode())
    assert not named("neutouch").matches(path.with_suffix(".tact"), b"1606029300 75273990 1 1 3 3 0 0 3 0 \n")
    assert not named("nmnist").matches(path.with_suffix(".bin"), nmnist([(71, 0, 34, 0)]))


# ---- files that are not sound

BLOCK = many(1000, 320, 240)
GOOD_4 = dv.head_4() + dv.coded(BLOCK)


def cuts():
    """Yield files that end within a word, an event, a packet or its header."""
    for name, size in WORD_BYTES.items():
        for cut in (1, size - 1):
            told = "the event" if name == "es" else "the last word"
            yield name, WRITE[name](ONE) + b"\1" * cut, 1, f"{told}", f"{size} bytes", "drops a truncated"
    for left in (3, 8, 100):
        told = f"the packet at byte {len(GOOD_4)} must end within the {left} bytes left, got "
        yield "aedat4", GOOD_4 + dv.coded(BLOCK)[:left], 1000, told, f"({left} in all)"
    told = f"byte {len(GOOD_4)}, got byte {len(GOOD_4) + 9}; --repair reads the packets that are"
    yield "aedat4", dv.head_4(end=len(GOOD_4) + 9) + dv.coded(BLOCK), 1000, "the table of packets", told


def bad_headers():
    """Yield files whose header, or that of a packet, lacks or contradicts something."""
    told = "must name the chip in a line '# AEChip: ...', but has none"
    yield "aedat2", dv.head_2(None) + dv.words(BLOCK[:5]), 5, told, "an unnamed camera as a DVS128"
    for header in ("", "% Width 304\n"):
        told = f"'% Version 2', which is missing; --repair reads the data after {len(header)} bytes"
        yield "dat", dat(ONE, header), 1, told
    for name, version in (("evt2", "2.0"), ("evt3", "3.0")):
        for header in ("", "% Date today\n"):
            told = f"reads the data after {len(header)} bytes of header as EVT {version}"
            yield name, WRITE[name](ONE, header), 1, f"the encoding in a line '% evt {version}'", told
    n = 2**31 - 1
    for size in (n, -1, -n - 1):
        bad = dv.packet_4(b"abc", 0, size) + dv.coded(ONE)
        told = f"{len(GOOD_4)} must end within the {len(bad)} bytes left, got a length of {size} bytes"
        yield "aedat4", GOOD_4 + bad, 1000, told, f"({len(bad)} in all)"


def bad_words():
    """Yield files with words that are none of the format, or come before others that they need."""
    told = f"at byte {len(dv.head_2()) + 8} must be valid for a DVS128, got 0x00040002"
    yield "aedat2", dv.head_2() + dv.stamped([2, 0x40002, 2, 0x40002], range(4)), 2, told, "(2 in all)"
    told = f"one of EVT 2.0, got 0x9 at byte {len(EVT2) + 8}; --repair skips words of unknown type (2 in all)"
    yield "evt2", raw([*evt2_words(ONE), 0x9 << 28, 0x2 << 28], 4, EVT2), 1, told
    told = f"one of EVT 3.0, got 0x1 at byte {len(EVT3) + 8}"
    yield "evt3", raw([*evt3_words(ONE), 0x1000, 0xD000], 2, EVT3), 1, told, "(2 in all)"
    told = f"got 2 from byte {len(EVT2)} on; --repair drops events before the first time high (2 in all)"
    yield "evt2", raw([evt2_event(1, 2, 3, 0), evt2_event(2, 2, 3, 1), *evt2_words(ONE)], 4, EVT2), 1, told
    told = f"got 3 from byte {len(EVT3)} on; --repair drops events before the first time high, row or vector"
    for before in (
        [evt3_y(4), evt3_base(0, 1), evt3_x(1, 0), evt3_vector(0b11, 12)],  # no time high
        [evt3_high(0), evt3_low(1), evt3_base(0, 1), evt3_x(1, 0), evt3_vector(0b11, 12)],  # no row
        [evt3_high(0), evt3_y(3), evt3_vector(0b110, 12), evt3_vector(0b1, 8)],  # no vector base
    ):
        yield "evt3", raw([*before, *evt3_words(ONE)], 2, EVT3), 1, told, "(3 in all)"
    for line in [
        "2 44 1.5",
        "0 44",
        "0 -4 1.5",
        "0 44 nan",
        "0 44 1.5 7",
        "0,44,1.5",
        "\x00\xff",
        "7" * 5000,
    ]:
        told = "line 3 must be a sign (0 or 1), a taxel and a time, got "
        content = "\n".join([*LINES[:2], line, LINES[-1], line]).encode()
        yield "neutouch", content, 3, told, "skips lines that are not events (2 in all)"


FAULTS = [*cuts(), *bad_headers(), *bad_words()]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda x: f"{x[0]}: {x[3][:40]}")
def test_damage_is_told_and_repaired(path, fault):
    name, content, n_left, *sentences = fault
    path.write_bytes(content)
    faulty(named(name), path, n_left, *sentences)


ZEROS = bytes(1 << 22)
BAD_4 = {
    "must be compressed as lz4: ": dv.packet_4(bytes(40)),
    "must be compressed as lz4": dv.coded(BLOCK, "zstd"),
    "must hold a flatbuffer of its own length, got 0 bytes": dv.packet_4(b""),
    "must hold a flatbuffer EVTS, got b'IMUS'": dv.coded(BLOCK, kind=b"IMUS"),
    "must hold 4294967295 items of 16 bytes, got 16000 bytes": dv.coded(BLOCK, count=2**32 - 1),
    "must be of a stream in the header (0, 1, 2), got stream 77": dv.packet_4(b"abc", 77),
    "the packet at byte": dv.packet_4(dv.COMPRESS["lz4"](dv.content(BLOCK))[:2000]),
}


@pytest.mark.parametrize(
    ("sentence", "compression", "bad"),
    [
        *((sentence, "lz4", bad) for sentence, bad in BAD_4.items()),
        ("must be compressed as zstd: ", "zstd", dv.coded(BLOCK)),
        ("must hold a flatbuffer", "none", dv.coded(BLOCK)),
        ("the packet at byte", "zstd", dv.packet_4(dv.COMPRESS["zstd"](dv.content(BLOCK))[:2000])),
        ("at most 32768 bytes after decompression, got more", "lz4", dv.packet_4(dv.COMPRESS["lz4"](ZEROS))),
        (
            "at most 32768 bytes after decompression, got more",
            "zstd",
            dv.packet_4(dv.COMPRESS["zstd"](ZEROS)),
        ),
        ("must be at most 32768 bytes long, got 40000", "lz4", dv.packet_4(bytes(40000))),
    ],
)
def test_a_bad_packet_of_aedat4_among_good_ones(path, monkeypatch, sentence, compression, bad):
    monkeypatch.setattr(aedat4, "_MOST_BYTES", 1 << 15)
    good = dv.head_4(compression) + dv.coded(BLOCK[:400], compression)
    path.write_bytes(good + bad + dv.coded(BLOCK[400:], compression))
    left = faulty(named("aedat4"), path, 1000, f"the packet at byte {len(good)} ", sentence)
    assert tuples(left) == BLOCK


REFUSED = {
    "es": {
        b"": "the file must begin with 'Event Stream' at byte 0, it is empty",
        b"Event Strea": "it begins with b'Event Strea'",
        head_es(version=b"\x01\x00\x00"): "the version at byte 12 must be 2.0, got 1.0.0",
        head_es(version=b"\x02\x01\x00"): "the version at byte 12 must be 2.0, got 2.1.0",
        head_es(4): "byte 15 must be DVS or ATIS, whose events have addresses, got colour events",
        head_es(77): "whose events have addresses, got 77 events",
        head_es()[:19]: "the header must be 20 bytes long, got 19",
        head_es()[:13]: "the header must be 20 bytes long, got 13",
        head_es(height=0): "the frame at byte 16 must be at least 1 x 1, got 300 x 0",
    },
    "evt2": {
        WRITE["evt2"](ONE, "% evt 3.0\n"): "must be EVT 2.0 for this reader, got '% evt 3.0'",
        WRITE["evt2"](ONE, "% format EVT21;height=7;width=9\n"): "got '% evt 2.1'",
        WRITE["evt2"](ONE, "% evt 2.0\n% endianness big\n"): "endianness must be little, got 'big'",
        b"% evt 2.0\n" + b"% more\n" * 20_000: "the header must end within 64512 bytes",
    },
    "evt3": {WRITE["evt3"](ONE, "% evt 2.0\n"): "must be EVT 3.0 for this reader, got '% evt 2.0'"},
    "dat": {
        dat(ONE, "% Version 3\n"): "the version of a DAT file must be 2, got '3'",
        dat([], mark=b"\x0e\x08"): "bytes 12 and 13 must be the event type 0 or 12 and the event",
        dat([], mark=b"\x00\x10"): "got 0 and 16",
        dat([], mark=b""): "got the end of the file",
    },
    "aedat2": {
        b"": "the file must begin with the line '#!AER-DAT2.0' at byte 0, it is empty",
        b"#!AER-DAT1.0\r\n": "it begins with b'#!AER-DAT1.0'",
        b"#!AER-DAT2.0": "it begins with b'#!AER-DAT2.0'",
        dv.head_2("a.b.Cochlea64"): "AEChip must be a DVS128 or a DAVIS, got 'Cochlea64'",
    },
    "aedat4": {
        b"#!AER-DAT4.1\r\n": "it begins with b'#!AER-DAT4.1'",
        dv.VERSION_4: "the header at byte 14 must state its length within the 0 bytes left, got 0",
        dv.head_4()[:200]: "the header at byte 14 must state its length within the 186 bytes left, got ",
        dv.VERSION_4 + b"\x28\0\0\0" + bytes(40): "must hold a flatbuffer IOHE, got b'",
        dv.described(b"<dv>", 1): "must describe the streams in XML: no element",
        dv.head_4(streams=(("EVTS", (320, 0)),)): "in XML: a stream must be at least 1 x 1, got 320 x 0",
        dv.head_4(streams=(("EVTS", ("a", 9)),)): "must describe the streams in XML: invalid literal",
        dv.head_4(7): "must state a compression from 0 (none) to 4, got 7",
        dv.head_4(-1): "must state a compression from 0 (none) to 4, got -1",
        dv.head_4(streams=(("IMUS", None),)): "must describe a stream of type EVTS, got 0 of type IMUS",
        dv.head_4(streams=()): "must describe a stream of type EVTS, got none",
    },
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_header_that_is_not_sound_is_refused_even_with_repair(path, name):
    for content, sentence in REFUSED[name].items():
        path.write_bytes(content)
        refused(named(name), path, sentence)


def checked_events(name, path, width, height, repair=False):
    repairs = Repairs(path.name, repair)
    blocks = list(checked(named(name).blocks(path, repairs), width, height, repairs))
    return [event for block in blocks for event in tuples(block)], repairs.notes


@pytest.mark.parametrize("name", ["dat", "evt2", "evt3"])
def test_times_that_run_backwards_are_no_wrap(path, name):
    ahead = {"dat": 1 << 30, "evt2": 1 << 33, "evt3": 1 << 22}[name]
    path.write_bytes(WRITE[name]([(6000 + ahead, 1, 1, 0), (7, 2, 2, 1)]))
    with pytest.raises(RecordingError, match=rf"event 1 must not be earlier .* got 7, {6000 + ahead}"):
        checked_events(name, path, 10, 10)
    assert [t for t, *_ in checked_events(name, path, 10, 10, True)[0]] == [6000 + ahead] * 2


def test_what_the_check_finds_in_decoded_events(path):
    words = [*START, evt3_base(1272, 1), evt3_vector(0xFFF, 12), evt3_base(2047, 0), evt3_vector(3, 8)]
    path.write_bytes(raw(words, 2, EVT3))
    with pytest.raises(RecordingError, match=r"event 8 must have its \(x, y\) within .*got 1280, 4;"):
        checked_events("evt3", path, 1280, 720)
    events, (note,) = checked_events("evt3", path, 1280, 720, True)
    assert [x for _, x, _, _ in events] == list(range(1272, 1280))
    assert note.endswith("drops events outside the frame (6 in all)")
    path.write_bytes(dat([(1, 0, 0, 9)]))
    with pytest.raises(RecordingError, match="event 0 must have polarity 0 or 1, got 9; --repair"):
        checked_events("dat", path, 10, 10)


# ---- ST-MNIST: a matrix of MATLAB


def matrix(n):
    """Return a spike train with one to three taxels per column, its times in seconds."""
    rng = np.random.default_rng(0)
    recording = np.zeros((N_ROWS, n))
    for _ in range(3):
        recording[rng.integers(0, 100, n), np.arange(n)] = rng.choice([-1, 1], n)
    recording[-1] = np.sort(rng.uniform(0, 2, n))
    return recording


def events_of(spikes):
    column, taxel = np.nonzero(spikes[:-1].T)
    times = np.rint(spikes[-1, column] * 1e6)
    return list(zip(times, taxel % 10, taxel // 10, spikes.T[column, taxel] > 0, strict=True))


def test_the_published_sample_of_stmnist(shared_data):
    path = shared_data / "native_event_files" / "tonic_sample_stmnist.mat"
    assert tuples(read(named("stmnist"), path)[0]) == events_of(loadmat(path)["spiketrain"])


@pytest.mark.parametrize(("dtype", "compressed"), [("f8", True), (">f8", False), ("f4", True), ("i2", False)])
def test_any_number_type_of_stmnist(tmp_path, dtype, compressed):
    spikes = matrix(40)
    spikes[-1] = np.arange(40) if dtype == "i2" else spikes[-1]
    content = {"about": "other", "wide": np.ones((3, 900)), "spiketrain": spikes.astype(dtype)}
    savemat(tmp_path / "a.mat", content, do_compression=compressed)
    events, notes = read(named("stmnist"), tmp_path / "a.mat")
    assert notes == [] and tuples(events) == events_of(spikes.astype(dtype).astype(np.float64))


@pytest.mark.parametrize("compressed", [False, True])
def test_a_damaged_stmnist_is_refused(tmp_path, compressed):
    path = tmp_path / "a.mat"
    savemat(path, {"spiketrain": np.ones((N_ROWS, 70))}, do_compression=compressed)
    whole, half = path.read_bytes(), path.stat().st_size // 2
    at = half if compressed else whole.index(np.ones(2).tobytes()) - 8
    wrong = bytes(64) if compressed else bytes([99])  # one byte on which scipy.io.loadmat crashes
    damaged = {whole[:at] + wrong + whole[at + len(wrong) :]: "cannot be read"}
    if compressed:
        damaged |= {whole[:-1] + bytes([whole[-1] ^ 1]): "cannot be read"}
    for content, sentence in ({whole[:n]: "" for n in (0, 100, 190, half)} | damaged).items():
        path.write_bytes(content)
        refused(named("stmnist"), path, sentence)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"other": np.ones((3, 3)), "more": "text"}, "no array 'spiketrain'; known: other, more"),
        ({"spiketrain": np.ones((100, 7))}, "must be 101 x n real numbers, got float64 of shape (100"),
        ({"spiketrain": np.ones((101, 7)) * 1j}, "must be 101 x n real numbers, got complex128"),
        ({"spiketrain": "no numbers"}, "must be 101 x n real numbers, got <U"),
    ],
)
def test_another_matrix(tmp_path, content, sentence):
    savemat(tmp_path / "a.mat", content)
    refused(named("stmnist"), tmp_path / "a.mat", sentence)


def test_columns_without_a_time(tmp_path):
    spikes, path = matrix(10), tmp_path / "a.mat"
    spikes[-1, [2, 5]] = np.nan, np.inf
    spikes[17, 8] = np.nan
    savemat(path, {"spiketrain": spikes})
    wanted = events_of(np.delete(spikes, [2, 5, 8], axis=1))
    told = "column 2 must hold numbers and a time in seconds, got the time nan"
    assert tuples(faulty(named("stmnist"), path, len(wanted), told, "(3 in all)")) == wanted
    savemat(path, {"spiketrain": np.zeros((N_ROWS, 0))})
    assert len(read(named("stmnist"), path)[0].t_us) == 0


# ---- memory

MOST_PER_EVENT = {"es": 480, "nmnist": 480, "aedat2": 180, "aedat4 lz4": 120}
MOST_PER_EVENT |= {"dat": 240, "evt2": 240, "evt3 by 12": 240}


@pytest.mark.parametrize("name", MOST_PER_EVENT)
def test_memory_does_not_follow_the_length(path, name):
    """A file of five blocks takes a block's memory: some copies of it, and the bytes that are read."""
    content, form = WRITE[name](many(BLOCK_EVENTS, 128, 128)), named(name.split()[0])
    header = dv.head_4() if name == "aedat4 lz4" else WRITE[name]([])
    path.write_bytes(content)
    list(form.blocks(path, Repairs(path.name, False)))  # imports what is needed
    path.write_bytes(content + 4 * content[len(header) :])
    tracemalloc.start()
    n = sum(len(block.t_us) for block in form.blocks(path, Repairs(path.name, False)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert n == 5 * BLOCK_EVENTS and peak < MOST_PER_EVENT[name] * BLOCK_EVENTS
