"""Time surfaces: kernels against the definition, hard cases by hand, the online rule, the noise filter."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse_papers.models import time_surfaces
from dse_papers.models.time_surfaces import Field, Memory, Stream, nearest, neighbours, prepared, surface
from tests.plugins.dse_papers.streams import HEIGHT, PLANES, WIDTH, drawn, stream


def all_surfaces(events, field):
    return Memory(field).surfaces(events, np.arange(len(events.t_us)))


def definition(events, field):
    found = [surface(events, i, field) for i in range(len(events.t_us))]
    return np.array(found).reshape(len(found), field.size)


fields = st.builds(
    Field,
    st.just(WIDTH),
    st.just(HEIGHT),
    st.just(PLANES),
    radius=st.integers(1, 9),
    tau_us=st.sampled_from([1e-3, 20.0, 5e4, 1e12]),
)


@given(seed=st.integers(0, 10_000), n=st.integers(0, 40), field=fields)
def test_the_kernel_gives_the_surfaces_of_the_definition(seed, n, field):
    events = drawn(seed, n)
    np.testing.assert_allclose(all_surfaces(events, field), definition(events, field), rtol=1e-15, atol=0)


@given(seed=st.integers(0, 10_000), n=st.integers(1, 40), field=fields, f=st.integers(1, 7))
def test_the_kernel_assigns_as_the_definition_does(seed, n, field, f):
    events, rng = drawn(seed, n), np.random.default_rng(seed)
    surfaces = definition(events, field)
    once = rng.random((f, field.size)) * rng.choice([0.1, 1.0])
    prototypes = np.concatenate([once, once])  # of equally near ones, the lowest number
    label = Memory(field).assign(events, prepared(prototypes))
    np.testing.assert_array_equal(label, nearest(surfaces, prototypes))
    assert label.max() < f


@given(seed=st.integers(0, 10_000), n=st.integers(1, 60), field=fields, f=st.integers(1, 4))
def test_the_kernel_learns_as_the_definition_does(seed, n, field, f):
    events, rng = drawn(seed, n), np.random.default_rng(seed)
    start = rng.random((f, field.size))
    prototypes, chosen = prepared(start), np.ones(f)
    Memory(field).learn(events, prototypes, chosen)
    expected = time_surfaces.learnt_online(definition(events, field), start)
    np.testing.assert_allclose(prototypes.columns.T, expected, rtol=1e-12, atol=1e-15)
    assert chosen.sum() == f + n


@given(seed=st.integers(0, 10_000), cut=st.integers(0, 30))
def test_blocks_of_a_recording_are_one_recording_until_it_is_forgotten(seed, cut):
    events, field = drawn(seed, 30), Field(WIDTH, HEIGHT, PLANES, 2, 5e4)
    prototypes = prepared(np.random.default_rng(seed).random((4, field.size)))
    memory = Memory(field)
    parts = (Stream(*(a[:cut] for a in events)), Stream(*(a[cut:] for a in events)))
    labels = np.concatenate([memory.assign(part, prototypes) for part in parts])
    memory.forget()
    np.testing.assert_array_equal(labels, memory.assign(events, prototypes))


def test_one_event_sees_only_itself_at_age_0():
    field = Field(WIDTH, HEIGHT, PLANES, 1, 20.0)
    found = all_surfaces(stream((7, 2, 2, 1)), field).reshape(3, 3, PLANES)
    assert found[1, 1].tolist() == [0, 1, 0]
    assert found.sum() == 1


def test_no_event_has_no_surface():
    field = Field(WIDTH, HEIGHT, PLANES, 1, 20.0)
    assert all_surfaces(stream(), field).shape == (0, 27)
    assert Memory(field).assign(stream(), prepared(np.zeros((2, 27)))).shape == (0,)
    assert neighbours(stream(), 2, 10).shape == (0,)


def test_simultaneous_events_see_those_before_them_in_the_list():
    field = Field(3, 1, 1, 1, 20.0)
    found = all_surfaces(stream((5, 0, 0, 0), (5, 1, 0, 0), (5, 2, 0, 0)), field)
    assert found.tolist() == [[0, 1, 0], [1, 1, 0], [1, 1, 0]]


def test_ages_are_exact():
    field = Field(3, 1, 2, 2, 1000.0)
    events = stream((0, 0, 0, 0), (400, 0, 0, 0), (500, 2, 0, 1), (1700, 1, 0, 0))
    expected = np.zeros((5, 2))
    expected[1, 0], expected[3, 1], expected[2, 0] = math.exp(-1.3), math.exp(-1.2), 1
    np.testing.assert_array_equal(all_surfaces(events, field)[3], expected.ravel())


def test_places_outside_the_frame_are_0_and_never_part_of_every_surface():
    wide = Field(2, 1, 1, 5, 20.0)
    assert wide.reach == (1, 0)
    assert wide.size == 3
    corner = all_surfaces(stream((0, 1, 0, 0), (1, 0, 0, 0)), wide)
    np.testing.assert_array_equal(corner, [[0, 1, 0], [0, 1, math.exp(-1 / 20)]])


def test_all_events_at_one_place():
    field = Field(1, 1, 1, 3, 20.0)
    events = stream(*((t, 0, 0, 0) for t in range(50)))
    np.testing.assert_array_equal(all_surfaces(events, field), np.ones((50, 1)))
    assert Memory(field).assign(events, prepared(np.array([[0.2], [0.9], [0.9]]))).tolist() == [1] * 50


@pytest.mark.parametrize("tau_us", [20.0, 1e-300, 1e300])
def test_tiny_and_huge_time_constants_are_exact_without_a_warning(tau_us):
    field = Field(2, 1, 1, 1, tau_us)
    events = stream((0, 0, 0, 0), (10**12, 1, 0, 0))
    found = all_surfaces(events, field)
    np.testing.assert_array_equal(found, definition(events, field))
    assert found[1].tolist() == [float(tau_us > 1e12), 1, 0]


@given(
    seed=st.integers(0, 10_000), shift=st.tuples(st.integers(0, 4), st.integers(0, 4), st.integers(0, 10**9))
)
def test_moved_events_have_the_same_surfaces(seed, shift):
    dx, dy, dt = shift
    events, field = drawn(seed, 25, 4, 4), Field(20, 20, PLANES, 3, 5e4)
    inside = events._replace(x=events.x + 6, y=events.y + 6)
    moved = Stream(inside.t_us + dt, inside.x + np.int32(dx), inside.y + np.int32(dy), inside.plane)
    np.testing.assert_array_equal(all_surfaces(inside, field), all_surfaces(moved, field))


def test_the_online_rule_by_hand():
    # Two places; the event sees S = (0, 1, 0). |C| = 5, so beta = 3 / 5 and alpha = 0.01 / (1 + 1 / 20000).
    field = Field(2, 1, 1, 1, 20.0)
    found, chosen = prepared(np.array([[4.0, 3.0, 0.0], [90.0, 90.0, 90.0]])), np.ones(2)
    Memory(field).learn(stream((0, 0, 0, 0)), found, chosen)
    alpha = 0.01 / (1 + 1 / 20000)
    expected = [4 - alpha * 0.6 * 4, 3 + alpha * (1 - 0.6 * 3), 0]
    np.testing.assert_allclose(found.columns[:, 0], expected, rtol=1e-15)
    assert found.columns[:, 1].tolist() == [90, 90, 90]
    assert found.half_squares[0] == pytest.approx(0.5 * (found.columns[:, 0] ** 2).sum(), rel=1e-15)
    assert chosen.tolist() == [2, 1]


def test_a_prototype_of_zeros_learns_without_dividing_by_zero():
    found = prepared(np.zeros((1, 3)))
    Memory(Field(2, 1, 1, 1, 20.0)).learn(stream((0, 0, 0, 0)), found, np.ones(1))
    assert found.columns.ravel().tolist() == [0, 0.01 / (1 + 1 / 20000), 0]


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ((3, 6, 0, 0), r"x of events must be in \[0, 5\], got 1 to 6"),
        ((3, 0, -1, 0), r"y of events must be in \[0, 4\], got -1 to 1"),
        ((3, 0, 0, 3), r"plane of events must be in \[0, 2\], got 1 to 3"),
        ((1, 0, 0, 0), "times of events must never fall"),
    ],
)
def test_events_outside_the_field_are_refused(event, message):
    memory = Memory(Field(WIDTH, HEIGHT, PLANES, 1, 20.0))
    with pytest.raises(ValueError, match=message):
        memory.assign(stream((2, 1, 1, 1), event), prepared(np.zeros((1, 27))))
    with pytest.raises(ValueError, match="prototypes must have 27 numbers each, got 26"):
        memory.assign(stream(), prepared(np.zeros((1, 26))))


def test_neighbours_are_earlier_events_near_in_place_and_time_of_any_plane():
    events = stream(
        (0, 3, 3, 0),
        (0, 3, 3, 1),  # the same time, later in the list: sees the first
        (10, 5, 3, 0),  # at a distance of exactly 2
        (10, 4, 4, 0),  # of sqrt(2)
        (11, 5, 5, 2),  # the first two are at a distance of sqrt(8), and too long ago
        (10_000, 3, 3, 0),
    )
    assert neighbours(events, 2, 10).tolist() == [0, 1, 2, 3, 2, 0]
    assert neighbours(events, 1, 10).tolist() == [0, 1, 0, 0, 0, 0]
    assert neighbours(events, 3, 10**6).tolist() == [0, 1, 2, 3, 4, 5]


@given(seed=st.integers(0, 10_000), radius=st.integers(1, 6), span=st.sampled_from([0, 1, 700, 10**6]))
def test_neighbours_are_those_of_the_definition(seed, radius, span):
    t, x, y, _ = events = drawn(seed, 40)
    expected = [
        sum(t[i] - t[j] <= span and (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 <= radius**2 for j in range(i))
        for i in range(len(t))
    ]
    assert neighbours(events, radius, span).tolist() == expected
