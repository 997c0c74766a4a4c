"""One training step (forward, SpikeRate loss, backward, Adam) of this engine beside a plain torch loop.

    python -m benchmarks.train_step [CASE ...]        one thread; CPU seconds, best of a few repeats

Cases as (inputs, hidden, outputs, steps, batch) at 2 % random input spikes; `fabric` has the density of five
send-on-delta thresholds with three input delays. The error is the largest difference of a weight gradient
from the torch loop in float64, relative to its largest entry.
"""

from __future__ import annotations

import os

os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")})

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from benchmarks.torch_loop import gradients as by_torch
from dse.engine import cpu
from dse.engine.events import Rows
from dse.engine.network import gradients
from dse.models.training import Adam
from dse.neurons import cuba_lif
from dse.neurons.surrogate import exponential

CASES = {
    "A": (1600, 450, 11, 250, 32, 0.02),
    "B": (1600, 100, 11, 250, 32, 0.02),
    "C": (6084, 425, 11, 1000, 8, 0.02),
    "fabric": (480, 150, 7, 128, 32, 0.20),
}


def best_of(function: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Return the smallest CPU time of some calls after a warm-up, and the last result."""
    function()
    seconds = []
    for _ in range(repeats):
        began = time.process_time()
        result = function()
        seconds.append(time.process_time() - began)
    return min(seconds), result


def step_of(case: tuple[int, int, int, int, int, float], table: Table, name: str) -> None:
    """Measure one case and add its rows."""
    n_in, hidden, n_out, n_steps, batch, density = case
    rng = np.random.default_rng(0)
    x = (rng.random((batch, n_steps, n_in)) < density).astype(np.uint8)
    labels = rng.integers(0, n_out, batch)
    flat = x.reshape(-1, n_in)
    offsets = np.concatenate([[0], np.cumsum(flat.sum(axis=1, dtype=np.int64))])
    rows = Rows(offsets, np.nonzero(flat)[1].astype(np.int32), batch, n_steps, n_in)
    weights = [
        rng.uniform(-0.25, 0.25, shape).astype(np.float32) for shape in ((n_in, hidden), (hidden, n_out))
    ]
    surrogates = [exponential(80, 0.03, 3.0)] * 2
    decays = (cuba_lif.round_decay(0.25), cuba_lif.round_decay(0.03))

    def layers(integer: bool) -> list[cpu.Weights]:
        rounding = cuba_lif.quantise if integer else np.asarray
        return [cpu.weights(rounding(w), None, *decays, 80) for w in weights]

    def ours(integer: bool) -> Callable[[], Any]:
        masters = [w.copy() for w in weights]
        adam, units = Adam.start(masters), [np.ones(w.shape[1], np.float32) for w in masters]

        def step() -> Any:
            found = gradients(
                rows,
                layers(integer),
                surrogates,
                labels,
                true_rate=0.2,
                false_rate=0.02,
                integer=integer,
                gains=[None, None],
            )
            adam.update(masters, list(found.feed_forward), [1e-6 * u for u in units])
            return found.feed_forward

        return step

    def torch_step(dtype: torch.dtype, integer: bool) -> Callable[[], Any]:
        masters = [torch.tensor(w, requires_grad=True) for w in weights]
        adam = torch.optim.Adam(masters, lr=1e-6)

        def step() -> Any:
            _, found, _ = by_torch(
                x, layers(integer), surrogates, labels, 0.2, 0.02, integer, [None, None], dtype
            )
            for master, g in zip(masters, found, strict=True):
                master.grad = torch.as_tensor(g, dtype=torch.float32)
            adam.step()
            return found

        return step

    repeats = 5 if n_steps < 500 else 2
    exact = {
        integer: by_torch(x, layers(integer), surrogates, labels, 0.2, 0.02, integer, [None, None])[1]
        for integer in (True, False)
    }

    def error(found: Any, integer: bool) -> float:
        pairs = zip(found, exact[integer], strict=True)
        return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)

    loop_s, found = best_of(torch_step(torch.float32, False), max(2, repeats - 2))
    table.add_row(name, "torch loop, float32", f"{loop_s:.4f}", "1.0", f"{error(found, False):.1e}")
    for integer, label in ((False, "dse, ideal (float64 states)"), (True, "dse, integer")):
        seconds, found = best_of(ours(integer), repeats)
        table.add_row(
            name, label, f"{seconds:.4f}", f"{loop_s / seconds:.1f}", f"{error(found, integer):.1e}"
        )


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    table = Table(
        "case", "engine", "CPU s per step", "times faster", "gradient error", title="One training step"
    )
    for name in sys.argv[1:] or list(CASES):
        step_of(CASES[name], table, name)
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
