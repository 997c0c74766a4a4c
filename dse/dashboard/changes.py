"""What changed between two versions of a page, small enough to send every time a trial finishes.

A change is one of `{"set": value}`, `{"splice": [start, n_removed, items]}` for a list, or
`{"keys": {key: change}, "gone": [key]}` for a mapping; no change is None. `dashboards/live.js` applies it.
"""

from __future__ import annotations

from typing import Any


def difference(old: Any, new: Any) -> dict[str, Any] | None:
    """Return what turns `old` into `new`, both plain values that JSON can hold; None if they are the same.

    Lists differ in one stretch: what they begin and end with alike is not sent, as when rows were added.
    """
    if old is new:
        return None
    if isinstance(old, dict) and isinstance(new, dict):
        return _of_mappings(old, new)
    if isinstance(old, list) and isinstance(new, list):
        return _of_lists(old, new)
    # JSON tells true from 1, and Python does not.
    same = type(old) is type(new) and old == new
    return None if same else {"set": new}


def _of_mappings(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any] | None:
    kept = [key for key in old if key in new]
    added = [key for key in new if key not in old]
    if [*kept, *added] != list(new):  # the order of columns is what a reader sees
        return {"set": new}
    changed = {key: part for key in kept if (part := difference(old[key], new[key])) is not None}
    gone = [key for key in old if key not in new]
    keys = changed | {key: {"set": new[key]} for key in added}
    return {"keys": keys, "gone": gone} if keys or gone else None


def _of_lists(old: list[Any], new: list[Any]) -> dict[str, Any] | None:
    shorter = min(len(old), len(new))
    head = _alike(old, new, shorter)
    if head == len(old) == len(new):
        return None
    tail = _alike(reversed(old), reversed(new), shorter - head)
    return {"splice": [head, len(old) - head - tail, new[head : len(new) - tail]]}


def _alike(old: Any, new: Any, most: int) -> int:
    """Return how many of the first `most` items are the same."""
    for count, (one, other) in enumerate(zip(old, new, strict=False)):
        if count == most or difference(one, other) is not None:
            return count
    return most
