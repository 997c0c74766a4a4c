"""Blocks of columns: what is packed comes back, and every row begins where the kernels expect it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.engine.layout import aligned, packed, padded, unpacked, width_at


@given(rows=st.integers(0, 9), columns=st.integers(1, 200), whole=st.booleans())
def test_a_matrix_comes_back_from_its_blocks(rows, columns, whole):
    kind = np.int8 if whole else np.float32
    matrix = np.random.default_rng(0).integers(-128, 128, (rows, columns)).astype(kind)
    flat = packed(matrix, kind)
    assert flat.dtype == kind and flat.size == rows * padded(columns)
    np.testing.assert_array_equal(unpacked(flat, rows, columns), matrix)


@pytest.mark.parametrize("columns", [1, 16, 17, 48, 64, 65, 100, 112, 450])
def test_blocks_cover_all_columns_and_elements_lie_where_the_kernels_look(columns):
    rows, n = 3, padded(columns)
    matrix = np.arange(rows * columns, dtype=np.float32).reshape(rows, columns)
    flat = packed(matrix, np.float32)
    column = 0
    while column < n:
        width = width_at(column, n)
        assert width in (16, 32, 64) and column % 16 == 0
        for row in range(rows):
            for c in range(width):
                expected = matrix[row, column + c] if column + c < columns else 0
                assert flat[rows * column + row * width + c] == expected
        column += width
    assert column == n


def test_arrays_begin_on_a_cache_line_and_with_zeros():
    for n in (1, 7, 1000):
        found = aligned(n, np.float32)
        assert found.ctypes.data % 64 == 0 and found.shape == (n,) and not found.any()
