"""What Brayshaw et al. print about the touch, and the soft scenes do; the hard ones mostly do not.

Accuracies of their classifiers are not facts about the touch: no test here asks for one of them.
"""

import functools

import numpy as np
import pytest

from dse.scene import simulate
from dse.scene.load import load_scene
from dse.scene.trial import trial

LATER = slice(150, None)
"""Bins of 10 ms from 1.5 s on."""

AT_12_MM_S = {
    "motions": "[{kind: constant, speed_mm_s: 12, acceleration_mm_s2: 3000}]",
    "duration_ms": "2000",
}


@functools.cache
def psth(name):
    """Return the events (texture, bin of 10 ms) of one trial of each texture at 12 mm/s."""
    scene = load_scene(name, {"trials": "1"} | (AT_12_MM_S if "dvxplorer" in name else {}))
    return np.stack([counts(scene, k, 10.0) for k in range(scene.n_trials)])


def counts(scene, k, bin_ms):
    """Return the events of trial k in bins."""
    n_bins = round(scene.duration_ms / bin_ms)
    return np.bincount(simulate.events(scene, k).t_us // round(1000 * bin_ms), minlength=n_bins)[:n_bins]


def falls_ms(rates):
    """Return when a rate in bins of 10 ms has lost 90 % of what it has above its later level at its onset."""
    later, onset = rates[LATER].mean(), rates[5:15].mean()
    smooth = np.convolve(rates, np.full(5, 0.2), "same")
    return 10.0 * (5 + int(np.argmax(smooth[5:] < later + 0.1 * (onset - later))))


@pytest.mark.parametrize("name", ["natural_textures", "neurotac_dvxplorer"])
def test_the_initial_movement_sends_many_spikes_for_some_500_ms_at_12_mm_s(name):
    soft, hard = psth(f"{name}_soft").mean(axis=0), psth(name).mean(axis=0)
    assert 350 < falls_ms(soft) < 650
    assert falls_ms(hard) < 250
    assert soft[:50].mean() > 1.5 * soft[LATER].mean()


def test_pins_send_more_than_natural_textures_whatever_the_label():
    pins, natural = psth("pin_arrays_soft").sum(axis=1), psth("natural_textures_soft").sum(axis=1)
    assert pins.min() > natural.max()
    assert pins.mean() > 1.5 * natural.mean()


def slips_per_s(name):
    """Return how often the skin of each texture springs back by half a pixel or more in 1.5 to 5 s."""
    scene = load_scene(name, {"trials": "1"})
    least_mm = 0.5 / scene.sensor.image_scale_px_mm
    rates = []
    for k in range(scene.n_trials):
        paths = simulate.pin_paths(scene, k, 0.5)
        s = paths.s_mm[paths.t_s > 1.5]
        turns = np.flatnonzero(np.diff(np.sign(np.diff(s)))) + 1
        rates.append(np.sum(-np.diff(s[turns]) > least_mm) / 3.5)
    return np.array(rates)


@pytest.mark.parametrize("name", ["natural_textures", "pin_arrays"])
def test_stick_slip_occurs_throughout_the_test_on_every_texture(name):
    assert slips_per_s(f"{name}_soft").min() > 3
    assert slips_per_s(name).min() < 1


def profiles(name, texture, trials, bin_ms, duration_ms):
    """Return a scene of one texture, and its events (motion, trial, bin)."""
    changes = {"trials": str(trials), "textures": f"[{texture}]", "duration_ms": str(duration_ms)}
    scene = load_scene(name, changes)
    found = np.stack([counts(scene, k, bin_ms) for k in range(scene.n_trials)])
    return scene, found.reshape(len(scene.motions), trials, -1)


def test_constant_speeds_differ_from_the_start():
    """Every trial of a faster constant speed peaks higher in its first 80 ms than any of a slower one."""
    for name, apart in (("neurotac_dvxplorer_soft", True), ("neurotac_dvxplorer", False)):
        scene, found = profiles(name, "denim", 3, 10.0, 80.0)
        peaks = found[[m.label.startswith("constant") for m in scene.motions]].max(axis=-1)
        assert bool(np.all(peaks[:-1].max(axis=1) < peaks[1:].min(axis=1))) == apart, peaks


def kinds_of_the_nearest(name, trials):
    """Return how often the nearest profile, and the second nearest, are of a trial's own kind.

    By the means of log rates of 100 ms over some trials on wool, one left out.
    """
    scene, found = profiles(name, "wool", trials, 100.0, 1000.0)
    kinds = np.array([motion.label.split("_")[0] for motion in scene.motions])
    rates, own = np.log1p(found), []
    for left_out in range(trials):
        means = np.delete(rates, left_out, axis=1).mean(axis=1)
        distance = np.linalg.norm(rates[:, left_out, None] - means, axis=-1)
        own.append(kinds[np.argsort(distance, axis=1)[:, :2]] == kinds[:, None])
    first, second = np.mean(own, axis=(0, 1))
    return float(first), float(second)


def test_profiles_are_confused_within_their_kind_and_not_across():
    soft = kinds_of_the_nearest("neurotac_dvxplorer_soft", 4)
    hard = kinds_of_the_nearest("neurotac_dvxplorer", 2)
    assert soft[0] > 0.95 > hard[0]
    assert soft[1] > 0.85 > hard[1]


@pytest.mark.parametrize(
    ("name", "most_mm"),
    [("neurotac_dvxplorer_soft", 0.1), ("natural_textures_soft", 0.5), ("pin_arrays_soft", 0.1)],
)
def test_trials_start_where_arm_and_cloth_leave_them(name, most_mm):
    scene = load_scene(name)
    starts = np.abs([trial(scene, k).start_mm for k in range(40)])
    assert 0.8 * most_mm < starts.max() <= most_mm
