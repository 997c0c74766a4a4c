from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.config import SearchSpace, load_space
from dse.search.space import design_at, grid, index_of, n_designs
from tests.spaces import write_space


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> SearchSpace:
    folder = tmp_path_factory.mktemp("space")
    return load_space(write_space(folder, ("epochs: 1", "epochs: {range: [1, 9], step: 4}")))


def test_the_last_axis_changes_fastest(space: SearchSpace) -> None:
    expected = itertools.product([(1.0, 2.0), (1.0, 2.0, 4.0)], [4, 8, 12], [1, 5, 9])
    assert [tuple(design.values()) for design in grid(space)] == list(expected)
    assert list(grid(space)[0]) == ["encoder.thresholds", "model.hidden", "training.epochs"]
    assert n_designs(space) == len(grid(space)) == 18


@given(st.integers(0, 17))
def test_index_and_design_are_inverse(space: SearchSpace, index: int) -> None:
    assert index_of(space, design_at(space, index)) == index
    space.resolve(design_at(space, index))


@pytest.mark.parametrize("index", [-1, 18])
def test_no_design_outside_the_grid(space: SearchSpace, index: int) -> None:
    with pytest.raises(ValueError, match=r"index must be in \[0, 18\)"):
        design_at(space, index)


def test_a_value_that_is_not_on_the_grid(space: SearchSpace) -> None:
    with pytest.raises(ValueError, match=r"model.hidden must be one of \[4, 8, 12\], got 5"):
        index_of(space, {**design_at(space, 0), "model.hidden": 5})


def test_a_range_without_steps_has_no_grid(tmp_path: Path) -> None:
    path = write_space(
        tmp_path, ("0.8", "{range: [0.1, 0.9]}"), ("sampler: grid", "sampler: tpe, n_trials: 3")
    )
    space = load_space(path)
    assert n_designs(space) is None
    with pytest.raises(ValueError, match=r"ranges without steps: model\.true_rate"):
        grid(space)


def test_a_space_without_axes_is_one_design(tmp_path: Path) -> None:
    space = load_space(write_space(tmp_path), {"encoder.thresholds": "[1]", "model.hidden": "4"})
    assert grid(space) == [{}]
