"""Every event that leaves `checked` is sound, and nothing is repaired without a note."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.data.recordings import RecordingError
from dse.data.recordings.formats import Repairs, checked
from tests.data.recordings.formats.reading import block, tuples


def passed(*blocks, repair=True):
    repairs = Repairs("a.raw", repair)
    sound = checked(iter(blocks), 10, 5, repairs)
    return [event for each in sound for event in tuples(each)], repairs.notes


OUTSIDE = "drops events outside the frame"
NONE = "treats the file as a recording without events"
FAULTS = [
    # Events, a border of blocks, the fault, what repair leaves, and what it does.
    *(
        (
            [(4, 0, 0, 0), (5, x, y, 0)],
            rf"event 1 .*\(x, y\) within .* 10 x 5 pixels, got {x}, {y}",
            1,
            OUTSIDE,
        )
        for x, y in ((10, 0), (0, 5), (-1, 0))
    ),
    (
        [(4, 0, 0, 0), (-2, 0, 0, 0)],
        "event 1 must have a time of at least 0 us, got -2",
        1,
        "drops events bef",
    ),
    ([(4, 0, 0, 0), (5, 0, 0, 2)], "event 1 must have polarity 0 or 1, got 2", 2, "treats other polarities"),
    (
        [(4, 0, 0, 0), (3, 0, 0, 0)],
        "event 1 must not be earlier .*latest time before, got 3, 4",
        2,
        "sets the time",
    ),
    (
        [(9, 10, 0, 0), (3, 1, 0, 0)],
        "event 0 must have its",
        [(3, 1, 0, 0)],
        OUTSIDE,
    ),  # it does not set the time
    (
        *([(5, 0, 0, 0), (3, 1, 0, 0), (4, 2, 0, 0), (6, 3, 0, 0)], "event 1 must not be earlier"),
        [(5, 0, 0, 0), (5, 1, 0, 0), (5, 2, 0, 0), (6, 3, 0, 0)],
        "sets the time of an event out of order to the latest time before (2 in all)",
    ),
    ([], "must have events, got none", 0, NONE),
    ([(1, 99, 0, 0)], "event 0 must have its", 0, NONE),
]


@pytest.mark.parametrize(("events", "fault", "left", "repair"), FAULTS)
def test_an_unsound_event_is_named_and_repaired_with_a_note(events, fault, left, repair):
    for blocks in ([block(*events)], [block(*events[:1]), block(), block(*events[1:])]):
        with pytest.raises(RecordingError, match=rf"^a\.raw: {fault}.*; --repair "):
            passed(*blocks, repair=False)
        found, notes = passed(*blocks)
        assert (len(found) if isinstance(left, int) else found) == left
        assert notes[-1].startswith("a.raw: ") and repair in notes[-1]


times = st.integers(-3, 30)
some_events = st.lists(
    st.tuples(times, st.integers(-2, 12), st.integers(-2, 7), st.integers(0, 3)), max_size=8
)


@given(st.lists(some_events, max_size=5))
def test_repair_leaves_only_sound_events_in_their_order(parts):
    given_blocks = [block(*part) for part in parts]
    before = [tuples(part) for part in given_blocks]
    found, notes = passed(*given_blocks)
    assert [tuples(part) for part in given_blocks] == before, "the input is not changed"
    inside = [(x, y, p) for part in parts for t, x, y, p in part if 0 <= x < 10 and 0 <= y < 5 and t >= 0]
    assert [(x, y, min(p, 1)) for x, y, p in inside] == [(x, y, p) for _, x, y, p in found]
    assert all(a[0] <= b[0] for a, b in pairwise(found)) and all(t >= 0 for t, *_ in found)
    whole = [event for part in parts for event in part]
    assert (whole == found and bool(found)) == (not notes)
    together, notes_together = passed(block(*whole))
    assert together == found and sorted(notes_together) == sorted(notes), "block borders do not matter"
