"""Decays that are learnt: their gradients, and the whole numbers that they run as.

With dL/dz = lu and lv of dse.engine.neurons.cuba_lif.backward, which ignores the reset, and decays in 1:

    dL/dd_u = - sum over t of lu[t] u[t-1]
    dL/dd_v = - sum over t of lv[t] v_r[t-1],    lv[t] = lu[t] - (1 - d_u) lu[t+1]

A decay is learnt as a real number and runs rounded to 1/4096, straight through. SLAYER learns decays too, but
adds up without the minus and takes v before its reset (lava-dl; REFERENCES.md): it moves them the other way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array, Floats, Ints
from dse.engine.adam import adam
from dse.engine.layout import width_at
from dse.engine.neurons.cuba_lif import Population, round_decay
from dse.engine.neurons.fixed_point import DECAY_SCALE

_LEAST = 1 / DECAY_SCALE


@dataclass
class Decays:
    """Decays of a layer's neurons in training.

    masters: (2, neuron) float32 decays of u and of v; (2, 1): all neurons share them.
    first, second: Adam's moments, likewise.
    """

    masters: Floats
    first: Floats
    second: Floats

    @classmethod
    def of(cls, population: Population, n_neurons: int, per: str) -> Decays:
        """Return the decays of neurons at their start, one pair per 'layer' (the mean) or per 'neuron'."""
        decays = [np.broadcast_to(d, n_neurons) for d in (population.decay_current, population.decay_voltage)]
        start = np.array(decays, np.float64) / DECAY_SCALE
        masters = start.mean(axis=1, keepdims=True) if per == "layer" else start
        return cls(_within(masters), *(np.zeros(masters.shape, np.float32) for _ in range(2)))

    @property
    def whole(self) -> Ints:
        """The decays as they run, (2, neuron or 1) int32."""
        return round_decay(self.masters)

    def update(self, by_keep: Floats, learning_rate: float, steps: int) -> None:
        """Take Adam's step `steps`, from 1, given dL/d(1 - decay), (2, neuron)."""
        n = self.masters.shape[1]
        gradient = -(by_keep if n > 1 else by_keep.sum(axis=1, keepdims=True))[:, :n]
        arrays = (self.masters, gradient.astype(np.float32), self.first, self.second)
        masters, self.first, self.second = adam(*arrays, steps, learning_rate)
        self.masters = _within(masters)

    def state(self) -> dict[str, Array]:
        """Return a copy of what an update reads and writes."""
        return {name: getattr(self, name).copy() for name in ("masters", "first", "second")}

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take over the numbers of a state."""
        self.masters, self.first, self.second = (state[x].copy() for x in ("masters", "first", "second"))


def _within(masters: Floats) -> Floats:
    """Return decays inside (0, 1), float32: a state neither stays for ever nor is lost at once."""
    return np.clip(masters, _LEAST, 1 - _LEAST).astype(np.float32)


@compiled()
def add_gradients(
    by_input: Array,
    states: Array,
    n_samples: int,
    n_steps: int,
    n_columns: int,
    keep_u: Array,
    gradient: Any,
) -> None:
    """Add dL/d(1 - decay) of a layer's neurons.

    Args:
        by_input: dL/dz in blocks.
        states: u, then v after its reset, in weight units and blocks.
        n_samples: of the chunk.
        n_steps: of a sample.
        n_columns: padded neurons.
        keep_u: (column,) 1 - decay of u.
        gradient: (2, column) float64.
    """
    n_rows, half = n_samples * n_steps, n_samples * n_steps * n_columns
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for n in range(n_samples):
            for t in range(1, n_steps):
                at = n_rows * column + (n * n_steps + t) * width
                later = 1.0 if t + 1 < n_steps else 0.0
                after = at + (width if t + 1 < n_steps else 0)
                for c in range(width):
                    here = by_input[at + c]
                    by_v = here - later * keep_u[column + c] * by_input[after + c]
                    gradient[0, column + c] += here * states[at - width + c]
                    gradient[1, column + c] += by_v * states[half + at - width + c]
        column += width
