"""Velocity profiles: closed forms, the travel that they promise, and their names."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.base import registry
from dse.scene.motions.accelerating import Accelerating
from dse.scene.motions.constant import Constant
from dse.scene.motions.table import Table
from dse.scene.motions.triangular import Triangular

KINDS = registry.known("scene.motions")
assert {"constant", "table"} <= KINDS.keys()

speeds = travels = st.floats(1.0, 200.0)
times = st.lists(st.floats(0.01, 2.0), min_size=1, max_size=8).map(lambda x: (0.0, *np.cumsum(x).tolist()))
motions = st.one_of(
    st.builds(Constant, speeds, travels, st.floats(20.0, 1000.0)),
    st.builds(Accelerating, speeds, travels),
    st.builds(Triangular, speeds, travels),
    times.flatmap(
        lambda t: st.builds(
            Table, st.just(t), st.lists(st.floats(0, 100), min_size=len(t), max_size=len(t)).map(tuple)
        )
    ),
)


def path_mm(motion, t_s, n=200_000):
    """The path up to a time, by the midpoint rule."""
    step = t_s / n
    return float(motion.speed((np.arange(n) + 0.5) * step).sum() * step)


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_is_explained(kind):
    fields = dataclasses.fields(KINDS[kind])
    assert all(registry.rule_of(field).doc for field in fields)
    units = {field.name: registry.rule_of(field).unit for field in fields if field.name != "name"}
    assert all(units.values()), units


@given(motions)
def test_speed_is_never_negative_and_never_above_its_peak(motion):
    speed = motion.speed(np.linspace(0, motion.duration_s, 101))
    assert speed.shape == (101,)
    assert (speed >= 0).all()
    assert (speed <= motion.peak_mm_s * (1 + 1e-12)).all()


@given(st.one_of(*(st.builds(cls, speeds, travels) for cls in (Constant, Accelerating, Triangular))))
def test_the_travel_is_reached_when_the_motion_ends(motion):
    assert path_mm(motion, motion.duration_s, 20_000) == pytest.approx(motion.travel_mm, rel=1e-4)


@pytest.mark.parametrize(
    ("motion", "duration_s"),
    [
        (Constant(17.5), 84 / 17.5 + 17.5 / 600),
        (Constant(60), 84 / 60 + 60 / 600),
        (Accelerating(35), 4.8),
        (Accelerating(60), 2.8),
        (Triangular(35), 4.8),
        (Triangular(42), 4.0),
        (Table((0, 1, 3), (0, 10, 10)), 3),
    ],
)
def test_durations(motion, duration_s):
    assert motion.duration_s == pytest.approx(duration_s)


def test_constant_speed_follows_its_ramp():
    motion = Constant(60)
    assert motion.speed(np.array([0, 0.1, 0.2, 1.0])).tolist() == [0, 30, 60, 60]
    # x = V t - V^2 / (2 A) once the ramp is over
    assert path_mm(motion, 1.0) == pytest.approx(60 - 60**2 / 600)


def test_acceleration_is_a_parabola_in_space():
    motion = Accelerating(42)
    assert motion.speed(np.array([0, 2.0, 4.0])).tolist() == [0, 21, 42]
    assert path_mm(motion, 2.0) == pytest.approx(42 * 2.0**2 / (2 * 4))


def test_a_triangle_turns_half_way():
    motion = Triangular(42)
    assert motion.speed(np.array([0, 1.0, 2.0, 3.0, 4.0])).tolist() == [0, 21, 42, 21, 0]
    assert path_mm(motion, 2.0) == pytest.approx(42)
    assert path_mm(motion, 3.0) == pytest.approx(84 - 42 * (4 - 3) ** 2 / 4)


def test_zero_speed_stands_still_for_ever():
    motion = Constant(0)
    assert motion.duration_s == math.inf
    assert motion.peak_mm_s == 0
    assert motion.speed(np.array([0.0, 1.0, 1e6])).tolist() == [0, 0, 0]


def test_a_travel_too_short_for_the_speed_ends_on_the_ramp():
    motion = Constant(60, travel_mm=1.5)
    assert motion.peak_mm_s == pytest.approx(30)
    assert motion.duration_s == pytest.approx(0.1)


def test_a_table_is_straight_between_its_points():
    motion = Table((0, 1, 3), (0, 10, 30))
    assert motion.speed(np.array([0.5, 1.0, 2.0])).tolist() == [5, 10, 20]
    assert motion.peak_mm_s == 30


@pytest.mark.parametrize(
    ("t_s", "v_mm_s", "message"),
    [
        ((0.5, 1), (1, 1), r"t_s must start at 0, .*, got \[0\.5, 1\]"),
        ((0, 1, 1), (1, 1, 1), "t_s must start at 0"),
        ((0,), (1,), "at least two times"),
        ((0, 1), (1,), "v_mm_s must have one speed for each of 2 times, got 1"),
    ],
)
def test_a_table_that_is_none(t_s, v_mm_s, message):
    with pytest.raises(ValueError, match=message):
        Table(t_s, v_mm_s)


def test_labels():
    found = [x.label for x in (Constant(17.5), Accelerating(35), Triangular(60), Table((0, 1), (0, 9)))]
    assert found == ["constant_17.5", "accelerating_35", "triangular_60", "table_9"]
    assert Constant(17.5, name="slow").label == "slow"
