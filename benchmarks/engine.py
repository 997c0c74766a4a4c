"""What each shortcut of the engine saves, and what it costs: seconds, gradient error, final accuracy.

    DSE_DATA=... python -m benchmarks.engine [--seeds 3] [--epochs N] [SPACE ...]

One design per space is trained in float64 (`ideal`), float32 and integer arithmetic, with the surrogate
gradient whole and cut where it falls below a share of its height, and on spikes merged into longer bins (time
constants, delays and jitter keep their milliseconds). Seconds are CPU seconds of one training on one core.

The gradient error is the distance of the first batch's gradient, over all weights, from that of float64 with
the whole surrogate and the same master weights, relative to its length; beside it the distance from the same
arithmetic with the whole surrogate. Other bins are other problems and have neither. Accuracy: validation,
last epochs, mean over seeds and its standard error.
"""

from __future__ import annotations

import os

os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")})

import argparse
import dataclasses
import time
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.recorded_touch import CASES, SETS
from dse.base import seeds
from dse.base.records import Dataset, Spikes
from dse.data import dataset
from dse.engine.events import gather
from dse.engine.network import gradients
from dse.engine.neurons import fixed_point
from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.surrogate import exponential
from dse.models.snn.family import SNN
from dse.models.snn.initialise import deployed, initialise, populations_of
from dse.models.training import Training

# The default surrogate is three thresholds wide and is nowhere small; a tenth of that is worth cutting.
NARROW = {"tau_grad": 0.003, "output_tau_grad": 0.03}
VARIANTS: dict[str, dict[str, Any]] = {
    "float64, whole surrogate": {"arithmetic": "ideal"},
    "float32, whole surrogate": {"arithmetic": "float32"},
    "integer, whole surrogate": {},
    "integer, cut at 0.01": {"surrogate_cut": 0.01},
    "integer, cut at 0.1": {"surrogate_cut": 0.1},
    "integer, cut at 0.5": {"surrogate_cut": 0.5},
    "integer, a tenth as wide": NARROW,
    "integer, a tenth as wide, cut at 0.01": NARROW | {"surrogate_cut": 0.01},
    "integer, a tenth as wide, cut at 0.1": NARROW | {"surrogate_cut": 0.1},
}
BINS = (2, 5)


def merged(data: Dataset, n: int) -> Dataset:
    """Return a data set with n steps merged into one; a channel fires where it fired in any of them."""
    spikes = data.spikes
    n_steps = spikes.n_steps // n
    n_samples = len(data.target)
    counts = np.diff(spikes.row_offsets)
    row = np.repeat(np.arange(counts.size), counts)
    sample, step = np.divmod(row, spikes.n_steps)
    kept = step < n_steps * n
    row = (sample * n_steps + step // n)[kept]
    cells = np.unique(row * spikes.n_channels + spikes.channel[kept])
    rows, channels = np.divmod(cells, spikes.n_channels)
    offsets = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n_samples * n_steps))])
    length = data.n_steps // n
    starts = {
        key: np.minimum(getattr(data, key) // n, n_steps - length).astype(np.int32)
        for key in ("start", "start_low", "start_high")
    }
    coarse = Spikes(
        offsets.astype(np.int64), channels.astype(np.int32), n_steps, spikes.n_channels, n * spikes.step_ms
    )
    return dataclasses.replace(data, spikes=coarse, n_steps=length, **starts)


def slower(model: SNN, n: int) -> SNN:
    """Return a model whose time constants and delays keep their milliseconds when n steps become one."""

    def decay(d: float) -> float:
        return 1 - (1 - d) ** n

    neuron = model.neuron
    assert isinstance(neuron, CubaLif)
    return dataclasses.replace(
        model,
        neuron=dataclasses.replace(
            neuron,
            current_decay=tuple(map(decay, neuron.current_decay)),
            voltage_decay=tuple(map(decay, neuron.voltage_decay)),
            output_current_decay=decay(neuron.output_current_decay),
            output_voltage_decay=decay(neuron.output_voltage_decay),
        ),
        input_delays=tuple(dict.fromkeys(round(d / n) for d in model.input_delays)),
    )


def first_gradient(data: Dataset, model: SNN, training: Training) -> np.ndarray:
    """Return the gradient of the first batch by all master weights, drawn as for integer arithmetic."""
    rng = np.random.default_rng(0)
    batch = data.train[: training.batch_size]
    rows = gather(data.spikes, batch, data.start[batch], data.n_steps, model.input_delays)
    start_model = dataclasses.replace(model, arithmetic="integer")
    populations = populations_of(start_model, len(data.classes), data.spikes.step_ms, rng)
    start = initialise(rows, start_model, populations, len(data.classes), rng)
    widths = [*[model.tau_grad] * len(model.hidden), model.output_tau_grad]
    found = gradients(
        rows,
        deployed(start.feed_forward, start.recurrent, populations, model.arithmetic),
        [
            exponential(p.to_threshold, tau, model.scale_grad, model.surrogate_cut)
            for p, tau in zip(populations, widths, strict=True)
        ],
        data.target[batch],
        true_rate=model.true_rate,
        false_rate=model.false_rate,
        arithmetic=model.arithmetic,
        gains=[None] * len(populations),
    )
    passes = [
        fixed_point.quantise_passes(w) if model.arithmetic == "integer" else 1 for w in start.feed_forward
    ]
    return np.concatenate([(g * p).ravel() for g, p in zip(found.feed_forward, passes, strict=True)]).astype(
        float
    )


def trained(data: Dataset, model: SNN, training: Training, n_seeds: int) -> tuple[list[float], float]:
    """Return the validation accuracy of each seed, and the mean CPU seconds of a training."""
    accuracies, seconds = [], []
    for seed in range(n_seeds):
        began = time.process_time()
        outcome = model.fit(data, training, partial(seeds.generator, seed, {}))
        seconds.append(time.process_time() - began)
        label = outcome.validation.output.sum(axis=1, dtype=np.int64).argmax(axis=1)
        accuracies.append(float((label == data.target[data.validation]).mean()))
    return accuracies, float(np.mean(seconds))


def main() -> None:
    """Train, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--epochs", type=int, help="absent: those of the search space")
    parser.add_argument("spaces", nargs="*", default=["braille", "fabric_texture"])
    options = parser.parse_args()
    table = Table(
        "data", "engine", "step ms", "CPU s", "times float64", "gradient error", "of the cut", "accuracy"
    )
    for name in options.spaces:
        space = next(case for case in CASES if SETS[case.recordings].space == name).space(1)
        sections = space.resolve({})
        data, _ = dataset.build(sections, space.source.parent)
        base, training = sections.model, sections.training
        assert isinstance(base, SNN)
        if options.epochs:
            training = dataclasses.replace(training, epochs=options.epochs)
        cases = [(text, data, dataclasses.replace(base, **keys)) for text, keys in VARIANTS.items()]
        cases += [(f"integer, {n} steps in one", merged(data, n), slower(base, n)) for n in BINS]
        trained(data, base, dataclasses.replace(training, epochs=1), 1)  # compile
        reference_s = None
        for text, used, model in cases:
            errors = ["-", "-"]
            if used is data:
                whole = dataclasses.replace(model, surrogate_cut=0.0)
                real = dataclasses.replace(whole, arithmetic="ideal")
                found, *exact = (first_gradient(data, m, training) for m in (model, real, whole))
                errors = [f"{np.linalg.norm(found - e) / np.linalg.norm(e):.1e}" for e in exact]
            each, seconds = trained(used, model, training, options.seeds)
            reference_s = reference_s or seconds
            spread = np.std(each, ddof=1) / np.sqrt(len(each)) if len(each) > 1 else 0.0
            table.add_row(
                name,
                text,
                f"{used.spikes.step_ms:g}",
                f"{seconds:.1f}",
                f"{reference_s / seconds:.2f}",
                *errors,
                f"{np.mean(each):.3f} ± {spread:.3f}",
            )
    Console(width=130).print(table)


if __name__ == "__main__":
    main()
