"""What each part of the training of the printed networks is worth: one change at a time, several seeds.

`python -m benchmarks.printed` trains 125 hidden neurons as search_spaces/texture_profile_contrasts.yaml does,
on 12 trials of each texture and profile, and prints a table: test accuracy, spikes, peak, CPU seconds.
All are means over seeds, with the standard deviation of accuracy behind ±. The data are simulated once.
"""

from __future__ import annotations

import argparse
import functools
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

import numpy as np

from dse.base import seeds
from dse.base.records import Dataset, Outcome, Response
from dse.config.load import load_space
from dse.data import dataset
from dse.data.dataset.cache import opened_root
from dse.engine.losses.spike_rate import SpikeRate
from dse.models.snn import contrasts, outputs
from dse.models.training import FitRequest

SPACE = Path(__file__).resolve().parent.parent / "search_spaces" / "texture_profile_contrasts.yaml"
JOINT = {"epochs": 8, "output_epochs": 0, "learning_rate": 0.01, "hidden_lr_factor": 0.05}
AS_PRINTED = {
    "start": "fan_in", "regions": 0, "whitened": "none", "weight_norm": True, "weight_scale": 2,
    "rounding": "nearest", "threshold_exponents": (), "max_axonal_delay": 62, "learnt_decays": "layer",
    "loss": SpikeRate(), "epochs": 16, "output_epochs": 0, "learning_rate": 0.01, "step_unit": "weight",
    "dropout": 0.1, "input_dropout": 0.1, "batch_size": 4, "clip_norm": 1.0,
}  # fmt: skip
AFTERWARDS = {**JOINT, "epochs": 16, "output_epochs": 8, "output_learning_rate": 0.05}
ROUNDED = {"compensated": lambda weights, _: weights}
ROWS: dict[str, dict[Any, Any]] = {
    "all parts": {},
    "as printed (texture_profile_as_printed.yaml), 16 epochs": AS_PRINTED,
    "lags of 20 to 320 ms": {"input_delays": (0, 20, 40, 80, 160, 320)},
    "start uniform": {"start": "uniform"},
    "start uniform, 6084 free weights, rounded": {
        "start": "uniform", "regions": 0, "rounding": "nearest", "threshold_exponents": (0, 3),
    },
    "no contrasts near those that stay": {contrasts: {"_ROUNDS": 0}},
    "outputs share no drive": {outputs: {"_COMMON": ()}},
    "roundings compensate nothing": {outputs: ROUNDED},
    "none of the three": {contrasts: {"_ROUNDS": 0}, outputs: {"_COMMON": (), **ROUNDED}},
    "outputs not whitened": {"whitened": "none"},
    "weight norm of the outputs, not whitened": {"whitened": "none", "weight_norm": True, "regions": 0,
                                                 "rounding": "nearest", "start": "uniform",
                                                 "threshold_exponents": (0, 3)},
    "all layers learn from the start": JOINT,
    "all layers learn afterwards, 8 epochs": AFTERWARDS,
    "the same, decays learnt": {**AFTERWARDS, "learnt_decays": "neuron"},
    "the same, axonal delays learnt": {**AFTERWARDS, "max_axonal_delay": 62},
    "dropout 0.1": {"dropout": 0.1},
    "last epoch kept": {"keep": "last"},
    "batches of 8": {"batch_size": 8},
    "loss: spike rate": {"loss": SpikeRate()},
    "hidden spikes priced at 1e-5": {"hidden_spike_penalty": 1e-5},
    "hidden spikes priced at 1e-4": {"hidden_spike_penalty": 1e-4},
    "float32": {"arithmetic": "float32", "rounding": "nearest", "threshold_exponents": ()},
}  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", choices=("texture", "profile"), action="append", help="default: both")
    parser.add_argument("--rows", nargs="*", help=f"any of {'; '.join(ROWS)} (default: all)")
    parser.add_argument("--hidden", type=int, default=125, help="hidden neurons")
    parser.add_argument("--trials", type=int, default=12, help="training trials of each texture and profile")
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    print("| task | | test accuracy | hidden spikes | peak, thresholds | 24 bits | CPU s |")
    print("|---|---|---|---|---|---|---|")
    for task in arguments.task or ("texture", "profile"):
        data, sections = loaded(task, arguments.hidden, arguments.trials)
        for name in arguments.rows or ROWS:
            found = list(trainings(data, sections, ROWS[name], arguments.seeds))
            accuracy, spikes, peak, cpu_s = np.array([x[:4] for x in found]).T
            fits = "left" if any(x[4] for x in found) else "held"
            spread = accuracy.std(ddof=min(1, len(found) - 1))
            print(
                f"| {task} | {name} | {accuracy.mean():.3f} ± {spread:.3f} | "
                f"{spikes.mean():.0f} | {peak.max():.0f} | {fits} | {cpu_s.mean():.0f} |",
                flush=True,
            )


def loaded(task: str, hidden: int, n_trials: int) -> tuple[Dataset, Any]:
    """Return the data set with its first trials for training, and the sections of the design."""
    space = load_space(SPACE)
    sections = space.resolve({"task.target": task, "model.hidden": 25, "model.hidden_spike_penalty": 0.0})
    root, _ = opened_root(Path("results/studies"))
    data = dataset.load(dataset.prepare(sections, SPACE.parent, root, 2))
    repetition = np.asarray(dataset.recordings(sections, SPACE.parent).columns["repetition"])
    train = data.train[repetition[data.train] < n_trials]
    model: Any = sections.model
    model = replace(model, hidden=(hidden,))
    return replace(data, train=train), replace(sections, model=model)


def trainings(
    data: Dataset, sections: Any, changes: dict[Any, Any], n_seeds: int
) -> Iterator[tuple[float, float, float, float, bool]]:
    """Yield accuracy, hidden spikes of a sample, peak, CPU seconds and overflow of a training per seed."""
    model, training = sections.model, sections.training
    of_modules = {k: v for k, v in changes.items() if isinstance(k, ModuleType)}
    of_model = {k: v for k, v in changes.items() if k not in of_modules and hasattr(model, k)}
    of_training = {k: v for k, v in changes.items() if k not in of_modules and k not in of_model}
    model, training = replace(model, **of_model), replace(training, **of_training)
    with ExitStack() as without:
        for module, values in of_modules.items():
            without.enter_context(mock.patch.multiple(module, **values))
        yield from _seeds(data, model, training, n_seeds)


def _seeds(
    data: Dataset, model: Any, training: Any, n_seeds: int
) -> Iterator[tuple[float, float, float, float, bool]]:
    for seed in range(1, n_seeds + 1):
        began = time.process_time()
        rngs = functools.partial(seeds.generator, seed, {})
        ((_, outcome),) = model.fit_cohort(data, [FitRequest(model, training, rngs)], rngs)
        if not isinstance(outcome, Outcome):
            raise outcome
        assert isinstance(outcome.test, Response)
        right = outcome.test.output.sum(axis=1, dtype=np.int64).argmax(axis=1) == data.target[data.test]
        spikes = outcome.test.spikes[..., 1:-1].sum() / data.test.size
        health = outcome.health
        yield (
            float(right.mean()),
            float(spikes),
            float(health["peak_thresholds"]),
            time.process_time() - began,
            bool(health["overflows_24_bit"]),
        )


if __name__ == "__main__":
    main()
