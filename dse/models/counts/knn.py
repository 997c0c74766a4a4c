"""The k nearest training samples vote; distances of counts are whole numbers, so that ties are ties."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dse.base.records import Array
from dse.base.registry import param, register
from dse.models.counts.rate_windows import Learnt, RateClassifier, as_features
from dse.models.training import Generators

_BATCH = 256


@register("models", "knn")
@dataclass(frozen=True)
class KNN(RateClassifier):
    """k nearest neighbours of spike counts by Euclidean distance; counts are not scaled.

    Cost: the training set is stored, W_t = training samples x features, each one multiply-accumulate.
    Source: [Brayshaw et al., temporal and spatio-temporal domains in REFERENCES.md]; it prints neither k nor
    weights, the defaults are scikit-learn's.
    """

    k: int = param(5, low=1, doc="number of neighbours that vote (all training samples if there are fewer)")
    weights: Literal["uniform", "distance"] = param(
        "uniform",
        doc="uniform: every vote counts 1; distance: it counts 1 / distance, and only neighbours "
        "at distance 0 count if there are any",
    )

    def learn(self, counts: Array, target: Array, lengths: Array, most: int, rngs: Generators) -> Learnt:
        """Store the training samples."""
        return Learnt({"counts": counts, "target": target})

    def label(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Array:
        """Return the neighbours' vote, (n, k) int64; distances grow with the input, window by window."""
        stored, target = arrays["counts"], arrays["target"]
        label = np.empty((len(counts), len(lengths)), np.int64)
        for first in range(0, len(counts), _BATCH):
            part = slice(first, first + _BATCH)
            squared = np.zeros((len(counts[part]), len(stored)))
            for j, (begin, end) in enumerate(zip([0, *lengths[:-1]], lengths, strict=True)):
                squared += squared_distances(counts[part, begin:end], stored[:, begin:end])
                label[part, j] = vote(squared, target, self.k, self.weights)
        return label

    def n_weights(self, arrays: Mapping[str, Array], n_features: Array) -> Array:
        """Return training samples x features."""
        return len(arrays["counts"]) * n_features

    def program(
        self, arrays: Mapping[str, Array], counts: Array, lengths: Array
    ) -> Mapping[str, Array | list[float]]:
        """Return the numbers that are compared, and the samples; votes by distance have no C."""
        if self.weights == "distance":
            return {}
        n = len(arrays["counts"])
        return {"neighbour": n * lengths * counts.shape[2], "sample": [n] * len(lengths)}

    def stored_bits(self, arrays: Mapping[str, Array]) -> int:
        """Return 8, or 16 if a count needs them."""
        return 8 if arrays["counts"].max(initial=0) < 2**8 else 16


def squared_distances(a: Array, b: Array) -> Array:
    """Return squared Euclidean distances of whole numbers, (n, m) float64, exact below 2**53.

    Args:
        a: (n, window, channel) counts.
        b: (m, window, channel) counts.
    """
    x, y = (as_features(z).astype(np.float64) for z in (a, b))
    return np.asarray((x * x).sum(axis=1)[:, None] + (y * y).sum(axis=1) - 2 * (x @ y.T))


def vote(squared: Array, target: Array, k: int, weights: str) -> Array:
    """Return the class with most votes among the k nearest, (n,) int64; the lowest class on ties.

    Of equally distant samples the first is nearer.

    Args:
        squared: (n, m) squared distances, whole numbers.
        target: (m,) classes of the samples that vote.
        k: how many vote; all, where k > m.
        weights: 'uniform' or 'distance'.
    """
    k, m = min(k, len(target)), len(target)
    # One whole number holds distance and place: its order is that of both, and no two are alike.
    key = squared.astype(np.int64) * m + np.arange(m)
    key = np.sort(np.partition(key, k - 1, axis=1)[:, :k], axis=1)
    distance, votes = np.sqrt(key // m), target[key % m]
    if weights == "distance":
        with np.errstate(divide="ignore"):
            weight = 1 / distance
        at_zero = np.isinf(weight)
        weight = np.where(at_zero.any(axis=1, keepdims=True), at_zero, weight)
    else:
        weight = np.ones_like(distance)
    classes = np.unique(target)
    share = np.stack([np.where(votes == c, weight, 0.0).sum(axis=1) for c in classes], axis=1)
    return np.asarray(classes[share.argmax(axis=1)])
