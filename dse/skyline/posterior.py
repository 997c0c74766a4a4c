"""What is probably true of accuracies that were measured with errors on few recordings and seeds."""

from __future__ import annotations

import numpy as np

from dse.base.records import Floats, Ints

_LEVELS = (np.arange(1000) + 0.5) / 1000
_STEPS = 20


def expected(accuracy: Floats, n: Floats, number: Floats) -> Floats:
    """Return the posterior mean of the true accuracy of each measured one, (row,).

    How true accuracies are spread over the points of a task is not assumed but learnt from the measured ones:
    the distribution of most likelihood, by expectation maximisation from an even one. It is stopped after 20
    steps, since the distribution of most likelihood itself would be a few spikes. The mean given what was
    measured is right for any point, however it was chosen, as far as the distribution is right.

    Source: Efron, J. Am. Stat. Assoc. 106, 2011 (selection bias and empirical Bayes); Laird and Louis,
    J. Comput. Graph. Stat. 1, 1991 (a smooth prior by few steps).

    Args:
        accuracy: (row,) measured, fractions.
        n: (row,) of how many recordings.
        number: (row,) how many points measured the same; points without errors in common would need no more.
    """
    right = n * accuracy
    log = right[:, None] * np.log(_LEVELS) + (n - right)[:, None] * np.log1p(-_LEVELS)
    likelihood = np.exp(log - log.max(axis=1, keepdims=True))
    prior = np.full(len(_LEVELS), 1 / len(_LEVELS))
    for _ in range(_STEPS):
        posterior = likelihood * prior
        posterior *= (number / posterior.sum(axis=1))[:, None]
        prior = posterior.sum(axis=0) / number.sum()
    posterior = likelihood * prior
    return np.asarray((posterior * _LEVELS).sum(axis=1) / posterior.sum(axis=1))


def posterior_samples(
    accuracy: Floats, costs: Floats, trial: Ints, errors: Floats, rng: np.random.Generator
) -> Floats:
    """Return samples of the true accuracies of design points given the measured ones, (draw, row).

    Resamples alone would repeat the luck of points that look good by chance. Here the true mean accuracy of a
    trial is, before anything is measured, normal around a trend in the ranks of the other goals, and the
    measured one differs from it by errors like those of the resamples. The variance around the trend is that
    of the measured means, errors included: it shrinks luck at most by half, and does not collapse where
    errors are as large as the differences. Samples are drawn by Matheron's rule; differences within a trial,
    which were measured on the same networks, are left as resampled.

    Source: Efron and Morris, J. Am. Stat. Assoc. 70, 1975 (shrinkage); Journel and Huijbregts, Mining
    Geostatistics, 1978 (conditioning by kriging).

    Args:
        accuracy: (row,) measured.
        costs: (row, goal) the other goals, as measured.
        trial: (row,) which rows share networks.
        errors: (draw, row) resampled accuracies less the measured ones.
        rng: of the prior's samples.
    """
    trial = np.unique(trial, return_inverse=True)[1]
    number = np.bincount(trial)
    n_draws, n_trials = len(errors), len(number)

    def of_trials(rows: Floats) -> Floats:
        return np.stack([np.bincount(trial, row, n_trials) / number for row in rows])

    ranks = np.argsort(np.argsort(costs, axis=0, kind="stable"), axis=0) / max(len(costs) - 1, 1) - 0.5
    terms = of_trials(np.column_stack([np.ones(len(accuracy)), ranks, ranks**2]).T).T
    measured, noise = of_trials(accuracy[None])[0], of_trials(errors)
    trend = terms @ np.linalg.lstsq(terms, measured, rcond=None)[0]
    free = n_trials - terms.shape[1]
    if free < 1:  # too few trials for a trend
        return accuracy - errors
    residual = measured - trend
    spread = float(residual @ residual) / free
    # Errors of all trials have the same part in common, since recordings are hard for all of them.
    variance = (noise**2).mean(axis=0)
    shared = (noise.sum(axis=1) ** 2).mean() - variance.sum()
    covariance = np.full((n_trials, n_trials), max(shared, 0.0) / (n_trials * (n_trials - 1)))
    np.fill_diagonal(covariance, variance)
    gain = np.linalg.lstsq(spread * np.eye(n_trials) + covariance, spread * np.eye(n_trials), rcond=None)[0]
    prior = rng.normal(0.0, np.sqrt(spread), (n_draws, n_trials))
    of_trial = trend + prior + (residual - prior - noise) @ gain
    return np.asarray(accuracy - errors + (of_trial - measured + noise)[:, trial])
