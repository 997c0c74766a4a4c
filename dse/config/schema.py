"""JSON Schema of a search space, for editors that complete and check YAML while it is written.

Dialect 2020-12. It accepts everything that `load_space` accepts; rules between keys are checked there only.
"""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from collections.abc import Mapping
from typing import Any, Literal, Union, get_args, get_origin

from dse.base import registry
from dse.base.registry import Rule
from dse.config.load import REQUIRED
from dse.config.locate import shipped_profiles
from dse.config.parts import COMPONENTS, FAMILIES, WITH_AXES
from dse.config.resolved import SECTIONS, SETTINGS
from dse.config.search import AUTO
from dse.config.values import Hint, is_list, keys_of

Schema = dict[str, Any]
_SCALARS: dict[object, str] = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "string",
    type(None): "null",
}


def json_schema() -> Schema:
    """Return the schema, made from the components that are registered."""
    lists = ("hardware", "targets", "objectives", "limits")
    sections = {name: _section(name) for name in SECTIONS if name not in lists}
    objectives = [
        text for name, column in registry.columns().items() for text in (name, f"{name}:{column.direction}")
    ]
    # A choice of components repeats what each may hold, so the schema says that once.
    one = {name: sections[name] for name in FAMILIES}
    for name in FAMILIES:
        reference = {"$ref": f"#/$defs/{name}"}
        sections[name] = {"anyOf": [reference, _choice(reference)]}
    sections["objectives"] = _listed({"enum": objectives})
    profile_file = {"type": "string", "pattern": r"\.ya?ml$"}
    sections["hardware"] = _listed({"anyOf": [{"enum": list(shipped_profiles())}, profile_file]})
    sections["targets"] = _listed({"enum": list(registry.known("targets"))})
    sections["limits"] = _listed({"type": "string"})
    sections["search"]["properties"]["sampler"]["enum"].insert(0, AUTO)
    about = {
        "study": {"type": "string"},
        "seed": {"type": "integer", "minimum": 0},
        "plugins": _listed({"type": "string"}),
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "dse search space",
        "type": "object",
        "properties": {**about, **sections},
        "required": list(REQUIRED),
        "additionalProperties": False,
        "$defs": one,
    }


def schema_text() -> str:
    """Return the schema as JSON with a line for every section."""
    texts = []
    for key, value in json_schema().items():
        if key in ("properties", "$defs"):
            lines = [f"{json.dumps(name)}: {json.dumps(inner)}" for name, inner in value.items()]
            texts.append(f"{json.dumps(key)}: {{\n{f',{chr(10)}'.join(lines)}\n}}")
        else:
            texts.append(f"{json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(texts) + "\n}"


def _section(name: str) -> Schema:
    if name not in COMPONENTS and name != "test":
        return _object(SETTINGS[name], axes=name in WITH_AXES, listed=name == "decision")
    known = registry.known(COMPONENTS["data" if name == "test" else name])
    options = []
    for kind, cls in known.items():
        schema = _object(cls, axes=name in WITH_AXES)
        schema["properties"] = {"kind": {"const": kind}, **schema["properties"]}
        schema["required"] = [] if name == "test" else ["kind", *schema.get("required", [])]
        options.append(schema)
    bare = [kind for kind, option in zip(known, options, strict=True) if option["required"] == ["kind"]]
    return {"anyOf": [*options, {"enum": bare}] if name in FAMILIES else options}


def _object(cls: type, *, axes: bool = False, listed: bool = False) -> Schema:
    keys = keys_of(cls)
    for name, key in list(keys.items()):
        for component in key.rule.choices if key.rule.component else ():
            keys |= keys_of(cls, {name: component})  # which of them belong together is checked by the reader
    properties: Schema = {}
    for name, key in keys.items():
        rule, schema = key.rule, _value(key.hint, key.rule)
        if (axes or listed) and rule.axis:
            options = [schema, *_axes(schema)] + ([{"type": "array", "items": schema}] if listed else [])
            schema = {"anyOf": options}
        if rule.doc:
            schema = {**schema, "description": rule.doc + (f" ({rule.unit})" if rule.unit else "")}
        properties[name] = schema
    return _mapping(properties, [name for name, key in keys_of(cls).items() if key.default is None])


def _axes(schema: Schema) -> list[Schema]:
    """Return the two forms of an axis of such values."""
    number = {"type": "number"}
    span = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    keys = {"range": span, "step": number, "log": {"type": "boolean"}}
    return [_choice(schema), _mapping(keys, ["range"])]


def _choice(schema: Schema) -> Schema:
    return _mapping({"choice": {"type": "array", "items": schema, "minItems": 1}}, ["choice"])


def _mapping(properties: Schema, required: list[str]) -> Schema:
    """Return the schema of a mapping without other keys."""
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def _value(hint: Hint, rule: Rule) -> Schema:
    origin, args = get_origin(hint) or hint, get_args(hint)
    if hint is Any or hint is object:
        return {}
    if origin is Literal:
        return {"enum": list(args)}
    if origin in (Union, types.UnionType):
        return {"anyOf": [_value(option, rule) for option in args]}
    if is_list(hint):
        inner = [argument for argument in args if argument is not Ellipsis]
        return _listed(_value(inner[0], rule) if inner else {})  # one value is short for a list of one
    if dataclasses.is_dataclass(origin):
        return _object(typing.cast(type, origin))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _value(args[1], rule) if args else {}}
    if rule.choices:
        return {"enum": list(rule.choices)}
    schema: Schema = {"type": _SCALARS.get(origin, "string")}
    if origin in (int, float):
        schema |= {} if rule.low is None else {"exclusiveMinimum" if rule.low_open else "minimum": rule.low}
        schema |= (
            {} if rule.high is None else {"exclusiveMaximum" if rule.high_open else "maximum": rule.high}
        )
    return schema


def _listed(element: Schema) -> Schema:
    """Return the schema of an element or a list of them."""
    return {"anyOf": [element, {"type": "array", "items": element}]}
