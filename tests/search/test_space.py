import dataclasses
import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.config import Axis, load_space
from dse.config.parts import Part
from dse.search.space import corners, design_at, index_of, n_designs_of_each
from tests import families
from tests.spaces import grid, write_space


@pytest.fixture(scope="module")
def space(tmp_path_factory):
    folder = tmp_path_factory.mktemp("space")
    return load_space(write_space(folder, ("epochs: 1", "epochs: {range: [1, 9], step: 4}")))


def test_the_last_axis_changes_fastest(space):
    expected = itertools.product([(1.0, 2.0), (1.0, 2.0, 4.0)], [4, 8, 12], [1, 5, 9])
    assert [tuple(design.values()) for design in grid(space)] == list(expected)
    assert list(grid(space)[0]) == ["encoder.thresholds", "model.hidden", "training.epochs"]
    assert space.n_designs == len(grid(space)) == 18


@given(st.integers(0, 17))
def test_index_and_design_are_inverse(space, index):
    assert index_of(space, design_at(space, index)) == index
    space.resolve(design_at(space, index))


@pytest.mark.parametrize("index", [-1, 18])
def test_no_design_outside_the_grid(space, index):
    with pytest.raises(ValueError, match=r"index must be in \[0, 18\)"):
        design_at(space, index)


def test_a_value_that_is_not_on_the_grid(space):
    with pytest.raises(ValueError, match=r"model.hidden must be one of \[4, 8, 12\], got 5"):
        index_of(space, {**design_at(space, 0), "model.hidden": 5})


def test_a_range_without_steps_has_no_grid(tmp_path):
    path = write_space(
        tmp_path, ("0.8", "{range: [0.1, 0.9]}"), ("sampler: grid", "sampler: tpe, n_trials: 3")
    )
    space = load_space(path)
    assert space.n_designs is None
    with pytest.raises(ValueError, match="whose axes all have values"):
        design_at(space, 0)


def test_a_space_without_axes_is_one_design(tmp_path):
    space = load_space(write_space(tmp_path), {"encoder.thresholds": "[1]", "model.hidden": "4"})
    assert grid(space) == [{}]


# Sizes of a plain axis, or for every kind of a section the sizes of the axes that only this kind has.
branching = st.one_of(
    st.integers(1, 4), st.lists(st.lists(st.integers(1, 3), max_size=3), min_size=2, max_size=4)
)
FAMILIES = ("encoder", "model")


def conditional(space, shape):
    """Return a space with an axis for each number of a shape, and a choice of kinds for each list."""
    axes = {}
    entries = {}
    sections = iter(FAMILIES)
    for number, below in enumerate(shape):
        section = None if isinstance(below, int) else next(sections, None)
        if section is None:
            size = below if isinstance(below, int) else len(below)
            axes[f"training.a{number}"] = Axis(f"training.a{number}", tuple(range(size)))
            continue
        kind = Axis(f"{section}.kind", tuple(f"k{i}" for i in range(len(below))))
        axes[kind.name] = kind
        entries[section] = {}
        for name, sizes in zip(kind.values or (), below, strict=True):
            entries[section][name] = part_of(name, [f"b{i}" for i in range(len(sizes))])
            for i, size in enumerate(sizes):
                axis = Axis(f"{section}.{name}.b{i}", tuple(range(size)), condition=(kind.name, name))
                axes[axis.name] = axis
    parts = dict(space.parts) | {"training": part_of("", [f"a{i}" for i in range(len(shape))])}
    for section in FAMILIES:
        several = entries.get(section, {})
        parts[section] = dataclasses.replace(part_of("" if several else "only", []), entries=several)
    return dataclasses.replace(space, axes=axes, parts=parts)


def part_of(kind, keys):
    """Return a section of integer keys, in which one more does not vary."""
    fields = [(key, int, dataclasses.field(default=0)) for key in (*keys, "still")]
    made = dataclasses.make_dataclass("Made", fields, frozen=True)
    return Part(made, kind, {"still": 1}, {}, good=True)


def enumerated(space):
    """Yield every design by plain recursion: the last axis changes fastest."""

    def go(design, names):
        if not names:
            yield design
            return
        axis = space.axes[names[0]]
        if axis.condition is not None and design[axis.condition[0]] != axis.condition[1]:
            yield from go(design, names[1:])
            return
        for value in axis.values or ():
            yield from go({**design, axis.name: value}, names[1:])

    return go({}, list(space.axes))


@given(st.lists(branching, max_size=4), st.data())
def test_a_conditional_grid_is_that_of_plain_recursion(space, shape, data):
    found = conditional(space, shape)
    total = found.n_designs
    assert total is not None
    for index in {0, total - 1, data.draw(st.integers(0, total - 1))}:
        assert index_of(found, design_at(found, index)) == index
        resolved = found.resolve(design_at(found, index))
        for section in found.choices:
            assert resolved.kinds[section] == design_at(found, index)[f"{section}.kind"]
    if total < 2000:
        assert grid(found) == list(enumerated(found))
        assert all(list(design) == list(found.active(design)) for design in grid(found))
    for section in found.choices:
        each = n_designs_of_each(found, section)
        assert list(each) == list(found.choices[section])
        assert sum(n or 0 for n in each.values()) == total


@given(st.lists(branching, max_size=4))
def test_corners_are_designs_of_every_kind(space, shape):
    found = conditional(space, shape)
    designs = list(corners(found, FAMILIES, 50))
    kinds = [tuple(design.get(f"{section}.kind") for section in FAMILIES) for design in designs]
    assert len(set(kinds)) == math.prod(len(entries) for entries in found.choices.values())
    assert len({index_of(found, design) for design in designs}) == len(designs) <= max(50, len(set(kinds)))
    plain = [name for name in found.axes if name.startswith("training.")]
    assert all(design[name] == 0 for design in designs for name in plain)


def test_designs_of_a_grid_too_large_to_enumerate(space):
    found = conditional(space, [[[3, 3, 3], [3, 3]], 4, [[3, 3, 3], [3], []], *[4] * 5])
    found = dataclasses.replace(found, axes={**found.axes, "x.y": Axis("x.y", tuple(range(8)))})
    total = found.n_designs
    assert total == 36 * 4 * 31 * 4**5 * 8 > 30e6
    for index in range(0, total, total // 1000):
        assert index_of(found, design_at(found, index)) == index


def test_a_range_without_steps_in_one_kind_leaves_the_others_countable(space):
    found = conditional(space, [[[2, 2], [1]], 3])
    open_range = Axis("encoder.k1.b0", None, 0.5, 2.0, condition=("encoder.kind", "k1"))
    found = dataclasses.replace(found, axes={**found.axes, open_range.name: open_range})
    assert found.n_designs is None
    assert n_designs_of_each(found, "encoder") == {"k0": 12, "k1": None}
    ends = [design.get("encoder.k1.b0") for design in corners(found, ("encoder",), 10)]
    assert ends == [None, None, None, None, 0.5, 2.0]


def test_a_design_of_another_kind_is_not_in_the_grid(space):
    found = conditional(space, [[[2], [2]]])
    for design in ({"encoder.kind": "k0", "encoder.k1.b0": 0}, {"encoder.kind": "k0"}, {}):
        with pytest.raises(ValueError, match="a design must have the axes"):
            index_of(found, design)


def test_the_number_of_designs_is_a_sum_over_kinds(tmp_path):
    families.register()
    space = load_space(write_space(tmp_path, text=families.SPACE))
    assert space.n_designs == families.N_DESIGNS == 180
    assert n_designs_of_each(space, "model") == {
        "snn": 6, "wide_of_a_test": 144, "near_of_a_test": 30
    }  # fmt: skip
    assert n_designs_of_each(space, "encoder") == {"send_on_delta": 120, "loud_of_a_test": 60}
