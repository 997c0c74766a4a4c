import numpy as np
import pandas as pd
import pytest

from dse.figures.energy import draw_energy, gather_energy


def table() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "encoder.gain": [10.0, 1.0, 3.0, 0.3, 5.0],
            "accuracy": [0.9, 0.8, 0.9, 0.4, np.nan],
            "accuracy_se": [0.01, 0.02, 0.03, 0.04, 0.05],
            "energy_uj": [40.0, 10.0, 20.0, 12.0, 30.0],
            "split": ["b", "a", "<c>", "a", "b"],
        }
    )


def test_points_in_the_order_of_the_parameter():
    found = gather_energy(table(), "encoder.gain")
    assert found.labels == ("0.3", "1", "3", "10")
    assert found.values.tolist() == [[12, 0.4], [10, 0.8], [20, 0.9], [40, 0.9]]
    assert found.on_front.tolist() == [False, True, True, False]
    assert found.low[:, 1].tolist() == found.high[:, 1].tolist() == [0.04, 0.02, 0.03, 0.01]
    assert not found.low[:, 0].any()
    assert found.n_left_out == 1


def test_any_columns_in_any_direction():
    directions = {"accuracy_se": "max", "energy_uj": "min"}
    found = gather_energy(table(), "split", "accuracy_se", "energy_uj", directions)
    assert found.labels == ("<c>", "a", "a", "b", "b")
    assert found.values[found.on_front].tolist() == [[0.02, 10], [0.04, 12], [0.05, 30]]


def test_the_drawing_joins_and_labels_the_front():
    dominated, front = draw_energy(gather_energy(table(), "split")).data
    assert (list(front.x), list(front.text)) == ([10, 20], ["a", "&lt;c&gt;"])
    assert (list(dominated.x), dominated.mode, dominated.error_x.visible) == ([12, 40], "markers", False)
    assert len(dominated.text) == 2, "for whoever hovers"
    assert front.mode == "lines+markers+text"


def test_what_it_refuses():
    with pytest.raises(ValueError, match=r"columns must be in the table, got \['gain'\]"):
        gather_energy(table(), "gain")
    with pytest.raises(ValueError, match=r"for both columns, got none for \['accuracy'\]"):
        gather_energy(table(), "split", objectives={"energy_uj": "min"})


def test_an_empty_table():
    found = gather_energy(table()[:0], "split")
    assert found.labels == ()
    assert len(draw_energy(found).data) == 2
