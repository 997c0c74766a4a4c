"""Search spaces as YAML: one file is one study.

`load_space` returns a validated `SearchSpace` or raises one `ConfigError` that lists every fault with its
line. A new component needs no change here: its dataclass fields are its keys, their annotations and `param`
rules are what is checked. A new section is one entry in `sections.py`. What reads is imported when needed.
"""

import importlib
from typing import TYPE_CHECKING, Any

from dse.config.faults import ConfigError, Fault, known_names

if TYPE_CHECKING:
    from dse.config.axes import Axis
    from dse.config.load import load_space
    from dse.config.locate import shipped_spaces
    from dse.config.resolved import Sections
    from dse.config.settings import ExecutionSettings
    from dse.config.space import DecisionGrid, Design, SearchSpace

_IN = {
    **{"Axis": "axes", "load_space": "load", "shipped_spaces": "locate", "Sections": "resolved"},
    **{"ExecutionSettings": "settings", "DecisionGrid": "space", "Design": "space", "SearchSpace": "space"},
}

__all__ = [
    "Axis",
    "ConfigError",
    "DecisionGrid",
    "Design",
    "ExecutionSettings",
    "Fault",
    "SearchSpace",
    "Sections",
    "known_names",
    "load_space",
    "shipped_spaces",
]


def __getattr__(name: str) -> Any:
    if name not in _IN:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_IN[name]}"), name)
