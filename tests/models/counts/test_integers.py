"""Layers of integers: by hand, within 32 bits whatever comes, and close to what was trained."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.models.counts.integers import MOST_SUM, IntegerLayers, largest_sum, rounded


def test_two_layers_by_hand():
    weights = np.array([[2, -3], [5, 127]], np.int8), np.array([[4], [-1]], np.int8)
    biases = np.array([-3, 1], np.int32), np.array([7], np.int32)
    layers = IntegerLayers(weights, biases, (1,), 1.0)
    # (1, 2): 2 + 10 - 3 = 9 -> 4, -3 + 254 + 1 = 252 -> 126; 16 - 126 + 7
    # (0, 9): 42 -> 21, 1144 -> 572, held at 255; 84 - 255 + 7.  (2, 0): 1 -> 0, -5 -> 0; 7
    _, hidden, outputs = layers.inputs(np.array([[1, 2], [0, 9], [2, 0]]))
    assert hidden.tolist() == [[4, 126], [21, 255], [0, 0]]
    assert outputs.tolist() == [[-103], [-164], [7]]
    # inputs up to 9: 3 + 9 (2 + 5), 1 + 9 (3 + 127); hidden units up to 255: 7 + 255 (4 + 1)
    assert largest_sum(layers, 9) == 7 + 255 * 5 and largest_sum(layers, 90) == 1 + 90 * 130


@given(
    seed=st.integers(0, 10**6),
    most=st.sampled_from([1, 255, 2**16, 2**31, 2**40]),
    sizes=st.sampled_from([(1, 1), (3, 2), (40, 5, 3), (4, 6, 3, 2)]),
    power=st.integers(-12, 12),
)
def test_no_sum_passes_32_bits(seed, most, sizes, power):
    rng = np.random.default_rng(seed)
    layers = [
        (10.0**power * rng.normal(size=(n, m)), 10.0 ** rng.integers(-12, 12) * rng.normal(size=m))
        for n, m in pairwise(sizes)
    ]
    found = rounded(layers, rng.integers(0, min(most, 300) + 1, (20, sizes[0])), most)
    reached = largest_sum(found, most)
    assert reached <= MOST_SUM and len(found.shifts) == len(sizes) - 2
    assert all(w.dtype == np.int8 and abs(w.astype(int)).max() <= 127 for w in found.weights)
    # The bound is reached: by inputs of a sum's own signs, in integers without limits.
    weight, bias = found.weights[0].astype(object), found.biases[0].astype(object)
    worst = max(
        abs(int(b)) + sum(most * abs(int(w)) for w in column)
        for column, b in zip(weight.T, bias, strict=True)
    )
    assert worst <= reached and (len(sizes) > 2 or worst == reached)


def test_what_was_trained_is_kept():
    rng = np.random.default_rng(2)
    x = rng.integers(0, 12, (200, 30))
    layers = [
        (rng.normal(0, 0.2, (30, 20)), rng.normal(0, 1, 20)),
        (rng.normal(0, 0.3, (20, 4)), np.zeros(4)),
    ]
    exact = np.maximum(x @ layers[0][0] + layers[0][1], 0) @ layers[1][0]
    found = rounded(layers, x, 12)
    outputs = found.inputs(x)[-1] / found.scale
    assert np.abs(outputs - exact).max() < 0.05 * np.abs(exact).max()
    assert found.inputs(x)[1].max() >= 128  # units use their 8 bits
    again = IntegerLayers.of(found.stored(3), 3)
    assert np.array_equal(again.inputs(x)[-1], found.inputs(x)[-1]) and again.scale == found.scale


def test_a_large_weight_of_an_input_that_is_seldom_there_leaves_the_others_their_bits():
    rng = np.random.default_rng(3)
    weight = rng.normal(0, 0.2, (30, 4))
    x = rng.integers(0, 12, (300, 30))
    weight[7], x[:, 7] = 40.0, 0
    x[4, 7] = 1
    exact = x @ weight
    found = rounded([(weight, np.zeros(4))], x, 12)
    right = (found.inputs(x)[-1].argmax(axis=1) == exact.argmax(axis=1)).mean()
    off = np.delete(found.inputs(x)[-1] / found.scale - exact, 4, axis=0)
    assert right > 0.97 and np.sqrt((off**2).mean()) < 0.05 * exact.std()
    assert found.weights[0][7].tolist() == [127] * 4  # at the limit, not beyond
    plain = np.rint(127 / 40 * weight) * 40 / 127  # one scale for all, without a limit
    assert np.sqrt(((x @ plain - exact) ** 2).mean()) > 5 * np.sqrt((off**2).mean())


@pytest.mark.parametrize("bias", [0.0, -5.0, 1e30])
def test_weights_of_0(bias):
    found = rounded([(np.zeros((2, 1)), np.array([bias]))], np.ones((3, 2), int), 9)
    assert not found.weights[0].any() and np.sign(found.biases[0]) == np.sign(bias)
