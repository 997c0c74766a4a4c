"""Which class says what each section of a search space may hold.

`data`, `encoder` and `model` hold one component of a package, named by `kind`; the other sections
are one dataclass each (`dse.config.settings`). Components are imported when they are asked for.
"""

from __future__ import annotations

import typing
from collections.abc import Mapping
from typing import Any

from dse import registry
from dse.config.settings import (
    Decision,
    ExecutionSettings,
    Precision,
    Preprocessing,
    Search,
    Split,
    Task,
    Training,
    Window,
)

# Sections whose component may be an axis.
FAMILIES = ("encoder", "model")
COMPONENTS = {"data": "recordings", "encoder": "encoders", "model": "models"}
SETTINGS: Mapping[str, type] = {
    "task": Task,
    "window": Window,
    "split": Split,
    "preprocessing": Preprocessing,
    "training": Training,
    "decision": Decision,
    "precision": Precision,
    "search": Search,
    "execution": ExecutionSettings,
}
# In the order of a file; `test` holds keys of `data`, `hardware` and `objectives` are lists of names.
SECTIONS = (
    *("data", "task", "window", "split", "test", "preprocessing", "encoder", "model", "training", "decision"),
    *("precision", "hardware", "objectives", "search", "execution"),
)
WITH_AXES = ("window", "preprocessing", "encoder", "model", "training", "task")


def settings_class(section: str) -> type:
    """Return the dataclass of a section that has no `kind`."""
    return SETTINGS[section]


def components(section: str) -> dict[str, type]:
    """Return the components that `kind` of a section may name."""
    return registry.known(COMPONENTS[section])


def front_end(recordings: type[Any]) -> str | None:
    """Return the section that what a recordings component reads cannot do without; None for spikes.

    Signals need an encoder and events preprocessing; spikes, and events once they are counted, may have an
    encoder as well.
    """
    hint = typing.get_type_hints(recordings.read)["return"]
    found = {_front_end(kind) for kind in typing.get_args(hint) or (hint,)}
    if len(found) > 1:
        raise TypeError(f"{recordings.__name__}.read must return recordings of one kind, got {hint}")
    return found.pop()


def _front_end(kind: type[Any]) -> str | None:
    """Return the section for one kind of recordings; what yields `blocks` is a source of events."""
    if hasattr(kind, "blocks"):
        return "preprocessing"
    return "encoder" if kind.__name__ == "Signals" else None
