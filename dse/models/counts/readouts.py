"""Classifiers of counts with a score per class: layers of weights after each input length.

Layers are in floating point, weight (input, unit) and bias (unit,) of each, or in integers
(`dse.models.counts.integers`); a stored scale `j/scale` says which. Hidden units are max(0, .).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from dse.base.native.threads import single_threaded
from dse.base.records import Array, Dataset, Floats, Network, Parameters
from dse.measure.heads import head_scores
from dse.models.counts.integers import IntegerLayers
from dse.models.counts.rate_windows import Windowed, as_features


class Readouts(Windowed):
    """A classifier whose answer is the class of the largest output, the lowest on ties."""

    def inputs(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Iterator[Array]:
        """Yield what the layers of each input length see, (n, input)."""
        features = as_features(counts)
        for length in lengths:
            yield features[:, : length * counts.shape[2]]

    def label(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Array:
        """Return the class of the largest output, (n, k) int64; the lowest on ties."""
        label = np.full((len(counts), len(lengths)), arrays["classes"][0], np.int64)
        for j, x in enumerate(self._inputs(arrays, counts, lengths)):
            label[:, j] = arrays["classes"][_of_classes(outputs(x, arrays, j)).argmax(axis=1)]
        return label

    def scores(
        self, fitted: Network | Parameters, dataset: Dataset, samples: Array, read_out: int = -1
    ) -> Floats:
        """Return the outputs before softmax; those of heads are summed over the joint classes.

        Args:
            fitted: the layers.
            dataset: spikes and windows.
            samples: which of its samples.
            read_out: number of the input length that they answer after; -1: the whole window.
        """
        assert isinstance(fitted, Parameters)
        arrays = fitted.arrays
        scores = np.full((len(samples), len(dataset.classes)), -np.inf)
        scores[:, arrays["classes"]] = 0
        counts, j = self.counts(dataset, samples, arrays), read_out % len(arrays["lengths"])
        with single_threaded():
            for x in self._inputs(arrays, counts, arrays["lengths"][j : j + 1]):
                found = _of_classes(outputs(x, arrays, j))
                scores[:, arrays["classes"]] = found / arrays.get(f"{j}/scale", 1)
        return head_scores(dataset, scores)

    def n_weights(self, arrays: Mapping[str, Array], n_features: Array) -> Array:
        """Return the weights of the matrices."""
        return np.array(
            [sum(weight.size for weight, _ in layers_of(arrays, j)) for j in range(len(n_features))], np.int64
        )

    def program(
        self, arrays: Mapping[str, Array], counts: Array, lengths: Array
    ) -> Mapping[str, Array | list[float]]:
        """Return the work of `worked`."""
        return self.worked(arrays, self._inputs(arrays, counts, lengths))

    def worked(
        self, arrays: Mapping[str, Array], inputs: Iterable[Array]
    ) -> Mapping[str, Array | list[float]]:
        """Return the inputs, those of units that are not 0, their weights, and the units.

        Args:
            arrays: what is learnt.
            inputs: what the layers of each input length see, as of `inputs`.
        """
        n = len(arrays["lengths"])
        work, kinds = np.zeros((4, n)), ("scale", "single_row", "single", "single_unit")
        for j, x in enumerate(inputs):
            work[0, j] = x.shape[1]
            for given, (_, bias) in zip(passed(x, arrays, j), layers_of(arrays, j), strict=False):
                not_0 = np.count_nonzero(given) / max(1, len(given))
                work[1:, j] += not_0, not_0 * len(bias), len(bias)
        if "0/scale" in arrays:
            kinds = ("integer_input", "integer_row", "integer", "integer_unit")
            return dict(zip(kinds, work, strict=True)) | {"tally_count": np.zeros(n)}
        return dict(zip(kinds, work, strict=True))

    def stored_bits(self, arrays: Mapping[str, Array]) -> int:
        """Return the bits of a weight."""
        return 8 if "0/scale" in arrays else 32

    def check_fitted(self, fitted: Parameters, n_outputs: int) -> None:
        """Check layers of integers that are read from a file (`dse.config.contracts.Family`).

        Raises:
            ValueError: numbers are none of 8 and 32 bits, or layers do not fit each other.
        """
        arrays = fitted.arrays
        for j in range(len(arrays["lengths"]) if "0/scale" in arrays else 0):
            layers = IntegerLayers.of(arrays, j)
            for weight, bias in zip(layers.weights, layers.biases, strict=True):
                if weight.dtype != np.int8 or bias.dtype != np.int32 or weight.shape[1:] != bias.shape:
                    raise ValueError(
                        f"readout {j} must have weights (input, unit) int8, biases (unit,) int32"
                    )
            if any(len(w) != len(b) for w, b in zip(layers.weights[1:], layers.biases, strict=False)):
                raise ValueError(f"the layers of readout {j} must fit each other")

    def _inputs(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Iterator[Array]:
        """Yield what layers see; where training held one class, there are none."""
        return self.inputs(arrays, counts, lengths) if len(arrays["classes"]) > 1 else iter(())


def forward(x: Array, layers: list[tuple[Array, Array]]) -> list[Array]:
    """Return the inputs of every layer in floating point, and last the outputs, each (n, unit).

    Args:
        x: (n, feature).
        layers: weight (input, unit) and bias (unit,) of each layer.
    """
    found = [x]
    for k, (weight, bias) in enumerate(layers):
        y = found[-1] @ weight + bias
        found.append(np.maximum(y, 0) if k < len(layers) - 1 else y)
    return found


def passed(x: Array, arrays: Mapping[str, Array], j: int) -> list[Any]:
    """Return the inputs of every layer after input length j, and last the outputs, each (n, unit)."""
    if f"{j}/scale" in arrays:
        return list(IntegerLayers.of(arrays, j).inputs(x))
    return forward(x, layers_of(arrays, j))


def outputs(x: Array, arrays: Mapping[str, Array], j: int) -> Array:
    """Return the outputs of the layers after input length j, (n, output)."""
    return np.asarray(passed(x, arrays, j)[-1])


def layers_of(arrays: Mapping[str, Array], j: int) -> list[tuple[Array, Array]]:
    """Return weight and bias of each layer for input length j; none where training held one class."""
    depth = sum(name.startswith(f"{j}/") and name.endswith("/weight") for name in arrays)
    return [(arrays[f"{j}/{k}/weight"], arrays[f"{j}/{k}/bias"]) for k in range(depth)]


def scaling(features: Array) -> tuple[Floats, Floats]:
    """Return mean and standard deviation of each feature, (feature,); 1 for one that is constant.

    Args:
        features: (n, feature).
    """
    mean, scale = features.mean(axis=0), features.std(axis=0)
    scale[scale == 0] = 1
    return mean, scale


def unscaled(layers: list[tuple[Array, Array]], mean: Floats, scale: Floats) -> list[tuple[Floats, Floats]]:
    """Return layers of scaled features as layers of the features themselves, in double."""
    (weight, bias), *others = ((w.astype(np.float64), b.astype(np.float64)) for w, b in layers)
    weight = weight / scale[:, None]
    return [(weight, bias - mean @ weight), *others]


def _of_classes(output: Array) -> Array:
    """Return the outputs for the classes of training, (n, class); one output > 0 says the second of two."""
    return output if output.shape[1] > 1 else np.concatenate([np.zeros_like(output), output], axis=1)
