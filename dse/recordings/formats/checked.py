"""What the events of a file must be, whatever its format: in order, in the frame, ON or OFF."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dse.recordings.formats import Broken
from dse.records import Array, Block, Bools, Ints


def checked(blocks: Iterator[Block], width: int, height: int, broken: Broken) -> Iterator[Block]:
    """Yield the blocks of one recording after checks: times never fall, addresses lie in the frame.

    With repair, in this order: events outside the frame or before 0 us are dropped; a polarity above 1 is ON;
    an event earlier than one before it takes the latest time so far. That loses none and brings none forward,
    but one wrong stamp far ahead holds up all that follow it: the note counts them.

    Raises:
        RecordingError: an event is not sound, or there is none, and `broken` raised it.
    """
    n_read, n_kept, latest = 0, 0, 0
    for block in blocks:
        t_us, x, y, polarity = block.t_us, block.x, block.y, block.polarity
        number: Ints = np.arange(n_read, n_read + len(t_us))
        n_read += len(t_us)
        outside = (x < 0) | (x >= width) | (y < 0) | (y >= height)
        frame = f"have its (x, y) within the frame of {width} x {height} pixels"
        _report(broken, number, outside, frame, (x, y), "drops events outside the frame")
        early = t_us < 0
        _report(broken, number, early, "have a time of at least 0 us", (t_us,), "drops events before 0 us")
        other = polarity > 1
        _report(broken, number, other, "have polarity 0 or 1", (polarity,), "treats other polarities as ON")
        valid = ~(outside | early)
        if not valid.all():
            number, t_us, x, y, polarity = (part[valid] for part in (number, t_us, x, y, polarity))
        if not len(t_us):
            continue
        in_order = np.maximum.accumulate(np.maximum(t_us, latest))
        order = "not be earlier than a previous event: time in us and latest time before"
        falls = t_us < in_order
        _report(
            broken,
            number,
            falls,
            order,
            (t_us, in_order),
            "sets the time of an event out of order to the latest time before",
        )
        latest = int(in_order[-1])
        n_kept += len(t_us)
        yield Block(in_order, x, y, np.minimum(polarity, 1))
    if not n_kept:
        broken("must have events, got none", "treats the file as a recording without events", 1)


def _report(
    broken: Broken, number: Ints, bad: Bools, rule: str, values: tuple[Array, ...], repair: str
) -> None:
    """Report the bad events of a block by the first of them; `number` counts them through the recording."""
    if bad.any():
        k = int(bad.argmax())
        got = ", ".join(str(value[k]) for value in values)
        broken(f"event {number[k]} must {rule}, got {got}", repair, int(bad.sum()))
