"""Prototypes: the surfaces that are drawn, k-means and the online rule in their hard cases, determinism."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse_papers.models import prototypes, time_surfaces
from dse_papers.models.prototypes import clustered, drawn_surfaces, learnt_online
from dse_papers.models.time_surfaces import Field, surface
from tests.plugins.dse_papers.streams import drawn

FIELD = Field(6, 5, 3, 2, 5e4)


def recordings(seed, *n):
    return [partial(drawn, seed + i, size) for i, size in enumerate(n)]


def all_surfaces(given):
    found = [surface(r(), i, FIELD) for r in given for i in range(len(r().t_us))]
    return np.array(found).reshape(-1, FIELD.size)


@given(seed=st.integers(0, 1000), n=st.integers(1, 30))
def test_surfaces_are_drawn_from_all_recordings_without_replacement(seed, n):
    sizes = (7, 0, 12, 1)
    found = drawn_surfaces(recordings(seed, *sizes), sizes, FIELD, n, 1, np.random.default_rng(seed))
    chosen = np.sort(np.random.default_rng(seed).choice(20, min(n, 20), replace=False))
    np.testing.assert_allclose(found, all_surfaces(recordings(seed, *sizes))[chosen], rtol=1e-7)


def test_no_more_surfaces_are_drawn_than_fit_into_memory(monkeypatch):
    monkeypatch.setattr(prototypes, "_MOST_NUMBERS", 4 * FIELD.size + 1)
    for least, expected in ((1, 4), (7, 7), (100, 9)):
        found = drawn_surfaces(recordings(0, 9), [9], FIELD, 9, least, np.random.default_rng(0))
        assert len(found) == expected


def test_k_means_finds_two_heaps():
    rng = np.random.default_rng(0)
    heaps = np.concatenate([rng.normal(0, 0.1, (40, 5)), rng.normal(3, 0.1, (60, 5))]).astype(np.float32)
    found = clustered(heaps, 2, rng)
    order = found[:, 0].argsort()
    np.testing.assert_allclose(found[order], [heaps[:40].mean(axis=0), heaps[40:].mean(axis=0)], atol=1e-5)
    np.testing.assert_array_equal(clustered(heaps, 9, np.random.default_rng(3)),
                                  clustered(heaps, 9, np.random.default_rng(3)))  # fmt: skip


@pytest.mark.parametrize("n", [3, 4, 500])
def test_as_many_prototypes_as_surfaces_that_differ(n):
    surfaces = np.eye(3, dtype=np.float32)[[0, 0, 1, 0, 2, 1]]
    np.testing.assert_array_equal(clustered(surfaces, n, np.random.default_rng(0)), np.eye(3))


def test_without_a_surface_one_prototype_of_zeros():
    none = np.zeros((0, FIELD.size), np.float32)
    assert clustered(none, 4, np.random.default_rng(0)).tolist() == [[0.0] * FIELD.size]
    found = learnt_online(recordings(0, 0), none, FIELD, 4, np.random.default_rng(0))
    assert found.tolist() == [[0.0] * FIELD.size]


@given(seed=st.integers(0, 1000), n=st.integers(1, 6))
def test_the_online_rule_passes_once_over_all_events_in_random_order(seed, n):
    events = recordings(seed, 20, 0, 15)
    surfaces = drawn_surfaces(events, (20, 0, 15), FIELD, 30, 1, np.random.default_rng(seed))
    found = learnt_online(events, surfaces, FIELD, n, np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    start = np.array(list({s.tobytes(): s for s in surfaces[rng.permutation(30)]}.values()), np.float64)[:n]
    order = rng.permutation(3)
    expected = time_surfaces.learnt_online(all_surfaces([events[i] for i in order]), start)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
