"""The networks and inputs whose training step is timed: the same in every process, whatever runs there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dse.base.records import Arithmetic

TRUE_RATE, FALSE_RATE = 0.2, 0.02
DECAY_CURRENT, DECAY_VOLTAGE, THRESHOLD = 1024, 123, 80
"""SLAYER's defaults of its N-MNIST example, in integers: 0.25, 0.03, 1.25."""
PERIOD, QUALITY, GAIN = 8.0, 3.0, 8.0
"""Of resonators: steps, quality factor, and what their weights are multiplied with, to fire as often."""
TAU_GRAD, SCALE_GRAD = 0.03, 3.0
LEARNING_RATE = 1e-6
"""So small that activity does not drift while it is timed."""


@dataclass(frozen=True)
class Variant:
    """What a row trains.

    arithmetic: of the states.
    share: of the hidden neurons that resonate.
    reset: whether spikes reset the potential of resonators.
    delayed: whether layers hand their spikes on one step later.
    max_delay: longest delay of a hidden neuron's synapses, which are drawn and learnt; 0: they have none.
    form: how weights follow from what is learnt: free, weight norm, or whitened (the outputs).
    regions: runs of inputs with one weight to each hidden neuron; 0: every input has its own.
    """

    arithmetic: Arithmetic
    share: float = 0.0
    reset: bool = False
    delayed: bool = True
    max_delay: int = 0
    form: str = "free"
    regions: int = 0


@dataclass(frozen=True)
class Case:
    """A classifier with one hidden layer, and a batch of random input spikes of a density."""

    sizes: tuple[int, int, int]
    n_steps: int
    batch: int
    density: float

    @cached_property
    def x(self) -> np.ndarray:
        """Input spikes (sample, step, input) uint8."""
        shape = (self.batch, self.n_steps, self.sizes[0])
        return (np.random.default_rng(0).random(shape, np.float32) < self.density).astype(np.uint8)

    @cached_property
    def labels(self) -> np.ndarray:
        """Class numbers (sample,)."""
        return np.arange(self.batch) % self.sizes[-1]

    @cached_property
    def weights(self) -> list[np.ndarray]:
        """Weights (input, neuron) float32 as torch starts them, uniform within +-1 / sqrt(inputs)."""
        rng = np.random.default_rng(1)
        shapes = zip(self.sizes, self.sizes[1:], strict=False)
        return [rng.uniform(-1, 1, (i, o)).astype(np.float32) / np.float32(np.sqrt(i)) for i, o in shapes]

    def weights_of(self, variant: Variant) -> list[np.ndarray]:
        """Return the weights as a variant runs them: those of resonators stronger, 8-bit ones rounded.

        They are rounded up or down by chance: to the nearest would zero all of case C.
        """
        hidden, output = self.weights
        if (pool := self.pool(variant)) is not None:
            hidden = hidden[np.flatnonzero(np.diff(pool, prepend=-1))][pool]
        resonates = np.arange(self.sizes[1]) < round(variant.share * self.sizes[1])
        started = [hidden * np.where(resonates, GAIN, 1).astype(np.float32), output]
        if variant.arithmetic != "integer":
            return started
        rng = np.random.default_rng(2)
        chances = [rng.random(w.shape, np.float32) for w in started]
        if pool is not None:
            chances[0] = chances[0][pool]
        return [np.floor(w * 32 + x) / np.float32(32) for w, x in zip(started, chances, strict=True)]

    def pool(self, variant: Variant) -> np.ndarray | None:
        """Return the region of each input, (input,); None: it has none."""
        n_inputs = self.sizes[0]
        return np.arange(n_inputs) * variant.regions // n_inputs if variant.regions else None


CASES = {
    "A": Case((1600, 450, 11), 250, 32, 0.02),
    "B": Case((1600, 100, 11), 250, 32, 0.02),
    "C": Case((6084, 425, 11), 1000, 8, 0.02),
    # The density of five send-on-delta thresholds with three input delays.
    "fabric": Case((480, 150, 7), 128, 32, 0.20),
    "tiny": Case((40, 12, 3), 30, 4, 0.10),
}
