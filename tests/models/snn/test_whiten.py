"""Bases of whitened weights: definition, hard counts, the same bits; effective rank."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from dse.models.snn.whiten import basis, covariance, effective_rank, eigen
from tests.study.test_processors import KERNELS, PRODUCT, on


def counts(n_samples=300, n=40, seed=0):
    """Return counts of neurons that follow one common rate, and a little of their own."""
    rng = np.random.default_rng(seed)
    common = np.exp(rng.normal(0, 0.5, n_samples))[:, None] * rng.uniform(2, 90, n)
    return rng.poisson(np.maximum(common + rng.normal(0, 3, (n_samples, n)), 0))


def test_a_basis_is_its_definition_and_makes_counts_white():
    x = counts()
    scales = 1 / (x.std(axis=0) + 5)
    means = (x * scales).T @ (x * scales) / len(x)
    np.testing.assert_allclose(covariance(x)[0], scales, rtol=1e-12)
    np.testing.assert_allclose(covariance(x)[1], means, rtol=1e-12)
    values, vectors = np.linalg.eigh(means)
    expected = scales[:, None] * vectors[:, ::-1] / np.sqrt(values[::-1] + 0.1)
    length = np.sqrt((expected**2).sum(axis=1).mean())
    found, of_row = basis(x)
    assert of_row == pytest.approx(length, rel=1e-9)
    signs = np.sign((found * expected).sum(axis=0))
    np.testing.assert_allclose(found, signs * expected / length, atol=1e-5)
    white = (x @ found.astype(np.float64) * of_row).T @ (x @ found.astype(np.float64) * of_row) / len(x)
    np.testing.assert_allclose(white, np.diag(values[::-1] / (values[::-1] + 0.1)), atol=1e-4)
    assert np.linalg.cond(white) < 0.01 * np.linalg.cond(means)


RNG = np.random.default_rng(3)
TALL = RNG.normal(size=(30, 9))
HARD = {
    "one": np.array([[3.0]]),
    "none": np.zeros((0, 0)),
    "zero": np.zeros((5, 5)),
    "equal": 2 * np.eye(7),
    "rank_1": np.ones((6, 6)),
    "rank_3": TALL[:3].T @ TALL[:3],
    "equal_pairs": np.kron(np.eye(4), np.ones((2, 2))),
    "graded": np.diag(10.0 ** np.arange(-12, 1)),
    "graded_and_turned": (TALL * 10.0 ** -np.arange(9)).T @ (TALL * 10.0 ** -np.arange(9)),
    "tiny": 1e-200 * np.eye(3),
    "large": 1e140 * (TALL.T @ TALL),
    "full": TALL.T @ TALL,
}


@pytest.mark.parametrize("name", HARD)
def test_eigenvectors_of_hard_matrices_are_orthonormal_and_give_the_matrix_back(name):
    matrix = HARD[name]
    values, vectors = eigen(matrix)
    rank = int(np.linalg.matrix_rank(matrix)) if matrix.size else 0
    assert values.shape == (rank,) and vectors.shape == (len(matrix), rank)
    assert (np.diff(values) <= 0).all() and (values > 0).all()
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(rank), atol=1e-11)
    largest = np.abs(matrix).max(initial=0)
    np.testing.assert_allclose(vectors * values @ vectors.T, matrix, atol=1e-13 * largest * len(matrix))
    if rank:
        expected = np.linalg.eigvalsh(matrix)[::-1][:rank]
        np.testing.assert_allclose(values, expected, atol=1e-13 * largest * len(matrix))
        assert (vectors[np.abs(vectors).argmax(axis=0), np.arange(rank)] > 0).all()


def test_silent_neurons_have_a_direction_each_and_equal_ones_have_one():
    x = counts(n=12)
    x[:, [2, 7]] = 0
    x[:, 9] = x[:, 4]
    found, of_row = basis(x)
    assert found.shape == (12, 9 + 2)
    silent = found[[2, 7]] * of_row
    np.testing.assert_allclose(silent[:, -2:], np.eye(2) / 5 / np.sqrt(0.1), rtol=1e-6)
    assert not silent[:, :-2].any() and not found[[0, 1, 3, 4, 5, 6, 8, 9, 10, 11], -2:].any()
    np.testing.assert_allclose(found[9], found[4], atol=1e-6)
    # Silent neurons do not change what the others learn in.
    others = np.delete(np.arange(12), [2, 7])
    alone, length = basis(x[:, others])
    assert length == of_row
    np.testing.assert_array_equal(found[others][:, :-2], alone)


def test_counts_of_nothing_and_of_one_sample_have_a_basis():
    nothing, length = basis(np.zeros((4, 3), np.int64))
    np.testing.assert_allclose(nothing * length, np.eye(3) / 5 / np.sqrt(0.1), rtol=1e-6)
    one, length = basis(np.array([[3, 0, 4]]))
    assert one.shape == (3, 2) and np.isfinite(one).all()
    direction = np.array([3, 4]) / 5  # the second moment has this eigenvector alone
    np.testing.assert_allclose(one[[0, 2], 0] * length, 0.2 * direction / np.sqrt(1.1), rtol=1e-6)
    assert not one[[0, 2], 1].any() and not one[1, 0]


def test_neither_threads_nor_the_order_of_samples_change_a_bit():
    x = counts(500, 130)
    results = []
    for threads, order in ((1, np.arange(500)), (4, np.arange(500)[::-1]), (2, RNG.permutation(500))):
        with threadpool_limits(threads):
            results.append(basis(x[order]))
    for matrix, length in results[1:]:
        assert length == results[0][1]
        np.testing.assert_array_equal(matrix, results[0][0])


def test_a_basis_has_the_same_bits_with_the_kernels_of_another_processor():
    if len({on(kernel, "-c", PRODUCT) for kernel in KERNELS}) == 1:
        pytest.skip("numpy's linear algebra has no kernels that differ here")
    program = (
        "from tests.models.snn.test_whiten import counts; from dse.models.snn.whiten import basis; "
        "matrix, length = basis(counts(200, 61)); print(matrix.tobytes().hex(), length.hex())"
    )
    assert len({on(kernel, "-c", program) for kernel in KERNELS}) == 1


def test_the_effective_rank_counts_directions():
    rng = np.random.default_rng(1)
    apart = rng.poisson(20, (20_000, 8))
    assert effective_rank(apart) == pytest.approx(8, rel=0.01)
    assert effective_rank(np.repeat(apart[:, :1], 8, axis=1) * np.arange(1, 9)) == pytest.approx(1)
    assert effective_rank(np.repeat(apart[:, :2], 4, axis=1)) == pytest.approx(2, rel=0.01)
    assert effective_rank(
        np.column_stack([apart[:, :3], np.zeros(20_000), np.full(20_000, 7)])
    ) == pytest.approx(3, rel=0.01)
    correlations = np.linalg.eigvalsh(np.corrcoef(counts().T))
    expected = correlations.sum() ** 2 / (correlations**2).sum()
    assert effective_rank(counts()) == pytest.approx(expected, rel=1e-9)
    for same in (np.zeros((5, 4), int), np.full((5, 4), 3), np.array([[1, 2, 3]]), np.zeros((0, 3), int)):
        assert effective_rank(same) == 0
