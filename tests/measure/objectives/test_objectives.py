"""What the shipped objectives declare, and how they are called."""

from dataclasses import dataclass

import numpy as np
import pytest

from dse.base import registry
from dse.base.records import Operations
from dse.base.registry import Column, register
from dse.measure.objectives import Points, measured


@pytest.fixture(autouse=True)
def registry_as_before(monkeypatch):
    registry.known("objectives")
    monkeypatch.setattr(registry, "_components", {s: dict(c) for s, c in registry._components.items()})


def test_the_columns_of_the_record_are_declared():
    columns = (
        "accuracy accuracy_se accuracy_test n_weights spikes_per_inference spikes_total synaptic_operations "
        "decision_latency_ms hardware_latency_ms latency_ms energy_uj energy_uj_low energy_uj_high n_cores "
        "fits itr_bits t_p_ms t_h_ms t_c_ms undecided macs train_s"
    )
    assert set(columns.split()) <= set(registry.columns())


def points():
    one = np.array([1.0])
    load = Operations(one, one, one, np.array([4]), one)
    return Points(
        n_samples=2,
        accuracy=one,
        accuracy_test=None,
        decision_latency_ms=one,
        spikes=one[:, None],
        n_weights=np.array([4]),
        load=load,
    )


def test_an_objective_is_called_from_its_registration():
    @register("objectives", "errors")
    @dataclass(frozen=True)
    class Errors:
        """Share of wrong answers."""

        needs = "points"
        columns = (Column("errors", "", "min", "Share of wrong answers."),)

        def measure(self, points):
            return {"errors": 1 - points.accuracy}

    columns = measured("points", points())
    assert columns["errors"].tolist() == [0.0]
    assert list(columns)[:2] == ["accuracy", "accuracy_se"]
    assert registry.columns("points")["errors"].direction == "min"
    assert "errors" not in registry.columns("hardware")


def test_a_column_that_is_not_declared_is_refused():
    @register("objectives", "errors")
    @dataclass(frozen=True)
    class Errors:
        needs = "points"
        columns = (Column("errors", "", "min", "Share of wrong answers."),)

        def measure(self, points):
            return {"error": 1 - points.accuracy}

    with pytest.raises(TypeError, match="objective 'errors' must declare its columns, got error as well"):
        measured("points", points())


def test_a_column_is_declared_once():
    with pytest.raises(ValueError, match="column 'accuracy' is already declared by objective 'accuracy'"):

        @register("objectives", "mine")
        @dataclass(frozen=True)
        class Mine:
            needs = "full_read_out"
            columns = (Column("accuracy", "", "max", "Accuracy."),)

            def measure(self, answer):
                return {}
