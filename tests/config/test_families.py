"""A section that is a choice of components: an axis of kinds, and axes that only one kind has."""

import json

import pytest

from dse.config import ConfigError, load_space
from dse.config.schema import json_schema
from dse.config.yaml_lines import parse
from tests import families, tiny_study
from tests.spaces import SPACE, grid, write_space


@pytest.fixture(autouse=True)
def known():
    families.register()


def loaded(folder, *changes, **overrides):
    return load_space(write_space(folder, *changes, text=families.SPACE), overrides)


def faults_of(folder, *changes, overrides=None):
    path = write_space(folder, *changes, text=families.SPACE)
    with pytest.raises(ConfigError) as caught:
        load_space(path, overrides)
    return [str(fault).removeprefix(f"{path}:") for fault in caught.value.faults]


def test_kinds_are_an_axis_and_their_axes_have_a_condition(tmp_path):
    space = loaded(tmp_path)
    assert {name: axis.condition for name, axis in space.axes.items()} == {
        "encoder.kind": None,
        "encoder.send_on_delta.thresholds": ("encoder.kind", "send_on_delta"),
        "model.kind": None,
        "model.wide_of_a_test.width": ("model.kind", "wide_of_a_test"),
        "model.wide_of_a_test.gain": ("model.kind", "wide_of_a_test"),
        "model.wide_of_a_test.name": ("model.kind", "wide_of_a_test"),
        "model.near_of_a_test.k": ("model.kind", "near_of_a_test"),
        "training.epochs": None,
    }
    assert space.axes["model.kind"].values == ("snn", "wide_of_a_test", "near_of_a_test")
    assert space.axes["model.near_of_a_test.k"].values == (1, 2, 3, 4, 5)
    assert space.n_designs == families.N_DESIGNS
    assert {name: len(kinds) for name, kinds in space.choices.items()} == {"encoder": 2, "model": 3}
    assert space.parts["model"].entries["wide_of_a_test"].values == {"flag": False, "most": 100}


def test_a_design_resolves_to_plain_sections(tmp_path):
    space = loaded(tmp_path)
    design = {
        "encoder.kind": "loud_of_a_test",
        "model.kind": "wide_of_a_test",
        "model.wide_of_a_test.width": 8,
        "model.wide_of_a_test.gain": 1.5,
        "model.wide_of_a_test.name": "far",
        "training.epochs": 2,
    }
    resolved = space.resolve(design)
    wide = {"kind": "wide_of_a_test", "flag": False, "most": 100, "width": 8, "gain": 1.5, "name": "far"}
    assert resolved.to_plain()["model"] == wide
    assert resolved.to_plain()["encoder"] == {"kind": "loud_of_a_test", "volume": 1.0}
    assert resolved.training.epochs == 2
    # What is trained cannot know that there was a choice: a plain file gives the same sections.
    plain = load_space(tmp_path / "tiny.yaml", {"model": json.dumps(wide), "encoder": "loud_of_a_test"})
    assert plain.resolve({"training.epochs": 2}) == resolved


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model.kind": "snn"}, "a design must have the axes"),
        ({"model.near_of_a_test.k": 2}, "a design must have the axes"),
        ({"model.near_of_a_test.k": None}, r"model\.near_of_a_test\.k must be on its axis"),
        ({"encoder.kind": "deaf"}, r"encoder\.kind must be on its axis .*, got 'deaf'"),
        ({"encoder.kind": ["deaf"]}, r"encoder\.kind must be on its axis"),
    ],
)
def test_a_design_with_axes_of_another_kind(tmp_path, change, message):
    space = loaded(tmp_path)
    design = {"encoder.kind": "loud_of_a_test", "training.epochs": 1}
    if "model.near_of_a_test.k" not in change or change["model.near_of_a_test.k"] is None:
        design |= {"model.kind": "near_of_a_test", "model.near_of_a_test.k": 1}
    else:
        design |= {"model.kind": "snn"}
    with pytest.raises(ValueError, match=message):
        space.resolve(design | change)


def test_it_survives_a_round_trip(tmp_path):
    space = loaded(tmp_path)
    again = tmp_path / "again.yaml"
    again.write_text(space.to_yaml(), encoding="utf-8")
    assert load_space(again).to_yaml() == space.to_yaml()
    assert grid(load_space(again)) == grid(space)
    plain = parse(space.to_yaml(), "again").data["model"]["choice"]
    assert [entry["kind"] for entry in plain] == ["snn", "wide_of_a_test", "near_of_a_test"]
    assert plain[1]["width"] == {"choice": [4, 8, 12]}


@pytest.mark.parametrize("model", ["near_of_a_test", "{choice: [near_of_a_test]}", "{kind: near_of_a_test}"])
def test_a_name_and_a_choice_of_one_are_a_plain_section(tmp_path, model):
    path = write_space(tmp_path, ("{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}", model))
    space = load_space(path)
    assert space.to_plain()["model"] == {"kind": "near_of_a_test", "k": 3}
    assert list(space.axes) == ["encoder.thresholds"]


def test_all_faults_of_all_entries_at_once(tmp_path):
    faults = faults_of(
        tmp_path,
        ("thresholds: {choice: [[1, 2], [1, 2, 4]]}", "thresholds: {choice: [[1, 2], [0, 1]]}"),
        ("    - loud_of_a_test", "    - lod_of_a_test"),
        ("    - snn", "    - {kind: snn, hiden: [4]}"),
        ("      width: {choice: [4, 8, 12]}", "      width: {choice: [4, 0]}"),
        ("      name: {choice: [near, far]}", "      name: {choice: [near, fear]}"),
        ("k: {range: [1, 5]}}", "k: {range: [5, 1]}}\n    - near_of_a_test\n    - strict_of_a_test\n    - 7"),
    )
    assert [fault.split(";")[0] for fault in faults] == [
        "15: encoder.send_on_delta.thresholds.choice[1][0] must be > 0, got 0.0",
        "16: unknown encoder.kind 'lod_of_a_test'",
        "19: unknown key 'model.snn.hiden'",
        "21: model.wide_of_a_test.width.choice[1] must be >= 1, got 0",
        "23: unknown model.wide_of_a_test.name.choice[1] 'fear'",
        "24: model.near_of_a_test.k.range must be in increasing order, got [5, 1]",
        "25: model.choice has 'near_of_a_test' twice",
        "26: model.strict_of_a_test.size is required: its size",
        "27: model.choice[5] must be the name of a component, or a mapping with a kind, got 7",
    ]
    for place, name in ((1, "loud_of_a_test"), (2, "hidden"), (4, "far")):
        assert faults[place].endswith(f"Did you mean '{name}'?")


def test_rules_between_keys_are_tried_at_the_corners_of_an_entry(tmp_path):
    (fault,) = faults_of(tmp_path, ("width: {choice: [4, 8, 12]}", "width: {choice: [4, 120, 12]}"))
    assert fault == "21: model.wide_of_a_test.width must be at most 100, got 120"


@pytest.mark.parametrize(
    ("model", "fault"),
    [
        ("{choice: []}", "model.choice must be a list of one or more components, got []"),
        ("{choice: snn}", "model.choice must be a list of one or more components, got 'snn'"),
        ("{choice: [snn, {k: 3}]}", "model.kind is required; known: "),
        ("{choice: [snn, {kind: 3}]}", "unknown model.kind 3; known: "),
        ("{choice: [sn, near_of_a_test]}", "unknown model.kind 'sn'; known: "),
        ("sn", "unknown model.kind 'sn'; known: "),
        ("strict_of_a_test", "model.size is required: its size"),
        ("{choice: [snn, snn]}", "model.choice has 'snn' twice"),
        ("{choice: [snn, near_of_a_test], step: 2}", "unknown key 'model.step'; known: choice, snn, near"),
        ("4", "model must be a mapping with a kind, got 4"),
    ],
)
def test_one_fault_of_a_choice(tmp_path, model, fault):
    (found,) = faults_of(tmp_path, overrides={"model": model})
    assert found.startswith(f"--set model: {fault}")


def test_the_gaussian_process_says_which_samplers_can(tmp_path):
    (fault,) = faults_of(tmp_path, ("sampler: grid, batch: 4", "sampler: gp, n_trials: 9"))
    assert fault == (
        "27: search.sampler 'gp' cannot search "
        "encoder.send_on_delta.thresholds, an axis that only some designs have; "
        "these can: grid, nsga2, nsga3, random, sobol, tpe"
    )


def test_the_gaussian_process_takes_kinds_without_axes(tmp_path):
    gp = {"search": "{sampler: gp, n_trials: 4}", "encoder": "loud_of_a_test"}
    space = loaded(tmp_path, **gp, model="{choice: [snn, near_of_a_test]}")
    assert (space.search.sampler_name, space.n_designs) == ("gp", 4)


@pytest.mark.parametrize(
    ("overrides", "n"),
    [
        ({"model.wide_of_a_test.width": "64"}, 3 * (1 + 4 * 2 + 5) * 2),
        ({"model.snn.hidden": "{choice: [5, 6, 7]}"}, 3 * (3 + 24 + 5) * 2),
        ({"model.near_of_a_test": "{kind: near_of_a_test, k: 2}"}, 3 * (1 + 24 + 1) * 2),
        ({"model": "near_of_a_test"}, 3 * 2),
        ({"model": "{kind: near_of_a_test, k: 2}"}, 3 * 2),
        ({"model": "near_of_a_test", "model.k": "{choice: [1, 2]}"}, 3 * 2 * 2),
        ({"model.choice": "[snn, near_of_a_test]", "encoder": "loud_of_a_test"}, 2 * 2),
    ],
)
def test_keys_of_an_entry_can_be_replaced(tmp_path, overrides, n):
    space = loaded(tmp_path, **overrides)
    assert space.n_designs == n
    assert len(grid(space)) == n


@pytest.mark.parametrize(
    ("key", "value", "fault"),
    [
        ("model.knn.k", "3", "unknown key 'model.knn'; known: choice, snn, wide_of_a_test, near_of_a_test"),
        ("model.hidden", "64", "unknown key 'model.hidden'; known: choice, snn, "),
        ("model.kind", "snn", "unknown key 'model.kind'; known: choice, snn, "),
        ("model.snn.hiden", "64", "unknown key 'model.snn.hiden'; known: hidden, "),
        ("model.wide_of_a_test.width", "0", "model.wide_of_a_test.width must be >= 1, got 0"),
        ("model.wide_of_a_test.width", "200", "model.wide_of_a_test.width must be at most 100, got 200"),
    ],
)
def test_a_wrong_key_of_an_entry_is_a_fault(tmp_path, key, value, fault):
    (found,) = faults_of(tmp_path, overrides={key: value})
    assert found.startswith(f"--set {key}: {fault}")


def test_an_encoder_may_stand_for_recordings_of_spikes(tmp_path):
    encoder = {"kind": "loud_of_a_test", "volume": {"choice": [0.5, 2.0]}}
    assert "encoder.volume" in tiny_study.make_space(tmp_path, encoder=encoder).axes
    with pytest.raises(ConfigError, match=r"encoder\.volume must be >= 0, got -1"):
        tiny_study.make_space(tmp_path, encoder={"kind": "loud_of_a_test", "volume": -1})
    with pytest.raises(ConfigError, match="'preprocessing' does not apply to raster recordings"):
        tiny_study.make_space(tmp_path, preprocessing={"bin_ms": 5})


@pytest.mark.parametrize(
    ("task", "name"),
    [
        ("{target: [fabric, speed], joint: true}", "fabric+speed"),
        ("{target: [fabric, speed]}", "fabric|speed"),
        ("{target: [fabric, {column: speed, abs: true}], joint: true, name: both}", "both"),
    ],
)
def test_a_joint_task_is_called_after_its_parts(tmp_path, task, name):
    space = load_space(write_space(tmp_path, ("task: {target: fabric}", f"task: {task}")))
    assert space.parts["task"].values["name"] == name


def accepts(schema, value, root):
    """Return whether a value fits a JSON Schema, of which only what ours use is understood."""
    if "$ref" in schema:
        found = root
        for key in schema["$ref"].removeprefix("#/").split("/"):
            found = found[key]
        return accepts(found, value, root)
    if "anyOf" in schema and not any(accepts(option, value, root) for option in schema["anyOf"]):
        return False
    if ("const" in schema and value != schema["const"]) or value not in schema.get("enum", [value]):
        return False
    if isinstance(value, dict) and "properties" in schema:
        known = schema["properties"]
        if set(schema.get("required", ())) - set(value) or set(value) - set(known):
            return False
        return all(accepts(known[key], inner, root) for key, inner in value.items())
    if isinstance(value, list) and "items" in schema:
        enough = len(value) >= schema.get("minItems", 0)
        return enough and all(accepts(schema["items"], inner, root) for inner in value)
    wanted = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float)}
    return isinstance(value, wanted.get(schema.get("type", ""), object))


@pytest.mark.parametrize("text", [SPACE, families.SPACE])
def test_the_schema_accepts_a_search_space(tmp_path, text):
    schema = json.loads(json.dumps(json_schema()))
    assert accepts(schema, parse(text, "space").data, schema)
    written = load_space(write_space(tmp_path, text=text)).to_plain()
    for section in ("encoder", "model"):
        value = json.loads(json.dumps(written[section]))
        assert accepts(schema["properties"][section], value, schema)


@pytest.mark.parametrize(
    ("model", "good"),
    [
        ("snn", True),
        ("{choice: [snn, near_of_a_test]}", True),
        ("{choice: [{kind: near_of_a_test, k: {choice: [1]}}, {kind: strict_of_a_test, size: 1}]}", True),
        ("strict_of_a_test", False),
        ("{choice: [strict_of_a_test]}", False),
        ("{choice: []}", False),
        ("{choice: [snn], k: 3}", False),
        ("{choice: [{kind: near_of_a_test, kk: 3}]}", False),
        ("nobody", False),
    ],
)
def test_the_schema_knows_choices_of_components(model, good):
    schema = json_schema()
    value = parse(model, "model").data
    assert accepts(schema["properties"]["model"], value, schema) is good


def test_a_choice_of_one_keeps_plain_names_of_its_axes(tmp_path):
    plain = "{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"
    choice = load_space(write_space(tmp_path, (plain, f"{{choice: [{plain}]}}")))
    before = load_space(write_space(tmp_path))
    assert choice.to_yaml() == before.to_yaml()
    assert grid(choice) == grid(before)
