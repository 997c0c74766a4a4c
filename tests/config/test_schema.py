import dataclasses
import itertools
import json

from dse.base import registry
from dse.base.registry import rule_of
from dse.config.locate import shipped_folder, shipped_spaces
from dse.config.parts import COMPONENTS, FAMILIES, WITH_AXES
from dse.config.resolved import SECTIONS, SETTINGS
from dse.config.schema import json_schema
from tests.installed import needs_papers


def test_it_is_json_and_has_every_section():
    schema = json.loads(json.dumps(json_schema()))
    assert set(schema["properties"]) == {"study", "seed", "plugins", *SECTIONS}
    assert schema["additionalProperties"] is False


@needs_papers
def test_the_shipped_schema_is_that_of_the_code():
    """Where it is not: dse describe --schema > search_spaces/schema.json."""
    assert json.loads((shipped_folder("search_spaces") / "schema.json").read_text()) == json_schema()
    for name, path in shipped_spaces().items():
        first = path.read_text(encoding="utf-8").splitlines()[0]
        assert first == "# yaml-language-server: $schema=schema.json", name


def one_of(section):
    """Return the schemas of the components of a section."""
    schema = json_schema()
    return schema["$defs" if section in FAMILIES else "properties"][section]["anyOf"]


def components_of(rule):
    """Return the components that a key may name, whose keys stand beside it."""
    return registry.known(rule.component) if rule.component else {}


def test_it_has_every_key_of_every_component():
    properties = json_schema()["properties"]
    for section in COMPONENTS:
        options = [option for option in one_of(section) if "properties" in option]
        by_kind = {option["properties"]["kind"]["const"]: option for option in options}
        assert by_kind.keys() == registry.known(COMPONENTS[section]).keys()
        for kind, option in by_kind.items():
            fields = dataclasses.fields(registry.known(COMPONENTS[section])[kind])
            inner = [cls for field in fields for cls in components_of(rule_of(field)).values()]
            names = {field.name for field in (*fields, *itertools.chain(*map(dataclasses.fields, inner)))}
            assert set(option["properties"]) == {"kind", *names}
            assert "kind" in option["required"]
    for section in ("task", "window", "training", "execution"):
        names = {field.name for field in dataclasses.fields(SETTINGS[section])}
        assert set(properties[section]["properties"]) == names


def test_axes_are_allowed_where_the_reader_allows_them():
    def forms(section, key):
        found = one_of(section)[0] if section in COMPONENTS else json_schema()["properties"][section]
        return found["properties"][key].get("anyOf", [])

    assert "training" in WITH_AXES
    assert any("choice" in form.get("properties", {}) for form in forms("training", "epochs"))
    assert not any("choice" in form.get("properties", {}) for form in forms("execution", "jobs"))


def test_bounds_and_choices_are_carried_over():
    properties = json_schema()["properties"]
    assert properties["execution"]["properties"]["jobs"]["minimum"] == 1
    assert "accuracy:max" in properties["objectives"]["anyOf"][0]["enum"]
    assert "grid" in properties["search"]["properties"]["sampler"]["enum"]
