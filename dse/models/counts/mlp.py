"""A multi-layer perceptron of spike counts: rectified linear units, trained by scikit-learn."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.measure.heads import head_scores
from dse.models.counts.rate_windows import Learnt, RateClassifier, as_features
from dse.models.training import Generators, TrainingDiverged
from dse.records import Array, Dataset, Floats, Network, Parameters
from dse.registry import param, register


@register("models", "mlp")
@dataclass(frozen=True)
class MLP(RateClassifier):
    """Multi-layer perceptron of spike counts, each feature scaled to mean 0 and variance 1 in training.

    Adam in batches of 200, in float32; training ends where the loss has not fallen by 1e-4 for ten epochs.
    Counts that are constant in training are only moved to 0. Where training holds one class, it is answered.

    Cost: W_t = the matrices, each weight one multiply-accumulate; biases and scales are not counted.
    Health: converged, whether every input length ended before `epochs`; epochs_trained of the whole window.
    Source: [Brayshaw et al., temporal and spatio-temporal domains in REFERENCES.md]; it prints no settings,
    the defaults are scikit-learn's.
    """

    hidden: tuple[int, ...] = param((100,), low=1, doc="neurons of each hidden layer")
    alpha: float = param(1e-4, low=0, doc="L2 penalty")
    learning_rate: float = param(1e-3, low=0, low_open=True, doc="step size of Adam")
    epochs: int = param(200, low=1, doc="largest number of passes over the training samples")
    # Each input length is a training of its own: fifty of them take minutes where features are many.
    read_outs: int = param(
        10, low=1, high=50, doc="largest number of input lengths with a prediction, evenly spaced", axis=False
    )

    def learn(self, counts: Array, target: Array, lengths: Array, rngs: Generators) -> Learnt:
        """Train one network per input length.

        Raises:
            TrainingDiverged: weights became infinite or NaN.
        """
        from threadpoolctl import threadpool_limits

        classes = np.unique(target)
        features = as_features(counts)
        mean, scale = (each.astype(np.float32) for each in (features.mean(axis=0), features.std(axis=0)))
        scale[scale == 0] = 1
        arrays: dict[str, Array] = {"classes": classes, "mean": mean, "scale": scale}
        if len(classes) == 1:
            return Learnt(arrays, {}, {"converged": True, "epochs_trained": 0})
        x = _scaled(features, arrays)
        converged = True
        with threadpool_limits(1):  # sums do not depend on how many threads share them
            for j, length in enumerate(lengths):
                seed = int(rngs("mlp", int(length)).integers(2**31))
                net = self._trained(x[:, : length * counts.shape[2]], target, seed)
                converged &= net.n_iter_ < self.epochs
                for k, (weight, bias) in enumerate(zip(net.coefs_, net.intercepts_, strict=True)):
                    arrays |= {f"{j}/{k}/weight": weight, f"{j}/{k}/bias": bias}
        health = {"converged": bool(converged), "epochs_trained": int(net.n_iter_)}
        return Learnt(arrays, {"loss": np.array(net.loss_curve_, np.float64)}, health)

    def _trained(self, x: Array, target: Array, seed: int) -> Any:
        """Return a trained network of scikit-learn; it warns of nothing."""
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.neural_network import MLPClassifier

        net = MLPClassifier(
            self.hidden,
            alpha=self.alpha,
            learning_rate_init=self.learning_rate,
            max_iter=self.epochs,
            random_state=seed,
        )
        with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            warnings.simplefilter("ignore", ConvergenceWarning)
            try:
                return net.fit(x, target)
            except ValueError as error:
                if "non-finite" not in str(error):
                    raise
                raise TrainingDiverged(
                    f"the weights became infinite or NaN with learning rate {self.learning_rate:g}"
                ) from error

    def label(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Array:
        """Return the class of the largest output, (n, k) int64; the lowest on ties."""
        from threadpoolctl import threadpool_limits

        if len(arrays["classes"]) == 1:
            return np.full((len(counts), len(lengths)), arrays["classes"][0], np.int64)
        x = _scaled(as_features(counts), arrays)
        label = np.empty((len(counts), len(lengths)), np.int64)
        with threadpool_limits(1):
            for j, length in enumerate(lengths):
                output = _of_classes(x[:, : length * counts.shape[2]], arrays, j)
                label[:, j] = arrays["classes"][output.argmax(axis=1)]
        return label

    def scores(self, fitted: Network | Parameters, dataset: Dataset, samples: Array) -> Floats:
        """Return the outputs before softmax; those of heads are summed over the joint classes."""
        from threadpoolctl import threadpool_limits

        assert isinstance(fitted, Parameters)
        arrays, counts = fitted.arrays, self._counts(dataset, samples)
        scores = np.full((len(counts), len(dataset.classes)), -np.inf)
        scores[:, arrays["classes"]] = 0
        if len(arrays["classes"]) > 1:
            last = len(arrays["lengths"]) - 1
            with threadpool_limits(1):
                scores[:, arrays["classes"]] = _of_classes(_scaled(as_features(counts), arrays), arrays, last)
        return head_scores(dataset, scores)

    def n_weights(self, arrays: Mapping[str, Array], n_features: Array) -> Array:
        """Return the weights of the matrices."""
        return np.array(
            [sum(weight.size for weight, _ in _layers(arrays, j)) for j in range(len(n_features))], np.int64
        )

    def program(
        self, arrays: Mapping[str, Array], counts: Array, lengths: Array
    ) -> Mapping[str, Array | list[float]]:
        """Return the scaled features, inputs of units other than 0, their weights, and the units."""
        from threadpoolctl import threadpool_limits

        scaled, work = _scaled(as_features(counts), arrays), np.zeros((4, len(lengths)))
        with threadpool_limits(1):
            for j, length in enumerate(lengths):
                x = scaled[:, : length * counts.shape[2]]
                for k, (weight, bias) in enumerate(_layers(arrays, j)):
                    inputs = np.count_nonzero(x) / max(1, len(x))
                    work[:, j] += len(weight) if k == 0 else 0, inputs, inputs * len(bias), len(bias)
                    x = np.maximum(x @ weight + bias, 0)
        return dict(zip(("scale", "single_row", "single", "single_unit"), work, strict=True))

    def stored_bits(self, arrays: Mapping[str, Array]) -> int:
        """Return 32: weights are floats."""
        return 32


def forward(x: Array, layers: list[tuple[Array, Array]]) -> Array:
    """Return the outputs before softmax, (n, output); hidden units are max(0, .).

    Args:
        x: (n, feature).
        layers: weight (input, unit) and bias (unit,) of each layer.
    """
    for k, (weight, bias) in enumerate(layers):
        x = x @ weight + bias
        if k < len(layers) - 1:
            x = np.maximum(x, 0)
    return x


def _of_classes(x: Array, arrays: Mapping[str, Array], j: int) -> Array:
    """Return the outputs for the classes of training, (n, class), after input length j."""
    output = forward(x, _layers(arrays, j))
    # Of two classes, one output > 0 says the second.
    return output if output.shape[1] > 1 else np.concatenate([np.zeros_like(output), output], axis=1)


def _scaled(features: Array, arrays: Mapping[str, Array]) -> Array:
    return np.asarray((features.astype(np.float32) - arrays["mean"]) / arrays["scale"])


def _layers(arrays: Mapping[str, Array], j: int) -> list[tuple[Array, Array]]:
    """Return weight and bias of each layer for input length j; none where training held one class."""
    depth = sum(name.startswith(f"{j}/") and name.endswith("/weight") for name in arrays)
    return [(arrays[f"{j}/{k}/weight"], arrays[f"{j}/{k}/bias"]) for k in range(depth)]
