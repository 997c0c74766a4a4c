"""One training run -> the record's columns: accuracy, spikes, operations, time and energy, exactly.

The full read-out answers at the end of the window: a spiking network by argmax of its output spike counts
(lowest class on ties), any other classifier as it does. Earlier read-outs answer after a shorter input. Every
(phi, theta) setting of a spiking network answers when it is confident; what that costs is the mean work that
was done up to each sample's own decision, never a share of the whole.

A joint target has a measurement for each of its heads; its own accuracy counts samples with every head right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dse.hardware.cost import NotApplicable, cost, drawn
from dse.hardware.profile import Figures, Profile
from dse.measure import decision
from dse.measure.heads import head_answers, head_slices, joint_label
from dse.measure.objectives.accuracy import accuracy, wilson_se
from dse.measure.objectives.confusion import confusion
from dse.measure.objectives.information import itr_bits, itr_bits_per_s
from dse.measure.objectives.latency import latency_ms
from dse.measure.objectives.memory_bytes import memory_bytes
from dse.measure.objectives.n_weights import n_weights
from dse.measure.objectives.spikes import spikes_per_inference, spikes_per_inference_no_input, spikes_total
from dse.measure.objectives.synaptic_operations import synaptic_operations
from dse.records import (
    Answers,
    Array,
    Dataset,
    Head,
    Network,
    Operations,
    Outcome,
    Parameters,
    Response,
    Workload,
)

READ_OUTS = 20
"""Input lengths, evenly spaced, after which a spiking network is read out."""

Columns = dict[str, Array]

DRAWN = ("energy_uj", "energy_throttled_uj", "hardware_latency_ms", "latency_ms")
"""Hardware columns that depend on a chip's figures; `drawn_on` draws them."""

# What the decision maker reaches when the input ends after each length, and the settings that do it.
_OF_DECISIONS = (
    *("accuracy_best", "t_p_ms", "phi_p", "theta_p", "t_h_ms", "phi_h", "theta_h"),
    *("accuracy_best_strict", "t_p_strict_ms", "t_h_strict_ms"),
)


@dataclass(frozen=True)
class Measurement:
    """What one run measured, on the validation set unless the name says test.

    columns: the full read-out, column -> number.
    points: column -> (phi, theta); empty without a decision grid.
    read_outs: column -> (k,), after time_ms[j] of the input.
    points_load, read_outs_load: mean work of the same answers, which any hardware can be asked the cost of.
    hardware: profile -> `columns_on` of the full read-out.
    confusion, confusion_test: (true class, answered class) counts of the full read-out.
    heads: of a joint target, head -> its own measurement.
    """

    columns: dict[str, Any]
    points: Columns
    read_outs: Columns
    points_load: Workload | Operations | None
    read_outs_load: Workload | Operations | None
    hardware: dict[str, dict[str, Any]]
    confusion: Array
    confusion_test: Array | None
    heads: dict[str, Measurement] = field(default_factory=dict)


@dataclass(frozen=True)
class _Question:
    """What is asked of the answers: true classes of both sets, how many there are, the outputs that answer.

    joint_of: (n_joint,) class of each joint class, where answers are joint classes; None where they are not.
    """

    target: Array
    target_test: Array
    n_classes: int
    outputs: slice
    joint_of: Array | None = None


@dataclass(frozen=True)
class _Work:
    """Mean work per inference, each (...,), and the same as hardware is asked for its cost."""

    spikes: Array
    spikes_no_input: Array
    additions: Array
    macs: Array
    load: Workload | Operations


def measure(
    outcome: Outcome,
    dataset: Dataset,
    phi: Array,
    theta: Array,
    hardware: Sequence[Profile],
    weight_bits: int = 8,
) -> Measurement:
    """Measure one run.

    Args:
        outcome: what the model family returned.
        dataset: what it was trained on.
        phi: spike offsets of the decision grid.
        theta: its confidences; both empty for the full read-out only. Spiking families alone have one.
        hardware: profiles that the full read-out is priced on.
        weight_bits: bits per weight of a spiking network.

    Raises:
        ValueError: a response holds no samples, or the grid is out of range.
    """
    truth, truth_test = dataset.target[dataset.validation], dataset.target[dataset.test]
    if not dataset.heads:
        asked = _Question(truth, truth_test, len(dataset.classes), slice(None))
        return _measured(outcome, asked, phi, theta, hardware, weight_bits)
    heads = {
        head.name: _measured(
            outcome, _of_head(head, outputs, truth, truth_test), phi, theta, hardware, weight_bits
        )
        for head, outputs in zip(dataset.heads, head_slices(dataset), strict=True)
    }
    n_classes = len(dataset.classes)
    right, labels = _joint_labels(outcome.validation, dataset, truth)
    first = next(iter(heads.values()))
    n, correct = len(truth), int(right.sum())
    matrix, matrix_test = confusion(labels[labels >= 0], truth[labels >= 0], n_classes), None
    unnamed = np.bincount(truth[labels < 0], minlength=n_classes)  # combinations that no class is
    columns = {
        **first.columns,
        "accuracy": correct / n,
        "accuracy_se": float(wilson_se(correct, n)),
        **{f"accuracy_{name}": found.columns["accuracy"] for name, found in heads.items()},
        **_information(np.column_stack([matrix, unnamed]), first.columns["decision_latency_ms"]),
    }
    if outcome.test is not None:
        right, labels = _joint_labels(outcome.test, dataset, truth_test)
        columns["accuracy_test"] = float(right.mean())
        matrix_test = confusion(labels[labels >= 0], truth_test[labels >= 0], n_classes)
        columns |= {f"accuracy_test_{name}": found.columns["accuracy_test"] for name, found in heads.items()}
    for name in ("t_p_ms", "t_h_ms", "t_c_ms"):  # times of a head's own decisions
        columns.pop(name, None)
    return Measurement(columns, {}, {}, None, None, first.hardware, matrix, matrix_test, heads)


def read_out(output: Array) -> Array:
    """Return the class with most output spikes over the window, (n,); the lowest class on ties."""
    return np.asarray(output.sum(axis=1, dtype=np.int64).argmax(axis=1))


def columns_on(profile: Profile, load: Workload | Operations) -> Columns:
    """Return the hardware columns of some work on one profile, in the shape of its counts.

    A chip that cannot run such a classifier has no columns, and counted operations have energies only.
    """
    try:
        found = cost(profile, load)
    except NotApplicable:
        return {}
    columns: Mapping[str, Any] = found.energy_uj.columns("energy_uj")
    if found.timed:
        columns = {
            **columns,
            "energy_dynamic_uj": found.dynamic_uj,
            "energy_static_uj": found.static_uj.value,
            "energy_static_throttled_uj": found.static_throttled_uj.value,
            **found.energy_throttled_uj.columns("energy_throttled_uj"),
            "idle_mw": found.idle_mw,
            "hardware_latency_ms": found.hardware_latency_ms,
            "latency_ms": _latency_ms(load, found.step_time_us.value) + found.pipeline_ms,
            "n_cores": found.n_cores.value,
            "n_cores_high": found.n_cores.high,
            "fits": found.fits,
        }
    shape = np.shape(found.energy_uj.value)
    return {name: np.broadcast_to(np.asarray(x), shape).copy() for name, x in columns.items()}


def drawn_on(profile: Profile, load: Workload | Operations, figures: Figures) -> Columns:
    """Return the hardware columns that depend on a chip's figures, under draws of them: (draw, ...) each.

    Args:
        profile: the chip.
        load: counts (...).
        figures: `profile.drawn`, the same for all that are to be compared.

    Returns:
        Some of `columns_on`; none where the chip cannot run the classifier.
    """
    try:
        found = drawn(profile, load, figures)
    except NotApplicable:
        return {}
    return {
        "energy_uj": found.energy_uj,
        "energy_throttled_uj": found.energy_throttled_uj,
        "hardware_latency_ms": found.hardware_latency_ms,
        "latency_ms": _latency_ms(load, found.step_time_us),
    }


def _latency_ms(load: Workload | Operations, step_time_us: Array) -> Array:
    if isinstance(load, Operations):  # computes once, when the input is complete
        return np.asarray(load.duration_ms + step_time_us * 1e-3)
    return latency_ms(load.n_steps * load.step_ms, load.step_ms, step_time_us)


def _of_head(head: Head, outputs: slice, truth: Array, truth_test: Array) -> _Question:
    return _Question(
        head.of_class[truth], head.of_class[truth_test], len(head.classes), outputs, head.of_class
    )


def _joint_labels(said: Response | Answers, dataset: Dataset, truth: Array) -> tuple[Array, Array]:
    """Return whether every head is right, and the joint class that is answered, -1 where there is none."""
    if isinstance(said, Answers):
        label = said.label[:, -1]
    else:
        label = joint_label(head_answers(dataset, said.output.sum(axis=1, dtype=np.int64)), dataset.heads)
    return label == truth, label


def _measured(
    outcome: Outcome,
    asked: _Question,
    phi: Array,
    theta: Array,
    hardware: Sequence[Profile],
    weight_bits: int,
) -> Measurement:
    found, points, points_work = (
        _of_spikes(outcome, asked, phi, theta, weight_bits)
        if isinstance(outcome.validation, Response)
        else (_of_answers(outcome, asked), {}, None)
    )
    n = len(asked.target)
    work = found.work
    bits = work.load.number_bits
    read_outs = found.read_outs | {"memory_bytes": memory_bytes(found.read_outs["n_weights"], np.array(bits))}
    columns = {
        "accuracy": read_outs["accuracy"][-1].item(),
        "accuracy_se": read_outs["accuracy_se"][-1].item(),
        **({} if found.label_test is None else {"accuracy_test": read_outs["accuracy_test"][-1].item()}),
        "n_weights": int(read_outs["n_weights"][-1]),
        "memory_bytes": read_outs["memory_bytes"][-1].item(),
        "decision_latency_ms": read_outs["decision_latency_ms"][-1].item(),
        **{name: x[-1].item() for name, x in _activity(work, n).items()},
    }
    matrix = confusion(found.label, asked.target, asked.n_classes)
    columns |= _information(matrix, columns["decision_latency_ms"])
    columns["t_c_ms"] = decision.t_c(read_outs["decision_latency_ms"], read_outs["accuracy"])
    columns |= found.times
    # Health that is one number is a column; the rest stays in the record.
    columns |= {name: x for name, x in outcome.health.items() if isinstance(x, bool | int | float)}
    columns["train_s"] = outcome.train_s
    full = work.load.mapped(lambda counts: counts[-1])
    return Measurement(
        columns,
        points,
        {**read_outs, **_activity(work, n)},
        points_work.load if points_work else None,
        work.load,
        {chip.name: {column: x.item() for column, x in columns_on(chip, full).items()} for chip in hardware},
        matrix,
        None if found.label_test is None else confusion(found.label_test, asked.target_test, asked.n_classes),
    )


@dataclass(frozen=True)
class _ReadOuts:
    """Answers after k input lengths: columns (k,), their work, the last labels, times to decide."""

    read_outs: Columns
    work: _Work
    label: Array
    label_test: Array | None
    times: dict[str, float | None]


def _of_answers(outcome: Outcome, asked: _Question) -> _ReadOuts:
    said, test = outcome.validation, outcome.test
    assert isinstance(said, Answers) and not isinstance(test, Response)  # a family answers in one way

    def labels(answers: Answers) -> Array:
        return answers.label if asked.joint_of is None else asked.joint_of[answers.label]

    label = labels(said)
    test_label = None if test is None else labels(test)
    spikes = said.input_spikes.mean(axis=0)
    read_outs = {
        **_accuracies(label, asked.target),
        "decision_latency_ms": np.asarray(said.time_ms, np.float64),
        "n_weights": np.asarray(said.n_weights),
    }
    if test_label is not None:
        read_outs["accuracy_test"] = (test_label == asked.target_test[:, None]).mean(axis=0)
    macs, additions = np.asarray(said.macs, np.float64), np.asarray(said.additions, np.float64)
    load = Operations(
        macs, additions, np.zeros_like(macs), np.asarray(said.n_weights), np.asarray(said.time_ms, np.float64)
    )
    work = _Work(spikes, np.zeros_like(spikes), additions, macs, load)
    return _ReadOuts(read_outs, work, label[:, -1], None if test_label is None else test_label[:, -1], {})


def _of_spikes(
    outcome: Outcome, asked: _Question, phi: Array, theta: Array, weight_bits: int
) -> tuple[_ReadOuts, Columns, _Work | None]:
    network, said, test = outcome.network, outcome.validation, outcome.test
    assert isinstance(said, Response) and not isinstance(test, Answers)  # a family answers in one way
    output = said.output[..., asked.outputs]
    n, n_steps = output.shape[:2]
    if not n or not n_steps:
        raise ValueError(
            f"a response must have at least one sample and one step, got output of shape {output.shape}"
        )
    lengths = np.unique(np.rint(np.linspace(n_steps / READ_OUTS, n_steps, READ_OUTS)).astype(int))
    lengths = lengths[lengths > 0]
    label = _labels_after(output, lengths)
    per_step = np.concatenate([said.spikes, said.updates], axis=2)
    done = per_step.cumsum(axis=1, dtype=np.int64)
    work = _spiking_work(network, said, done[:, lengths - 1].mean(axis=0), lengths, weight_bits)
    read_outs = {
        **_accuracies(label, asked.target),
        "decision_latency_ms": lengths * said.step_ms,
        "n_weights": np.full(len(lengths), _n_weights(network)),
    }
    label_test = None
    if test is not None:
        label_test = _labels_after(test.output[..., asked.outputs], lengths)
        read_outs["accuracy_test"] = (label_test == asked.target_test[:, None]).mean(axis=0)
        label_test = label_test[:, -1]
    times: dict[str, float | None] = {}
    points: Columns = {}
    points_work = None
    if len(phi) and len(theta):
        found = decision.surface(output, asked.target, phi, theta, said.step_ms, done)
        n_steps_done = found.decision_latency_ms / said.step_ms
        points_work = _spiking_work(network, said, found.work, n_steps_done, weight_bits)
        points = {
            "accuracy": found.accuracy,
            "accuracy_se": wilson_se(np.rint(found.accuracy * n), n),
            "accuracy_strict": found.accuracy_strict,
            "decision_latency_ms": found.decision_latency_ms,
            "undecided": found.undecided,
            "ties": found.ties,
            **_activity(points_work, n),
        }
        if test is not None:
            settings = (asked.target_test, phi, theta, test.step_ms)
            points["accuracy_test"] = decision.surface(test.output[..., asked.outputs], *settings).accuracy
        early = decision.early(output, asked.target, lengths, phi, theta, said.step_ms)
        read_outs |= {name: getattr(early, name) for name in _OF_DECISIONS}
        times["t_p_ms"] = decision.t_p(found).decision_latency_ms
        human = decision.t_h(found)
        times["t_h_ms"] = None if human is None else human.decision_latency_ms
    return _ReadOuts(read_outs, work, label[:, -1], label_test, times), points, points_work


def _accuracies(label: Array, target: Array) -> Columns:
    """Return accuracy and its error after each of k read-outs; label: (n, k)."""
    found = np.array([accuracy(column, target) for column in label.T])
    return {"accuracy": found, "accuracy_se": wilson_se(np.rint(found * len(target)), len(target))}


def _labels_after(output: Array, lengths: Array) -> Array:
    """Return argmax of the output spikes of the first steps, (n, k); the lowest class on ties."""
    counts = np.stack([output[:, :length].sum(axis=1, dtype=np.int64) for length in lengths], axis=1)
    return np.asarray(counts.argmax(axis=2))


def _n_weights(network: Network | Parameters) -> int:
    return n_weights(network) if isinstance(network, Network) else int(network.arrays["n_weights"])


def _spiking_work(
    network: Network | Parameters, said: Response, done: Array, n_steps: Array, weight_bits: int
) -> _Work:
    """Return mean work (..., layer + layer - 1) of a spiking classifier with the same leading axes.

    One that is no stack of layers has its synapses counted in its response, and is operations to hardware.
    """
    if isinstance(network, Parameters):
        assert said.synapses is not None  # the family counts what no stack says
        n_layers = len(said.synapses)
        spikes = done[..., :n_layers]
        additions = spikes @ np.array(said.synapses)
        none = np.zeros_like(additions)
        operations = Operations(
            none,
            additions,
            done[..., n_layers:].sum(axis=-1),
            np.full(additions.shape, _n_weights(network)),
            np.asarray(n_steps * said.step_ms, np.float64),
            weight_bits,
        )
        return _Work(spikes.sum(axis=-1), spikes[..., 1:].sum(axis=-1), additions, none, operations)
    n_layers = len(network.sizes)
    load = Workload(
        sizes=network.sizes,
        recurrent=tuple(layer.recurrent is not None for layer in network.layers),
        n_steps=n_steps,
        spikes=done[..., :n_layers],
        updates=done[..., n_layers:],
        step_ms=said.step_ms,
        weight_bits=weight_bits,
        synapses=said.synapses,
        stored=network.stored,
    )
    additions = synaptic_operations(load)
    return _Work(
        spikes_per_inference(load),
        spikes_per_inference_no_input(load),
        additions,
        np.zeros_like(additions),
        load,
    )


def _activity(work: _Work, n: int) -> Columns:
    """Return spikes and operations; `n` samples were evaluated."""
    return {
        "spikes_per_inference": work.spikes,
        "spikes_per_inference_no_input": work.spikes_no_input,
        "spikes_total": spikes_total(work.spikes, n),
        "synaptic_operations": work.additions,
        "macs": work.macs,
    }


def _information(matrix: Array, time_ms: float) -> dict[str, float]:
    bits = itr_bits(matrix)
    return {"itr_bits": bits, "itr_bits_per_s": itr_bits_per_s(bits, time_ms)}
