import numpy as np
import pytest

from dse.recordings import RecordingError
from dse.recordings.positions import check_positions, position_faults, taxel_positions

PLACES = ((4, 0), (0, 7), (4, 7))


def test_taxels_lie_where_they_are_said_to_and_in_a_row_else():
    taxel, plane = np.array([0, 0, 1, 1, 2, 2]), np.array([0, 1] * 3)
    found = taxel_positions(PLACES, taxel, plane)
    assert found.dtype == np.int32
    assert found.tolist() == [[4, 0, 0], [4, 0, 1], [0, 7, 0], [0, 7, 1], [4, 7, 0], [4, 7, 1]]
    assert taxel_positions(None, taxel, plane)[:, :2].tolist() == [[k, 0] for k in (0, 0, 1, 1, 2, 2)]
    assert taxel_positions(None, np.array([0]), np.array([0])).tolist() == [[0, 0, 0]]


def test_good_positions_have_no_fault():
    for positions in (None, PLACES, [[0, 0]], ((65535, 0),)):
        check_positions(positions)
    assert position_faults(PLACES, 3) == position_faults(None, 8) == position_faults(PLACES, None) == []


@pytest.mark.parametrize(
    ("positions", "got"),
    [
        (((0, 0), (1, -1)), r"got \[1, -1\] for taxel 1"),
        (((0, 0.5),), r"got \[0, 0.5\] for taxel 0"),
        (((0, True),), r"got \[0, True\] for taxel 0"),
        (((0, 1, 2),), r"got \[0, 1, 2\] for taxel 0"),
        ((3, 4), r"got \[3\] for taxel 0"),
        (((0, 65536),), r"from 0 to 65535 for every taxel, got \[0, 65536\] for taxel 0"),
        (((2, 1), (0, 0), (2, 1)), r"must be distinct, got \[2, 1\] for taxels 0 and 2"),
    ],
)
def test_places_that_are_none(positions, got):
    with pytest.raises(RecordingError, match=got):
        check_positions(positions)


@pytest.mark.parametrize("positions", [PLACES, ()])
def test_another_number_of_places_than_taxels(positions):
    fault = rf"must hold \[x, y\] for each of the 2 taxels, got {len(positions)}"
    with pytest.raises(RecordingError, match=fault):
        taxel_positions(positions, np.arange(2), np.zeros(2, dtype=int))
