"""Gaussian naive Bayes: every feature of a class is normal, and independent of the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.base.registry import param, register
from dse.models.counts.rate_windows import Learnt, RateClassifier, as_features
from dse.models.training import Generators

_BATCH = 256


@register("models", "naive_bayes")
@dataclass(frozen=True)
class NaiveBayes(RateClassifier):
    """Gaussian naive Bayes of spike counts; counts are not scaled, which does not change its predictions.

        log p(c | x) = log p(c) - 1/2 sum_f [log(2 pi v[c, f]) + (x[f] - mean[c, f])**2 / v[c, f]] + const
        v[c, f] = variance[c, f] + var_smoothing x the largest variance of a feature over all samples

    Where no feature varies in training, the most frequent class is answered.

    Cost: W_t = 2 x features x classes in training; each is one multiply-accumulate, as a x**2 + b x + c takes
    two per feature and class. The constants of the classes are not counted, as biases are not.
    Source: [Brayshaw et al., temporal and spatio-temporal domains in REFERENCES.md]; smoothing and its
    default are scikit-learn's.
    """

    var_smoothing: float = param(
        1e-9, low=0, low_open=True, doc="fraction of the largest variance that is added to every variance"
    )

    def learn(self, counts: Array, target: Array, lengths: Array, most: int, rngs: Generators) -> Learnt:
        """Estimate means and variances; only the smoothing depends on the input length."""
        features = as_features(counts)
        classes, n_of = np.unique(target, return_counts=True)
        largest = np.maximum.accumulate(features.var(axis=0))[lengths * counts.shape[2] - 1]
        return Learnt(
            {
                "classes": classes,
                "log_prior": np.log(n_of / n_of.sum()),
                "mean": np.stack([features[target == c].mean(axis=0) for c in classes]),
                "variance": np.stack([features[target == c].var(axis=0) for c in classes]),
                "smoothing": self.var_smoothing * largest,
            }
        )

    def label(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Array:
        """Return the most likely class, (n, k) int64; the lowest on ties."""
        label = np.empty((len(counts), len(lengths)), np.int64)
        features = as_features(counts)
        for first in range(0, len(counts), _BATCH):
            x = features[first : first + _BATCH]
            for j, n_features in enumerate(lengths * counts.shape[2]):
                seen = slice(0, n_features)
                likely = log_likelihood(
                    x[:, seen], arrays["mean"][:, seen], arrays["variance"][:, seen] + arrays["smoothing"][j]
                )
                best = (arrays["log_prior"] + likely).argmax(axis=1)
                label[first : first + _BATCH, j] = arrays["classes"][best]
        return label

    def n_weights(self, arrays: Mapping[str, Array], n_features: Array) -> Array:
        """Return 2 x features x classes."""
        return 2 * len(arrays["classes"]) * n_features

    def program(
        self, arrays: Mapping[str, Array], counts: Array, lengths: Array
    ) -> Mapping[str, Array | list[float]]:
        """Return the features of all classes, those not 0, those that differ from their mean."""
        ends = lengths * counts.shape[2]
        x, n = as_features(counts), len(arrays["classes"])
        differ = sum((x != mean).sum(axis=0).cumsum() for mean in arrays["mean"]) / max(1, len(x))
        not_0 = n * (x != 0).sum(axis=0).cumsum() / max(1, len(x))
        return {
            "feature": n * ends,
            "difference": not_0[ends - 1],
            "deviation": differ[ends - 1],
        }

    def stored_bits(self, arrays: Mapping[str, Array]) -> int:
        """Return 64: means and variances are doubles."""
        return 64


def log_likelihood(x: Array, mean: Array, variance: Array) -> Array:
    """Return log p(x | class) of independent normal features, (n, class); 0 where a variance is 0.

    Args:
        x: (n, feature).
        mean: (class, feature).
        variance: (class, feature), either all > 0 or, where no feature says anything, all 0.
    """
    if not variance.all():
        return np.zeros((len(x), len(mean)))
    scores = np.empty((len(x), len(mean)))
    for c, (m, v) in enumerate(zip(mean, variance, strict=True)):
        scores[:, c] = -0.5 * np.log(2 * np.pi * v).sum() - 0.5 * ((x - m) ** 2 / v).sum(axis=1)
    return scores
