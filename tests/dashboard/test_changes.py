import json

from hypothesis import given
from hypothesis import strategies as st

from dse.dashboard.changes import difference

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 2) | st.sampled_from(["", "a", "__proto__"]),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.sampled_from("abcd"), inner, max_size=4),
    max_leaves=20,
)


def applied(old, change):
    """Apply a change as the page does."""
    if change is None:
        return old
    if "set" in change:
        return change["set"]
    if "splice" in change:
        start, removed, items = change["splice"]
        return [*old[:start], *items, *old[start + removed :]]
    keys, gone = change["keys"], change["gone"]
    kept = {key: applied(value, keys.get(key)) for key, value in old.items() if key not in gone}
    return kept | {key: part["set"] for key, part in keys.items() if key not in old}


@given(VALUES, VALUES)
def test_a_change_turns_the_old_into_the_new(old, new):
    change = difference(old, new)
    assert json.dumps(applied(old, change)) == json.dumps(new)  # tells true from 1, and the order of keys
    assert (change is None) == (json.dumps(old) == json.dumps(new))


def test_added_rows_are_all_that_is_sent():
    old = {"columns": {"accuracy": [0.5, 0.6, 0.9], "task": ["a", "a", "a"]}, "notes": ["n"]}
    new = {"columns": {"accuracy": [0.5, 0.7, 0.8, 0.6, 0.9], "task": ["a"] * 5}, "notes": ["n"]}
    assert difference(old, new) == {
        "keys": {
            "columns": {
                "keys": {
                    "accuracy": {"splice": [1, 0, [0.7, 0.8]]},
                    "task": {"splice": [3, 0, ["a", "a"]]},
                },
                "gone": [],
            }
        },
        "gone": [],
    }


def test_the_same_is_no_change():
    assert difference({"a": [1, {"b": None}]}, {"a": [1, {"b": None}]}) is None
