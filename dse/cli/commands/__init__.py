"""The commands, a function each, which parses no text and answers with an `Answer`."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

MODULE_OF = {
    **dict.fromkeys(("example", "init", "prepare"), "begin"),
    **dict.fromkeys(("audit", "check", "doctor", "enqueue", "run"), "search"),
    **{"dashboard": "choose", "figure": "drawing", "pick": "choose"},
    **{"report": "reporting", "skyline": "choose"},
    **dict.fromkeys(("evaluate", "export", "measure", "reproduce"), "deploy"),
    **{"stream": "streaming", "verify": "deploy"},
    **{"cost": "costs", "describe": "look_up", "simulate": "simulation"},
}
"""Command -> its module, in the order of `dse --help`."""


def function_of(name: str) -> Callable[..., Any]:
    """Return the function of a command; no other module of commands is imported."""
    function: Callable[..., Any] = getattr(importlib.import_module(f"{__name__}.{MODULE_OF[name]}"), name)
    return function
