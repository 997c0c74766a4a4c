"""Trials as event lists: the same whatever is asked for, whatever else the scene holds."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import scene_reference as reference
from dse.scene import background, simulate
from dse.scene.scene import Variation
from tests.scene import small

VARIED = {"variation": Variation(), "camera": replace(small.CAMERA, noise_hz=2.0)}
DENIM = small.scene(**VARIED)
FOAM = small.scene(small.FOAM, 42.0, **VARIED)


def same(a, b):
    return all(np.array_equal(getattr(a, x), getattr(b, x)) for x in ("t_us", "x", "y", "polarity"))


def test_events_are_sorted_within_frame_and_record():
    found = simulate.events(DENIM, 0)
    order = np.lexsort((found.polarity, found.x, found.y, found.t_us))
    np.testing.assert_array_equal(order, np.arange(len(order)))
    assert len(order) > 10_000
    assert 0 <= found.t_us[0] and found.t_us[-1] <= 300_000
    for place, size in zip((found.x, found.y), small.SENSOR.frame_px, strict=True):
        assert place.min() >= 0 and place.max() < size
    assert set(np.unique(found.polarity)) == {0, 1}
    assert [x.dtype for x in (found.t_us, found.x, found.y, found.polarity)] == [
        np.int64, np.int32, np.int32, np.uint8,
    ]  # fmt: skip


@pytest.mark.parametrize("scene", [DENIM, FOAM], ids=["denim", "foam"])
def test_fast_equals_reference_but_for_the_closed_form(scene):
    slow, fast = reference.events(scene, 0), simulate.events(replace(scene, method=small.EXACT), 0)
    assert len(fast.t_us) / len(slow.t_us) == pytest.approx(1, abs=0.003)
    assert small.likeness(slow, fast, scene, 1.0) > 0.994
    assert small.likeness(slow, fast, scene, 10.0) > 0.9995


@pytest.mark.parametrize("scene", [DENIM, FOAM], ids=["denim", "foam"])
def test_the_default_steps_keep_the_events(scene):
    slow, fast = reference.events(scene, 0), simulate.events(scene, 0)
    assert len(fast.t_us) / len(slow.t_us) == pytest.approx(1, abs=0.012)
    assert small.likeness(slow, fast, scene, 1.0) > 0.95
    assert small.likeness(slow, fast, scene, 10.0) > 0.995


def test_room_that_does_not_suffice_is_made_larger(monkeypatch):
    block = simulate.events(DENIM, 0)
    monkeypatch.setattr(simulate, "_MEV_S", 1e-3)
    assert same(simulate.events(DENIM, 0), block)


def many(**other):
    """A scene of 2 textures, 2 motions, 2 forces and 3 trials, around the cell of DENIM."""
    fields = {
        "textures": (small.FOAM, small.DENIM), "motions": (small.Steady(60.0), small.Steady(28.0)),
        "forces_n": (1.0, 1.5), "trials": 3,
    } | VARIED | other  # fmt: skip
    return small.scene(**fields)


def test_trial_k_does_not_know_what_else_the_scene_holds():
    alone = simulate.events(small.scene(trials=1, **VARIED), 0)
    scene = many()
    k = ((1 * 2 + 1) * 2 + 1) * 3
    assert scene.cell(k) == (1, 1, 1, 0)
    assert same(simulate.events(scene, k), alone)
    turned = many(textures=scene.textures[::-1], motions=scene.motions[::-1], forces_n=(1.5,), trials=1)
    assert same(simulate.events(turned, 0), alone)
    assert not same(simulate.events(scene, k + 1), alone)


def test_trials_do_not_depend_on_order_or_threads():
    scene = many(duration_ms=120.0)
    ks = [0, 7, 14, 23]
    one_by_one = {k: simulate.events(scene, k) for k in ks}
    backwards = {k: simulate.events(scene, k) for k in reversed(ks)}
    with ThreadPoolExecutor(4) as pool:
        together = dict(zip(ks * 3, pool.map(lambda k: simulate.events(scene, k), ks * 3), strict=True))
    for k in ks:
        assert same(one_by_one[k], backwards[k])
        assert same(one_by_one[k], together[k])


def test_another_seed_is_another_trial():
    a, b = (simulate.events(replace(DENIM, seed=seed), 0) for seed in (1, 2))
    assert not same(a, b)
    assert len(a.t_us) == pytest.approx(len(b.t_us), rel=0.5)
    assert (
        reference.thresholds(replace(DENIM, seed=1)) != reference.thresholds(replace(DENIM, seed=2))
    ).any()


def test_the_camera_is_one_camera_and_its_start_is_the_trials_own():
    scene = many()
    np.testing.assert_array_equal(reference.thresholds(scene), reference.thresholds(DENIM))
    theta = np.log(reference.thresholds(scene))
    assert theta.mean() == pytest.approx(np.log(0.3), abs=0.005)
    assert theta.std() == pytest.approx(0.12, abs=0.005)
    first, second = reference.start_levels(scene, 0), reference.start_levels(scene, 1)
    assert (np.abs(first) < 1).all()
    assert first.mean() == pytest.approx(0, abs=0.02)
    assert first.var() == pytest.approx(1 / 3, abs=0.02)
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.05


def test_background_events_are_uniform_and_part_of_the_trial():
    scene = replace(DENIM, camera=replace(small.CAMERA, noise_hz=20.0))
    noise, quiet = background.events(scene, 0), simulate.events(replace(DENIM, camera=small.CAMERA), 0)
    expected = 20.0 * 88 * 88 * 0.3
    assert len(noise.t_us) == pytest.approx(expected, abs=5 * np.sqrt(expected))
    assert (np.diff(noise.t_us) >= 0).all()
    assert noise.polarity.mean() == pytest.approx(0.5, abs=0.02)
    for values, end in ((noise.t_us, 300_000), (noise.x, 88), (noise.y, 88)):
        assert values.min() >= 0 and values.max() < end
        assert values.mean() == pytest.approx(end / 2, rel=0.03)
    assert same(simulate.events(scene, 0), reference.in_order([quiet, noise]))


def test_a_trial_that_is_not_there_is_refused():
    with pytest.raises(IndexError, match=r"trial must be in \[0, 1\), got 1"):
        simulate.events(DENIM, 1)
