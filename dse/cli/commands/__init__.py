"""The commands, a module per group: a function each, which parses no text and answers with an `Answer`."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

GROUPS = {
    "begin": ("example", "init", "prepare"),
    "search": ("audit", "check", "doctor", "enqueue", "run"),
    "choose": ("dashboard", "figure", "pick", "report", "skyline"),
    "deploy": ("evaluate", "export", "measure", "reproduce", "stream", "verify"),
    "look_up": ("cost", "describe", "simulate"),
}
"""Module -> its commands, in the order of `dse --help`."""

GROUP_OF = {name: group for group, names in GROUPS.items() for name in names}
"""Command -> its module."""


def function_of(name: str) -> Callable[..., Any]:
    """Return the function of a command; only the module of its group is imported."""
    module = importlib.import_module(f"{__name__}.{GROUP_OF[name]}")
    function: Callable[..., Any] = getattr(module, name)
    return function
