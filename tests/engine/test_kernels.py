"""The loops of the CPU engine against numpy, with the cases in which short integers would overflow."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.base.native.compiled import _sources
from dse.engine import kernels
from dse.engine.adam import adam
from dse.engine.batch import batch_of
from dse.engine.layers import laid_out, prepare, run, weights
from dse.engine.layout import LANES, aligned, packed, padded, unpacked, width_at
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.surrogate import exponential


def gathered(rows, table, kind, out_kind):
    """Return the sums of table rows that each row lists, block by block."""
    n_inputs, n_columns = table.shape
    n_rows = rows.n_samples * rows.n_steps
    flat, out = packed(table, kind), aligned(n_rows * padded(n_columns), out_kind)
    column = 0
    while column < padded(n_columns):
        width = width_at(column, padded(n_columns))
        start, place = n_inputs * column, n_rows * column
        kernels.gather(
            rows.offsets, rows.index, rows.times, 0, n_rows, flat, start, width, 1.0, out, place, False
        )
        column += width
    return unpacked(out, n_rows, n_columns)


@pytest.mark.parametrize("n_columns", [1, 16, 40, 64, 100, 130])
def test_sums_of_int8_rows_are_exact(n_columns):
    rng = np.random.default_rng(1)
    x = (rng.random((3, 20, 50)) < 0.3).astype(np.uint8)
    table = rng.integers(-128, 128, (50, n_columns))
    found = gathered(rows_of(x), table, np.int8, np.float32)
    np.testing.assert_array_equal(found, x.reshape(60, 50).astype(int) @ table)


@pytest.mark.parametrize("weight", [-128, 127])
def test_thousands_of_the_largest_int8_rows_do_not_overflow(weight):
    x = np.ones((1, 2, 6084), np.uint8)
    found = gathered(rows_of(x), np.full((6084, 5), weight), np.int8, np.float32)
    assert (found == 6084 * weight).all()


@pytest.mark.parametrize(("kind", "bound"), [(np.float32, 1e-5), (np.float64, 1e-12)])
def test_sums_of_real_rows_agree_with_numpy(kind, bound):
    rng = np.random.default_rng(2)
    x = (rng.random((2, 10, 700)) < 0.6).astype(np.uint8)
    table = rng.normal(size=(700, 70)).astype(np.float32)
    expected = x.reshape(20, 700).astype(np.float64) @ table.astype(np.float64)
    found = gathered(rows_of(x), table, np.float32, kind)
    np.testing.assert_allclose(found, expected, atol=bound * np.abs(expected).max())


def test_the_transpose_lists_each_inputs_rows_chunk_by_chunk():
    rng = np.random.default_rng(3)
    x = (rng.random((9, 1000, 6)) < 0.05).astype(np.uint8)
    batch = batch_of(rows_of(x))
    assert batch.starts.tolist() == [0, 4, 8, 9]
    for chunk in range(3):
        first, end = batch.starts[chunk : chunk + 2]
        part = x[first:end].reshape(-1, 6)
        for i in range(6):
            low, high = batch.offsets[chunk, i : i + 2]
            np.testing.assert_array_equal(batch.index[low:high], np.flatnonzero(part[:, i]))


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
@pytest.mark.parametrize("tau", [0.001, 0.03, 0.5])
def test_the_fast_exponential_is_the_surrogate(arithmetic, tau):
    # One input, one spike: the potential that each neuron meets is its weight.
    drive = np.linspace(-3.9, 3.9, 240).astype(np.float32)
    drive = drive if arithmetic != "integer" else np.round(drive * 32) / np.float32(32)
    layer = weights(drive[None], None, cuba_lif.Population(np.int32(4096), np.int32(4096), 80))
    x = np.ones((1, 1, 1), np.uint8)
    v = prepare(layer, arithmetic).forward(rows_of(x), keep_voltage=True).voltage[0, 0]
    surrogate = exponential(80 / 64, tau, 3.0)
    ready = laid_out(layer, arithmetic, surrogate)
    z = aligned(ready.n_columns, np.float64 if arithmetic == "ideal" else np.float32)
    fired, none = np.zeros(ready.n_columns // LANES, np.uint16), np.zeros(0, np.int32)
    rows = rows_of(x)
    run(ready, rows.offsets, rows.index, 0, 1, 1, kernels.SLOPE, z, fired, none, ready.keep_u[:16])
    expected = surrogate(v.astype(np.float64) - 80 / 64)
    lowest = 2.0**-1000 if arithmetic == "ideal" else 2.0**-100  # where the fast form ends
    bound = 1e-12 if arithmetic == "ideal" else 5e-6
    np.testing.assert_allclose(unpacked(z, 1, 240)[0], expected, rtol=bound, atol=2 * lowest)


def test_below_its_cut_a_surrogate_is_zero():
    whole, cut = exponential(80 / 64, 0.003, 3.0), exponential(80 / 64, 0.003, 3.0, cut=0.01)
    v = np.linspace(-4, 4, 200)
    expected = np.where(whole(v) > 0.01 * whole.height, whole(v), 0)
    np.testing.assert_array_equal(cut(v), expected)
    assert 0 < (cut(v) > 0).sum() < 200
    with pytest.raises(ValueError, match=r"cut must be within \[0, 1\)"):
        exponential(80 / 64, 0.003, 3.0, cut=1.0)


def updates(gradient, table, w, grid, steps):
    n_rows, n = w.shape
    flat = [packed(x, np.float32) for x in (w, np.zeros_like(w), np.zeros_like(w))]
    unit = np.ones(padded(n), np.float32)
    norms = []
    for step in range(1, steps + 1):
        g = packed(gradient, np.float32)
        arguments = (n_rows, padded(n), unit, 1.0, 0.01 / (1 - 0.9**step), 0.9, 0.999, 1 / (1 - 0.999**step))
        norms.append(kernels.adam(flat[0], g, flat[1], flat[2], *arguments, 1e-8, table, grid, -128.0, 127.0))
        assert not g.any()  # ready for the next batch
    return unpacked(flat[0], n_rows, n), np.array(norms)


def test_the_fused_update_is_adam():
    rng = np.random.default_rng(4)
    w, g = (rng.normal(size=(7, 40)).astype(np.float32) for _ in range(2))
    found, norms = updates(g, np.zeros(0, np.int8), w, 0.0, 5)
    expected, first, second = w, np.zeros_like(w), np.zeros_like(w)
    for step in range(1, 6):
        expected, first, second = adam(expected, g, first, second, step, np.float32(0.01))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(norms, (g.astype(np.float64) ** 2).sum(), rtol=1e-6)


def test_adam_takes_a_first_step_of_the_rate_against_the_sign():
    w = np.array([[1.0, 2.0]], np.float32)
    moved, _, _ = adam(
        w, np.array([[0.5, -3.0]], np.float32), 0 * w, 0 * w, 1, np.array([0.1, 0.2], np.float32)
    )
    np.testing.assert_allclose(moved, [[0.9, 2.2]], rtol=1e-6)


def test_rounded_weights_follow_their_masters_which_stay_within_the_range():
    w = np.array([[0.0, 5.0, -4.0, 3.98]], np.float32)  # 5.0 has no gradient; 3.98 * 32 = 127.4 -> 127
    table = packed(np.zeros((1, 4)), np.int8)
    found, norms = updates(np.ones((1, 4), np.float32), table, w, 32.0, 3)
    assert found[0, 2] == -4.0 and found[0, 0] < 0 and found[0, 3] < 127 / 32
    assert 3.9 < found[0, 1] < 127 / 32  # back within the range after an update, it has a gradient again
    assert unpacked(table, 1, 4).tolist() == [[-1, 126, -128, 126]]
    np.testing.assert_allclose(norms, [3, 4, 4], rtol=1e-6)


def test_compiled_code_is_kept_under_the_sources_of_the_whole_engine():
    assert kernels.gather._cache._cache_file._source_stamp == _sources(Path(kernels.__file__).parent)
