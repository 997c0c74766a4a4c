"""Every operation of the vector language against numpy, lane by lane."""

import numba
import numpy as np
import pytest

from dse.base.native.vectors import (
    LANES_8,
    LANES_16,
    LANES_32,
    LANES_64,
    as_type_of,
    bits,
    count_bits,
    differs,
    either,
    fma,
    greater,
    joined,
    larger,
    load,
    lowest_bit,
    magnitude,
    power_of_two,
    rint,
    select,
    smaller,
    splat,
    sqrt,
    store,
    trunc,
    widened,
    zeros,
)

FLOATS = (np.float32, np.float64)
INTEGERS = (np.int8, np.int16, np.int32, np.int64)
SPECIAL = [
    0.0,
    -0.0,
    1.0,
    -1.5,
    2.5,
    -2.5,
    3.5,
    1e30,
    -1e30,
    1e-40,
    -1e-40,
    np.inf,
    -np.inf,
    np.nan,
    0.5,
    -0.5,
]


def numbers(kind, n=16, seed=0):
    """Return lanes with ties, infinities, NaN and denormal numbers, or whole numbers up to the limits."""
    if np.dtype(kind).kind == "i":
        info = np.iinfo(kind)
        drawn = np.random.default_rng(seed).integers(-7, 8, n).astype(kind)
        drawn[:2] = info.min, info.max
        return drawn
    values = np.array(SPECIAL * (n // 16), kind)
    return np.roll(values, seed)


def unary(operation):
    @numba.njit(error_model="numpy")
    def run(x, out):
        store(out, 0, operation(load(x, 0, LANES_16)))

    return run


def binary(operation):
    @numba.njit(error_model="numpy")
    def run(x, y, out):
        store(out, 0, operation(load(x, 0, LANES_16), load(y, 0, LANES_16)))

    return run


@pytest.mark.parametrize("kind", FLOATS)
@pytest.mark.parametrize(
    ("operation", "expected"), [(trunc, np.trunc), (rint, np.rint), (sqrt, np.sqrt), (magnitude, np.abs)]
)
def test_functions_of_one_vector(operation, expected, kind):
    x = numbers(kind)
    out = np.empty_like(x)
    unary(operation)(x, out)
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(out, expected(x))
    assert (np.signbit(out) == np.signbit(expected(np.abs(x)) if operation is sqrt else expected(x)))[
        ~np.isnan(out) & (out != 0)
    ].all()


@numba.njit
def _add(x, y, out):
    store(out, 0, load(x, 0, LANES_16) + load(y, 0, LANES_16))


@numba.njit
def _subtract(x, y, out):
    store(out, 0, load(x, 0, LANES_16) - load(y, 0, LANES_16))


@numba.njit
def _multiply(x, y, out):
    store(out, 0, load(x, 0, LANES_16) * load(y, 0, LANES_16))


@numba.njit(error_model="numpy")
def _divide(x, y, out):
    store(out, 0, load(x, 0, LANES_16) / load(y, 0, LANES_16))


ARITHMETIC = ((_add, np.add), (_subtract, np.subtract), (_multiply, np.multiply))


@pytest.mark.parametrize("kind", [*FLOATS, *INTEGERS])
@pytest.mark.parametrize(("operation", "expected"), ARITHMETIC)
def test_arithmetic_is_plain_and_integers_wrap(operation, expected, kind):
    x, y = numbers(kind), numbers(kind, seed=5)
    out = np.empty_like(x)
    operation(x, y, out)
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(out, expected(x, y))


@pytest.mark.parametrize("kind", [*FLOATS, np.int32])
def test_division(kind):
    x, y = numbers(kind), numbers(kind, seed=5)
    if kind is np.int32:
        y = np.where(y == 0, kind(3), y)
    out = np.empty_like(x)
    _divide(x, y, out)
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(out, np.trunc(x / y).astype(kind) if kind is np.int32 else x / y)


@pytest.mark.parametrize("kind", FLOATS)
@pytest.mark.parametrize(("operation", "expected"), [(larger, np.fmax), (smaller, np.fmin)])
def test_the_larger_and_the_smaller_pass_over_nan(operation, expected, kind):
    x, y = numbers(kind), numbers(kind, seed=5)
    out = np.empty_like(x)
    binary(operation)(x, y, out)
    np.testing.assert_array_equal(out, expected(x, y))


@numba.njit
def _fused(x, y, z, out):
    store(out, 0, fma(load(x, 0, LANES_16), load(y, 0, LANES_16), load(z, 0, LANES_16)))


@pytest.mark.parametrize("kind", FLOATS)
def test_a_fused_product_is_rounded_once(kind):
    tiny = np.finfo(kind).eps
    x, y = np.full(16, 1 + tiny, kind), np.full(16, 1 - tiny, kind)
    out = np.empty_like(x)
    _fused(x, y, -np.ones_like(x), out)
    np.testing.assert_array_equal(x * y - 1, 0)  # (1 + e) (1 - e) rounds to 1
    np.testing.assert_array_equal(out, -kind(tiny) * kind(tiny))


@numba.njit
def _masks(x, y, out):
    a, b = load(x, 0, LANES_16), load(y, 0, LANES_16)
    above, other = greater(a, b), differs(a, b)
    store(out, 0, select(above, a, b))
    return bits(above), bits(other), bits(either(above, other))


@pytest.mark.parametrize("kind", FLOATS)
def test_masks_of_comparisons_with_nan(kind):
    x, y = numbers(kind), np.roll(numbers(kind), 1)
    y[3] = x[3]
    out = np.empty_like(x)
    lanes = 1 << np.arange(16, dtype=np.uint64)
    above, other, any_of = _masks(x, y, out)
    assert above == lanes[x > y].sum()
    assert other == lanes[x != y].sum()
    assert any_of == lanes[(x > y) | (x != y)].sum()
    np.testing.assert_array_equal(out, np.where(x > y, x, y))


@numba.njit
def _cast(x, out):
    store(out, 0, as_type_of(load(x, 0, LANES_16), out))


@numba.njit
def _stored(x, out):
    store(out, 0, load(x, 0, LANES_16))


@pytest.mark.parametrize("target", [*FLOATS, *INTEGERS])
@pytest.mark.parametrize("source", [*FLOATS, *INTEGERS])
def test_casts_are_those_of_c(source, target):
    x = np.array([0, 1, -1, 2, -3, 100, -100, 127, -128, 5, 6, 7, 8, -9, 10, 11], source)
    if np.dtype(source).kind == "f":
        x[8:] = [-127.9, 5.5, -5.5, 0.99, -0.99, 1e-20, -1e-20, 64.25]  # truncated where whole numbers follow
    for operation in (_cast, _stored):
        out = np.empty(16, target)
        operation(x, out)
        np.testing.assert_array_equal(out, x.astype(target))


@numba.njit
def _sum_16(x, out):
    total = widened(zeros(x, LANES_16), out)
    for i in range(3):
        total = total + widened(load(x, 16 * i, LANES_16), out)
    store(out, 0, total)


@pytest.mark.parametrize("kind", [np.int8, np.float32, np.float64])
def test_sums_of_bytes_do_not_overflow(kind):
    x = np.full(48, -128, kind)
    out = np.empty(16, np.float64)
    _sum_16(x, out)
    np.testing.assert_array_equal(out, -384.0)


@numba.njit
def _scaled_32(x, factor, offset, out):
    v = load(x, offset, LANES_32)
    store(out, offset, v * splat(factor, v))


@numba.njit
def _scaled_64(x, factor, offset, out):
    v = load(x, offset, LANES_64)
    store(out, offset, v * splat(factor, v))


@pytest.mark.parametrize("offset", [0, 1, 3, 37])
@pytest.mark.parametrize(("operation", "lanes"), [(_scaled_32, 32), (_scaled_64, 64)])
def test_wide_vectors_start_anywhere_and_touch_nothing_else(operation, lanes, offset):
    x = np.random.default_rng(1).normal(size=lanes + 41).astype(np.float32)
    out = np.full_like(x, 7.0)
    operation(x, 0.1, offset, out)
    expected = np.full_like(x, 7.0)
    expected[offset : offset + lanes] = x[offset : offset + lanes] * np.float32(0.1)
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize(("kind", "lowest", "highest"), [(np.float32, -126, 127), (np.float64, -1022, 1023)])
def test_powers_of_two(kind, lowest, highest):
    n = np.linspace(lowest, highest, 16).round().astype(kind)
    out = np.empty_like(n)
    unary(power_of_two)(n, out)
    np.testing.assert_array_equal(out, np.exp2(n.astype(np.float64)).astype(kind))


@numba.njit
def _counted(x):
    return count_bits(x), lowest_bit(x)


@pytest.mark.parametrize("x", [1, 2, 0b1011000, 2**63, 2**64 - 1])
def test_bits_of_a_number(x):
    assert _counted(np.uint64(x)) == (x.bit_count(), (x & -x).bit_length() - 1)


def test_words_are_shifted_lane_by_lane():
    @numba.njit(error_model="numpy")
    def run(x, y, by, out):
        a, b = load(x, 0, LANES_8), load(y, 0, LANES_8)
        shift = splat(np.uint64(by), a)
        store(out, 0, joined(a << shift, (a >> shift) | b))

    x, y = np.random.default_rng(0).integers(0, 2**64, (2, 8), np.uint64, endpoint=False)
    for by in (0, 1, 63):
        out = np.zeros(16, np.uint64)
        run(x, y, by, out)
        expected = [x << np.uint64(by), (x >> np.uint64(by)) | y]  # ones are not drawn in from the left
        np.testing.assert_array_equal(out, np.concatenate(expected))
