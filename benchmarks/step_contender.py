"""The worker behind benchmarks.train_step: one contender and one case, on demand.

python -m benchmarks.step_contender NAME CASE
"""

from __future__ import annotations

import sys
from typing import Any, Protocol

import numpy as np

from benchmarks.cases import (
    CASES,
    DECAY_CURRENT,
    DECAY_VOLTAGE,
    FALSE_RATE,
    LEARNING_RATE,
    SCALE_GRAD,
    TAU_GRAD,
    THRESHOLD,
    TRUE_RATE,
    Case,
    Variant,
)
from benchmarks.worker import cpu_seconds, serve

COPIES = 8
OURS = {
    "dse, ideal": (Variant("ideal"), 1),
    "dse, float32": (Variant("float32"), 1),
    "dse, integer": (Variant("integer"), 1),
    f"dse, integer, cohort of {COPIES}": (Variant("integer"), COPIES),
    "dse, weight norm, integer": (Variant("integer", form="weight norm"), 1),
    "dse, whitened outputs, integer": (Variant("integer", form="whitened"), 1),
    "dse, 12 regions, integer": (Variant("integer", regions=12), 1),
    "dse, resonators, float32": (Variant("float32", 1.0), 1),
    "dse, resonators, integer": (Variant("integer", 1.0), 1),
    "dse, half resonators, integer": (Variant("integer", 0.5), 1),
    f"dse, resonators, integer, cohort of {COPIES}": (Variant("integer", 1.0), COPIES),
    "dse, delays to 30, float32": (Variant("float32", max_delay=30), 1),
    "dse, delays to 30, integer": (Variant("integer", max_delay=30), 1),
    "dse, delays to 62, integer": (Variant("integer", max_delay=62), 1),
}
"""Row -> what it trains, and how many copies at a time."""


class Contender(Protocol):
    """What is timed; gradients are those of the weights as they start."""

    def step(self) -> Any: ...
    def infer(self) -> Any: ...
    def rates(self) -> list[float]: ...
    def gradients(self) -> list[np.ndarray]: ...


class _Peer:
    """A case's network in torch."""

    def __init__(self, name: str, case: Case) -> None:
        import torch

        from benchmarks.peer_training import Learner, dense_inputs
        from benchmarks.peers import Population, peer
        from dse.engine.neurons.surrogate import exponential

        surrogate = exponential(THRESHOLD / 64, TAU_GRAD, SCALE_GRAD)
        populations = [
            Population(
                np.full(n, 1 - DECAY_CURRENT / 4096),
                np.full(n, 1 - DECAY_VOLTAGE / 4096),
                THRESHOLD / 64,
                surrogate,
            )
            for n in case.sizes[1:]
        ]
        weights = case.weights_of(Variant("float32", 1.0 if "resonators" in name else 0.0))
        self._learner = Learner(peer(name, weights, populations), TRUE_RATE, FALSE_RATE)
        self._inputs = self._learner.network.prepare(dense_inputs(case.x))
        self._labels = torch.as_tensor(case.labels)

    def step(self) -> None:
        self._learner.step(self._inputs, self._labels, LEARNING_RATE)

    def infer(self) -> Any:
        return self._learner.answers(self._inputs)

    def rates(self) -> list[float]:
        import torch

        with torch.no_grad():
            return [float(s.mean()) for s in self._learner.network.spikes(self._inputs)]

    def gradients(self) -> list[np.ndarray]:
        self.step()
        return [w.grad.numpy() for w in self._learner.network.weights if w.grad is not None]


def contender(name: str, case: Case) -> Contender:
    """Return a contender by the name of its row."""
    if name in OURS:
        from benchmarks.ours import Ours

        return Ours(case, *OURS[name])
    return _Peer(name, case)


def main() -> None:
    """Answer the parent."""
    name, case = sys.argv[1], CASES[sys.argv[2]]
    it = contender(name, case)
    copies = OURS[name][1] if name in OURS else 1

    def timed(what: str, at_least_s: float, at_least: int) -> list[float]:
        return [s / copies for s in cpu_seconds(getattr(it, what), at_least_s, at_least)]

    def gradients(path: str) -> None:
        np.savez(path, *it.gradients())

    serve({"timed": timed, "rates": it.rates, "gradients": gradients})


if __name__ == "__main__":
    main()
