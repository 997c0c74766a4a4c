"""One training run -> the record's columns: accuracy, spikes, operations, time and energy, exactly.

The full read-out answers at the end of the window by argmax of the output spike counts (lowest class on
ties). Every (phi, theta) setting answers earlier; what it costs is the mean work that was done up to each
sample's own decision, never a share of the whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse import decision
from dse.hardware.cost import cost
from dse.hardware.profile import load as load_profile
from dse.metrics.accuracy import accuracy, wilson_se
from dse.metrics.confusion import confusion
from dse.metrics.latency import decision_latency_ms, latency_ms
from dse.metrics.n_weights import n_weights
from dse.metrics.spikes import spikes_per_inference, spikes_per_inference_no_input, spikes_total
from dse.metrics.synaptic_operations import synaptic_operations
from dse.records import Array, Dataset, Network, Outcome, Response, Workload


@dataclass(frozen=True)
class Measurement:
    """What one run measured, on the validation set unless the name says test.

    columns: the full read-out, column -> number.
    points: column -> (phi, theta); empty without a decision grid.
    hardware, hardware_points: the same per hardware profile.
    confusion, confusion_test: (true class, answered class) counts of the full read-out.
    """

    columns: dict[str, Any]
    points: dict[str, Array]
    hardware: dict[str, dict[str, Any]]
    hardware_points: dict[str, dict[str, Array]]
    confusion: Array
    confusion_test: Array | None


def measure(
    outcome: Outcome, dataset: Dataset, phi: Array, theta: Array, hardware: Sequence[str]
) -> Measurement:
    """Measure one run.

    Args:
        outcome: what the model family returned.
        dataset: what it was trained on.
        phi: spike offsets of the decision grid.
        theta: its confidences; both empty for the full read-out only.
        hardware: names of hardware profiles.

    Raises:
        ValueError: a response holds no samples, or the grid is out of range.
    """
    network, response = outcome.network, outcome.validation
    target, n_classes = dataset.target[dataset.validation], len(dataset.classes)
    label = read_out(response.output)
    n, n_steps = response.output.shape[:2]
    correct = int((label == target).sum())
    last = np.full(n, n_steps - 1)
    columns: dict[str, Any] = {
        "accuracy": accuracy(label, target),
        "accuracy_se": float(wilson_se(correct, n)),
        "n_weights": n_weights(network),
        "decision_latency_ms": decision_latency_ms(last, response.step_ms),
    }
    confusion_test = None
    if outcome.test is not None:
        label_test, target_test = read_out(outcome.test.output), dataset.target[dataset.test]
        columns["accuracy_test"] = accuracy(label_test, target_test)
        confusion_test = confusion(label_test, target_test, n_classes)

    work = _cumulative_work(response)
    full = work[:, -1].mean(axis=0)
    load = _workload(network, full, np.array(float(n_steps)), response.step_ms)
    columns |= {name: x.item() for name, x in _activity(load, n).items()}
    on_hardware = {
        name: {column: x.item() for column, x in columns_on(name, load).items()} for name in hardware
    }

    points: dict[str, Array] = {}
    points_on_hardware: dict[str, dict[str, Array]] = {}
    if len(phi) and len(theta):
        found = decision.surface(response.output, target, phi, theta, response.step_ms, work)
        load = _workload(network, found.work, found.decision_latency_ms / response.step_ms, response.step_ms)
        points = {
            "accuracy": found.accuracy,
            "accuracy_se": wilson_se(np.rint(found.accuracy * n), n),
            "accuracy_strict": found.accuracy_strict,
            "decision_latency_ms": found.decision_latency_ms,
            "undecided": found.undecided,
            "ties": found.ties,
            **_activity(load, n),
        }
        if outcome.test is not None:
            test = decision.surface(outcome.test.output, target_test, phi, theta, outcome.test.step_ms)
            points["accuracy_test"] = test.accuracy
        points_on_hardware = {name: columns_on(name, load) for name in hardware}
        columns["t_p_ms"] = decision.t_p(found).decision_latency_ms
        human = decision.t_h(found)
        columns["t_h_ms"] = None if human is None else human.decision_latency_ms
    # Health that is one number is a column; the rest stays in the record.
    columns |= {name: x for name, x in outcome.health.items() if isinstance(x, bool | int | float)}
    columns["train_s"] = outcome.train_s
    return Measurement(
        columns, points, on_hardware, points_on_hardware, confusion(label, target, n_classes), confusion_test
    )


def read_out(output: Array) -> Array:
    """Return the class with most output spikes over the window, (n,); the lowest class on ties."""
    return np.asarray(output.sum(axis=1, dtype=np.int64).argmax(axis=1))


def columns_on(profile: str, load: Workload) -> dict[str, Array]:
    """Return the hardware columns of a workload on one profile, in the shape of `load.n_steps`."""
    found = cost(load_profile(profile), load)
    decision_ms = load.n_steps * load.step_ms
    columns = {
        "energy_uj": found.energy_uj,
        "energy_dynamic_uj": found.dynamic_uj,
        "energy_static_uj": found.static_uj,
        "energy_static_throttled_uj": found.static_throttled_uj,
        "energy_uj_low": found.energy_uj_low,
        "energy_uj_high": found.energy_uj_high,
        "hardware_latency_ms": found.hardware_latency_ms,
        "latency_ms": latency_ms(decision_ms, load.step_ms, found.step_time_us),
        "n_cores": found.n_cores,
        "fits": found.fits,
    }
    return {
        name: np.broadcast_to(np.asarray(x), np.shape(load.n_steps)).copy() for name, x in columns.items()
    }


def _cumulative_work(response: Response) -> Array:
    """Return spikes and updates per layer, done up to and including each step, (n, T, layer + layer - 1)."""
    return np.concatenate([response.spikes, response.updates], axis=2).cumsum(axis=1, dtype=np.int64)


def _workload(network: Network, work: Array, n_steps: Array, step_ms: float) -> Workload:
    """Return mean work (..., layer + layer - 1) as a workload with the same leading axes."""
    n_layers = len(network.sizes)
    return Workload(
        sizes=network.sizes,
        recurrent=tuple(layer.recurrent is not None for layer in network.layers),
        n_steps=n_steps,
        spikes=work[..., :n_layers],
        updates=work[..., n_layers:],
        step_ms=step_ms,
    )


def _activity(load: Workload, n: int) -> dict[str, Array]:
    """Return spikes and synaptic operations; `n` samples were evaluated."""
    return {
        "spikes_per_inference": spikes_per_inference(load),
        "spikes_per_inference_no_input": spikes_per_inference_no_input(load),
        "spikes_total": spikes_total(load, n),
        "synaptic_operations": synaptic_operations(load),
    }
