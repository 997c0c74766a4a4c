"""What a worker does for a study: prepare a data set, or train one design once and record it.

A job carries paths and settings only; spikes are read from the prepared data set as a memory map.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dse import dataset, seeds, store
from dse.measure import measure
from dse.records import Array


@dataclasses.dataclass(frozen=True)
class Preparation:
    """Prepare the data set of `sections` (a resolved design) at `folder`; data files lie beside `base`."""

    sections: Mapping[str, Any]
    base: Path
    folder: Path


@dataclasses.dataclass(frozen=True)
class Run:
    """Train a design once.

    sections: the design resolved. model, training: the components of those sections.
    data: folder of the prepared data set. folder: where the run is published.
    phi, theta: decision grid. hardware: names of profiles.
    """

    trial: int
    repeat: int
    design: Mapping[str, Any]
    seed: int
    sections: Mapping[str, Any]
    model: Any
    training: Any
    data: Path
    folder: Path
    phi: tuple[float, ...]
    theta: tuple[float, ...]
    hardware: tuple[str, ...]


def prepare(job: Preparation) -> list[str]:
    """Build and save a data set; return the warnings about it."""
    built, warnings = dataset.build(job.sections, job.base)
    with store.explained(job.folder):
        dataset.save(built, job.folder)
    return warnings


def train(job: Run) -> dict[str, Any]:
    """Train, measure and publish one run; return its record."""

    def rngs(purpose: str, *index: int) -> np.random.Generator:
        return seeds.generator(job.seed, job.design, purpose, job.repeat, *index)

    data = dataset.load(job.data)
    outcome = job.model.fit(data, job.training, rngs)
    found = measure(outcome, data, np.array(job.phi), np.array(job.theta), job.hardware)
    record = {
        "trial": job.trial,
        "repeat": job.repeat,
        "design": dict(job.design),
        "seed": job.seed,
        "sections": dict(job.sections),
        "classes": list(data.classes),
        "data": job.data.name,
        "status": "finished",
        "reason": "",
        "columns": found.columns,
        "hardware": found.hardware,
    }
    arrays = {
        "weights.npz": store.network_arrays(outcome.network),
        "response.npz": store.response_arrays(outcome.validation, data.validation),
        "confusion.npz": {"validation": found.confusion},
        "history.npz": dict(outcome.history),
    }
    if outcome.test is not None:
        arrays["response_test.npz"] = store.response_arrays(outcome.test, data.test)
    if found.confusion_test is not None:
        arrays["confusion.npz"]["test"] = found.confusion_test
    if found.points:
        arrays["surface.npz"] = _surface(job, found.points, found.hardware_points)
    files = {name: _writer(content) for name, content in arrays.items()}
    store.save_run(job.folder, record, files)
    return record


def _writer(arrays: Mapping[str, Array]) -> Any:
    return lambda path: store.save_arrays(path, arrays)


def _surface(
    job: Run, points: Mapping[str, Array], hardware: Mapping[str, Mapping[str, Array]]
) -> dict[str, Array]:
    per_profile = {
        f"{name}/{column}": x for name, columns in hardware.items() for column, x in columns.items()
    }
    return {"phi": np.array(job.phi), "theta": np.array(job.theta), **points, **per_profile}
