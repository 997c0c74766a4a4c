"""Plain rivals on recorded touch: accuracy in floating point and in integers, weights, energy on a Cortex-M4.

    python -m benchmarks.rivals [--seeds 3]

Recordings, split, encoder and window are those of `headline_braille_small` and `headline_fabrics_small`, of
the latter nine crops of each training recording. Validation accuracy, mean of the seeds; energy is that of
the C of an inference (`mcu_m4`), encoder left out. `float`: the same readout before it was rounded.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

import dse
from dse import seeds
from dse.config.settings import Training
from dse.dataset.assemble import build
from dse.hardware.cost import cost
from dse.hardware.profile import load
from dse.models.counts import kernels, linear, mlp
from dse.models.counts.readouts import forward
from dse.recordings.windows import with_crops
from dse.records import Array, Dataset, Operations

SETS = {"headline_braille_small": 1, "headline_fabrics_small": 9}
"""Search spaces, and crops of a training recording."""


def families(data: Dataset) -> dict[str, Any]:
    """Return the rivals by what they are."""
    step_ms, whole_ms = data.spikes.step_ms, data.n_steps * data.spikes.step_ms
    counts = {"channels": "each", "read_outs": 1}
    network = mlp.MLP(window_ms=whole_ms / 8, hidden=(32,), **counts)
    return {
        "linear, 4 windows": linear.Linear(window_ms=whole_ms / 4, **counts),
        "mlp of 32, 8 windows": replace(network, precision="int8"),
        "mlp of 32, 8 windows, float32": network,
        "300 kernels": kernels.Kernels(window_ms=step_ms, read_outs=1),
    }


def before_rounding(family: Any, data: Dataset, crops: Dataset, generators: Any) -> float:
    """Return the validation accuracy of a readout by logistic regression that is not rounded."""
    outcome = family.fit(crops, Training(), generators)
    arrays = outcome.network.arrays
    x: list[Array] = []
    for each, samples in ((crops, crops.train), (data, data.validation)):
        counts = family.counts(each, samples, arrays)
        x += [*family.inputs(arrays, counts, arrays["lengths"])]
    weight, bias, _ = linear.logistic(x[0], crops.target[crops.train], family.alpha, family.epochs)
    label = arrays["classes"][forward(x[1], [(weight, bias)])[-1].argmax(axis=1)]
    return float((label == data.target[data.validation]).mean())


def row(family: Any, data: Dataset, crops: Dataset, seed: int) -> tuple[float, float, float, float]:
    """Return accuracy, that before rounding (NaN of others), weights, and energy in uJ."""

    def generators(purpose: str, *index: int) -> np.random.Generator:
        return seeds.generator(seed, {}, purpose, 0, *index)

    outcome = family.fit(crops, Training(), generators)
    answers = family.respond(outcome.network, data, data.validation)
    accuracy = (answers.label[:, -1] == data.target[data.validation]).mean()
    work = Operations(
        answers.macs,
        answers.additions,
        np.zeros_like(answers.macs),
        answers.n_weights,
        answers.time_ms,
        program=answers.program,
    )
    energy_uj = float(np.squeeze(cost(load("mcu_m4"), work).energy_uj.value))
    exact = float("nan")
    if not isinstance(family, mlp.MLP):
        exact = before_rounding(family, data, crops, generators)
    return float(accuracy), exact, float(answers.n_weights[-1]), energy_uj


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    print("| recordings | family | accuracy | float | stored numbers | energy, uJ |")
    print("|---|---|---|---|---|---|")
    for name, n_crops in SETS.items():
        space = dse.load_space(name)
        data = build(space.resolve({}), space.source.parent)[0]
        crops = with_crops(data, n_crops)
        for what, family in families(data).items():
            rows = np.array([row(family, data, crops, seed) for seed in range(options.seeds)])
            accuracy, exact, n_weights, energy_uj = rows.mean(axis=0)
            error = rows[:, 0].std(ddof=1) / np.sqrt(len(rows)) if len(rows) > 1 else 0.0
            before = "-" if np.isnan(exact) else f"{exact:.3f}"
            numbers = f"{accuracy:.3f} ± {error:.3f} | {before} | {n_weights:.0f} | {energy_uj:.0f}"
            print(f"| {name} | {what} | {numbers} |", flush=True)


if __name__ == "__main__":
    main()
