"""Evaluating trained networks at other precisions; the results are files (`dse.study.precision`)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from dse import store
from dse.models.snn.quantise import rounded
from dse.neurons.fixed_point import STATE_LIMIT
from dse.records import Network, Outcome, Response
from dse.study import jobs, precision
from dse.study.executors.work import Failure
from dse.study.precision import Setting
from dse.study.record import Numbers, RunRecord


@dataclass(frozen=True)
class Job:
    """Evaluate a trained run at some settings."""

    run: jobs.Run
    settings: tuple[Setting, ...]


def evaluate(job: Job) -> Iterator[tuple[Setting, Failure | None]]:
    """Evaluate a run at its settings, one after the other; each result is stored at once.

    Yields:
        A setting, and None after it is stored, or why it failed. An error that fails all settings is raised.
    """
    loaded = jobs.load(job.run)
    network = store.fitted_of(store.load_arrays(job.run.folder / "weights.npz"))
    record = store.read_record(job.run.folder)
    trained = RunRecord.from_plain(record, job.run.folder).measured.columns
    run = job.run
    if run.phi_step is not None:  # the same settings as in training
        surface = next(x for x in record["files"] if x.startswith("surface"))
        phi = store.load_arrays(run.folder / surface)["phi"]
        run = dataclasses.replace(run, phi=tuple(phi.tolist()))
    for setting in job.settings:
        why = None
        try:
            _evaluate(run, setting, network, loaded, trained)
        except (store.StoreError, MemoryError):
            raise  # a full disk is not the run's fault
        except Exception as error:
            why = Failure.of(error)
        yield setting, why


def _evaluate(
    run: jobs.Run, setting: Setting, network: object, loaded: jobs.Loaded, trained: Mapping[str, Any]
) -> None:
    """Measure a run at a setting and publish its file."""
    if not isinstance(network, Network):
        raise TypeError(f"only a Network can be rounded, got {type(network).__name__}")
    data = loaded.data
    fewer = rounded(network, *setting)
    validation = run.sections.model.respond(fewer, data, data.validation)
    test = run.sections.model.respond(fewer, data, data.test) if data.test.size else None
    assert isinstance(validation, Response)  # a network answers with spikes
    health = {
        "peak_state": validation.peak_state,
        "overflows_24_bit": validation.peak_state > STATE_LIMIT,
        "n_weights_dense": fewer.n_weights_dense,
    }
    reported = {name: x for name, x in health.items() if name in trained}  # not every family reports all
    outcome = Outcome(fewer, validation, test, {}, reported, trained.get("train_s", 0.0))
    measurement = run.measured(outcome, data, setting[0])
    files = jobs.arrays_of(run, measurement, "")
    for name, head in measurement.heads.items():
        files |= jobs.arrays_of(run, head, f"_{name}")
    precision.save(run.folder, setting, Numbers.of(measurement, loaded.leak), files)
