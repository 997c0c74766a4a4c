"""A multi-layer perceptron of spike counts: rectified linear units, trained by scikit-learn."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dse.base.records import Array
from dse.base.registry import fixed, param, register
from dse.models.counts.integers import rounded
from dse.models.counts.levels import LevelReader
from dse.models.counts.rate_windows import Learnt, as_features
from dse.models.counts.readouts import Readouts, scaling, unscaled
from dse.models.training import Generators, TrainingDiverged


@register("models", "mlp")
@dataclass(frozen=True)
class MLP(LevelReader, Readouts):
    """Multi-layer perceptron of spike counts or levels, each scaled to mean 0 and variance 1 in training.

    Adam in batches of 200, in float32; training ends where the loss has not fallen by 1e-4 for ten epochs.
    Counts that are constant in training are only moved to 0. Where training holds one class, it is answered.
    With precision int8, what was trained is rounded to weights and units of 8 bits, scales included: it is
    these integers that are measured and stored (`dse.models.counts.integers`).

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
    read_outs: int = fixed(
        10, low=1, high=50, doc="largest number of input lengths with a prediction, evenly spaced"
    )
    precision: Literal["float32", "int8"] = param(
        "float32",
        choices=("float32", "int8"),
        doc="numbers of the network that answers; it trains in float32 either way",
    )

    def learn(self, counts: Array, target: Array, lengths: Array, most: int, rngs: Generators) -> Learnt:
        """Train one network per input length.

        Raises:
            TrainingDiverged: weights became infinite or NaN.
        """
        classes = np.unique(target)
        features = as_features(counts)
        mean, scale = scaling(features)
        of_scale = {"mean": mean.astype(np.float32), "scale": scale.astype(np.float32)}
        of_scale["scale"][of_scale["scale"] == 0] = 1
        arrays: dict[str, Array] = {"classes": classes} | (of_scale if self.precision == "float32" else {})
        if len(classes) == 1:
            return Learnt(arrays, {}, {"converged": True, "epochs_trained": 0})
        x = _scaled(features, of_scale)
        converged = True
        for j, length in enumerate(lengths):
            seed, n = int(rngs("mlp", int(length)).integers(2**31)), length * counts.shape[2]
            net = self._trained(x[:, :n], target, seed)
            converged &= net.n_iter_ < self.epochs
            layers = list(zip(net.coefs_, net.intercepts_, strict=True))
            if self.precision == "int8":
                exact = unscaled(layers, *(values[:n].astype(np.float64) for values in of_scale.values()))
                arrays |= rounded(exact, features[:, :n], most).stored(j)
                continue
            for k, (weight, bias) in enumerate(layers):
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

    def inputs(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Iterator[Array]:
        """Yield the counts of each input length; scaled, where the network computes in floating point."""
        if self.precision == "int8":
            yield from super().inputs(arrays, counts, lengths)
            return
        x = _scaled(as_features(counts), arrays)
        for length in lengths:
            yield x[:, : length * counts.shape[2]]


def _scaled(features: Array, arrays: Mapping[str, Array]) -> Array:
    return np.asarray((features.astype(np.float32) - arrays["mean"]) / arrays["scale"])
