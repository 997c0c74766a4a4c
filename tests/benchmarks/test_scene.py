from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scene import EXACT, METHODS, Likeness, accuracy, likeness, pooled, van_rossum
from dse.records import Block
from tests.scene import small


def block(t_us: list[int], x: list[int], y: list[int]) -> Block:
    return Block(
        np.array(t_us, np.int64),
        np.array(x, np.int32),
        np.array(y, np.int32),
        np.zeros(len(x), np.uint8),
    )


def test_events_are_counted_in_pools_of_4_pixels_that_lie_in_the_frame() -> None:
    found = pooled(block([0, 900, 1000, 1999, 500], [0, 3, 4, 7, 9], [0, 3, 0, 3, 0]), (10, 5), 2.0)
    np.testing.assert_array_equal(found, [[2, 0], [0, 2]])


def test_van_rossum_distance_of_shifted_spikes_is_known() -> None:
    """Of single spikes dt apart: |f - g|^2 = (1 - exp(-dt / tau)) 2 |f|^2."""
    a, b = np.zeros((2000, 1)), np.zeros((2000, 1))
    a[5], b[12] = 1, 1
    assert van_rossum(a, b, 10.0) == pytest.approx(np.sqrt(2 * (1 - np.exp(-0.7))), rel=1e-6)
    assert van_rossum(b, b, 10.0) == 0


def test_the_same_events_are_alike_and_others_are_not() -> None:
    scene = small.scene(duration_ms=40.0)
    rng = np.random.default_rng(0)
    one, other = (
        block(sorted(rng.integers(0, 40_000, n)), rng.integers(0, 88, n), rng.integers(0, 88, n))
        for n in (4000, 5000)
    )
    assert likeness(one, one, scene) == Likeness(0, pytest.approx(1, abs=1e-6), pytest.approx(1, abs=1e-6), 0)
    found = likeness(other, one, scene)
    assert found.counts == 0.25
    assert abs(found.r1) < 0.05 and abs(found.r10) < 0.1
    assert found.van_rossum > 0.5


def test_the_classifier_tells_classes_apart_and_does_not_guess_noise() -> None:
    rng = np.random.default_rng(0)
    target = np.repeat(np.arange(3), 30)
    noise = rng.standard_normal((90, 40))
    assert accuracy(noise + 6 * np.eye(3, 40)[target], target, 0) > 0.9
    assert accuracy(noise, target, 0) < 0.65


def test_every_method_has_steps_that_are_multiples() -> None:
    for name, method in METHODS.items():
        for inner, outer in (
            (method.friction_step_ms, method.texture_step_ms),
            (method.texture_step_ms, method.camera_step_ms),
        ):
            assert outer / inner == pytest.approx(round(outer / inner)), name
    assert len(set(METHODS.values())) == len(METHODS)
    assert EXACT.skip_px == 0
