"""Windows at other positions."""

from dataclasses import replace

from dse.data import dataset
from dse.testing import small


def test_windows_move_only_where_steps_are_stored():
    data = small.dataset(margin=2)
    assert dataset.has_room(data, 2).all() and not dataset.has_room(data, 3).any()
    narrow = replace(
        data, start_low=data.start, start_high=data.start, room_low=data.start_low, room_high=data.start_high
    )
    assert dataset.has_room(narrow, -2).all() and not dataset.has_room(narrow, -3).any()
    assert dataset.shifted(narrow, -2).start.tolist() == data.start_low.tolist()
