import numpy as np

from dse.config.parts import target_columns
from dse.config.settings import Column
from dse.data.recordings.targets import heads, target

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
    assert target(COLUMNS, Column("velocity"))[1] == ("-100", "-20", "20", "100")


def test_absolute_values():
    codes, classes = target(COLUMNS, Column("velocity", abs=True))
    assert (codes.tolist(), classes) == ([1, 0, 1, 0], ("20", "100"))
    assert target(COLUMNS, Column("small", abs=True))[1] == ("0", "127", "128")


def test_combinations_hold_only_what_occurs():
    codes, classes = target(COLUMNS, ("fabric", Column("velocity", abs=True)))
    assert (codes.tolist(), classes) == ([0, 1, 0, 1], ("silk|100", "wool|20"))
    codes, classes = target(COLUMNS, ("fabric", "velocity"))
    assert [classes[i] for i in codes] == ["silk|-100", "wool|20", "silk|100", "wool|-20"]
    assert target_columns(("fabric", Column("velocity", abs=True))) == ("fabric", "velocity")
    assert target_columns("fabric") == ("fabric",)


JOINT = ("fabric", Column("velocity", abs=True))


def test_heads_have_the_classes_of_their_columns():
    columns = {
        "fabric": np.array(["silk", "wool", "silk", "wool", "lint"]),
        "velocity": np.array([-100, 20, 20, -100, 5]),
    }
    codes, classes = target(columns, JOINT)
    assert classes == ("lint|5", "silk|20", "silk|100", "wool|20", "wool|100")
    fabric, velocity = heads(columns, JOINT, codes)
    assert (fabric.name, fabric.classes) == ("fabric", target(columns, "fabric")[1])
    assert (velocity.name, velocity.classes) == ("velocity", target(columns, JOINT[1])[1])
    assert fabric.of_class.dtype == velocity.of_class.dtype == np.int64
    assert fabric.of_class.tolist() == [0, 1, 1, 2, 2]
    assert velocity.of_class.tolist() == [0, 1, 2, 1, 2]
    for head in (fabric, velocity):
        own, names = target(columns, head.name if head is fabric else JOINT[1])
        assert [head.classes[i] for i in head.of_class[codes]] == [names[i] for i in own]


def test_heads_leave_out_what_is_in_no_part_of_the_split():
    columns = {"fabric": np.array(["a", "b", "c"]), "velocity": np.array([3, 1, 2])}
    fabric, velocity = heads(columns, ("fabric", "velocity"), np.array([0, -1, 1]))
    assert (fabric.classes, fabric.of_class.tolist()) == (("a", "c"), [0, 1])
    assert (velocity.classes, velocity.of_class.tolist()) == (("2", "3"), [1, 0])
