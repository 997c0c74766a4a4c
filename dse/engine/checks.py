"""What is checked of a network that is read from disk, before a kernel sees its arrays.

Kernels trust shapes and numbers: arrays that disagree would have them read beyond their ends.
"""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dse.base.records import Arithmetic, Array, Layer, Network
from dse.engine.delays import MOST
from dse.engine.neurons import neuron_of

_MOST_STEPS_PER_SAMPLE, _MOST_DELAY = 1024, 2**20


def check_network(network: Network, n_outputs: int) -> None:
    """Check the shapes, ranges and numbers of a network.

    Raises:
        ValueError: what disagrees.
    """
    if network.arithmetic not in typing.get_args(Arithmetic):
        known = ", ".join(typing.get_args(Arithmetic))
        raise ValueError(f"arithmetic must be one of {known}, got {network.arithmetic!r}")
    _check_whole("n_channels", network.n_channels, 1, 2**31)
    _check_whole("steps_per_sample", network.steps_per_sample, 1, _MOST_STEPS_PER_SAMPLE)
    if not network.delays:
        raise ValueError("delays must hold at least one delay, got none")
    for delay in network.delays:
        _check_whole("delays", delay, 0, _MOST_DELAY)
    if not network.layers:
        raise ValueError("layers must hold at least the outputs, got none")
    n_inputs = network.n_channels * len(network.delays)
    for k, layer in enumerate(network.layers):
        n_inputs = _check_layer(layer, k, n_inputs, network.arithmetic)
    if n_inputs != n_outputs:
        raise ValueError(f"the last layer must have {n_outputs} neurons, one per class, got {n_inputs}")


def _check_layer(layer: Layer, k: int, n_inputs: int, arithmetic: Arithmetic) -> int:
    """Check layer k; return its number of neurons."""
    if layer.weight.ndim != 2 or layer.weight.shape[0] < 1 or layer.weight.shape[1] != n_inputs:
        raise ValueError(
            f"array '{k}/weight' must have shape (neurons, {n_inputs}), got {layer.weight.shape}"
        )
    n = len(layer.weight)
    matrices: Sequence[tuple[str, Array | None, tuple[int, int], str]] = (
        ("weight", layer.weight, (n, n_inputs), "f"),
        ("recurrent", layer.recurrent, (n, n), "f"),
        ("shared", layer.shared, (n, n_inputs), "i"),
        ("delay", layer.delay, (n, n_inputs), "i"),
    )
    for name, matrix, shape, kind in matrices:
        if matrix is None:
            continue
        if matrix.shape != shape:
            raise ValueError(f"array '{k}/{name}' must have shape {shape}, got {matrix.shape}")
        if matrix.dtype.kind != kind or not np.isfinite(matrix).all():
            numbers = "finite numbers" if kind == "f" else "integers"
            wrong = "others" if matrix.dtype.kind == kind else f"type {matrix.dtype}"
            raise ValueError(f"array '{k}/{name}' must hold {numbers}, got {wrong}")
    for name, whole, high in (("shared", layer.shared, n * n_inputs - 1), ("delay", layer.delay, MOST)):
        low = -1 if name == "shared" else 0
        if whole is not None and not (low <= int(whole.min()) and int(whole.max()) <= high):
            raise ValueError(f"array '{k}/{name}' must be in [{low}, {high}]")
    _check_neurons(layer, k, n, arithmetic)
    return n


def _check_neurons(layer: Layer, k: int, n: int, arithmetic: Arithmetic) -> None:
    """Check the parameters of the neurons of layer k."""
    neuron = neuron_of(layer.neuron)
    if arithmetic not in neuron.arithmetics:
        known = ", ".join(neuron.arithmetics)
        raise ValueError(f"arithmetic of neuron '{layer.neuron}' must be one of {known}, got {arithmetic!r}")
    hints = _annotations(neuron.Populations)
    if set(hints) != set(layer.parameters):
        raise ValueError(
            f"layer {k} of neuron '{layer.neuron}' must have the parameters {', '.join(sorted(hints))}, "
            f"got {', '.join(sorted(layer.parameters)) or 'none'}"
        )
    for name, array in layer.parameters.items():
        what, kinds, shapes = f"array '{k}/{name}'", _kinds(hints[name]), ((), (n,))
        if hints[name] in _SCALARS:
            shapes = ((),)  # type: ignore[assignment]
        if array.shape not in shapes:
            raise ValueError(f"{what} must have shape {' or '.join(map(str, shapes))}, got {array.shape}")
        if array.dtype.kind not in kinds:
            raise ValueError(f"{what} must be of kind {' or '.join(kinds)}, got type {array.dtype}")
        if not np.isfinite(array).all():
            raise ValueError(f"{what} must hold finite numbers, got others")
        low, high = neuron.limits.get(name, (-math.inf, math.inf))
        if not (low <= array.min() and array.max() <= high):
            raise ValueError(f"{what} must be in [{low:g}, {high:g}], got {_outside(array, low, high)}")


_SCALARS: Mapping[object, str] = {bool: "b", int: "iu", float: "iuf"}
"""Kinds of the array that stores a parameter, one number for all neurons."""


def _annotations(populations: type[Any]) -> dict[str, Any]:
    """Return the annotation of each parameter; Any where it names what is not defined."""
    try:
        return typing.get_type_hints(populations)
    except NameError:
        return {field.name: Any for field in dataclasses.fields(populations)}


def _kinds(hint: Any) -> str:
    """Return the kinds of dtype that the annotation of a parameter allows."""
    if hint in _SCALARS:
        return _SCALARS[hint]
    for kind, allowed in ((np.bool_, "b"), (np.integer, "iu"), (np.floating, "f")):
        if kind.__name__ in str(hint):
            return allowed
    return "biuf"


def _outside(array: Array, low: float, high: float) -> str:
    return f"{array[(array < low) | (array > high)].flat[0]:g}"


def _check_whole(name: str, value: object, low: int, high: int) -> None:
    if type(value) is not int or not low <= value <= high:
        raise ValueError(f"{name} must be an integer in [{low}, {high}], got {value!r}")
