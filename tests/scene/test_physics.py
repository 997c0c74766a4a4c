"""What the physics must show, whatever its steps: delays, stick times, frequencies, rates."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dse.scene import simulate
from dse.scene.friction import FLOOR, LEAVES_AT, Friction, travel
from dse.scene.scene import Texture
from dse.scene.trial import trial
from tests.scene import small

FLAT_LINE = np.zeros(8)
SLIDING = replace(small.DENIM, name="sliding", mu_static=0.36, slip_jitter=0.0, friction_roughness=0.0)
"""Denim that never sticks again."""

GRATING = Texture("grating", 40, 1.6, 0.3, 3000.0, 0.36, 0.36, 2.5, 0.0, 0.0,
                  weave_share=1.0, weave_period_mm=1.6)  # fmt: skip


def moved(v, n=4000, step_s=1e-4, force_n=1.5, **other):
    """Return (s, X) at a constant speed, from rest."""
    numbers = {"mu_static": 0.8, "mu_kinetic": 0.6, "stribeck_mm_s": 50.0, "jitter": 0.0, "roughness": 0.0,
               "stiffness_n_mm": 0.9} | other  # fmt: skip
    flat = np.full(n, force_n)
    return np.array(travel(Friction(**numbers), np.full(n, v), flat, step_s, FLAT_LINE, 1.0, np.zeros(4)))


def displacement(scene, pin, step_ms=0.25):
    """Return t_s and the place (n, 2) of a pin."""
    paths = simulate.pin_paths(scene, 0, step_ms)
    return paths.t_s, paths.px[:, pin]


@pytest.mark.parametrize(("v", "mu", "force"), [(17.5, 0.4, 1.5), (60.0, 0.98, 1.2), (28.0, 0.3, 0.8)])
def test_stick_time_is_static_friction_over_stiffness_and_speed(v, mu, force):
    step = 1e-4
    s, x = moved(v, mu_static=mu, mu_kinetic=0.9 * mu, force_n=force)
    stuck_s = step * np.argmax(x > 0)
    assert stuck_s == pytest.approx(mu * force / (0.9 * v), abs=step)
    assert s.max() <= mu * force / 0.9 + 1e-9
    np.testing.assert_allclose(s + x, v * step * np.arange(len(s)), atol=1e-9)


def test_a_scene_sticks_as_long_as_its_friction_holds():
    v = 28.0
    scene = small.scene(small.SMOOTH, v)
    paths = simulate.pin_paths(scene, 0, 0.1)
    drawn = trial(scene, 0)
    stuck_s = paths.t_s[np.argmax(paths.x_mm > 0)] - drawn.onset_s
    assert stuck_s == pytest.approx(0.40 * 1.5 / (0.9 * v), abs=2e-4)
    # All pins in contact have moved with the skin, against the motion.
    shift = paths.px[np.argmax(paths.x_mm > 0)] - paths.px[0]
    np.testing.assert_allclose(shift[:, 0], -10.4 * 0.40 * 1.5 / 0.9, atol=0.1)
    np.testing.assert_allclose(shift[:, 1], 0, atol=1e-6)


def test_stick_slip_is_a_sawtooth_that_speed_smooths_away():
    slow, _ = moved(5.0, n=20_000)
    fades = 0.2 * np.exp(-5.0 / 50)
    s_k = (0.6 - fades / 2) * 1.5 / 0.9
    again = (0.6 + fades + FLOOR) * 1.5 / 0.9
    late = slow[4000:]
    ends = s_k + LEAVES_AT * (again - s_k)
    assert late.max() == pytest.approx(again, abs=1e-3)
    assert late.min() == pytest.approx(ends, abs=5e-3)
    falls = np.flatnonzero((np.diff(late) < 0) & (np.diff(late, prepend=late[0])[:-1] >= 0))
    slip_s = 0.002 * np.log(1 / LEAVES_AT)
    assert np.diff(falls).mean() * 1e-4 == pytest.approx((again - ends) / 5.0 + slip_s, rel=0.01)
    fast, _ = moved(600.0, n=4000)
    assert np.ptp(fast[2000:]) < 0.1 * np.ptp(late)


def test_steps_of_friction_move_no_slip():
    coarse, _ = moved(28.0, n=400, step_s=1e-3)
    fine, _ = moved(28.0, n=40_000, step_s=1e-5)
    np.testing.assert_allclose(coarse, fine[::100], atol=1e-6)


def test_incipient_slip_ends_the_stick_after_three_times_its_deflection():
    v, most, step = 12.0, 0.8 * 1.5 / 0.9, 1e-4
    s, x = moved(v, n=5000, mu_kinetic=0.8, incipient_slip=True)
    way = v * step * np.arange(len(s))
    stick = way < 3 * most
    np.testing.assert_allclose(s[stick], most * (1 - (1 - way[stick] / (3 * most)) ** 3), atol=1e-9)
    np.testing.assert_allclose(s[~stick], most, atol=0.02 * most)
    np.testing.assert_allclose(s + x, way, atol=1e-9)
    assert 0 < x[10] < 0.01 * way[10] and np.all(np.diff(x) >= 0)  # at first nearly all sticks


def test_steps_move_no_slip_while_the_rim_slips_before():
    numbers = {"mu_static": 0.5, "mu_kinetic": 0.4, "stiffness_n_mm": 0.15, "incipient_slip": True}
    coarse, _ = moved(28.0, n=1000, step_s=1e-3, **numbers)
    fine, _ = moved(28.0, n=10_000, step_s=1e-4, **numbers)
    assert np.sum(np.diff(fine) < -1e-3) > 100
    # (1 - phi)^(1/3) near the end of a stick holds five digits.
    np.testing.assert_allclose(coarse, fine[::10], atol=1e-4)


def test_incipient_slip_stands_still_with_the_tip_and_needs_no_force():
    friction = Friction(0.5, 0.4, 10.0, 0.2, 0.03, 0.15, incipient_slip=True)
    v = np.repeat([28.0, 0.0, 28.0], 500)
    line, normals = np.random.default_rng(7).standard_normal((2, 64))
    s, x = travel(friction, v, np.full(1500, 1.5), 1e-4, line, 0.5, normals)
    assert len(set(s[501:1001])) == len(set(x[501:1001])) == 1
    assert s[1200] > s[1000] > 0 and x[1200] > x[1000] > 0
    np.testing.assert_allclose(s + x, np.concatenate([[0], np.cumsum(v * 1e-4)]), rtol=1e-9)
    for force in (np.zeros(1500), np.where(np.arange(1500) < 250, 1.5, 0.0)):  # none, and none any more
        s, x = travel(friction, v, force, 1e-4, line, 0.5, normals)
        assert np.isfinite(s).all() and np.isfinite(x).all()
        assert 0 <= s[400] < 1e-2 and s[-1] < 1e-3
        np.testing.assert_allclose(s + x, np.concatenate([[0], np.cumsum(v * 1e-4)]), rtol=1e-9)


@pytest.mark.parametrize("incipient", [False, True])
def test_skin_never_moves_faster_than_it_relaxes_and_travel_never_turns_back(incipient):
    rng = np.random.default_rng(3)
    line = rng.standard_normal(64)
    v = np.abs(rng.normal(40, 20, 3000))
    friction = Friction(0.7, 0.6, 5.0, 0.3, 0.05, 0.9, incipient)
    s, x = travel(friction, v, np.full(3000, 1.5), 1e-4, line, 0.05, rng.standard_normal(256))
    assert np.isfinite(s).all() and (s >= 0).all()
    np.testing.assert_allclose(s + x, np.concatenate([[0], np.cumsum(v * 1e-4)]), rtol=1e-9)


@pytest.mark.parametrize("v", [20.0, 60.0])
def test_delay_between_two_pins_is_their_distance_over_speed(v):
    """Pins at +-1.35 mm on the line of motion read the same field, the rear one 2.7 mm later."""
    scene = small.scene(SLIDING, v, duration_ms=800.0)
    t_s, front = displacement(scene, 1)
    _, rear = displacement(scene, 4)
    _, aside = displacement(scene, 2)
    steady = t_s > 0.15 + 0.3 / v
    delay = 2 * 1.35 / v
    for axis in range(2):
        a, b, c = (pin[:, axis] - pin[:, axis][steady].mean() for pin in (front, rear, aside))
        later = np.interp(t_s + delay, t_s, b)
        inside = steady & (t_s + 0.16 < t_s[-1])
        spread = a[inside].std()
        assert spread > 0.1
        assert np.abs((later - a)[inside] - (later - a)[inside].mean()).max() < 0.05 * spread
        lags = np.arange(-80, 640) * 0.25e-3
        match = [np.corrcoef(a[inside], np.interp(t_s[inside] + lag, t_s, b))[0, 1] for lag in lags]
        assert lags[int(np.argmax(match))] == pytest.approx(delay, abs=0.3e-3)
        assert np.corrcoef(a[inside], c[inside])[0, 1] < 0.9


def test_doubled_speed_doubles_the_frequency_of_the_same_surface():
    peaks = []
    for v in (20.0, 40.0):
        t_s, place = displacement(small.scene(GRATING, v, duration_ms=1000.0), 0)
        steady = place[t_s > 0.2, 0]
        power = np.abs(np.fft.rfft((steady - steady.mean()) * np.hanning(len(steady)), 1 << 16))
        peaks.append(np.argmax(power) / ((1 << 16) * 0.25e-3))
    assert peaks[0] == pytest.approx(20.0 / 1.6, rel=0.05)
    assert peaks[1] / peaks[0] == pytest.approx(2, rel=0.03)


def test_event_rate_grows_with_speed():
    rates = [
        len(simulate.events(small.scene(SLIDING, v, duration_ms=400.0), 0).t_us) for v in (7, 14, 28, 56)
    ]
    assert all(b > 1.2 * a > 0 for a, b in pairwise(rates)), rates


def test_rougher_and_harder_textures_move_pins_more():
    def swing(texture):
        t_s, place = displacement(small.scene(texture, 40.0, duration_ms=500.0), 0)
        return float(place[t_s > 0.2].std(axis=0).max())

    plain = swing(SLIDING)
    assert swing(replace(SLIDING, rms_um=110)) == pytest.approx(2 * plain, rel=1e-3)
    assert swing(replace(SLIDING, modulus_mpa=0.02)) < 0.5 * plain
    assert swing(replace(SLIDING, rms_um=0)) == pytest.approx(0, abs=1e-9)


def test_the_pre_sliding_burst_carries_friction():
    low, high = (
        simulate.pin_paths(small.scene(replace(small.SMOOTH, mu_static=mu, mu_kinetic=mu)), 0, 0.25)
        for mu in (0.3, 0.6)
    )
    assert high.s_mm.max() == pytest.approx(2 * low.s_mm.max(), rel=1e-2)
    assert (high.px[0] - high.px[-1])[:, 0].min() == pytest.approx(10.4 * high.s_mm[-1], rel=1e-3)
