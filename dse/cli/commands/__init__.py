"""One module per command; `dse.cli` lists the names that it must define."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

GROUPS = ("begin", "search", "choose", "deploy", "look up")  # the order of `dse --help`


def commands_by_name() -> dict[str, ModuleType]:
    """Return the modules of this package by the name of their command, in the order of `dse --help`."""
    modules = {
        name: importlib.import_module(f"{__name__}.{name}") for _, name, _ in pkgutil.iter_modules(__path__)
    }
    return dict(sorted(modules.items(), key=lambda item: (GROUPS.index(item[1].GROUP), item[0])))
