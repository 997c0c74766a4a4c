"""The state machine of Event Stream: bytes of elapsed time alone, or events of five bytes."""

from __future__ import annotations

from dse.native.compiled import compiled


@compiled()
def decode(data, time, shift, t_us, x, y, polarity):  # type: ignore[no-untyped-def]
    """Decode whole events; return how many there are, how many bytes they took, and the time at the end.

    The lowest `shift` bits of an event's first byte are flags, the others the elapsed time; all of those set,
    the byte is no event but lets that much time pass, as many times as the flags say (zero: a reset).

    Args:
        data: (byte,) uint8, beginning between events.
        time: time of the byte before, us.
        shift: 1 for DVS (flag: polarity), 2 for ATIS (polarity, threshold crossing; those are left out).
        t_us: (event,) int64, filled.
        x: (event,) int32, filled.
        y: (event,) int32, filled.
        polarity: (event,) uint8, filled.
    """
    full, flags = 255 >> shift, (1 << shift) - 1
    n, at = 0, 0
    while at < len(data):
        elapsed, flag = data[at] >> shift, data[at] & flags
        if elapsed == full:
            time += full * flag
            at += 1
            continue
        if at + 5 > len(data):
            break
        time += elapsed
        if shift == 1 or flag & 1 == 0:
            t_us[n] = time
            x[n] = data[at + 1] | data[at + 2] << 8
            y[n] = data[at + 3] | data[at + 4] << 8
            polarity[n] = flag >> (shift - 1)
            n += 1
        at += 5
    return n, at, time
