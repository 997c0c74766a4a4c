"""Writers of the small files that the tests of the readers read back, after the formats' descriptions."""

import struct

import numpy as np
from hypothesis import strategies as st

Event = tuple[int, int, int, int]  # t_us, x, y, polarity


def event_lists(most_us, most_xy):
    """Return lists of 1 to 40 events in order: gaps up to `most_us`, addresses up to `most_xy`."""
    gap = st.one_of(st.just(0), st.integers(0, 100), st.integers(0, most_us))
    address = st.integers(0, most_xy)
    parts = st.lists(st.tuples(gap, address, address, st.integers(0, 1)), min_size=1, max_size=40)
    return parts.map(
        lambda found: [(sum(g for g, *_ in found[: k + 1]), *found[k][1:]) for k in range(len(found))]
    )


def evt2_event(t, x, y, p):
    return p << 28 | (t & 0x3F) << 22 | x << 11 | y


def evt2_high(high):
    return 0x8 << 28 | high % (1 << 28)


def evt2_words(events):
    words, high = [], None
    for t, x, y, p in events:
        if t >> 6 != high:
            high = t >> 6
            words.append(evt2_high(high))
        words.append(evt2_event(t, x, y, p))
    return words


def evt3_high(high):
    return 0x8 << 12 | high % (1 << 12)


def evt3_low(low):
    return 0x6 << 12 | low


def evt3_y(y):
    return 0x0 << 12 | y


def evt3_x(x, p):
    return 0x2 << 12 | p << 11 | x


def evt3_base(x, p):
    return 0x3 << 12 | p << 11 | x


def evt3_vector(valid, wide):
    return {12: 0x4, 8: 0x5}[wide] << 12 | valid


def evt3_words(events, wide=0):
    """Return EVT 3.0 words; with `wide` 12 or 8, runs of one time, row and polarity become vectors."""
    words = []
    high, low, row = None, 0, None
    k = 0
    while k < len(events):
        t, x, y, p = events[k]
        if t >> 12 != high:
            high, low = t >> 12, 0
            words.append(evt3_high(high))
        if t & 0xFFF != low:
            low = t & 0xFFF
            words.append(evt3_low(low))
        if y != row:
            row = y
            words.append(evt3_y(y))
        run = [x]
        k += 1
        while (
            wide
            and k < len(events)
            and events[k][0] == t
            and events[k][2:] == (y, p)
            and events[k][1] > run[-1]
        ):
            run.append(events[k][1])
            k += 1
        if len(run) == 1:
            words.append(evt3_x(x, p))
            continue
        words.append(evt3_base(x, p))
        for first in range(x, run[-1] + 1, wide):
            valid = sum(1 << (column - first) for column in run if first <= column < first + wide)
            words.append(evt3_vector(valid, wide))
    return words


def raw(words, size, header):
    """Return an EVT file: header, then little-endian words of `size` bytes."""
    return header.encode("latin-1") + np.array(list(words), dtype=f"<u{size}").tobytes()


def dat(events, header="% Version 2\n", mark=b"\x0c\x08"):
    packed = [struct.pack("<II", t % (1 << 32), p << 28 | y << 14 | x) for t, x, y, p in events]
    return header.encode() + mark + b"".join(packed)


def nmnist(events):
    return b"".join(bytes([x, y, p << 7 | t >> 16 & 0x7F, t >> 8 & 0xFF, t & 0xFF]) for t, x, y, p in events)


def head_es(kind=1, version=b"\x02\x00\x01", width=300, height=260):
    """Return the header of an Event Stream; kind 1 is DVS, 2 ATIS."""
    size = width.to_bytes(2, "little") + height.to_bytes(2, "little")
    return b"Event Stream" + version + bytes([kind]) + size


def coded_es(events, kind=1, height=260):
    """Return events of an Event Stream: elapsed time beyond a byte's range goes before the event."""
    full, most = 255 >> kind, (1 << kind) - 1
    recording, before = bytearray(), 0
    for t, x, y, polarity in events:
        steps, rest = divmod(t - before, full)
        while steps:
            recording.append(full << kind | min(steps, most))
            steps -= min(steps, most)
        recording.append(rest << kind | polarity << (kind - 1))
        recording += x.to_bytes(2, "little") + (height - 1 - y).to_bytes(2, "little")
        before = t
    return bytes(recording)
