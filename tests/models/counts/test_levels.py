"""Levels in windows against the definition, step by step."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Parameters
from dse.models.counts.levels import HELD
from dse.models.counts.linear import Linear
from dse.models.training import Training
from tests.models.counted import rngs, textures

FAMILY = Linear(window_ms=150.0, reads="levels", read_outs=2)


def of_two_places(rises):
    """Return textures whose channels 0, 1 are of one place, and 2, 3 of another."""
    positions = np.array([[0, 0, 0], [0, 0, 1], [5, 0, 0], [5, 0, 1]], np.int32)
    return replace(textures(n=40, n_steps=40), positions=positions, rises=np.array(rises, np.int32))


@pytest.mark.parametrize("factor", [1, 900])
def test_means_and_movements_are_those_of_the_definition(factor):
    data = of_two_places(np.multiply(factor, [-1, 1, 5, -2]))
    arrays = FAMILY.fit(data, Training(), rngs).network.arrays
    assert arrays["shift"] == (0 if factor == 1 else arrays["shift"]) and (factor == 1 or arrays["shift"] > 0)
    found = FAMILY.counts(data, data.validation, arrays)
    for n, i in enumerate(data.validation):
        first = i * data.spikes.n_steps + data.start[i]
        rises = np.zeros((40, 2), int)
        for t in range(40):
            begin, end = data.spikes.row_offsets[first + t : first + t + 2]
            for channel in data.spikes.channel[begin:end]:
                rises[t, channel // 2] += data.rises[channel]
        moved = np.zeros((40, 2), int)
        for t in range(40):
            begin, end = data.spikes.row_offsets[first + t : first + t + 2]
            for channel in data.spikes.channel[begin:end]:
                moved[t, channel // 2] += abs(data.rises[channel])
        level = np.cumsum(rises, axis=0)
        for w, part in enumerate((slice(0, 15), slice(15, 30), slice(30, 40))):
            wanted = np.stack([level[part].sum(axis=0), moved[part].sum(axis=0)], axis=1).ravel()
            wanted = np.clip(wanted >> int(arrays["shift"]), -HELD, HELD)
            assert found[n, w].tolist() == wanted.tolist()
    assert (found < 0).any() and (found > 0).any()


def test_what_levels_cannot_be():
    with pytest.raises(ValueError, match=r"model\.reads levels needs model\.channels each"):
        Linear(reads="levels", channels="sum")
    fitted = FAMILY.fit(of_two_places([-1, 1, 5, -2]), Training(), rngs).network
    FAMILY.check_fitted(fitted, 3)
    for name, value in (
        ("place", np.array([0, 0, 1, 7])),
        ("shift", np.array(40)),
        ("sign", np.ones(3, np.int8)),
    ):
        with pytest.raises(ValueError, match="must"):
            FAMILY.check_fitted(Parameters({**fitted.arrays, name: value}, 4), 3)
