import numpy as np

from dse import registry
from dse.measure.objectives.memory_bytes import memory_bytes


def test_bits_of_every_stored_weight() -> None:
    n, bits = np.array([0, 1, 84000, 84000]), np.array([8, 3, 8, 5])
    assert memory_bytes(n, bits).tolist() == [0.0, 0.375, 84000.0, 52500.0]


def test_it_is_an_objective_to_minimise() -> None:
    column = registry.columns()["memory_bytes"]
    assert (column.unit, column.direction) == ("bytes", "min")
