import numpy as np
import pytest

from dse.recordings import RecordingError
from dse.recordings.targets import target, target_columns

COLUMNS = {
    "fabric": np.array(["silk", "wool", "silk", "wool"]),
    "velocity": np.array([-100, 20, 100, -20], dtype=np.int8),
    "force": np.array([0.5, 2.0, 2.0, 10.0]),
    "small": np.array([-128, 127, 0, 0], dtype=np.int8),
}


def test_a_column_in_the_order_of_its_values():
    codes, classes = target(COLUMNS, "fabric")
    assert (codes.dtype, codes.tolist(), classes) == (np.int64, [0, 1, 0, 1], ("silk", "wool"))
    assert target(COLUMNS, "force")[1] == ("0.5", "2", "10")
    assert target(COLUMNS, {"column": "velocity"})[1] == ("-100", "-20", "20", "100")


def test_absolute_values():
    codes, classes = target(COLUMNS, {"column": "velocity", "abs": True})
    assert (codes.tolist(), classes) == ([1, 0, 1, 0], ("20", "100"))
    assert target(COLUMNS, {"column": "small", "abs": True})[1] == ("0", "127", "128")


def test_combinations_hold_only_what_occurs():
    codes, classes = target(COLUMNS, ["fabric", {"column": "velocity", "abs": True}])
    assert (codes.tolist(), classes) == ([0, 1, 0, 1], ("silk|100", "wool|20"))
    codes, classes = target(COLUMNS, ("fabric", "velocity"))
    assert [classes[i] for i in codes] == ["silk|-100", "wool|20", "silk|100", "wool|-20"]
    assert target_columns(["fabric", {"column": "velocity", "abs": True}]) == ("fabric", "velocity")
    assert target_columns("fabric") == ("fabric",)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("fabrik", r"task.target: no column 'fabrik' among data.columns; .*Did you mean 'fabric'\?"),
        ({"column": "fabric", "abs": True}, "task.target: abs needs numbers, column 'fabric' holds <U4"),
        ([], r"task.target must name a column, got \[\]"),
        ({"abs": True}, "task.target must name a column, got {'abs': True}"),
    ],
)
def test_faults(settings, message):
    with pytest.raises(RecordingError, match=message):
        target(COLUMNS, settings)


def test_two_combinations_of_one_name_are_refused():
    columns = {"a": np.array(["x|y", "x"]), "b": np.array(["z", "y|z"])}
    with pytest.raises(RecordingError, match=r"both named 'x\|y\|z'"):
        target(columns, ["a", "b"])
