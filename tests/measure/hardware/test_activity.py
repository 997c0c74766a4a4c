import numpy as np
import pytest

from dse.measure.hardware.inference import expected_updates


def test_a_chain_of_single_neurons():
    # An input that fires in half of the steps: layer 1 is awake in step 2 with 1/2 and in step 3 with 3/4;
    # layer 2 in step 3 if layer 1 was in step 2 and fired: 1/4.
    assert expected_updates((1, 1, 1), (0.5, 0.5, 0.0), 3).tolist() == [1.25, 0.25]
    assert expected_updates((1, 1, 1), (0.5, 0.5, 0.0), 1).tolist() == [0, 0]
    assert expected_updates((1, 1, 1), (0.5, 0.5, 0.0), 0).tolist() == [0, 0]


def test_full_activity_wakes_a_layer_per_step():
    assert expected_updates((3, 5, 2), (1.0, 1.0, 1.0), 10).tolist() == [5 * 9, 2 * 8]


def test_the_fan_in_is_what_can_wake_a_neuron():
    # 1 - 0.9 ** 2 = 0.19 in step 2, 1 - 0.81 ** 2 = 0.3439 in step 3.
    found = expected_updates((50, 4), (0.1, 0.0), 3, fan_in=(2.0,))
    assert found == pytest.approx([4 * (0.19 + 0.3439)])


def test_drawn_spikes_agree_in_the_mean():
    rng = np.random.default_rng(0)
    sizes, rates, n_steps, n = (6, 4, 3), (0.05, 0.08), 40, 20_000
    before = np.ones((n, 1), bool)
    updates = []
    for size, before_size, rate in zip(sizes[1:], sizes, rates, strict=False):
        # A layer that is not awake does not fire; the step after its first spike the next one is.
        fired = before & (rng.random((n, n_steps, before_size)) < rate).any(axis=-1)
        awake = np.zeros_like(fired)
        awake[:, 1:] = np.maximum.accumulate(fired, axis=1)[:, :-1]
        updates.append(size * awake.sum(axis=1))
        before = awake
    found = expected_updates(sizes, (*rates, 0.0), n_steps)
    error = np.std(updates, axis=1) / np.sqrt(n)
    assert (np.abs(np.mean(updates, axis=1) - found) < 4 * error).all()


def test_leading_axes_are_design_points_of_their_own():
    rates = np.random.default_rng(1).random((2, 3, 3))
    found = expected_updates((7, 5, 3), rates, 20)
    assert found.shape == (2, 3, 2)
    for at in np.ndindex(2, 3):
        assert found[at] == pytest.approx(expected_updates((7, 5, 3), rates[at], 20))


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        ((0.1,), r"rates must have shape \(..., 2\) as sizes, got \(1,\)"),
        ((-0.1, 0.0), "rates must be between 0 and 1"),
        ((1.1, 0.0), "rates must be between 0 and 1"),
        ((np.nan, 0.0), "rates must be between 0 and 1"),
    ],
)
def test_impossible_rates_are_named(rates, message):
    with pytest.raises(ValueError, match=message):
        expected_updates((3, 2), rates, 5)
