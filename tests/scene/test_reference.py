from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import scene_reference as reference
from dse.base.records import Block
from dse.scene import background, simulate
from dse.scene.scene import Camera
from dse.scene.tip import image_px, pins_mm
from tests.scene import small

SIZE = (48, 40)
RADIUS, EDGE = 4.2, 0.45
PLAIN = Camera(mismatch=0.0, refractory_us=0.0, noise_hz=0.0)


def line(start, shift, n=400, ms=40.0):
    """Return t_s and px of one pin on a straight line."""
    part = np.linspace(0, 1, n + 1)
    return part * ms * 1e-3, (np.array(start) + part[:, None] * np.array(shift))[:, None, :]


def pixels(size=SIZE, on=0.3, off=0.3, phase=None, seed=0):
    """Return start phases and thresholds of a frame (width, height)."""
    shape = size[::-1]
    phases = np.random.default_rng(seed).uniform(-1, 1, shape) if phase is None else np.full(shape, phase)
    thresholds = np.empty((*shape, 2), np.float32)
    thresholds[..., 0], thresholds[..., 1] = off, on
    return phases.astype(np.float32), thresholds


def seen(t_s, px, start, thresholds, camera=PLAIN, radius=RADIUS, edge=EDGE):
    return reference.camera(t_s, px, radius, edge, start, thresholds, camera)


def counts(found, size):
    """Return events (height, width, polarity)."""
    n = np.zeros((*size[::-1], 2), int)
    np.add.at(n, (found.y, found.x, found.polarity), 1)
    return n


def levels_at_start(light, start, thresholds, dark):
    theta = np.where(start > 0, thresholds[..., 0], thresholds[..., 1])
    return np.clip(np.log(light) + start * theta, np.log(dark), 0)


def test_nothing_moves_nothing_is_seen():
    t_s, px = line((20, 20), (0, 0))
    assert len(seen(t_s, px, *pixels()).t_us) == 0


def test_a_frame_is_the_light_of_its_pins():
    px = np.array([[12.5, 20.5], [20.0, 20.5]])
    light = reference.frame(px, RADIUS, EDGE, 5.0, SIZE)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    edges = sum(1 / (1 + np.exp((np.hypot(x - a, y - b) - RADIUS) / EDGE)) for a, b in px)
    np.testing.assert_allclose(light, 0.2 + 0.8 * np.minimum(1, edges), atol=1e-5)
    assert light.shape == (40, 48)
    assert light[20, 12] == pytest.approx(1, abs=1e-4)
    assert light[0, 0] == 0.2


def test_light_of_pins_on_one_another_is_white_and_no_more():
    one = reference.frame(np.array([[20.5, 20.5]]), RADIUS, EDGE, 5.0, SIZE)
    two = reference.frame(np.full((2, 2), 20.5), RADIUS, EDGE, 5.0, SIZE)
    assert two.max() == 1
    assert (two >= one).all()


@given(contrast=st.floats(1.5, 20), on=st.floats(0.05, 1.0), ratio=st.floats(1.02, 1.5))
def test_a_pin_over_a_pixel_crosses_every_level_once(contrast, on, ratio):
    """Dark to white is floor(ln contrast / theta) levels up, then as many of theta_off down as they hold."""
    t_s, px = line((-30.5, 1.5), (64.0, 0.0), n=1000)
    start, thresholds = pixels((3, 3), on, on * ratio, phase=0.0)
    found = seen(t_s, px, start, thresholds, replace(PLAIN, contrast=contrast), radius=14.0)
    theta_on, theta_off = (float(x) for x in thresholds[1, 1, ::-1])
    # White is reached but for exp(-14 / 0.45).
    up = int(np.floor((np.log(contrast) - 1e-9) / theta_on))
    down = int(np.floor(up * theta_on / theta_off))
    assert counts(found, (3, 3))[1, 1].tolist() == [down, up]


def test_a_rigid_shift_of_20_px_loses_no_event():
    """One pin: every pixel rises to one brightest moment and falls: its events are counted in closed form."""
    shift = 20.0
    start, thresholds = pixels(on=0.3, off=0.27)
    t_s, px = line((12.3, 20.1), (shift, 0.0))
    n = counts(seen(t_s, px, start, thresholds), SIZE)
    first, last = (reference.frame(px[i], RADIUS, EDGE, 5.0, SIZE) for i in (0, -1))
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    nearest = np.hypot(x - np.clip(x, 12.3, 12.3 + shift), y - 20.1)
    brightest = np.log(0.2 + 0.8 / (1 + np.exp((nearest - RADIUS) / EDGE)))
    level = levels_at_start(first, start, thresholds, 0.2)
    off, on = thresholds[..., 0].astype(float), thresholds[..., 1].astype(float)
    up = np.floor(np.maximum(0, brightest - level) / on)
    down = np.floor(np.maximum(0, level + up * on - np.log(last)) / off)
    assert up.sum() > 500
    # A brightest moment between two frames, 0.05 px apart, may touch a level that no frame touches.
    assert np.abs(n[..., 1] - up).sum() <= 2
    assert np.abs(n[..., 0] - down).sum() <= 2


@pytest.mark.parametrize("shift", [(20.0, 0.0), (14.04 * 2, 0.0), (-11.0, 23.0)])
def test_levels_follow_the_light_when_all_pins_shift_beyond_their_pitch(shift):
    """A renderer that looks up neighbours at rest loses light here, and ends on other levels."""
    size = small.SENSOR.frame_px
    rest = image_px(small.SENSOR, pins_mm(small.SENSOR))
    part = np.linspace(0, 1, 501)
    px = rest + part[:, None, None] * np.array(shift)
    start, thresholds = pixels(size, on=0.3, off=0.25)
    n = counts(seen(part * 0.05, px, start, thresholds), size)
    first, last = (reference.frame(px[i], RADIUS, EDGE, 5.0, size) for i in (0, -1))
    off, on = thresholds[..., 0], thresholds[..., 1]
    level = levels_at_start(first, start, thresholds, 0.2) + n[..., 1] * on - n[..., 0] * off
    assert n.sum() > 4000
    assert (np.log(last) < level + on + 1e-5).all()
    assert (np.log(last) > level - off - 1e-5).all()


def test_as_many_events_whichever_way_the_frame_is_turned():
    start, thresholds = pixels((40, 40))
    t_s, px = line((11.2, 20.3), (17.0, 3.0))
    plain = counts(seen(t_s, px, start, thresholds), (40, 40))
    turned = counts(seen(t_s, px[..., ::-1], start.T, thresholds.transpose(1, 0, 2)), (40, 40))
    np.testing.assert_array_equal(turned, plain.transpose(1, 0, 2))


def test_no_level_to_cross_no_events():
    t_s, px = line((10, 20), (20, 0))
    assert len(seen(t_s, px, *pixels(on=np.log(5) + 1e-3, off=np.log(5) + 1e-3)).t_us) == 0


def test_a_start_level_is_one_that_a_running_camera_can_hold():
    """A dark pixel whose phase would put its level below black fires where it would from black itself."""
    t_s, px = line((-10, 20), (40, 0))
    _, thresholds = pixels()
    below = seen(t_s, px, np.full(SIZE[::-1], -0.9, np.float32), thresholds)
    black = seen(t_s, px, np.zeros(SIZE[::-1], np.float32), thresholds)
    np.testing.assert_array_equal(below.t_us, black.t_us)
    assert len(black.t_us) > 500


def test_crossings_are_timed_on_the_line_between_two_frames():
    px = np.array([[[8.0, 20.5]], [[12.0, 20.5]]])
    start, thresholds = pixels(phase=0.0)
    found = seen(np.array([0.010, 0.014]), px, start, thresholds)
    before, now = (np.log(reference.frame(p, RADIUS, EDGE, 5.0, SIZE)[20, 14]) for p in px)
    mine = (found.x == 14) & (found.y == 20)
    n = int((now - before) / 0.3)
    level = before + float(np.float32(0.3)) * np.arange(1, n + 1)
    expected = np.floor(10_000 + 4_000 * (level - before) / (now - before))
    assert n == 5
    np.testing.assert_array_equal(found.t_us[mine], expected)
    assert (found.polarity[mine] == 1).all()


def test_in_its_dead_time_a_pixel_moves_its_level_and_sends_nothing():
    t_s, px = line((8, 20), (20, 0))
    awake = seen(t_s, px, *pixels())
    for dead_us, most in ((1e9, 1), (0.0, 100)):
        found = seen(t_s, px, *pixels(), camera=replace(PLAIN, refractory_us=dead_us))
        n = counts(found, SIZE).sum(axis=2)
        assert n.max() <= most
        assert (n > 0).sum() == (counts(awake, SIZE).sum(axis=2) > 0).sum()
    # What a dead pixel passed counts: on the way back it sends what it would have sent, never anything else.
    there = np.concatenate([px, px[::-1]])
    twice = np.concatenate([t_s, t_s[-1] + 1e-4 + t_s])
    whole = seen(twice, there, *pixels())
    late = seen(twice, there, *pixels(), camera=replace(PLAIN, refractory_us=2_000.0))
    code = [
        set(zip(*(a.tolist() for a in (b.t_us, b.x, b.y, b.polarity)), strict=True)) for b in (late, whole)
    ]
    assert code[0] < code[1]


def test_events_come_in_order_and_within_the_frame():
    t_s, px = line((3, 3), (50, 40))
    found = seen(t_s, px, *pixels())
    assert (np.diff(found.t_us) >= 0).all()
    assert found.x.min() >= 0 and found.x.max() < 48
    assert found.y.min() >= 0 and found.y.max() < 40
    assert [a.dtype for a in (found.t_us, found.x, found.y, found.polarity)] == [
        np.int64, np.int32, np.int32, np.uint8,
    ]  # fmt: skip


def test_background_events_can_be_made_to_reset_their_pixels():
    t_s, px = line((8, 20), (20, 0))
    start, thresholds = pixels()
    plain = seen(t_s, px, start, thresholds)
    y, x = np.divmod(np.arange(SIZE[0] * SIZE[1]), SIZE[0])
    every = Block(np.zeros(len(x), np.int64), x, y, np.zeros(len(x), np.uint8))
    found = reference.camera(t_s, px, RADIUS, EDGE, start, thresholds, PLAIN, every)
    # All pixels forgot their phase in the first frame: they answer as from phase 0, but for that frame.
    zero = seen(t_s, px, np.zeros_like(start), thresholds)
    assert abs(len(found.t_us) - len(zero.t_us)) < 0.02 * len(zero.t_us)
    assert not np.array_equal(found.t_us, plain.t_us)


def test_a_trial_is_the_camera_on_its_path_and_its_noise():
    scene = small.scene(camera=replace(small.CAMERA, noise_hz=5.0), duration_ms=60.0)
    found, noise = reference.events(scene, 0), background.events(scene, 0)
    paths = simulate.pin_paths(scene, 0, reference.STEP_MS)
    signal = reference.camera(
        paths.t_s, paths.px, paths.radius_px, paths.edge_px,
        reference.start_levels(scene, 0), reference.thresholds(scene), scene.camera,
    )  # fmt: skip
    assert len(noise.t_us) > 0 and len(signal.t_us) > 0
    assert len(found.t_us) == len(noise.t_us) + len(signal.t_us)
    assert (np.diff(found.t_us) >= 0).all()
