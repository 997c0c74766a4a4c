"""Where tactile scenes go wrong, case by case: the fast method answers as the definition, or says so."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import scene_reference as reference
from dse.config.settings import Preprocessing
from dse.data import preprocessing
from dse.data.recordings.pooling import pooling
from dse.scene import background, checks, simulate
from dse.scene.scene import Method, Sensor, Variation
from dse.scene.tip import pins_mm
from dse.scene.trial import trial
from tests.scene import small

DRIFT = replace(small.NONE, force_drift=0.06)
SEVEN = replace(small.SENSOR, n_across=1, frame_px=(64, 64))

FINE = replace(small.CAMERA, threshold=0.02, mismatch=0.0, refractory_us=0.0)
DAVIS = Sensor("grid", 3, 2.5, 8.8, (72, 72), 0.5)
SOFT = replace(small.SENSOR, stiffness_n_mm=0.15, rim_mm=30.0, frame_px=(136, 88), incipient_slip=True)


def agree(scene, counts=0.015, likeness=0.995):
    """Check a scene's fast events against its reference; return both."""
    slow, fast = reference.events(scene, 0), simulate.events(scene, 0)
    assert len(fast.t_us) > 0
    assert len(fast.t_us) / len(slow.t_us) == pytest.approx(1, abs=counts)
    assert small.likeness(slow, fast, scene) > likeness
    return slow, fast


def test_standing_still_sends_nothing():
    scene = small.scene(v_mm_s=0.0)
    found, flags = simulate.simulated(scene, 0)
    assert len(found.t_us) == 0
    assert flags.looks == 0
    assert len(reference.events(scene, 0).t_us) == 0


def test_a_soft_tip_neither_slips_nor_creeps_while_it_stands_or_touches_nothing():
    for scene in (small.scene(v_mm_s=0.0, sensor=SOFT), small.scene(force_n=0.0, sensor=SOFT)):
        found, flags = simulate.simulated(scene, 0)
        assert len(found.t_us) == flags.looks == 0


@pytest.mark.parametrize("texture", [small.SMOOTH, small.DENIM, small.FOAM], ids=lambda x: x.name)
def test_a_soft_tip_that_creeps_slips_and_stops_is_seen_as_by_definition(texture):
    # 60 mm/s on the way, then rest: the rim slips from the start, then stick-slip, then nothing moves.
    sticky = replace(texture, stribeck_mm_s=10.0)
    scene = small.scene(sticky, sensor=SOFT, motions=(small.Steady(60.0, duration_s=0.25),))
    paths = simulate.pin_paths(scene, 0, 0.1)
    assert np.ptp(paths.px[:, 0, 0]) > 30
    assert 0 < paths.x_mm[100] < 0.1 * paths.s_mm[100]
    assert np.ptp(paths.x_mm[paths.t_s > 0.27]) < 1e-3
    agree(scene, likeness=0.98)


def test_a_soft_tip_pressed_to_its_rim_and_out_of_sight_is_flagged():
    sensor = replace(SOFT, rim_mm=10.0, frame_px=(40, 40), stiffness_n_mm=0.5)
    scene = small.scene(force_n=20.0, v_mm_s=60.0, sensor=sensor)
    _, flags = simulate.simulated(scene, 0)
    assert flags.contact_saturated and flags.lost_looks > 0
    agree(scene)


def test_standing_still_while_the_force_drifts_moves_pins_slowly_and_little():
    scene = small.scene(v_mm_s=0.0, variation=DRIFT)
    moving = len(simulate.events(small.scene(variation=DRIFT), 0).t_us)
    found, flags = simulate.simulated(scene, 0)
    expected = reference.events(scene, 0)
    assert 0 < len(found.t_us) < 0.05 * moving
    assert abs(len(found.t_us) - len(expected.t_us)) <= max(5, 0.03 * len(expected.t_us))
    paths = simulate.pin_paths(scene, 0, 1.0)
    assert np.isfinite(paths.px).all()
    assert (paths.s_mm == 0).all() and (paths.x_mm == 0).all()
    assert flags.looks < 19 * 30  # far fewer than one per pin and step


def test_without_force_there_is_background_alone():
    # A drift of a force that is not there moves no pin either.
    scene = small.scene(force_n=0.0, camera=replace(small.CAMERA, noise_hz=1.0), variation=Variation())
    assert trial(scene, 0).drift != 0
    found, flags = simulate.simulated(scene, 0)
    noise = background.events(scene, 0)
    np.testing.assert_array_equal(found.t_us, noise.t_us)
    assert len(noise.t_us) > 1000
    assert flags.looks == 0 and not flags.contact_saturated
    assert np.isfinite(simulate.pin_paths(scene, 0, 1.0).px).all()


def test_a_contact_beyond_the_rim_is_clamped_and_flagged():
    # 20 N on a hard surface: Hertz asks for 17.1 mm, the rim is at 10.
    sensor = replace(small.SENSOR, rim_mm=10.0, stiffness_n_mm=12.0)
    scene = small.scene(force_n=20.0, sensor=sensor)
    assert trial(scene, 0).contact.radius_mm == 10.0
    assert simulate.simulated(scene, 0)[1].contact_saturated
    assert not simulate.simulated(small.scene(), 0)[1].contact_saturated
    agree(scene)


def test_pins_faster_than_a_pixel_per_step_cross_every_pixel_between():
    # 600 mm/s at 10.4 px/mm and 2 ms are 12 px per look; the reference needs finer frames here.
    sensor = replace(small.SENSOR, stiffness_n_mm=0.3)
    steady = replace(small.SMOOTH, mu_kinetic=small.SMOOTH.mu_static)
    scene = small.scene(steady, 600.0, sensor=sensor, duration_ms=40.0)
    slow, fast = reference.events(scene, 0, 0.02), simulate.events(scene, 0)
    paths = simulate.pin_paths(scene, 0, 1.0)
    assert np.abs(np.diff(paths.px[:, 0, 0])).max() > 4
    assert len(slow.t_us) > 3000
    assert len(fast.t_us) / len(slow.t_us) == pytest.approx(1, abs=0.012)


def test_a_texture_step_too_long_for_a_speed_is_refused():
    found = list(
        checks.step_faults(replace(Method(), texture_step_ms=2.0), small.SENSOR, small.Steady(600.0))
    )
    assert [key for key, _ in found] == ["texture_step_ms"]
    assert "must be at most" in found[0][1] and "600 mm/s" in found[0][1]
    assert not list(checks.step_faults(Method(), small.SENSOR, small.Steady(60.0)))


@pytest.mark.parametrize("frame", [(40, 72), (24, 24)])
def test_pins_may_leave_the_frame(frame):
    """Sheared by 20 px, out of a frame that cuts through their rest positions."""
    sensor = replace(small.SENSOR, frame_px=frame, stiffness_n_mm=0.3)
    scene = small.scene(sensor=sensor)
    shift = np.ptp(simulate.pin_paths(scene, 0, 1.0).px[:, 0, 0])
    assert shift > 18
    _, fast = agree(scene)
    assert fast.x.max() < frame[0] and fast.y.max() < frame[1]


def test_pins_out_of_sight_are_counted_and_come_back():
    sensor = replace(SEVEN, frame_px=(24, 24), stiffness_n_mm=0.05)
    scene = small.scene(sensor=sensor, v_mm_s=60.0)
    paths = simulate.pin_paths(scene, 0, 1.0)
    assert paths.px[..., 0].min() < -60
    found, flags = simulate.simulated(scene, 0)
    assert flags.lost_looks > 0
    expected = len(reference.events(scene, 0).t_us)
    assert len(found.t_us) == pytest.approx(expected, rel=0.015)


def test_pins_that_approach_each_other_share_their_pixels_light():
    """Shear that falls off between contact and rim pushes rings of pins into one another."""
    sensor = replace(small.SENSOR, rim_mm=3.0, stiffness_n_mm=0.0055)
    scene = small.scene(small.SMOOTH, 28.0, force_n=0.0135, sensor=sensor, duration_ms=400.0)
    paths = simulate.pin_paths(scene, 0, 1.0)
    gaps = np.hypot(*(paths.px[:, :, None] - paths.px[:, None]).transpose(3, 0, 1, 2))
    gaps[:, np.arange(19), np.arange(19)] = np.inf
    assert gaps[0].min() > 13
    assert gaps.min() < 2 * 4.16
    agree(replace(scene, method=small.EXACT), counts=0.002, likeness=0.9995)
    agree(scene, counts=0.005, likeness=0.999)


def test_pins_that_were_no_neighbours_at_rest_share_their_pixels_light():
    """A long lever on printed pins carries pins through each other that rest far apart: no chatter."""
    printed = replace(small.SMOOTH, name="printed", pin_radius_mm=2.0, modulus_mpa=3000.0)
    sensor = replace(small.SENSOR, lever_mm=4.0, frame_px=(112, 112), stiffness_n_mm=4.0)
    scene = small.scene(printed, 12.0, sensor=sensor, duration_ms=120.0)
    px = simulate.pin_paths(scene, 0, 1.0).px
    rest = small.SENSOR.image_scale_px_mm * pins_mm(sensor)
    far = np.hypot(*(rest[:, None] - rest).transpose(2, 0, 1)) > 24
    gaps = np.hypot(*(px[:, :, None] - px[:, None]).transpose(3, 0, 1, 2))
    assert gaps[:, far].min() < 2
    exact = replace(scene, method=small.EXACT)
    agree(exact, counts=0.004, likeness=0.9995)
    agree(scene, counts=0.008, likeness=0.999)
    assert simulate.simulated(exact, 0)[1].refractory_drops == 0
    assert simulate.simulated(scene, 0)[1].refractory_drops < 100


def test_a_rigid_shift_beyond_the_pitch_loses_no_event():
    """Sticking skin carries all pins 20 px: no neighbour at rest, no square box of pixels."""
    sensor = replace(small.SENSOR, stiffness_n_mm=0.3)
    scene = small.scene(replace(small.SMOOTH, mu_static=1.0), 28.0, sensor=sensor, duration_ms=75.0)
    paths = simulate.pin_paths(scene, 0, 1.0)
    assert (paths.x_mm == 0).all()
    np.testing.assert_allclose(np.ptp(paths.px[..., 0], axis=0), 20.0, atol=3.0)
    slow, fast = reference.events(scene, 0), simulate.events(scene, 0)
    assert len(slow.t_us) > 4000
    # Pins move 0.6 px from look to look: on their flank a pixel sees a little less of them than it should.
    assert len(fast.t_us) / len(slow.t_us) == pytest.approx(1, abs=0.008)
    assert small.likeness(slow, fast, scene, 1.0) > 0.98
    exact = simulate.events(replace(scene, method=small.EXACT), 0)
    assert len(exact.t_us) / len(slow.t_us) == pytest.approx(1, abs=0.004)
    assert small.likeness(slow, exact, scene, 1.0) > 0.995
    n = np.zeros((2, 88, 88, 2))
    for counted, found in zip(n, (slow, fast), strict=True):
        np.add.at(counted, (found.y, found.x, found.polarity), 1)
    # A pixel that a pin left keeps a last percent of light: few last OFFs are not sent, nor their ONs later.
    assert np.abs(n[0] - n[1]).max() <= 3
    assert np.mean(n[0] != n[1]) < 0.015


def test_noise_near_the_threshold_has_a_ceiling():
    def rate(**other):
        return background.rate_hz(small.scene(camera=replace(small.CAMERA, noise_hz=0.1, **other)))

    assert rate() == 0.1
    assert rate(noise_rms=0.1) == pytest.approx(0.1 + 3000 * math.exp(-4.5))
    assert rate(noise_rms=0.5, threshold=0.1) == pytest.approx(0.1 + 3000 * math.exp(-0.02))
    assert rate(noise_rms=0.5, threshold=0.1, bandwidth_hz=1e6, refractory_us=500.0) == pytest.approx(2000)
    assert rate(noise_rms=0.5, bandwidth_hz=1e9, readout_mev_s=10.0) == pytest.approx(1e7 / 88**2)
    scene = small.scene(camera=replace(small.CAMERA, threshold=0.05, noise_rms=0.2), duration_ms=50.0)
    expected = background.rate_hz(scene) * 88 * 88 * 0.05
    assert len(background.events(scene, 0).t_us) == pytest.approx(expected, rel=0.01)


def test_a_threshold_above_the_contrast_sends_nothing_and_is_warned_of():
    camera = replace(small.CAMERA, threshold=math.log(5.0), mismatch=0.0)
    scene = small.scene(camera=camera)
    assert len(simulate.events(scene, 0).t_us) == 0
    assert len(reference.events(scene, 0).t_us) == 0
    assert any("no pixel can send an event" in x for x in checks.warnings(scene))
    assert not checks.warnings(small.scene())


def test_no_mismatch_makes_a_threshold_that_never_ends():
    scene = small.scene(camera=replace(small.CAMERA, threshold=0.02, mismatch=1.0), sensor=SEVEN)
    scene = replace(scene, duration_ms=80.0)
    assert reference.thresholds(scene).min() >= 0.02 * (1 - 1e-4)
    assert np.isfinite(reference.thresholds(scene)).all()
    agree(scene, counts=0.01)


def test_a_full_pool_saturates():
    """One pool of 88 x 88 pixels has thousands of events per bin: 255 of them, not their remainder by 256."""
    scene = small.scene()
    found = pooling(Preprocessing(50.0, pool=88, polarity="merge", pool_threshold=254, exceeds=True), 88, 88)
    block = simulate.events(scene, 0)
    events = np.bincount(block.t_us // 50_000, minlength=6)
    assert events.max() > 1000
    np.testing.assert_array_equal(preprocessing.pool([block], found, 0, 0, 6)[0], events >= 255)


def test_several_levels_crossed_between_two_looks_are_several_events():
    camera = replace(small.CAMERA, threshold=0.05, mismatch=0.0, refractory_us=0.0)
    scene = small.scene(small.SMOOTH, camera=camera, sensor=SEVEN, duration_ms=60.0)
    slow = reference.events(scene, 0)
    for step_ms in (1.0, 4.0):
        fast = simulate.events(replace(scene, method=replace(Method(), camera_step_ms=step_ms)), 0)
        per_pixel = np.zeros((64, 64), int)
        np.add.at(per_pixel, (fast.y, fast.x), 1)
        assert per_pixel.max() > 25
        assert len(fast.t_us) == pytest.approx(len(slow.t_us), rel=0.05)


def test_after_its_profile_the_tip_stands_still():
    scene = small.scene(small.SMOOTH, motions=(small.Steady(60.0, duration_s=0.1),))
    paths = simulate.pin_paths(scene, 0, 1.0)
    after = paths.t_s > 0.1
    assert (paths.v_mm_s[after] == 0).all() and (paths.v_mm_s[1:100] == 60).all()
    assert np.ptp(paths.x_mm[paths.t_s > 0.12]) < 1e-3
    agree(scene, counts=0.01)


@pytest.mark.parametrize("texture", [small.SMOOTH, small.DENIM, small.FOAM], ids=lambda x: x.name)
def test_an_events_clock_is_that_of_its_pins(texture):
    """When the pins' paths end, so do the events: nothing that a look left over is sent late."""
    camera = replace(small.CAMERA, noise_hz=2.0)
    scene = small.scene(texture, motions=(small.Steady(60.0, duration_s=0.1),), camera=camera)
    paths = simulate.pin_paths(scene, 0, 0.1)
    moved = np.abs(np.diff(paths.px, axis=0)).max(axis=(1, 2))
    ends_us = 1e6 * paths.t_s[1:][moved > 1e-4].max()
    assert 100_000 < ends_us < 115_000
    found, noise = simulate.events(scene, 0).t_us, background.events(scene, 0).t_us
    signal = len(found) - len(noise)
    assert np.sum(found < 100_000) - np.sum(noise < 100_000) > 0.95 * signal > 5000
    # Skin that creeps to rest moves less than `skip`: looked at once when all is still, it sends few.
    late = np.sum(found >= ends_us) - np.sum(noise >= ends_us)
    assert late < 0.005 * signal
    still_us = ends_us + 10_000
    np.testing.assert_array_equal(found[found >= still_us], noise[noise >= still_us])


def test_other_steps_are_the_same_trial_in_its_statistics():
    """Slips draw by their number, so a finer step moves none of them."""
    scene = small.scene(replace(small.FOAM, slip_jitter=0.5))
    slips, n = [], []
    for step in (0.1, 0.05, 0.025):
        paths = simulate.pin_paths(scene, 0, step)
        falls = np.diff(paths.s_mm) < -step * 1e-3
        slips.append(int(np.sum(falls[1:] & ~falls[:-1])))
        n.append(len(reference.events(scene, 0, step).t_us))
    assert min(slips) > 3
    assert max(slips) - min(slips) <= 0.1 * max(slips)
    assert max(n) / min(n) < 1.05


def test_looks_where_pins_turn_keep_events_that_coarse_looks_lose():
    scene = small.scene(small.FOAM, 42.0)
    n = len(reference.events(scene, 0).t_us)
    fine, coarse = (simulate.simulated(replace(scene, method=Method(turn_px=px)), 0) for px in (0.02, 1.0))
    assert 0 < n - len(fine[0].t_us) < 0.4 * (n - len(coarse[0].t_us))
    exact = simulate.simulated(replace(scene, method=small.EXACT), 0)[1]
    assert coarse[1].looks < fine[1].looks < 0.1 * exact.looks


@pytest.mark.parametrize(
    ("scene", "counts"),
    [
        (small.scene(camera=FINE, sensor=SEVEN, duration_ms=100.0), 0.015),
        (
            small.scene(
                sensor=DAVIS, camera=replace(small.CAMERA, refractory_us=500.0), variation=Variation()
            ),
            0.015,
        ),
        (small.scene(sensor=replace(small.SENSOR, lens_per_mm2=0.01)), 0.015),
        *((small.scene(method=Method(0.125, 0.25, ms, 0.05)), x) for ms, x in ((0.5, 0.008), (4.0, 0.018))),
    ],
    ids=["fine threshold", "grid", "lens", "looks of 0.5 ms", "looks of 4 ms"],
)
def test_other_scenes_agree_too(scene, counts):
    agree(scene, counts=counts, likeness=0.997 if counts != 0.015 else 0.995)
