"""Section `precision`: at which bits and shares trained networks are evaluated."""

from dse.config import load_space
from dse.config.schema import json_schema
from tests.spaces import write_space

LINE = "objectives: [accuracy:max, n_weights:min]"


def with_section(folder, text):
    """Write the small search space with a section in front of its objectives, on line 18."""
    return write_space(folder, (LINE, f"precision: {text}\n{LINE}"))


def test_every_setting_but_the_trained_one(tmp_path):
    path = with_section(tmp_path, "{weight_bits: [8, 2, 4, 2], pruned: [0.5, 0]}")
    found = load_space(path).precision
    assert (found.weight_bits, found.pruned, found.within) == ((8, 2, 4, 2), (0.5, 0.0), 0.02)
    assert found.settings == ((2, 0.0), (2, 0.5), (4, 0.0), (4, 0.5), (8, 0.5))


def test_one_value_is_short_for_a_list_and_pruning_is_off(tmp_path):
    found = load_space(with_section(tmp_path, "{weight_bits: 4, within: 0}")).precision
    assert (found.weight_bits, found.pruned, found.within) == ((4,), (0.0,), 0.0)
    only = load_space(with_section(tmp_path, "{weight_bits: 8}")).precision
    assert only is not None and only.settings == ()


def test_it_survives_a_round_trip(tmp_path):
    space = load_space(with_section(tmp_path, "{weight_bits: [3, 5], pruned: [0, 0.25], within: 0.05}"))
    again = tmp_path / "again.yaml"
    again.write_text(space.to_yaml(), encoding="utf-8")
    assert load_space(again).precision == space.precision
    assert load_space(again).to_yaml() == space.to_yaml()


def test_editors_know_its_keys_and_bounds():
    section = json_schema()["properties"]["precision"]
    assert section["required"] == ["weight_bits"]
    assert set(section["properties"]) == {"weight_bits", "pruned", "within"}
    one, several = section["properties"]["pruned"]["anyOf"]
    assert one == several["items"] == {"type": "number", "minimum": 0, "exclusiveMaximum": 1}
