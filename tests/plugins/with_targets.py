"""Targets of tests/plugins/arrays_target.py for the time of a test."""

from dse.base import registry
from tests.plugins.arrays_target import Arrays, Locked, Stubborn, Unread


def load(monkeypatch):
    """Make the targets known until the test ends."""
    ours = {"arrays": Arrays, "locked": Locked, "unread": Unread, "stubborn": Stubborn}
    monkeypatch.setitem(registry._components, "targets", registry.known("targets") | ours)
