import pytest

from dse.measure import objectives


def test_the_columns_of_the_record_are_declared():
    columns = (
        "accuracy accuracy_se accuracy_test n_weights spikes_per_inference spikes_total synaptic_operations "
        "decision_latency_ms hardware_latency_ms latency_ms energy_uj energy_uj_low energy_uj_high n_cores "
        "fits itr_bits t_p_ms t_h_ms t_c_ms undecided macs train_s"
    )
    assert set(columns.split()) <= set(objectives.known())


def test_units_stand_in_the_names():
    units = {
        **{"ms": "_ms", "uJ": "_uj", "mW": "_mw", "s": "_s"},
        **{"bit": "_bits", "bit/s": "_bits_per_s", "bytes": "_bytes"},
    }
    for name, found in objectives.known().items():
        assert found.direction in ("max", "min")
        assert found.doc.endswith(".")
        assert found.unit == "" or units[found.unit] in name


def test_a_function_becomes_an_objective(monkeypatch):
    monkeypatch.setattr(objectives, "_objectives", {})

    @objectives.objective(unit="ms", direction="min")
    def delay_ms() -> float:
        """Time that is lost.

        More about it.
        """
        return 1.0

    assert objectives._objectives == {"delay_ms": objectives.Objective("ms", "min", "Time that is lost.")}
    assert delay_ms() == 1.0


def test_a_column_has_one_meaning(monkeypatch):
    monkeypatch.setattr(objectives, "_objectives", {})
    objectives.declare("x", "", "min", "One.")
    objectives.declare("x", "", "min", "One.")
    with pytest.raises(ValueError, match="'x' is declared twice"):
        objectives.declare("x", "", "max", "One.")
