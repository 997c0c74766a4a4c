"""The 40 designs of benchmarks.sweep, as a search space, as a cohort, and as what a peer needs of each.

They are those of `search_spaces/braille.yaml` with one time constant per layer, plain weight units and no
dropout, so that a plain loop or a framework trains them as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import dse
from benchmarks.peer_training import Task, TaskDesign
from benchmarks.peers import Population
from dse.base import seeds
from dse.base.records import Dataset, Outcome
from dse.config import SearchSpace
from dse.data import dataset
from dse.data.recordings import RecordingError
from dse.engine.events import dense, gather
from dse.engine.neurons.surrogate import exponential
from dse.models.snn.cohort import PROBE_SAMPLES
from dse.models.snn.family import SNN
from dse.models.snn.initialise import initialise, populations_of
from dse.models.snn.train import train
from dse.models.training import FitRequest, Generators
from dse.search.space import design_at

N_DESIGNS, N_RATES = 40, 5
SETTINGS = {
    "model.hidden": "{choice: [20, 60, 120, 200]}",
    "model.true_rate": "{choice: [0.2, 0.4]}",
    "training.learning_rate": "{choice: [0.005, 0.01, 0.02, 0.05, 0.1]}",
    "model.input_delays": "[0, 4, 8, 16, 32, 64]",
    "model.current_decay": "0.3",
    "model.voltage_decay": "0.12",
    "model.threshold": "5.0",
    "training.step_unit": "weight",
    "training.warmup_epochs": "1",
    "training.lr_every": "5",
    "training.average_epochs": "1",
    "training.dropout": "0",
    "training.event_dropout": "0",
    "training.dilation": "[1, 1]",
    "model.loss": "spike_rate",
    "training.silent_epochs": "0",
}


def some() -> list[int]:
    """Return every fifth design: sizes and true rates as often as in the grid, learning rates in turn."""
    return [N_RATES * k + k % N_RATES for k in range(N_DESIGNS // N_RATES)]


def load(folder: Path, epochs: int, arithmetic: str) -> tuple[SearchSpace, Dataset, bool]:
    """Return the search space, its data set, and whether that is recorded; `folder` takes invented data."""
    settings = SETTINGS | {"training.epochs": str(epochs), "model.arithmetic": arithmetic}
    space = dse.load_space("braille", settings)
    try:
        return space, _built(space), True
    except RecordingError:
        space = dse.load_space("braille", settings | {"data.file": str(_invented(folder / "invented.npz"))})
        return space, _built(space), False


def _built(space: SearchSpace) -> Dataset:
    return dataset.build(space.resolve(design_at(space, 0)), space.source.parent)[0]


def _invented(path: Path) -> Path:
    """Write spikes of seven classes laid out as the recorded ones; each class has its own rates over time."""
    rng = np.random.default_rng(0)
    label = np.arange(420) % 7
    knots = rng.gamma(1.0, 0.04, (7, 9, 12))
    rates = np.repeat(knots, 32, axis=1)[:, :256]
    spikes = rng.random((len(label), 256, 12)) < rates[label] * rng.gamma(4, 0.25, (len(label), 1, 12))
    np.savez(
        path,
        spikes_packed=np.packbits(spikes, axis=1),
        label=label,
        split=np.where(np.arange(len(label)) < 294, "train", "val"),
        class_names=np.array([f"class {k}" for k in range(7)]),
    )
    return path


def _generators(space: SearchSpace, values: dict[str, Any]) -> Generators:
    return lambda purpose, *index: seeds.generator(space.seed, values, purpose, 0, *index)


def shared(space: SearchSpace) -> Generators:
    """Return the generators of what designs share."""
    return _generators(space, {})


def designs(space: SearchSpace) -> list[FitRequest]:
    """Return the grid's designs with the generators that they have in a study's first repeat."""
    found = []
    for number in range(N_DESIGNS):
        values = design_at(space, number)
        sections = space.resolve(values)
        assert isinstance(sections.model, SNN)
        found.append(FitRequest(sections.model, sections.training, _generators(space, values)))
    return found


def accuracies(space: SearchSpace, data: Dataset) -> list[float]:
    """Train the grid as one cohort; return each design's validation accuracy."""
    target = data.target[data.validation]
    found = [np.nan] * N_DESIGNS
    for number, outcome in train(data, designs(space), shared(space)):
        if isinstance(outcome, Outcome):
            answers = outcome.validation.output.sum(axis=1).argmax(axis=1)
            found[number] = float((answers == target).mean())
    return found


def task(space: SearchSpace, data: Dataset, numbers: Sequence[int]) -> Task:
    """Return what peers need to train designs on the same batches, from the same weights."""
    chosen = designs(space)
    model, training, _ = chosen[0]
    every = np.arange(data.spikes.n_samples)
    rows = gather(data.spikes, every, data.start, data.n_steps, model.input_delays)
    batches, n_batches = shared(space)("batches"), -(-data.train.size // training.batch_size)
    picked = shared(space)("probe").permutation(data.train)[:PROBE_SAMPLES]
    probe = gather(data.spikes, picked, data.start[picked], data.n_steps, model.input_delays)
    found = {}
    for number in numbers:
        model, training, own = chosen[number]
        layers = populations_of(model, len(data.classes), data.spikes.step_ms, own("time constants"))
        start = initialise(probe, model, layers, len(data.classes), own("initialisation"))
        populations = [
            Population(
                p.keep[0],
                p.keep[1],
                p.threshold / 64,
                exponential(p.to_threshold, tau, model.scale_grad),
            )
            for p, tau in zip(layers, (model.tau_grad, model.output_tau_grad), strict=True)
        ]
        epochs = np.arange(training.epochs)[:, None] + np.arange(n_batches) / n_batches
        found[number] = TaskDesign(
            start.feed_forward,
            populations,
            model.true_rate,
            model.false_rate,
            np.vectorize(training.rate)(epochs),
        )
    return Task(
        dense(rows),
        data.target,
        np.stack([batches.permutation(data.train) for _ in range(training.epochs)]),
        data.validation,
        training.batch_size,
        found,
    )
