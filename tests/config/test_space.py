import json

import pytest

from dse.config import load_space
from tests.spaces import write_space


@pytest.fixture
def space(tmp_path):
    return load_space(
        write_space(tmp_path, ("true_rate: 0.8", "true_rate: {range: [0.5, 0.9]}")),
        {"search": "{n_trials: 4}"},
    )


DESIGN = {"encoder.thresholds": (1.0, 2.0), "model.hidden": 8, "model.true_rate": 0.6}


def test_a_design_takes_its_place(space):
    resolved = space.resolve(DESIGN)
    plain = resolved.to_plain()
    assert plain["encoder"]["thresholds"] == (1.0, 2.0)
    assert plain["model"]["hidden"] == (8,)
    assert plain["model"]["true_rate"] == 0.6
    assert resolved.kinds["model"] == "snn"
    assert plain["data"]["file"] == "touch.npz"


def test_a_design_from_json_is_the_same_design(space):
    assert space.resolve(json.loads(json.dumps(DESIGN))) == space.resolve(DESIGN)


def test_resolving_changes_nothing(space):
    before = space.to_yaml()
    space.resolve(DESIGN).to_plain()["data"]["columns"]["more"] = "x"
    space.to_plain()["data"]["columns"]["more"] = "x"
    assert space.to_yaml() == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model.hidden": 9}, r"model.hidden must be on its axis \{'choice': \[4, 8, 12\]\}, got 9"),
        ({"model.hidden": 8.0}, "model.hidden must be on its axis"),
        ({"model.true_rate": 0.95}, "model.true_rate must be on its axis"),
        ({"model.true_rate": True}, "model.true_rate must be on its axis"),
        ({"model.width": 3}, "a design must have the axes"),
    ],
)
def test_a_value_off_its_axis(space, change, message):
    with pytest.raises(ValueError, match=message):
        space.resolve(DESIGN | change)
