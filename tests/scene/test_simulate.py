"""Trials as event lists and as rasters: the same whatever is asked for, whatever else the scene holds."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse import preprocessing
from dse.config.settings import Preprocessing
from dse.recordings.pooling import pooling
from dse.scene import background, reference, simulate
from dse.scene.scene import Method, Variation
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


PINS = (4, 6, 78, 72)
"""What `crop: pins` keeps here: x, y, width, height."""

SETTINGS = {
    "pool 4": Preprocessing(1.0, pool=4),
    "one pool per pixel": Preprocessing(5.0),
    "overlapping, padded": Preprocessing(2.0, pool=(6, 4), stride=(3, 2), padding=(2, 1)),
    "merged, two events needed": Preprocessing(1.0, pool=4, polarity="merge", exceeds=True),
    "ON alone, cropped": Preprocessing(1.7, pool=5, polarity="ignore_off", crop=(7, 11, 53, 60)),
    "OFF alone, many needed": Preprocessing(10.0, pool=8, polarity="ignore_on", pool_threshold=20),
    "part of the record": Preprocessing(3.0, pool=4, time_ms=(70.5, 201.25)),
    "bins much shorter than a look": Preprocessing(0.13, pool=4, polarity="merge"),
    "bins a little longer than a look": Preprocessing(2.3, pool=4, pool_threshold=2),
    "long bins, the pins alone": Preprocessing(300.0, pool=88, crop="pins", pool_threshold=254, exceeds=True),
    "without quiet channels": Preprocessing(1.0, pool=4, rate_floor_hz=100.0),
}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("scene", [DENIM, FOAM], ids=["denim", "foam"])
def test_a_raster_is_the_pooled_event_list_bit_for_bit(scene, settings):
    found = pooling(settings, *scene.sensor.frame_px, pins=PINS)
    n_bins = found.n_bins(round(scene.duration_ms * 1000))
    counts, channels = simulate.raster(scene, 0, found, n_bins)
    expected = preprocessing.pool([simulate.events(scene, 0)], found, 0, 0, n_bins)
    np.testing.assert_array_equal(counts, expected[0])
    np.testing.assert_array_equal(channels, expected[1])
    assert counts.sum() > 0
    assert counts.dtype == np.int64 and channels.dtype == np.int32


@given(
    bin_ms=st.sampled_from([0.05, 0.333, 1.0, 1.7, 5.0, 40.0]),
    pool=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    stride=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    polarity=st.sampled_from(["split", "merge", "ignore_off", "ignore_on"]),
    threshold=st.integers(1, 5), exceeds=st.booleans(), crop=st.sampled_from([None, "pins", (7, 11, 53, 60)]),
    time_ms=st.sampled_from([None, (0.0, 33.3), (20.125, 55.0)]), extra=st.integers(-2, 2),
)  # fmt: skip
def test_a_raster_is_the_pooled_event_list_in_every_mode(
    bin_ms, pool, stride, polarity, threshold, exceeds, crop, time_ms, extra
):
    scene = replace(FOAM, duration_ms=80.0)
    chosen = Preprocessing(
        bin_ms, pool=pool, stride=tuple(map(min, stride, pool)), polarity=polarity, pool_threshold=threshold,
        exceeds=exceeds, crop=crop, time_ms=time_ms,
    )  # fmt: skip
    found = pooling(chosen, *scene.sensor.frame_px, pins=PINS)
    n_bins = max(1, found.n_bins(80_000) + extra)
    counts, channels = simulate.raster(scene, 0, found, n_bins)
    expected = preprocessing.pool([simulate.events(scene, 0)], found, 0, 0, n_bins)
    np.testing.assert_array_equal(counts, expected[0])
    np.testing.assert_array_equal(channels, expected[1])


def test_room_that_does_not_suffice_is_made_larger(monkeypatch):
    found = pooling(Preprocessing(1.0, pool=4), *small.SENSOR.frame_px)
    block, raster = simulate.events(DENIM, 0), simulate.raster(DENIM, 0, found, 300)
    monkeypatch.setattr(simulate, "_MEV_S", 1e-3)
    assert same(simulate.events(DENIM, 0), block)
    for narrow, wide in zip(simulate.raster(DENIM, 0, found, 300), raster, strict=True):
        np.testing.assert_array_equal(narrow, wide)


@pytest.mark.parametrize("step_ms", [0.5, 4.0])
def test_a_raster_is_the_pooled_event_list_at_other_steps_of_the_camera(step_ms):
    scene = replace(DENIM, method=replace(Method(), camera_step_ms=step_ms, skip_px=0.5))
    found = pooling(Preprocessing(1.0, pool=4), *scene.sensor.frame_px)
    counts, channels = simulate.raster(scene, 0, found, 300)
    expected = preprocessing.pool([simulate.events(scene, 0)], found, 0, 0, 300)
    np.testing.assert_array_equal(counts, expected[0])
    np.testing.assert_array_equal(channels, expected[1])


def test_a_raster_may_end_before_or_after_the_record():
    found = pooling(Preprocessing(1.0, pool=4), *small.SENSOR.frame_px)
    whole = simulate.raster(DENIM, 0, found, 300)
    short = simulate.raster(DENIM, 0, found, 120)
    long = simulate.raster(DENIM, 0, found, 340)
    np.testing.assert_array_equal(short[0], whole[0][:120])
    np.testing.assert_array_equal(short[1], whole[1][: short[0].sum()])
    np.testing.assert_array_equal(long[0], np.pad(whole[0], (0, 40)))
    np.testing.assert_array_equal(long[1], whole[1])


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
    assert (simulate.thresholds(replace(DENIM, seed=1)) != simulate.thresholds(replace(DENIM, seed=2))).any()


def test_the_camera_is_one_camera_and_its_start_is_the_trials_own():
    scene = many()
    np.testing.assert_array_equal(simulate.thresholds(scene), simulate.thresholds(DENIM))
    theta = np.log(simulate.thresholds(scene))
    assert theta.mean() == pytest.approx(np.log(0.3), abs=0.005)
    assert theta.std() == pytest.approx(0.12, abs=0.005)
    first, second = simulate.start_levels(scene, 0), simulate.start_levels(scene, 1)
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
