"""Columns of one run, counted by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dse.measure import measure, read_out
from dse.metrics.accuracy import wilson_se
from dse.records import Dataset, Layer, Network, Outcome, Response, Spikes


def _layer(n_out: int, n_in: int) -> Layer:
    decay = np.full(n_out, 1024, np.int32)
    return Layer(np.ones((n_out, n_in), np.float32), None, decay, decay, 80)


@pytest.fixture
def dataset() -> Dataset:
    zeros = np.zeros(6, np.int32)
    return Dataset(
        spikes=Spikes(np.zeros(6 * 4 + 1, np.int64), np.zeros(0, np.int32), 4, 3, 2.0),
        target=np.array([0, 1, 0, 1, 1, 0]),
        classes=("a", "b"),
        start=zeros,
        start_low=zeros,
        start_high=zeros,
        n_steps=4,
        train=np.array([0, 1]),
        validation=np.array([2, 3, 4]),
        test=np.array([5]),
    )


@pytest.fixture
def outcome() -> Outcome:
    """Three samples of four steps: decided at once, decided late, never a spike."""
    output = np.zeros((3, 4, 2), np.uint8)
    output[0, 0, 0] = output[0, 2, 1] = 1  # class 0 first; a tie at the end goes to class 0
    output[1, 1, 0] = output[1, 2, 1] = output[1, 3, 1] = 1  # 0 first, 1 at the end
    spikes = np.zeros((3, 4, 3), np.int32)
    spikes[..., 0] = 2
    spikes[..., 1] = 1
    spikes[..., 2] = output.sum(axis=2)
    updates = np.ones((3, 4, 2), np.int32)
    response = Response(output, spikes, updates, step_ms=2.0, peak_state=9)
    test = replace(response, output=output[:1], spikes=spikes[:1], updates=updates[:1])
    network = Network((_layer(5, 3), _layer(2, 5)), 3, (0,), 1, "integer")
    health = {"dead_neurons": 1, "overflows_24_bit": False, "initial_gain": [1.0, 2.0]}
    return Outcome(network, response, test, {}, health, train_s=1.5)


def test_the_full_read_out(outcome: Outcome, dataset: Dataset) -> None:
    found = measure(outcome, dataset, np.array([]), np.array([]), [])
    assert found.columns == {
        "accuracy": pytest.approx(2 / 3),  # 0 right (tie), 1 right, silent sample answers 0 and is 1
        "accuracy_se": pytest.approx(float(wilson_se(2, 3))),
        "accuracy_test": 1.0,
        "n_weights": 25,
        "decision_latency_ms": 8.0,
        "spikes_per_inference": pytest.approx((3 * 12 + 5) / 3),
        "spikes_per_inference_no_input": pytest.approx((3 * 4 + 5) / 3),
        "spikes_total": 41,
        "synaptic_operations": 8 * 5 + 4 * 2,  # output spikes have no targets
        "dead_neurons": 1,
        "overflows_24_bit": False,
        "train_s": 1.5,
    }
    assert found.confusion.tolist() == [[1, 0], [1, 1]]
    assert found.confusion_test is not None
    assert found.confusion_test.tolist() == [[1, 0], [0, 0]]
    assert found.points == {} and found.hardware == {}


def test_points_count_the_work_up_to_the_decision(outcome: Outcome, dataset: Dataset) -> None:
    found = measure(outcome, dataset, np.array([0]), np.array([0.6]), ["loihi1_silicon"])
    points = {name: x.item() for name, x in found.points.items()}
    # Decided after 1, 2 and (never, so at the end) 4 steps.
    assert points["decision_latency_ms"] == pytest.approx(2.0 * (1 + 2 + 4) / 3)
    assert points["accuracy"] == pytest.approx(1 / 3)
    assert points["accuracy_se"] == pytest.approx(float(wilson_se(1, 3)))
    assert points["accuracy_test"] == 1.0
    assert points["undecided"] == pytest.approx(1 / 3)
    assert points["spikes_per_inference"] == pytest.approx((7 * 3 + 1 + 1) / 3)
    assert points["spikes_per_inference_no_input"] == pytest.approx((7 + 2) / 3)
    assert points["spikes_total"] == 23
    assert points["synaptic_operations"] == pytest.approx((7 * 2 * 5 + 7 * 2) / 3)
    assert found.columns["t_p_ms"] == pytest.approx(points["decision_latency_ms"])
    assert found.columns["t_h_ms"] is None
    on_chip, full = found.hardware_points["loihi1_silicon"], found.hardware["loihi1_silicon"]
    assert on_chip["energy_uj"].shape == (1, 1)
    assert on_chip["energy_uj"].item() < full["energy_uj"]
    assert full["energy_uj"] == pytest.approx(full["energy_dynamic_uj"] + full["energy_static_uj"])
    assert full["energy_uj_low"] < full["energy_uj"] < full["energy_uj_high"]
    assert full["latency_ms"] > 8.0
    assert on_chip["fits"].item() is True and full["n_cores"] == 2


def test_ties_go_to_the_lowest_class_and_counts_do_not_overflow() -> None:
    output = np.zeros((2, 300, 3), np.uint8)
    output[0, :, 1:] = 1
    output[1, :290, 1] = 1  # 290 does not fit a byte
    output[1, :200, 0] = 1
    assert read_out(output).tolist() == [1, 1]
