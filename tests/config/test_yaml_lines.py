import math

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from dse.config.faults import ConfigError, Fault
from dse.config.yaml_lines import dump, override, parse, read_document, scalar


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("null", None),
        ("~", None),
        ("true", True),
        ("False", False),
        ("12", 12),
        ("-3", -3),
        ("0x1F", 31),
        ("0o17", 15),
        ("007", 7),
        ("1e-3", 0.001),
        ("1.", 1.0),
        (".5", 0.5),
        ("-2.5E+2", -250.0),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        # text, where YAML 1.1 would see booleans, a date and base-60 numbers
        ("no", "no"),
        ("on", "on"),
        ("2026-01-02", "2026-01-02"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("e3", "e3"),
    ],
)
def test_scalar_follows_the_core_schema(text, value):
    found = scalar(text)
    assert found == value
    assert type(found) is type(value)


def test_nan_is_a_number():
    assert math.isnan(scalar(".nan"))


@pytest.mark.parametrize("libyaml", [True, False])
def test_every_value_knows_its_line(libyaml, monkeypatch):
    monkeypatch.setattr(yaml, "__with_libyaml__", libyaml and yaml.__with_libyaml__)
    document = parse("a: 1\nb:\n  c: [x,\n    y]\n  d:\n  - 5\n  - {e: 6}\n", "f.yaml")
    assert document.data == {"a": 1, "b": {"c": ["x", "y"], "d": [5, {"e": 6}]}}
    lines = {path: place[1] for path, place in document.places.items()}
    assert lines == {
        (): 1,
        ("a",): 1,
        ("b",): 2,
        ("b", "c"): 3,
        ("b", "c", 0): 3,
        ("b", "c", 1): 4,
        ("b", "d"): 5,
        ("b", "d", 0): 6,
        ("b", "d", 1): 7,
        ("b", "d", 1, "e"): 7,
    }
    assert document.fault(("b", "d", 1, "absent", "deeper"), "text") == Fault("f.yaml", 7, "text")
    assert parse("a: '1'\nb: \"true\"\nc: |\n  3\n", "f").data == {"a": "1", "b": "true", "c": "3\n"}


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("a: 1\nb: 2\na: 3\n", ["f:3: duplicate key 'a', first on line 1"]),
        ("s:\n  a: 1\n  a: 3\n", ["f:3: duplicate key 's.a', first on line 2"]),
        (
            "a: !!python/object:os.system x\n",
            ["f:1: YAML tags are not supported, got 'tag:yaml.org,2002:python/object:os.system'"],
        ),
        ("a: 1\n? [b]\n: 2\n", ["f:2: a key must be a scalar, got a list or a mapping"]),
    ],
)
def test_faults_leave_the_rest_readable(text, faults):
    assert [str(fault) for fault in parse(text, "f").faults] == faults


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", 3),
        ("a: b: c\n", 1),
        ("a: 1\n\tb: 2\n", 2),
        ("a: 1\n\nb: \0\n", 3),
        ("\udc80", 1),
    ],
)
def test_a_syntax_error_has_its_line(text, line):
    (fault,) = parse(text, "f").faults
    assert fault.line == line
    assert fault.message.startswith("not valid YAML: ")


def test_an_alias_inside_its_own_anchor_ends():
    assert "nested more than 50 levels deep" in parse("a: &x [*x]\n", "f").faults[0].message
    [fault] = parse("b: 1\na: &x [*x, *x, *x]\n", "f").faults
    assert (fault.line, "has more than 100000 values here" in fault.message) == (2, True)


def test_aliases_of_aliases_are_counted():
    lines = ["a0: &a0 [1, 2, 3, 4, 5, 6, 7, 8]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 8)}]" for i in range(1, 12)]
    document = parse("\n".join(lines), "f")
    assert document.data == {} and "has more than 100000 values" in document.faults[0].message


def test_a_file_that_is_too_large_is_not_read(tmp_path):
    (tmp_path / "x.yaml").write_text("a: [" + "1," * 600_000 + "1]")
    with pytest.raises(ConfigError, match=r"x\.yaml:1: must have at most 1048576 bytes, got 1200006"):
        read_document(tmp_path / "x.yaml", {})


def test_hostile_nesting_ends():
    assert "nested more than 50 levels deep" in parse("[" * 1500, "f").faults[0].message


def test_an_alias_repeats_its_anchor():
    assert parse("a: &x [1, 2]\nb: *x\n", "f").data == {"a": [1, 2], "b": [1, 2]}


def test_an_empty_file_is_an_empty_mapping():
    assert parse("# nothing\n", "f").data == {}


def test_override_replaces_and_adds():
    document = parse("a: {b: [1, 2], c: 3}\n", "f")
    changed = override(document, {"a.b": "[5]", "a.d.e": "x", "g": ""})
    assert changed.data == {"a": {"b": [5], "c": 3, "d": {"e": "x"}}, "g": None}
    assert document.data == {"a": {"b": [1, 2], "c": 3}}
    assert str(changed.fault(("a", "b", 0), "wrong")) == "--set a.b: wrong"
    assert str(changed.fault(("a", "b", 1), "wrong")) == "--set a.b: wrong"
    assert str(changed.fault(("a", "c"), "wrong")) == "f:1: wrong"


def test_faults_of_an_override_name_it():
    changed = override(parse("a: 1\n", "f"), {"a": "[1", "": "2", "b..c": "3"})
    assert [fault.path for fault in changed.faults] == ["--set a", "--set ", "--set b..c"]
    assert changed.data == {"a": 1}


texts = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), max_size=8)
scalars = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | texts
    | st.sampled_from(["1e3", "no", "0o7", "null", "1_0", "~", "- a", "a: b", "2020-01-01", ".inf", "'"])
)  # fmt: skip
data = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(texts, data, max_size=4))
def test_what_is_dumped_is_read_back(content):
    document = parse(dump(content), "f")
    assert document.faults == []
    assert document.data == content
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(yaml, "__with_libyaml__", False)
        assert parse(dump(content), "f") == document
    assert repr(document.data) == repr(content)  # 1 and 1.0 and True are equal, but not the same


@given(st.text(max_size=60))
def test_no_text_breaks_the_parser(text):
    document = parse(text, "f")
    assert all(
        1 <= fault.line <= text.count("\n") + text.count("\r") + text.count("\x85") + 3
        for fault in document.faults
    )
