"""Resampled answers, and odds of rivals: what is stated against what is true of known designs."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from dse.skyline.front import Draws, front_share
from dse.skyline.pareto import non_dominated
from dse.skyline.posterior import expected, posterior_samples
from dse.skyline.rivals import odds_of
from dse.study import resampling

N_DRAWS = 100
GOALS = [("accuracy", "max"), ("n_weights", "min"), ("latency_ms", "min")]


class Population:
    """Designs with known true accuracies, and a study of them on few recordings and seeds.

    Recordings are harder or easier for all designs; a seed moves all points of a run.
    """

    def __init__(self, number, n_trials=40, n_recordings=300, repeats=3, spread=0.2):
        rng = np.random.default_rng([7, number])
        self.repeats = repeats
        weights, latency = rng.uniform(0, 3, n_trials).round(3), np.array([1.0, 2.0, 3.0])
        skill = 1 + (1 - np.exp(-weights)) + rng.normal(0, spread, n_trials)
        skill = skill[:, None] - 0.6 * (1 - latency / 3) + rng.normal(0, 0.05, (n_trials, 3))
        seeds = rng.normal(0, 0.15, (n_trials, repeats))
        ease = rng.normal(0, 1.5, n_recordings)
        level = skill[:, None, :] + seeds[:, :, None]
        chance = 1 / (1 + np.exp(-(level[:, :, None, :] + ease[:, None])))
        self.right = rng.random((n_trials, repeats, n_recordings, 1)) < chance
        all_ease = np.quantile(rng.normal(0, np.hypot(1.5, 0.15), 20_000), np.linspace(0.005, 0.995, 100))
        self.truth = (1 / (1 + np.exp(-(skill[..., None] + all_ease)))).mean(axis=2).ravel()
        self.rows = pd.DataFrame(
            {
                "trial": np.repeat(np.arange(n_trials), 3),
                "point": np.tile(np.arange(3), n_trials),
                "repeats": repeats,
                "accuracy": self.right.mean(axis=(1, 2)).ravel(),
                "n_weights": np.repeat(weights, 3),
                "latency_ms": np.tile(latency, n_trials),
            }
        )

    def errors(self, n_draws, monkeypatch):
        def right(folder, record, rows):
            answers = self.right[record.trial, record.repeat][:, rows["point"].to_numpy()]
            return np.arange(len(answers)), answers

        def records(folder, trial):
            return [SimpleNamespace(trial=trial, repeat=repeat) for repeat in range(self.repeats)]

        monkeypatch.setattr(resampling, "right_answers", right)
        monkeypatch.setattr(resampling, "load_records", records)
        return resampling.errors("", self.rows, n_draws)


@pytest.fixture(scope="module")
def populations():
    with pytest.MonkeyPatch.context() as patch:
        return [(p := Population(number), p.errors(N_DRAWS, patch)) for number in range(30)]


def test_stated_probabilities_of_the_front_are_true_as_often(populations):
    """Of the points said to be on the front with about 90 %, 85 to 95 % are; 50 % means 40 to 60 %."""
    stated, true = [], []
    for population, errors in populations:
        rows = population.rows
        costs = rows[["n_weights", "latency_ms"]].to_numpy()
        trial = rows["trial"].to_numpy()

        def of(rows, errors=errors, costs=costs, trial=trial):
            here = rows.index.to_numpy()
            samples = posterior_samples(
                rows["accuracy"].to_numpy(),
                costs[here],
                trial[here],
                errors[:, here],
                np.random.default_rng(0),
            )
            return {"accuracy": samples}

        stated.append(front_share(rows, GOALS, Draws(["accuracy"], of)))
        true.append(non_dominated(np.column_stack([-population.truth, costs])))
    share, on_front = np.concatenate(stated), np.concatenate(true)

    def truth_of(low, high):
        return on_front[(share >= low) & (share < high)].mean()

    assert 0.85 <= truth_of(0.85, 0.95) <= 0.95
    assert 0.4 <= truth_of(0.4, 0.6) <= 0.6
    assert truth_of(0.97, 1.1) > 0.95
    assert truth_of(0.0, 0.03) < 0.05


def test_the_corrected_accuracy_of_the_best_is_the_true_one_on_average(populations):
    gained, corrected_by = [], []
    for population, _ in populations:
        measured = population.rows["accuracy"].to_numpy()
        n = np.full(len(measured), population.right[0, ..., 0].size)  # answers of a trial
        best = measured.argmax()
        gained.append(measured[best] - population.truth[best])
        corrected_by.append(measured[best] - expected(measured, n, np.ones(len(measured)))[best])
    assert np.mean(corrected_by) == pytest.approx(
        np.mean(gained), abs=2.5 * np.std(gained) / np.sqrt(len(gained))
    )
    assert np.mean(corrected_by) > 0.01


def test_resamples_spread_as_measurements_do(populations):
    """Errors of resamples and true errors have the same size: recordings and seeds are both in them."""
    resampled = [errors.std(axis=0).mean() for _, errors in populations]
    true = [p.rows["accuracy"].to_numpy() - p.truth for p, _ in populations]
    assert np.mean(resampled) == pytest.approx(np.sqrt(np.mean(np.square(true))), rel=0.15)


def test_resamples_do_not_depend_on_the_rows_beside(populations, monkeypatch):
    population, _ = populations[0]
    errors = population.errors(20, monkeypatch)
    rows = population.rows
    population.rows = rows.iloc[::-1]
    np.testing.assert_allclose(population.errors(20, monkeypatch), errors[:, ::-1], rtol=1e-5, atol=1e-7)
    population.rows = rows


def test_matrix_products_of_samples_have_one_thread(monkeypatch):
    """Whatever the machine: how many share a product changes its last bits, and so who is on a front."""
    rows, threads = Population(0, n_trials=8).rows, []

    def errors(folder, rows, n_draws):
        threads.extend(each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas")
        return np.zeros((n_draws, len(rows)))

    for name, stand_in in (("errors", errors), ("_largest_se", lambda folder, rows: np.zeros(len(rows)))):
        monkeypatch.setattr(resampling, name, stand_in)
    monkeypatch.setattr(resampling.pricing, "check_studies", lambda paths, what: None)
    with threadpool_limits(2, user_api="blas"):
        resampling.draws([""], [rows], (), [("accuracy", "max")], 9).of(rows)
    assert set(threads) == {1}


def test_an_accuracy_of_one_is_uncertain():
    record = SimpleNamespace(trial=0, repeat=0)
    errors = resampling._resampled(record, np.arange(50), np.ones((50, 1), dtype=bool), 200)
    assert 0.005 < errors.std() < 0.04
    assert abs(errors.mean()) < 1e-9


def stated_and_true(number, population, errors):
    """Yield stated probabilities and what is true, of a few ways to call a part of the designs spiking."""
    rows, rng = population.rows, np.random.default_rng([8, number])
    weights, trial = rows["n_weights"].to_numpy(), rows["trial"].to_numpy()
    costs = rows[["n_weights", "latency_ms"]].to_numpy()
    accuracy = posterior_samples(rows["accuracy"].to_numpy(), costs, trial, errors, rng)
    for n_spiking in (8, 20, 32):
        is_spiking = np.isin(trial, rng.permutation(40)[:n_spiking])
        # Of what a chip takes, one number is uncertain for each side; the truth is one more sample of both.
        factors = rng.lognormal(rng.normal(0, 0.3), 0.3, (N_DRAWS + 1, 2))
        cost = np.where(is_spiking, factors[:, :1], factors[:, 1:]) * np.exp(weights)
        best = accuracy[:, accuracy.mean(axis=0).argmax()]
        found = [
            odds_of("accuracy", *(z[:, of] for z in (x, y) for of in (is_spiking, ~is_spiking)), best.std())
            for x, y in ((accuracy, cost[1:]), (population.truth[None], cost[:1]))
        ]
        for name in ("cheaper", "more_accurate"):
            yield tuple(getattr(odds, name) for odds in found)
        sides = (np.flatnonzero(is_spiking), np.flatnonzero(~is_spiking))
        ours, theirs = (population.truth[x[accuracy[:, x].mean(axis=0).argmax()]] for x in sides)
        yield found[0].best, 0.5 * (ours == theirs) + float(ours > theirs)


@pytest.fixture(scope="module")
def statements(populations):
    found = (stated_and_true(number, *one) for number, one in enumerate(populations))
    return np.array([pair for pairs in found for pair in pairs])


def test_stated_probabilities_of_rivals_are_true_as_often(statements):
    stated, true = statements.T
    for low, high in ((0.0, 0.1), (0.1, 0.35), (0.35, 0.65), (0.65, 0.9), (0.9, 1.01)):
        here = (stated >= low) & (stated < high)
        assert here.sum() >= 15
        error = np.sqrt(0.25 / here.sum())  # of a share, at most; statements of a population are alike
        assert true[here].mean() == pytest.approx(stated[here].mean(), abs=0.04 + 1.5 * error), (low, high)


def test_statements_of_rivals_tell_more_than_the_share_of_all(statements):
    stated, true = statements.T
    assert np.mean((stated - true) ** 2) < 0.7 * true.var()
