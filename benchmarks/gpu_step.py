"""One training step on the GPU engine, alone and as a cohort, and how far its gradients are from the CPU's.

    python -m benchmarks.gpu_step [CASE ...]          wall time, median of some steps after a warm-up

A step is everything that a cohort does with a batch: the spikes go to the device, the reports come back. The
gradient error is the largest difference from the CPU engine, relative to the gradient's largest entry; losses
and spike counts must be equal. Without a CUDA device there is nothing to measure, and it says so.
"""

from __future__ import annotations

import sys
import time
from statistics import median

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.cases import (
    CASES,
    FALSE_RATE,
    LEARNING_RATE,
    TRUE_RATE,
    Case,
    Variant,
)
from benchmarks.ours import SURROGATE, layers_of, rows_of
from dse.engine import gpu
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.network import gradients
from dse.records import Arithmetic

ARITHMETICS: tuple[Arithmetic, ...] = ("integer", "float32", "ideal")
COPIES = (1, 20)
STEPS = 20
WARM_UP = 3


def member_of(case: Case, arithmetic: Arithmetic) -> Member:
    """Return a case's network at its start."""
    layers = layers_of(case, Variant(arithmetic))
    return Member(
        tuple(
            TrainedLayer(
                layer.feed_forward,
                None,
                layer.population,
                SURROGATE,
                np.ones(layer.n_neurons, np.float32),
            )
            for layer in layers
        ),
        TRUE_RATE,
        FALSE_RATE,
        arithmetic,
    )


def error_of(case: Case, arithmetic: Arithmetic) -> float:
    """Return the error of the gradients of one step.

    Raises:
        ValueError: losses or spikes differ from the CPU engine's.
    """
    none = (None,) * len(case.weights)
    expected = gradients(
        rows_of(case.x),
        layers_of(case, Variant(arithmetic)),
        [SURROGATE] * len(none),
        case.labels,
        true_rate=TRUE_RATE,
        false_rate=FALSE_RATE,
        arithmetic=arithmetic,
        gains=none,
    )
    cohort = gpu.start([member_of(case, arithmetic)], case.batch, case.n_steps)
    report = cohort.step(rows_of(case.x), case.labels, {0: Turn(LEARNING_RATE, none)})[0]
    if arithmetic == "integer" and not np.allclose(
        (report.loss, *report.fired), (expected.loss, *expected.fired), rtol=1e-12
    ):
        raise ValueError(f"loss and spikes must be {expected.loss} and {expected.fired}, got {report}")
    pairs = zip(cohort.gradients(0).feed_forward, expected.feed_forward, strict=True)
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


def seconds_of(case: Case, arithmetic: Arithmetic, copies: int) -> float:
    """Return the median seconds of a cohort's step."""
    import torch

    cohort = gpu.start([member_of(case, arithmetic)] * copies, case.batch, case.n_steps)
    turns = {k: Turn(LEARNING_RATE, (None,) * len(case.weights)) for k in range(copies)}
    rows, found = rows_of(case.x), []
    for _ in range(WARM_UP + STEPS):
        began = time.perf_counter()
        cohort.step(rows, case.labels, turns)
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        found.append(time.perf_counter() - began)
    return median(found[WARM_UP:])


def main() -> None:
    """Print the table."""
    import torch

    from dse.engine.gpu.wide import device

    try:
        on = device()
    except gpu.DeviceUnavailable as fault:
        print(f"Nothing to measure: {fault}.")
        return
    name = torch.cuda.get_device_name() if on.type == "cuda" else "Triton's interpreter"
    table = Table(
        "case",
        "arithmetic",
        "designs",
        "ms per step",
        "ms per step and design",
        "samples/s, all designs",
        "gradient error",
        title=f"One training step on {name}",
    )
    for key in sys.argv[1:] or ("A", "B", "C"):
        case = CASES[key]
        for arithmetic in ARITHMETICS:
            error = error_of(case, arithmetic)
            for copies in COPIES:
                seconds = seconds_of(case, arithmetic, copies)
                table.add_row(
                    key,
                    arithmetic,
                    str(copies),
                    f"{1e3 * seconds:.2f}",
                    f"{1e3 * seconds / copies:.3f}",
                    f"{copies * case.batch / seconds:.0f}",
                    f"{error:.1e}",
                )
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
