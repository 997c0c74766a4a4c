"""Extreme learning machines: features, random weights, solutions, answers and hard cases."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.base import seeds
from dse.base.records import Answers, Dataset, Spikes
from dse.models.counts.elm import (
    ELM,
    RIDGES,
    borders,
    consecutive_folds,
    delay_line,
    reduced,
    ridge_solutions,
)
from dse.models.training import Training
from tests.saved_data import in_a_row


def rngs(repeat=0):
    return partial(lambda purpose, *index: seeds.generator(1, {}, purpose, repeat, *index))


def of(x, target, n_train, step_ms=10.0, n_test=0):
    """Return a data set of spikes (sample, step, channel): first training, then validation, then test."""
    n, n_steps, m = x.shape
    flat = x.reshape(-1, m)
    offsets = np.concatenate([[0], np.cumsum(flat.sum(axis=1, dtype=np.int64))])
    start = np.zeros(n, np.int32)
    return Dataset(
        Spikes(offsets, np.nonzero(flat)[1].astype(np.int32), n_steps, m, step_ms),
        np.asarray(target, np.int64), tuple("abcd"[: max(target) + 1]), start, start, start, n_steps,
        np.arange(n_train), np.arange(n_train, n - n_test), np.arange(n - n_test, n), in_a_row(m),
    )  # fmt: skip


def toy(n=90, n_steps=60, m=6):
    """Return three classes, in each of which another third of the channels fires more."""
    rng = np.random.default_rng(3)
    target = np.arange(n) % 3
    share = np.where(np.arange(m) * 3 // m == target[:, None], 0.4, 0.1)
    return of(rng.random((n, n_steps, m)) < share[:, None], target, n // 2, n_test=n // 6)


def fit(data, model, repeat=0):
    return model.fit(data, Training(), rngs(repeat))


def accuracy(answers, data, samples):
    assert isinstance(answers, Answers)
    return (answers.label == data.target[samples][:, None]).mean(axis=0)


SMALL = ELM(hidden=64, windows=4, window_ms=100.0)


@pytest.mark.parametrize("weights", ["uniform", "gaussian", "lognormal"])
@pytest.mark.parametrize("nonlinearity", ["counter", "tanh"])
def test_it_learns(weights, nonlinearity):
    data = toy()
    found = fit(data, dataclasses.replace(SMALL, weights=weights, nonlinearity=nonlinearity))
    assert accuracy(found.validation, data, data.validation)[-1] >= 0.9
    assert accuracy(found.test, data, data.test)[-1] >= 0.9


def test_windows_end_with_the_sample():
    assert borders(10, 4).tolist() == [0, 2, 6, 10]
    assert borders(8, 4).tolist() == [0, 4, 8]
    assert borders(3, 4).tolist() == [0, 3]


def test_delay_line_by_hand():
    counts = np.arange(1, 7).reshape(1, 3, 2)  # windows (1, 2), (3, 4), (5, 6)
    found = delay_line(counts, np.array([1, 3]), 2)
    assert found.tolist() == [[[1, 2, 0, 0], [5, 6, 3, 4]]]
    assert delay_line(counts, np.array([3]), 4).tolist() == [[[5, 6, 3, 4, 1, 2, 0, 0]]]


def test_answers_see_only_what_has_passed_and_cost_what_they_use():
    data = toy()
    found = fit(data, SMALL)
    assert found.validation.time_ms.tolist() == [100, 200, 300, 400, 500, 600]
    counted = np.array(
        [data.spikes.row_offsets[i * 60 + 60] - data.spikes.row_offsets[i * 60] for i in data.validation]
    )
    assert np.array_equal(found.validation.input_spikes[:, -1], counted)
    # windows x channels x hidden, biases, output weights of 3 classes
    by_hand = [min(k, 4) * 6 * 64 + 64 + 3 * 64 for k in range(1, 7)]
    assert found.validation.n_weights.tolist() == found.validation.macs.tolist() == by_hand
    assert found.validation.additions == pytest.approx(found.validation.input_spikes.mean(axis=0))
    assert found.health["random_weights"] == 4 * 6 * 64 + 64
    # Work per spike: those of the last four windows reach 64 neurons, as do the biases.
    total = found.validation.input_spikes.mean(axis=0)
    in_line = total - np.concatenate([np.zeros(4), total[:2]])
    assert found.validation.event_additions == pytest.approx(64 * (in_line + 1))
    assert found.validation.event_macs.tolist() == [64 * 3] * 6
    # Its program skips counts and hidden values of 0.
    x = delay_line(SMALL._counts(data, data.validation), np.arange(1, 7), 4)
    h = SMALL._hidden(x, *(found.network.arrays[name] for name in ("input_weight", "bias")))
    met, active = (np.count_nonzero(each, axis=2).mean(axis=0) for each in (x, h))
    work = found.validation.program
    assert work["double_row"] == pytest.approx(met + active) and (met[-1] < 24 or active[-1] < 64)
    assert work["double"] == pytest.approx(64 * met + 3 * active)
    assert work["double_input"].tolist() == work["tally_count"].tolist() == [6, 12, 18, 24, 24, 24]
    assert work["tally_add"] == pytest.approx(in_line) and work["tally_spike"] == pytest.approx(total)
    cut = dataclasses.replace(data, n_steps=30)
    early = SMALL.respond(found.network, cut, data.validation)
    assert np.array_equal(early.label, found.validation.label[:, :3])


def test_a_chip_has_no_biases():
    found = fit(toy(), dataclasses.replace(SMALL, weights="lognormal"))
    assert found.validation.event_additions[:4] == pytest.approx(
        64 * found.validation.input_spikes.mean(axis=0)[:4]
    )
    assert found.health["random_weights"] == 4 * 6 * 64
    assert (found.network.arrays["input_weight"] > 0).all()


def test_training_slides_the_delay_line_over_full_windows():
    data = toy()
    assert fit(data, SMALL).health["training_rows"] == 45 * 3  # ends at windows 4, 5, 6
    assert fit(data, dataclasses.replace(SMALL, windows=10)).health["training_rows"] == 45
    assert (
        fit(data, dataclasses.replace(SMALL, window_ms=110.0)).health["training_rows"] == 45 * 2
    )  # 50 + 5 x 110
    assert fit(data, dataclasses.replace(SMALL, window_ms=1e6)).health["training_rows"] == 45


def test_partial_delay_lines_make_early_answers_better():
    data = toy(180)
    full, partial = (fit(data, dataclasses.replace(SMALL, windows=6, partial=x)) for x in (False, True))
    assert (full.health["training_rows"], partial.health["training_rows"]) == (90, 90 * 6)
    early, better = (accuracy(x.validation, data, data.validation)[2] for x in (full, partial))
    assert better > early + 0.1


def test_at_most_fifty_read_outs():
    found = fit(toy(n_steps=130), ELM(hidden=8, window_ms=10.0))
    assert len(found.validation.time_ms) == 50
    assert found.validation.time_ms[-1] == 1300


@pytest.mark.parametrize("weights", ["uniform", "gaussian", "lognormal"])
def test_drive_is_the_expected_input_of_a_hidden_neuron(weights):
    data = toy()
    model = dataclasses.replace(SMALL, hidden=4000, weights=weights, drive=0.3)
    arrays = fit(data, model).network.arrays
    counts = np.stack([
        np.add.reduceat(dense_of(data, i), np.arange(0, 60, 10)) for i in data.train
    ])  # fmt: skip
    x = delay_line(counts, np.array([4, 5, 6]), 4).reshape(-1, 24)
    # z = W f(x) + b; of signed weights W f(x) is centred and independent of the drawn b, uniform in +-0.3.
    z = x @ arrays["input_weight"].T + arrays["bias"]
    drawn = 0.0 if weights == "lognormal" else 0.3**2 / 3
    assert np.sqrt((z**2).mean() - drawn) == pytest.approx(0.3, rel=0.03)


def dense_of(data, i):
    out = np.zeros((data.n_steps, data.spikes.n_channels))
    for t in range(data.n_steps):
        row = i * data.spikes.n_steps + t
        out[t, data.spikes.channel[data.spikes.row_offsets[row] : data.spikes.row_offsets[row + 1]]] = 1
    return out


def in_blocks(h, t, size):
    triangle = np.zeros((0, h.shape[1] + t.shape[1]))
    for k in range(0, len(h), size):
        triangle = reduced(triangle, h[k : k + size], t[k : k + size])
    return triangle


@given(seed=st.integers(0, 1000), n=st.integers(1, 40), hidden=st.integers(1, 12), block=st.integers(1, 40))
def test_solutions_are_those_of_the_normal_equations(seed, n, hidden, block):
    rng = np.random.default_rng(seed)
    h, t = rng.normal(size=(n, hidden)), rng.normal(size=(n, 2))
    betas, values = ridge_solutions(in_blocks(h, t, block), hidden, (0.0, 1e-3, 1.0))
    s = np.linalg.svd(h, compute_uv=False)
    assert values == pytest.approx(s)
    for beta, ridge in zip(betas, (0.0, 1e-3, 1.0), strict=True):
        if ridge == 0.0:
            expected = np.linalg.lstsq(h, t, rcond=None)[0]
        else:
            expected = np.linalg.solve(h.T @ h + ridge * s[0] ** 2 * np.eye(hidden), h.T @ t)
        assert np.allclose(beta, expected, atol=1e-6 * (1 + np.abs(expected).max()))


def test_a_rank_deficient_matrix_has_the_shortest_solution():
    rng = np.random.default_rng(0)
    h = rng.normal(size=(30, 3)) @ rng.normal(size=(3, 8))
    t = rng.normal(size=(30, 2))
    (beta,), values = ridge_solutions(in_blocks(h, t, 7), 8, (0.0,))
    assert len(values) == 3
    assert np.allclose(beta, np.linalg.pinv(h, rcond=1e-12) @ t)


@pytest.mark.parametrize("condition", [1e8, 1e12, 1e16])
def test_an_ill_conditioned_matrix(condition):
    rng = np.random.default_rng(1)
    u, _ = np.linalg.qr(rng.normal(size=(200, 20)))
    v, _ = np.linalg.qr(rng.normal(size=(20, 20)))
    values = np.logspace(0, -np.log10(condition), 20)
    h = u * values @ v.T
    t = u[:, :3]
    betas, found = ridge_solutions(in_blocks(h, t, 64), 20, RIDGES)
    assert np.isfinite(betas).all()
    assert 1 <= found[0] / found[-1] < 1e15
    for beta, ridge in zip(betas, RIDGES, strict=True):
        filtered = u[:, :3] * (values[:3] ** 2 / (values[:3] ** 2 + ridge))
        assert np.allclose(h @ beta, filtered, atol=1e-6)


def test_an_all_zero_matrix_has_the_zero_solution():
    betas, values = ridge_solutions(in_blocks(np.zeros((9, 4)), np.ones((9, 2)), 4), 4, RIDGES)
    assert not betas.any()
    assert values.size == 0


def test_the_largest_ridge_wins_a_tie():
    data = toy()
    model = dataclasses.replace(SMALL, hidden=256)
    ridge = fit(data, model).health["ridge"]
    # Every validation row is right from some ridge on down; the largest of those is taken.
    assert ridge > 0
    assert accuracy(fit(data, model).validation, data, data.validation)[-1] == 1.0


def test_folds_are_consecutive_in_every_class():
    target = np.array([1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 2])
    assert consecutive_folds(target, 5).tolist() == [0, 0, 0, 1, 2, 1, 2, 3, 3, 4, 0]


def test_a_ridge_from_training_depends_on_training_alone():
    data = toy()
    model = dataclasses.replace(SMALL, hidden=256, ridge_from="training")
    found = fit(data, model)
    no_validation = dataclasses.replace(data, validation=data.validation[:1])
    again = fit(no_validation, model)
    for name, array in found.network.arrays.items():
        assert np.array_equal(array, again.network.arrays[name])
    assert accuracy(found.test, data, data.test)[-1] >= 0.9


def test_a_ridge_from_training_is_that_of_the_slow_definition():
    rng = np.random.default_rng(5)
    target = np.arange(60) % 3
    share = np.where(np.arange(6) * 3 // 6 == target[:, None], 0.16, 0.1)  # hard: ridges differ
    data = of(rng.random((60, 60, 6)) < share[:, None], target, 40)
    model = dataclasses.replace(SMALL, windows=3, nonlinearity="tanh", ridge_from="training")
    found = fit(data, model)
    weight, bias = found.network.arrays["input_weight"], found.network.arrays["bias"]
    counts = np.stack([np.add.reduceat(dense_of(data, i), np.arange(0, 60, 10)) for i in data.train])
    h = np.tanh(delay_line(counts, np.array([3, 4, 5, 6]), 3) @ weight.T + bias)
    fold, right = consecutive_folds(target[:40], 5), np.zeros(len(RIDGES), int)
    for k in range(5):
        t = np.repeat(np.eye(3)[target[:40][fold != k]], 4, axis=0)
        u, s, v = np.linalg.svd(h[fold != k].reshape(-1, 64), full_matrices=False)
        for r, ridge in enumerate(RIDGES):
            beta = v.T @ ((s / (s**2 + ridge * s[0] ** 2))[:, None] * (u.T @ t))
            label = (h[fold == k].reshape(-1, 64) @ beta).argmax(axis=1)
            right[r] += (label == np.repeat(target[:40][fold == k], 4)).sum()
    assert len(np.unique(right)) > 3
    assert found.health["ridge"] == RIDGES[len(right) - 1 - right[::-1].argmax()]


@pytest.mark.parametrize("n_train", [1, 2, 4])
def test_a_ridge_from_few_training_samples(n_train):
    data = toy(30)
    few = dataclasses.replace(data, train=data.train[:n_train])
    found = fit(few, dataclasses.replace(SMALL, ridge_from="training"))
    assert np.isfinite(found.network.arrays["output_weight"]).all()
    assert set(np.unique(found.validation.label)) <= set(data.target[few.train])


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("weights", ["uniform", "lognormal"])
@pytest.mark.parametrize("hidden", [1, 2, 300])
def test_any_number_of_hidden_neurons(hidden, weights, precision):
    data = toy(30)
    found = fit(data, dataclasses.replace(SMALL, hidden=hidden, weights=weights, precision=precision))
    assert found.health["hidden_rank"] <= min(hidden, 15 * 3)
    assert found.network.arrays["output_weight"].dtype == precision
    assert np.isfinite(found.network.arrays["output_weight"]).all()
    assert set(np.unique(found.validation.label)) <= {0, 1, 2}


def test_float32_answers_as_float64_does():
    data = toy()
    both = [
        fit(data, dataclasses.replace(SMALL, precision=p)).validation.label[:, -1]
        for p in ("float64", "float32")
    ]
    assert (both[0] == both[1]).mean() > 0.9


@pytest.mark.parametrize("weights", ["uniform", "gaussian", "lognormal"])
def test_samples_without_spikes(weights):
    target = np.array([0, 1, 1, 1, 0, 1])
    data = of(np.zeros((6, 40, 3), bool), target, 4)
    found = fit(data, dataclasses.replace(SMALL, weights=weights))
    assert (found.validation.label == found.validation.label[0, 0]).all()
    assert found.health["hidden_constant"] == 1.0
    if weights != "lognormal":
        assert found.validation.label[0, 0] == 1, "biases alone say which class is frequent"


def test_one_training_sample_and_constant_features():
    x = np.ones((4, 40, 3), bool)
    found = fit(of(x, np.array([2, 0, 1, 2]), 1), SMALL)
    assert (found.validation.label == 2).all()


def test_what_it_refuses():
    data = toy()
    with pytest.raises(ValueError, match="training needs at least one training sample, got none"):
        fit(dataclasses.replace(data, train=data.train[:0]), SMALL)
    with pytest.raises(ValueError, match="window_ms must be >= the step of 10 ms, got 5"):
        fit(data, dataclasses.replace(SMALL, window_ms=5.0))
    with pytest.raises(ValueError, match="samples must have 6 channels as in training, got 3"):
        SMALL.respond(fit(data, SMALL).network, toy(m=3), data.test)
