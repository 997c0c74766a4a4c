"""What every component of section `recordings` promises; a new one is tested by being registered."""

import dataclasses

import pytest

from dse import registry
from dse.recordings import RecordingError

COMPONENTS = registry.known("recordings")
REQUIRED = {"file": "absent.npz", "step_ms": 1.0, "width": 4, "channels": ("a",), "taxel": "taxel"}


def test_the_known_formats():
    assert list(COMPONENTS) == ["events", "raster", "table", "time_series"]


@pytest.mark.parametrize("name", COMPONENTS)
def test_every_key_is_explained_and_none_is_an_axis(name):
    for field in dataclasses.fields(COMPONENTS[name]):
        rule = registry.rule_of(field)
        assert rule.doc and not rule.axis, field.name


@pytest.mark.parametrize("name", COMPONENTS)
def test_a_missing_file_is_one_fault_and_one_error(name, tmp_path):
    fields = {field.name for field in dataclasses.fields(COMPONENTS[name])}
    source = COMPONENTS[name](**{key: value for key, value in REQUIRED.items() if key in fields})
    faults = source.check(tmp_path)
    assert len(faults) == 1 and "data file 'absent.npz' not found" in faults[0]
    with pytest.raises(RecordingError, match=r"data file 'absent\.npz' not found"):
        source.read(tmp_path)
