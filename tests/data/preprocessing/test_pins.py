import numpy as np
import pytest

from dse.base.records import Block
from dse.data.preprocessing.pins import count_pixels, otsu, pin_rectangle


def test_counts_of_columns_and_rows():
    blocks = [
        Block(np.arange(3), np.array([0, 2, 2]), np.array([1, 1, 0]), np.ones(3, np.uint8)),
        Block(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.uint8)),
        Block(np.arange(1), np.array([3]), np.array([1]), np.zeros(1, np.uint8)),
    ]
    columns, rows = count_pixels(blocks, 5, 3)
    assert columns.tolist() == [1, 0, 2, 1, 0]
    assert rows.tolist() == [1, 3, 0]


@pytest.mark.parametrize(
    ("values", "threshold"),
    [([1, 1, 9, 9, 9], 1), ([9, 1, 9, 1], 1), ([0, 1, 2, 10, 11], 2), ([5, 5, 5], 5), ([3], 3)],
)
def test_threshold_of_two_classes(values, threshold):
    assert otsu(np.array(values, dtype=float)) == threshold


def test_the_threshold_splits_best():
    """The classes that Otsu's criterion finds have the least variance within them."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        values = np.concatenate(
            [rng.normal(0, 1, rng.integers(3, 30)), rng.normal(4, 2, rng.integers(3, 30))]
        )

        def within(threshold, values=values):
            parts = values[values <= threshold], values[values > threshold]
            return sum(((part - part.mean()) ** 2).sum() for part in parts)

        least = min(within(value) for value in np.sort(values)[:-1])
        assert within(otsu(values)) == pytest.approx(least, rel=1e-9)


def pin_counts(n, low, high, rng):
    """Counts along an axis: a round field of pins from `low` to `high`, noise elsewhere."""
    u = np.arange(n)
    across = 1 - ((u - (low + high) / 2) / ((high - low) / 2 + 0.5)) ** 2
    return rng.poisson(np.where(across > 0, 20_000 * np.sqrt(across.clip(0)), 0) + 60)


def test_the_rectangle_is_that_of_the_pins():
    rng = np.random.default_rng(1)
    rectangle = pin_rectangle(pin_counts(240, 40, 199, rng), pin_counts(180, 10, 169, rng))
    assert rectangle == (40, 10, 160, 160)


def test_a_broken_pixel_does_not_move_the_rectangle():
    rng = np.random.default_rng(2)
    columns, rows = pin_counts(240, 40, 199, rng), pin_counts(180, 10, 169, rng)
    columns[100] += 5_000_000
    rows[90] += 5_000_000
    assert pin_rectangle(columns, rows) == (40, 10, 160, 160)


@pytest.mark.parametrize("level", [0, 7])
def test_counts_that_are_all_the_same_keep_the_frame(level):
    assert pin_rectangle(np.full(6, level), np.full(4, level)) == (0, 0, 6, 4)


def test_gaps_between_pins_are_kept():
    assert pin_rectangle(np.array([0, 9, 0, 0, 8, 0]), np.array([5])) == (1, 0, 4, 1)
