from __future__ import annotations

import dataclasses
import json
from typing import Any

from dse.config.schema import json_schema
from dse.config.sections import COMPONENTS, FAMILIES, SECTIONS, WITH_AXES, components, settings_class


def test_it_is_json_and_has_every_section() -> None:
    schema = json.loads(json.dumps(json_schema()))
    assert set(schema["properties"]) == {"study", "seed", "plugins", *SECTIONS}
    assert schema["additionalProperties"] is False


def one_of(section: str) -> list[dict[str, Any]]:
    """Return the schemas of the components of a section."""
    schema = json_schema()
    return schema["$defs" if section in FAMILIES else "properties"][section]["anyOf"]  # type: ignore[no-any-return]


def test_it_has_every_key_of_every_component() -> None:
    properties = json_schema()["properties"]
    for section in COMPONENTS:
        options = [option for option in one_of(section) if "properties" in option]
        by_kind = {option["properties"]["kind"]["const"]: option for option in options}
        assert by_kind.keys() == components(section).keys()
        for kind, option in by_kind.items():
            names = {field.name for field in dataclasses.fields(components(section)[kind])}
            assert set(option["properties"]) == {"kind", *names}
            assert "kind" in option["required"]
    for section in ("task", "window", "training", "execution"):
        names = {field.name for field in dataclasses.fields(settings_class(section))}
        assert set(properties[section]["properties"]) == names


def test_axes_are_allowed_where_the_reader_allows_them() -> None:
    def forms(section: str, key: str) -> list[dict[str, Any]]:
        found = one_of(section)[0] if section in COMPONENTS else json_schema()["properties"][section]
        return found["properties"][key].get("anyOf", [])  # type: ignore[no-any-return]

    assert "training" in WITH_AXES
    assert any("choice" in form.get("properties", {}) for form in forms("training", "epochs"))
    assert not any("choice" in form.get("properties", {}) for form in forms("execution", "jobs"))


def test_bounds_and_choices_are_carried_over() -> None:
    properties = json_schema()["properties"]
    assert properties["execution"]["properties"]["jobs"]["minimum"] == 1
    assert "accuracy:max" in properties["objectives"]["anyOf"][0]["enum"]
    assert "grid" in properties["search"]["properties"]["sampler"]["enum"]
