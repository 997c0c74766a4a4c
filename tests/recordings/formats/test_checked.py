"""Every event that leaves `checked` is sound, and nothing is repaired without a note."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import Repairs, checked
from dse.records import Block
from tests.recordings.formats.reading import tuples


def block(*events):
    t_us, x, y, polarity = np.array(events, dtype=np.int64).reshape(-1, 4).T
    return Block(t_us, x.astype(np.int32), y.astype(np.int32), polarity.astype(np.uint8))


def events_of(blocks):
    return [event for block in blocks for event in tuples(block)]


def strict(*blocks):
    return events_of(checked(iter(blocks), 10, 5, Repairs("a.raw", False)))


def repaired(*blocks):
    repairs = Repairs("a.raw", True)
    return events_of(checked(iter(blocks), 10, 5, repairs)), repairs.notes


def test_sound_events_pass_unchanged():
    events = [(0, 0, 0, 0), (0, 9, 4, 1), (7, 3, 3, 1)]
    assert strict(block(*events[:2]), block(), block(*events[2:])) == events
    assert repaired(block(*events)) == (events, [])


OUTSIDE = r"event 1 must have its \(x, y\) within the frame of 10 x 5 pixels, got "


@pytest.mark.parametrize(
    ("event", "sentence"),
    [
        *(((5, x, y, 0), f"{OUTSIDE}{x}, {y}") for x, y in ((10, 0), (0, 5), (-1, 0))),
        ((-2, 0, 0, 0), "event 1 must have a time of at least 0 us, got -2"),
        ((5, 0, 0, 2), "event 1 must have polarity 0 or 1, got 2"),
        ((3, 0, 0, 0), "event 1 must not be earlier .*latest time before, got 3, 4"),
    ],
)
def test_an_unsound_event_is_named(event, sentence):
    with pytest.raises(RecordingError, match=rf"^a\.raw: {sentence}; --repair "):
        strict(block((4, 0, 0, 0), event))
    with pytest.raises(RecordingError, match=rf"^a\.raw: {sentence}; --repair "):
        strict(block((4, 0, 0, 0)), block(event))


@pytest.mark.parametrize(
    ("blocks", "wanted", "repairs"),
    [
        (
            (block((1, 0, 0, 0), (2, 10, 0, 0)), block((3, 0, 7, 1), (4, 1, 1, 1))),
            [(1, 0, 0, 0), (4, 1, 1, 1)],
            ["got 10, 0; --repair drops events outside the frame (2 in all)"],
        ),
        (
            (block((5, 0, 0, 0), (3, 1, 0, 0)), block((4, 2, 0, 0), (6, 3, 0, 0))),
            [(5, 0, 0, 0), (5, 1, 0, 0), (5, 2, 0, 0), (6, 3, 0, 0)],
            ["sets the time of an event out of order to the latest time before (2 in all)"],
        ),
        # A dropped event does not set the time.
        ((block((9, 10, 0, 0), (3, 1, 0, 0)),), [(3, 1, 0, 0)], ["drops events outside the frame"]),
        (
            (block((-1, 0, 0, 0), (0, 1, 1, 3)),),
            [(0, 1, 1, 1)],
            ["drops events before 0 us", "treats other polarities as ON"],
        ),
    ],
)
def test_what_repair_does_is_noted(blocks, wanted, repairs):
    events, notes = repaired(*blocks)
    assert events == wanted
    assert all(note.endswith(end) for note, end in zip(notes, repairs, strict=True))


@pytest.mark.parametrize("blocks", [(), (block(),), (block((1, 99, 0, 0)),)])
def test_a_recording_without_events(blocks):
    events, notes = repaired(*blocks)
    assert events == []
    assert notes[-1].startswith("a.raw: must have events, got none; --repair treats the file as")
    with pytest.raises(RecordingError, match=r"^a\.raw: "):
        strict(*blocks)


times = st.integers(-3, 30)
some_events = st.lists(
    st.tuples(times, st.integers(-2, 12), st.integers(-2, 7), st.integers(0, 3)), max_size=8
)


@given(st.lists(some_events, max_size=5))
def test_repair_leaves_only_sound_events_in_their_order(parts):
    found, notes = repaired(*(block(*part) for part in parts))
    inside = [(x, y, p) for part in parts for t, x, y, p in part if 0 <= x < 10 and 0 <= y < 5 and t >= 0]
    assert [(x, y, min(p, 1)) for x, y, p in inside] == [(x, y, p) for _, x, y, p in found]
    assert all(a[0] <= b[0] for a, b in pairwise(found))
    assert all(t >= 0 for t, *_ in found)
    whole = [event for part in parts for event in part]
    assert (whole == found and bool(found)) == (not notes)


@given(some_events, st.integers(0, 8))
def test_block_borders_do_not_matter(events, border):
    whole, notes = repaired(block(*events))
    parts, notes_of_parts = repaired(block(*events[:border]), block(*events[border:]))
    assert (whole, sorted(notes)) == (parts, sorted(notes_of_parts))


def test_the_input_is_not_changed():
    given_block = block((5, 0, 0, 3), (3, 11, 0, 0), (4, 1, 1, 1))
    before = [column.copy() for column in vars(given_block).values()]
    repaired(given_block)
    assert all((a == b).all() for a, b in zip(before, vars(given_block).values(), strict=True))
