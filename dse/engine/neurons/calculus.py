"""What a neuron's definition needs beyond the array API: spikes, constants and whole numbers.

A threshold has no useful derivative, and neither has rounding: what stands for them in the backward pass, and
what the backward pass shall not see, is said here. `NumpyCalculus` runs definitions; the one that also
differentiates them is dse.engine.autograd.TorchCalculus.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any, Protocol

import numpy as np

from dse.base.records import Arithmetic, Array, Floats, Ints


class Calculus(Protocol):
    """One array library with one arithmetic.

    xp: namespace of the array API, such as `xp.where`, `xp.exp`.
    arithmetic: of the states.
    """

    @property
    def xp(self) -> ModuleType: ...

    @property
    def arithmetic(self) -> Arithmetic: ...

    def zeros(self, shape: tuple[int, ...]) -> Array:
        """Return zeros of the states' type."""
        ...

    def fire(self, potential: Array, threshold: Array | float) -> Array:
        """Return 1 where the potential lies strictly above the threshold, else 0.

        The backward pass takes the surrogate at their difference for the derivative.
        """
        ...

    def constant(self, x: Array) -> Array:
        """Return the same numbers; the backward pass takes them for constants."""
        ...

    def truncated(self, x: Array, unit: int | Ints = 1) -> Array:
        """Return x / unit, truncated toward zero, in the states' type; its gradient is that of x / unit."""
        ...


@dataclass(frozen=True)
class NumpyCalculus:
    """numpy, without derivatives; integer states are int64, exact."""

    arithmetic: Arithmetic = "ideal"

    @property
    def xp(self) -> ModuleType:
        return np

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the states."""
        return np.dtype({"integer": "int64", "float32": "float32", "ideal": "float64"}[self.arithmetic])

    def zeros(self, shape: tuple[int, ...]) -> Array:
        """Return zeros of the states' type."""
        return np.zeros(shape, self.dtype)

    def fire(self, potential: Floats, threshold: Floats | float) -> Floats:
        """Return 1 where the potential lies strictly above the threshold, else 0, in the potential's type."""
        spikes: Floats = (potential > threshold).astype(potential.dtype)
        return spikes

    def constant(self, x: Array) -> Array:
        """Return x."""
        return x

    def truncated(self, x: Array, unit: int | Ints = 1) -> Array:
        """Return x / unit, truncated toward zero."""
        if x.dtype.kind == "i":
            return np.asarray(np.sign(x) * (np.abs(x) // unit))
        whole: Any = np.trunc(x / unit)
        return np.asarray(whole, self.dtype)
