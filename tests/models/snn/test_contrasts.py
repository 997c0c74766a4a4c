"""The start by contrasts: what candidates compare, and which of them stay."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.ours import rows_of
from dse.engine.events import pooled
from dse.engine.forward import prepare
from dse.engine.layers import weights
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.response import dc_gain, response_norm
from dse.models.snn import contrasts
from dse.models.snn.family import SNN
from tests.models.snn.toy import SHORT, accuracy, fit, rngs, toy

NEURONS = cuba_lif.rounded(0.25, 0.03, 1.25)


def drives(rows, most_below=np.inf):
    return contrasts.Drives(rows, NEURONS, 8, most_below)


def drawn(n, n_inputs=4, most_below=np.inf, rate=0.3):
    rng = np.random.default_rng(2)
    common = rate * np.exp(rng.normal(0, 0.5, (6, 500, 1)).cumsum(axis=1) * 0.05)
    rows = pooled(rows_of((rng.random((6, 500, 40)) < common).astype(np.uint8)), np.arange(40) % n_inputs)
    found = contrasts.Contrasts.drawn(n_inputs, n, 8, np.random.default_rng(3))
    return rows, drives(rows, most_below).weights(found), found


def test_a_candidate_is_excited_by_one_input_and_inhibited_by_less_of_another():
    rows, found, _ = drawn(200)
    means = contrasts.mean_counts(rows, 500).mean(axis=0)
    assert ((found > 1e-30).sum(axis=0) == 1).all() and ((found < -1e-30).sum(axis=0) == 1).all()
    np.testing.assert_array_equal(found.argmax(axis=0), np.arange(200) % 4)
    lowest, highest = (found * means[:, None]).min(axis=0), (found * means[:, None]).max(axis=0)
    share = -lowest / highest
    assert 0 <= share.min() < 0.1 and 0.9 < share.max() < 1.02
    np.testing.assert_array_equal(found, drawn(200)[1])


def test_shares_of_the_time_above_the_threshold_spread_evenly_on_a_logarithmic_scale():
    rows, found, _ = drawn(400)
    seen = contrasts.mean_counts(rows, 33)
    potential = seen @ found * dc_gain(NEURONS, 400)
    above = (potential > NEURONS.to_threshold).sum(axis=0) / (potential > 0).sum(axis=0)
    share = np.exp(np.log(0.02) + (np.arange(400) // 4 + 0.5) / 100 * np.log(0.95 / 0.02))
    assert np.abs(above - share).mean() < 0.06
    assert np.corrcoef(above, share)[0, 1] > 0.97
    fired = prepare(weights(found, None, NEURONS), "float32").forward(rows).fired.per_input().sum(axis=0)
    assert fired[-40:].mean() > 4 * fired[:40].mean() > 0


@pytest.mark.parametrize("most", [3.0, 20.0])
def test_mean_potentials_lie_no_deeper_than_allowed(most):
    rows, found, _ = drawn(200, most_below=most)
    gain = dc_gain(NEURONS, 200)
    memory = round(float(np.median((gain / response_norm(NEURONS, 200, rows.n_steps)) ** 2)))
    depth = -(contrasts.mean_counts(rows, memory) @ found * gain).min() / NEURONS.to_threshold
    assert 0.5 * min(most, 8) < depth < 1.001 * most


def test_inputs_that_never_fire_are_compared_with_nothing():
    rows = pooled(rows_of(np.ones((1, 60, 3), np.uint8)), np.array([0, 0, 2]))
    two = contrasts.Contrasts.drawn(2, 8, 8, np.random.default_rng(0))
    found = drives(rows).weights(two)
    assert (np.abs(found[1]) < 1e-30).all() and (np.abs(found[[0, 2]]) > 1e-6).all()
    silent = pooled(rows_of(np.zeros((1, 60, 3), np.uint8)), None)
    assert (np.abs(drives(silent).weights(two)) < 1e-30).all()


def test_an_input_alone_is_compared_with_nothing():
    rows = pooled(rows_of(np.ones((1, 60, 1), np.uint8)), None)
    found = drives(rows).weights(contrasts.Contrasts.drawn(1, 5, 8, np.random.default_rng(0)))
    assert (found > 0).all()


def test_neurons_whose_potential_has_no_limit_have_no_contrasts():
    rows = pooled(rows_of(np.ones((1, 20, 3), np.uint8)), np.arange(3))
    with pytest.raises(ValueError, match="a potential that has no limit"):
        contrasts.Drives(rows, cuba_lif.rounded(0.25, 0.0, 1.25), 3, np.inf)


@given(seed=st.integers(0, 2**30), n_inputs=st.integers(1, 6), n=st.integers(1, 60))
def test_candidates_close_by_differ_little_and_stay_contrasts(seed, n_inputs, n):
    rng = np.random.default_rng(seed)
    parents = contrasts.Contrasts.drawn(n_inputs, 24, 3, rng)
    near = parents.near(n_inputs, n, rng)
    assert near.share.size == n and ((near.excited >= 0) & (near.excited < n_inputs)).all()
    assert ((near.inhibited != near.excited) | (n_inputs == 1)).all()
    assert ((near.share >= 0) & (near.share <= 1)).all() and ((near.time > 0.019) & (near.time < 0.951)).all()
    for k in range(n):
        of = (parents.excited == near.excited[k]) & (parents.neuron == near.neuron[k])
        distance = (
            np.abs(parents.share - near.share[k]) / 0.2 + np.abs(np.log(parents.time / near.time[k])) / 2
        )
        assert distance[of].min() < 1.3


def test_rounds_lower_the_error_and_a_choice_made_before_is_kept():
    """Two classes differ in how input 0 compares with input 3; a readout of 4 of 8 neurons is to tell."""
    rng = np.random.default_rng(7)
    label = np.arange(120) % 2
    common = 0.2 * np.exp(rng.normal(0, 0.4, (120, 1, 1)))
    rates = np.repeat(common, 4, axis=2) * np.ones((1, 100, 1))
    rates[label == 1, :, 0] *= 1.25
    rows = rows_of((rng.random((120, 100, 4)) < rates).astype(np.uint8))
    at, targets = drives(rows), np.eye(2)[label]
    errors = []

    def run(matrix, population):
        layer = prepare(weights(matrix.astype(np.float32), None, population), "float32")
        return contrasts.run_candidates(layer, population.to_threshold, lambda *_: [rows], np.inf)

    for rounds in (0, 4):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(contrasts, "_ROUNDS", rounds)
            draws = np.random.default_rng(1)
            matrix, population, stored = contrasts.first_layer(
                contrasts.Contrasts, at, 4, draws, contrasts.Choice(run, targets, 0.0)
            )
        errors.append(error(run(matrix, population)[0], targets, np.arange(4)))
        after = np.random.default_rng(1)
        again = contrasts.first_layer(
            contrasts.Contrasts, at, 4, after, contrasts.Choice(run, targets, 0.0, stored)
        )
        np.testing.assert_array_equal(again[0], matrix)
        assert after.random() == draws.random()
    assert errors[1] < errors[0] - 1e-3


def error(counts, targets, of):
    """Return the least squared error of a ridge readout, as `chosen` minimises it."""
    scaled = counts / (counts.std(axis=0) + 5)
    x, y = scaled[:, of], targets - targets.mean(axis=0)
    gram = x.T @ x / len(x) + 0.003 * np.eye(x.shape[1])
    readout = np.linalg.solve(gram, x.T @ y / len(x))
    fit = (readout * (gram @ readout - 2 * (x.T @ y) / len(x))).sum()
    return float((y**2).sum() / len(x) + fit)


@given(seed=st.integers(0, 2**30), n=st.integers(2, 12), n_outputs=st.integers(1, 4))
def test_each_loss_is_that_which_raises_the_error_least(seed, n, n_outputs):
    """Against every neuron left out in turn, with a price on spikes and without."""
    rng = np.random.default_rng(seed)
    counts = rng.poisson(rng.uniform(1, 40, n), (60, n))
    targets = np.eye(n_outputs)[rng.integers(0, n_outputs, 60)]
    for price in (0.0, 1e-3):
        left = np.arange(n)
        while left.size > 1:
            rest = [np.delete(left, k) for k in range(left.size)]
            costs = [error(counts, targets, r) + price * counts[:, r].mean(axis=0).sum() for r in rest]
            left = contrasts.chosen(counts, targets, left.size - 1, price, np.zeros(n, bool))
            found = error(counts, targets, left) + price * counts[:, left].mean(axis=0).sum()
            assert found <= min(costs) + 1e-9


def test_what_a_readout_needs_stays_and_the_price_of_spikes_is_paid():
    rng = np.random.default_rng(0)
    label = np.arange(400) % 2
    counts = rng.poisson(30, (400, 50))
    counts[:, [7, 31]] += 25 * np.stack([label, 1 - label], axis=1)
    counts[:, 40] = 40 * counts[:, 7]  # says the same as 7, in more spikes
    out = np.zeros(50, bool)
    assert 31 in contrasts.chosen(counts, np.eye(2)[label], 2, 0.0, out)
    assert 40 not in contrasts.chosen(counts, np.eye(2)[label], 2, 1e-4, out)
    out[31] = True
    assert 31 not in contrasts.chosen(counts, np.eye(2)[label], 2, 0.0, out)


def test_a_network_that_starts_by_contrasts_learns_in_fewer_epochs():
    data = toy(n=90)
    training = SHORT.__class__(epochs=2, output_epochs=2, batch_size=9, dropout=0.0)
    for arithmetic in ("integer", "float32"):
        model = SNN(hidden=(12,), start="contrasts", arithmetic=arithmetic)
        outcome = fit(data, model, training, rngs())
        assert accuracy(outcome, data) > 0.9
        assert outcome.health["missed_initial_rates"] == 0 and outcome.health["initial_rate_hidden"] > 0


def test_neurons_that_would_leave_the_range_of_a_state_are_not_chosen():
    data = toy(n=90)
    training = SHORT.__class__(epochs=1, output_epochs=1, batch_size=9, dropout=0.0)
    peaks = []
    for threshold in (1.25, 320.0):
        neuron = CubaLif(threshold=threshold, current_decay=(0.25,), voltage_decay=(0.002,))
        outcome = fit(data, SNN(hidden=(12,), neuron=neuron, start="contrasts"), training, rngs())
        peaks.append(outcome.health["peak_thresholds"])
        assert not outcome.health["overflows_24_bit"]
    assert peaks[0] > 1
