"""What every component of section `recordings` promises; a new one is tested by being registered."""

import dataclasses
import re

import pytest

from dse.base import registry
from dse.data.recordings import PLACES, RecordingError

COMPONENTS = registry.known("recordings")
REQUIRED = {"step_ms": 1.0, "channels": ("a",), "taxel": "taxel", "samples": ("a",)}
ABSENT = {"file": "absent.npz", "folder": "absent", "scene": "absent.yaml"}


@pytest.mark.parametrize("name", COMPONENTS)
def test_every_key_is_explained_and_none_is_an_axis(name):
    for field in dataclasses.fields(COMPONENTS[name]):
        rule = registry.rule_of(field)
        assert rule.doc and not rule.axis, field.name


@pytest.mark.parametrize("name", COMPONENTS)
def test_what_is_missing_is_one_fault_and_one_error(name, tmp_path):
    fields = {field.name for field in dataclasses.fields(COMPONENTS[name])}
    keys = {key: value for key, value in {**REQUIRED, **ABSENT}.items() if key in fields}
    if name == "events":
        keys["width"] = 4
    (place,) = keys.keys() & ABSENT.keys()
    assert place in PLACES
    source = COMPONENTS[name](**keys)
    told = re.escape(f"'{ABSENT[place]}'")
    (fault,) = source.check(tmp_path)
    assert re.search(told, fault)
    for ask in (source.read, source.content):
        with pytest.raises(RecordingError, match=told):
            ask(tmp_path)


@pytest.mark.parametrize("name", ["events", "long_table", "raster", "table", "time_series", "wide_table"])
def test_content_is_what_is_in_the_file_and_not_where_it_lies(name, tmp_path):
    fields = {field.name for field in dataclasses.fields(COMPONENTS[name])}
    keys = {key: value for key, value in REQUIRED.items() if key in fields}
    keys |= {"events": {"width": 4}, "long_table": {"recording": "id"}}.get(name, {})
    found = []
    for file, inside in (("a.npz", b"one"), ("b.npz", b"one"), ("c.npz", b"two")):
        (tmp_path / file).write_bytes(inside)
        found.append(COMPONENTS[name](file=file, **keys).content(tmp_path))
    assert found[0] == found[1] != found[2]
    beside = COMPONENTS[name](file="a.npz", labels="c.npz", **keys).content(tmp_path)
    assert beside not in found, "labels count"
