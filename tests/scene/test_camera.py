"""The fast camera alone, on hand-made paths, beside the reference camera."""

import numpy as np
import pytest

from benchmarks import scene_reference as reference
from dse.base.records import Block
from dse.scene import camera
from dse.scene.camera import DROPPED, EVENTS, LOOKS, LOST
from dse.scene.scene import Camera

SIZE = (48, 40)
RADIUS, EDGE, CONTRAST = 4.2, 0.45, 5.0
KEY = 12345


def thresholds(on=0.3, off=0.3):
    """Return (height, width, 2): OFF, ON, each pixel a little different."""
    spread = np.exp(0.1 * np.random.default_rng(0).standard_normal((SIZE[1], SIZE[0], 2)))
    return (np.array([off, on]) * spread).astype(np.float32)


def watch(t_s, px, theta, refractory_us=0.0, capacity=1 << 16):
    """Return the events of pins looked at at every point of their path (n, pin, 2), and the tally."""
    gain = np.exp(theta * np.array([-1.0, 1.0])).astype(np.float32)
    light, n_pins = camera.light_of(RADIUS, EDGE, CONTRAST), px.shape[1]
    others = [[j for j in range(n_pins) if j != i] for i in range(n_pins)]
    neighbours = np.arange(n_pins + 1) * (n_pins - 1), np.array(others, dtype=np.int64).reshape(-1)
    view = camera.view(theta, gain, KEY, refractory_us, light, px[0] - 0.5, neighbours, capacity)
    camera.wake(view)
    for t0, t1, places in zip(t_s[:-1] * 1e6, t_s[1:] * 1e6, px[1:] - 0.5, strict=True):
        for i, (x, y) in enumerate(places):
            camera.look(view, i, x, y, float(t0), float(t1))
    none = np.zeros(0, np.int64)
    return camera.in_order(view.sent[: view.tally[EVENTS]], Block(none, none, none, none), SIZE), view.tally


def defined(t_s, px, theta, refractory_us=0.0):
    """Return the reference's events of a path, drawn at 40 frames per look."""
    fine = np.linspace(t_s[0], t_s[-1], 40 * (len(t_s) - 1) + 1)
    flat = px.reshape(len(px), -1)
    between = np.stack([np.interp(fine, t_s, x) for x in flat.T], axis=1).reshape(len(fine), *px.shape[1:])
    start = reference.start_phases(KEY, SIZE[1], SIZE[0])
    seen = Camera(contrast=CONTRAST, refractory_us=refractory_us)
    return reference.camera(fine, between, RADIUS, EDGE, start, theta, seen)


def counts(found):
    n = np.zeros((SIZE[1], SIZE[0], 2), int)
    np.add.at(n, (found.y, found.x, found.polarity), 1)
    return n


def straight(n, *pins, ms=20.0):
    part = np.linspace(0, 1, n + 1)
    px = np.stack([np.array(a) + part[:, None] * (np.array(b) - a) for a, b in pins], axis=1)
    return part * ms * 1e-3, px


PATHS = {
    "straight": straight(20, ((10.3, 20.1), (35.0, 22.0))),
    "one look for 25 px": straight(1, ((10.3, 20.1), (35.0, 22.0))),
    "hardly a pixel": straight(5, ((20.0, 20.0), (20.4, 20.9))),
    "out of the frame": straight(12, ((40.0, 20.0), (58.0, 20.0))),
    "into a corner": straight(15, ((-6.0, -4.0), (6.0, 5.0))),
    "two apart": straight(20, ((10.0, 10.0), (30.0, 12.0)), ((10.0, 28.0), (30.0, 30.0))),
}


@pytest.mark.parametrize(("t_s", "px"), PATHS.values(), ids=PATHS)
def test_level_crossings_in_closed_form_are_the_definitions(t_s, px):
    theta = thresholds()
    fast, tally = watch(t_s, px, theta)
    slow = defined(t_s, px, theta)
    assert len(slow.t_us) > 10
    # Between looks a pixel apart a pin may pass nearest to a pixel on its flank: that level is not seen.
    a, b = counts(fast), counts(slow)
    assert np.abs(a - b).sum() <= max(2, 0.012 * len(slow.t_us))
    assert tally[LOOKS] == px.shape[1] * (len(t_s) - 1)
    assert tally[DROPPED] == 0
    # The same events at nearly the same times: log light and distance part by a fraction of a pixel.
    alike = (a == b).all(axis=2)
    times = []
    for found in (fast, slow):
        kept = alike[found.y, found.x]
        order = np.lexsort((found.t_us[kept], found.polarity[kept], found.x[kept], found.y[kept]))
        times.append(found.t_us[kept][order])
    assert np.abs(times[0] - times[1]).max() < 0.1 * 1e6 * t_s[-1]
    assert np.median(np.abs(times[0] - times[1])) < 0.01 * 1e6 * t_s[-1]


@pytest.mark.parametrize("gap", [12.0, 9.0, 6.0])
def test_pins_that_touch_share_their_pixels_light(gap):
    """Two pins meet and part: a pixel between them is served by both and must answer their sum."""
    middle, y = 24.0, 20.2
    parts = [straight(30, ((middle - side * 14, y), (middle - side * gap / 2, y))) for side in (1, -1)]
    px = np.concatenate([x for _, x in parts], axis=1)
    px = np.concatenate([px, px[-2::-1]])
    t_s = np.linspace(0, 0.04, len(px))
    theta = thresholds()
    fast, slow = watch(t_s, px, theta)[0], defined(t_s, px, theta)
    assert len(slow.t_us) > 800
    assert np.abs(counts(fast) - counts(slow)).sum() < 0.005 * len(slow.t_us)


def test_a_pin_shares_light_with_those_that_it_passes_within_a_look():
    t_s, px = straight(1, ((6.3, 20.1), (42.0, 20.6)), ((24.2, 27.0), (24.2, 27.0)))
    theta = thresholds()
    fast, slow = watch(t_s, px, theta)[0], defined(t_s, px, theta)
    assert len(slow.t_us) > 2000
    assert np.abs(counts(fast) - counts(slow)).sum() < 0.012 * len(slow.t_us)


def test_a_pin_at_rest_sends_nothing_however_often_it_is_looked_at():
    t_s, px = straight(30, ((20.2, 20.7), (20.2, 20.7)))
    fast, tally = watch(t_s, px, thresholds())
    assert len(fast.t_us) == 0
    assert tally[LOOKS] == 30


def test_a_resting_pixel_moves_its_level_and_counts_what_it_does_not_send():
    t_s, px = straight(20, ((10.3, 20.1), (35.0, 22.0)), ms=2.0)
    theta = thresholds()
    awake, _ = watch(t_s, px, theta)
    tired, tally = watch(t_s, px, theta, refractory_us=200.0)
    assert tally[DROPPED] > 50
    assert len(tired.t_us) + tally[DROPPED] == len(awake.t_us)
    expected = defined(t_s, px, theta, refractory_us=200.0)
    assert len(tired.t_us) == pytest.approx(len(expected.t_us), rel=0.02)


def test_a_pin_far_outside_is_counted_as_lost():
    far = camera.PAD + 10.0
    t_s, px = straight(20, ((10.0, 20.0), (-far, 20.0)))
    fast, tally = watch(t_s, px, thresholds())
    assert tally[LOST] > 0
    assert fast.x.min() >= 0
    assert len(fast.t_us) == pytest.approx(len(defined(t_s, px, thresholds()).t_us), rel=0.02)


def test_a_full_list_says_how_many_events_there_were():
    t_s, px = straight(20, ((10.3, 20.1), (35.0, 22.0)))
    all_of_them, _ = watch(t_s, px, thresholds())
    some, tally = watch(t_s, px, thresholds(), capacity=100)
    assert len(some.t_us) == 100
    assert tally[EVENTS] == len(all_of_them.t_us)


def test_start_phases_fill_their_range_evenly():
    phases = reference.start_phases(KEY, 300, 200)
    assert np.abs(phases).max() < 1
    histogram = np.histogram(phases, 10, (-1, 1))[0]
    assert np.abs(histogram / 6000 - 1).max() < 0.06
    assert abs(np.corrcoef(phases[:, 1:].ravel(), phases[:, :-1].ravel())[0, 1]) < 0.02
    assert (phases != reference.start_phases(KEY + 1, 300, 200)).mean() > 0.999
