"""A study that takes no time: a few recordings, and model families that answer without training."""

from __future__ import annotations

import itertools
import os
import signal
import sys
import time
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dse.base import registry
from dse.base.records import Array, Dataset, Layer, Network, Outcome, Response
from dse.base.registry import param
from dse.config import load_space
from dse.models.training import FitRequest, Generators, Rung, Span, TrainingDiverged
from dse.store import StoreError
from dse.study import explore
from tests.layers import cuba_parameters
from tests.waiting import until

REAL = """
study: real
seed: 3
data: {kind: raster, file: tiny.npz, step_ms: 5.0, columns: {fabric: label}, class_names: {fabric: names}}
task: {target: fabric}
window: {n_steps: 16, at: middle}
split: {stratified: {validation: 0.5}}
model: {kind: snn, hidden: [12], input_delays: [0, 2]}
training: {epochs: 4, batch_size: 9, learning_rate: 0.02}
decision: {phi: [0, 2], theta: [0.4, 0.6]}
hardware: [loihi1_silicon]
objectives: [accuracy:max, energy_uj:min]
search: {sampler: grid, repeats: 2}
execution: {jobs: 1}
"""
"""A search space of real networks on the recordings of `write_recordings`."""

N_CHANNELS, N_STEPS, N_PER_CLASS = 4, 20, 12


@dataclass(frozen=True)
class Fake:
    """Answers well with a probability that grows with `hidden`, after doing what `mood` says."""

    hidden: tuple[int, ...] = param((8,), low=1, doc="neurons")
    true_rate: float = param(0.8, low=0, high=1, doc="changes nothing")
    mood: str = param(
        "fine",
        choices=("fine", "raise", "memory", "nan", "killed", "killed_twice", "slow"),
        doc="what happens in training",
    )
    seconds: float = param(0.0, low=0, doc="time that training takes")
    gate: str = param(
        "", doc="file that networks of 4 neurons wait for; that counts how often one was killed"
    )

    def fit(self, dataset: Dataset, training: Any, rngs: Any) -> Outcome:
        time.sleep(self.seconds)
        if self.gate and self.hidden[0] == 4:
            until(Path(self.gate).exists, f"{self.gate} to exist")
        if self.mood == "killed_twice":
            with open(self.gate, "ab") as file:
                file.write(b".")
                died_before = file.tell() > 2
            if not died_before:
                os.kill(os.getpid(), signal.SIGKILL)
        if self.mood == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.mood == "raise":
            raise ValueError("hidden must be kind")
        if self.mood == "memory":
            raise MemoryError
        rng = rngs("initialisation")
        sizes = (dataset.spikes.n_channels, *self.hidden, len(dataset.classes))
        layers = tuple(
            Layer(
                weight=rng.normal(size=(n_out, n_in)).astype(np.float32),
                recurrent=None,
                parameters=cuba_parameters(np.full(n_out, 1024, np.int32), np.full(n_out, 123, np.int32), 80),
            )
            for n_in, n_out in itertools.pairwise(sizes)
        )
        network = Network(layers, sizes[0], (0,), 1, "integer")
        history = {"loss": np.linspace(1, 0, training.epochs)}
        validation = self._answer(dataset, dataset.validation, rng, sizes)
        test = self._answer(dataset, dataset.test, rng, sizes) if dataset.test.size else None
        health = {"dead_neurons": 0, "overflows_24_bit": False, "initial_gain": [1.0]}
        return Outcome(network, validation, test, history, health, self.seconds)

    def _answer(
        self, dataset: Dataset, samples: Array, rng: np.random.Generator, sizes: tuple[int, ...]
    ) -> Response:
        n, n_steps, n_classes = len(samples), dataset.n_steps, len(dataset.classes)
        output = rng.random((n, n_steps, n_classes)) < 0.1
        knows = rng.random(n) < 1 - 1 / (1 + self.hidden[0] / 4)
        output[np.flatnonzero(knows), :, dataset.target[samples][knows]] |= (
            rng.random((knows.sum(), n_steps)) < 0.5
        )
        spikes = rng.integers(0, 3, (n, n_steps, len(sizes)), dtype=np.int32)
        spikes[..., -1] = output.sum(axis=2)
        updates = rng.integers(0, 3, (n, n_steps, len(sizes) - 1), dtype=np.int32)
        return Response(output.astype(np.uint8), spikes, updates, dataset.spikes.step_ms, 1000)


class _NoMemory(np.ndarray):
    """An array of which nothing can be made."""

    def __new__(cls) -> _NoMemory:
        return np.zeros((1, 1, 1)).view(cls)

    def sum(self, *_: Any, **__: Any) -> Any:
        raise MemoryError


@dataclass(frozen=True)
class Together(Fake):
    """The same in cohorts: one design finishes after the other, after doing what its `mood` says."""

    mood: str = param(
        "fine",
        choices=("fine", "killed", "diverged", "misshapen", "forgotten", "raise", "crowded"),
        doc="what happens in training",
    )
    megabytes: int = param(1, doc="memory that it claims to need", low=0)
    input_delays: tuple[int, ...] = param((0,), doc="changes nothing")
    steps_per_sample: int = param(1, doc="changes nothing")

    @staticmethod
    def fit_cohort(
        dataset: Dataset,
        designs: Sequence[FitRequest],
        shared: Generators,
        device: str = "cpu",
        threads: int = 1,
    ) -> Iterator[tuple[int, Outcome | TrainingDiverged]]:
        first_sample = shared("batches").permutation(dataset.train)[0]
        for number, (model, training, rngs) in reversed(list(enumerate(designs))):
            if model.mood == "forgotten":
                continue
            if model.mood == "diverged":
                yield number, TrainingDiverged("loss is not finite in epoch 1")
                continue
            outcome = model.fit(dataset, training, rngs)
            if model.mood == "misshapen":
                nothing = outcome.validation.output[:, :0]
                outcome = replace(outcome, validation=replace(outcome.validation, output=nothing))
            if model.mood == "crowded" and len(designs) > 1:
                outcome = replace(outcome, validation=replace(outcome.validation, output=_NoMemory()))
            history = {**outcome.history, "members": np.array(len(designs))}
            health = {**outcome.health, "first_sample": int(first_sample)}
            yield number, replace(outcome, history=history, health=health)

    def shares(self, training: Any) -> tuple[Hashable, ...]:
        return (training.batch_size,)

    def n_weights(self, n_channels: int, n_classes: int) -> int:
        return sum(a * b for a, b in itertools.pairwise((n_channels, *self.hidden, n_classes)))

    def memory_bytes(self, n_channels: int, n_classes: int, n_steps: int, training: Any) -> int:
        return self.megabytes * 2**20

    def workspace_bytes(
        self, n_channels: int, n_classes: int, n_steps: int, training: Any, threads: int = 1
    ) -> int:
        return 0

    def cost(
        self, n_channels: int, n_classes: int, n_steps: int, n_events: float, n_train: int, training: Any
    ) -> float:
        return 1.0


@dataclass(frozen=True)
class Curve(Together):
    """The same, with trainings that can pause: the share of right answers rises to `true_rate`."""

    mood: str = param("fine", choices=("fine", "diverged"), doc="what happens in training")
    rises: float = param(2.0, low=0, doc="epochs in which it gains all but a third of it")

    def fit(self, dataset: Dataset, training: Any, rngs: Any) -> Outcome:
        return self.after(training.epochs, dataset, training, rngs)

    def after(self, epochs: int, dataset: Dataset, training: Any, rngs: Any) -> Outcome:
        outcome = super().fit(dataset, training, rngs)
        right = self.true_rate * (1 - np.exp(-epochs / self.rises))
        n_right = round(right * len(dataset.validation))
        output = np.zeros_like(outcome.validation.output)
        label = dataset.target[dataset.validation]
        answer = np.where(np.arange(len(label)) < n_right, label, (label + 1) % len(dataset.classes))
        output[np.arange(len(label)), :, answer] = 1
        return replace(outcome, validation=replace(outcome.validation, output=output))

    @staticmethod
    def fit_cohort(
        dataset: Dataset,
        designs: Sequence[FitRequest],
        shared: Generators,
        device: str = "cpu",
        threads: int = 1,
    ) -> Iterator[tuple[int, Outcome | TrainingDiverged]]:
        yield from Curve.fit_span(dataset, designs, shared, device, threads)

    @staticmethod
    def fit_span(
        dataset: Dataset,
        designs: Sequence[FitRequest],
        shared: Generators,
        device: str = "cpu",
        threads: int = 1,
        span: Span | None = None,
    ) -> Iterator[tuple[int, Outcome | Rung | TrainingDiverged]]:
        for number, (model, training, rngs) in enumerate(designs):
            span = span or Span()
            start = int(span.states[number]()["epochs"]) if span.states else 0
            until = span.until or training.epochs
            if model.mood == "diverged" and start < 3 <= until:
                yield number, TrainingDiverged("loss is not finite in epoch 3")
            elif until < training.epochs:
                outcome = model.after(until, dataset, training, rngs)
                yield number, Rung(until, {"epochs": np.array(until)}, outcome)
            else:
                yield number, model.fit(dataset, training, rngs)


FAMILIES = {"fake": Fake, "together": Together, "curve": Curve}


def write_recordings(path, seed=0):
    """Write labelled rasters of three classes, each with a channel that spikes most."""
    rng = np.random.default_rng(seed)
    label = np.repeat(np.arange(3), N_PER_CLASS)
    rate = np.full((len(label), 1, N_CHANNELS), 0.05)
    rate[np.arange(len(label)), 0, label] = 0.5
    raster = (rng.random((len(label), N_STEPS, N_CHANNELS)) < rate).astype(np.uint8)
    np.savez(path, spikes=raster, label=label, names=np.array(["felt", "silk", "wool"]))
    return path


def plain(**changes):
    """Return a search space as plain data; keywords replace whole sections."""
    return {
        "study": "tiny",
        "seed": 7,
        "data": {
            "kind": "raster",
            "file": "tiny.npz",
            "step_ms": 5.0,
            "columns": {"fabric": "label"},
            "class_names": {"fabric": "names"},
        },
        "task": {"target": "fabric"},
        "split": {"stratified": {"validation": 0.5}},
        "model": {
            "kind": "fake",
            "hidden": {"choice": [[4], [8], [16]]},
            "true_rate": {"choice": [0.2, 0.8]},
        },
        "training": {"epochs": 2},
        "decision": {"phi": [0, 4], "theta": [0.4, 0.7, 1.0]},
        "hardware": ["loihi1_silicon"],
        "objectives": ["accuracy:max", "n_weights:min", "energy_uj:min"],
        "search": {"sampler": "grid", "batch": 4},
        "execution": {"jobs": 2},
        **changes,
    }


def make_space(folder, **changes):
    """Write a search space and its recordings into a folder and load it."""
    if not (folder / "tiny.npz").exists():
        write_recordings(folder / "tiny.npz")
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump(plain(**changes), sort_keys=False))
    register()
    return load_space(path)


def register():
    """Make the families of this file known; the fixture `registered` undoes it."""
    registry._components.setdefault("models", {}).update(FAMILIES)


def run_folder(folder):
    """Run the study of a folder as the command line does; return the exit code."""
    register()
    try:
        explore.run(load_space(Path(folder) / "tiny.yaml"), Path(folder) / "results", progress=False)
    except KeyboardInterrupt:
        return 130
    except StoreError as error:
        print(error, file=sys.stderr)
        return 2
    return 0
