"""Search spaces as YAML: one file is one study.

`load_space` returns a validated `SearchSpace` or raises one `ConfigError` that lists every fault with its
line. A new component needs no change here: its dataclass fields are its keys, their annotations and `param`
rules are what is checked. A new section is one entry in `resolved.py`. What reads is imported when needed.
"""

import importlib
from typing import TYPE_CHECKING, Any

from dse.config.faults import ConfigError as ConfigError
from dse.config.faults import Fault as Fault
from dse.config.faults import known_names as known_names

if TYPE_CHECKING:
    from dse.config.axes import Axis as Axis
    from dse.config.load import load_space as load_space
    from dse.config.locate import shipped_spaces as shipped_spaces
    from dse.config.resolved import Sections as Sections
    from dse.config.settings import ExecutionSettings as ExecutionSettings
    from dse.config.space import DecisionGrid as DecisionGrid
    from dse.config.space import Design as Design
    from dse.config.space import SearchSpace as SearchSpace

_IN = {
    **{"Axis": "axes", "load_space": "load", "shipped_spaces": "locate", "Sections": "resolved"},
    **{"ExecutionSettings": "settings", "DecisionGrid": "space", "Design": "space", "SearchSpace": "space"},
}


def __getattr__(name: str) -> Any:
    if name not in _IN:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_IN[name]}"), name)
