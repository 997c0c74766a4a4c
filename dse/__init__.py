"""Design space exploration of spiking classifiers for touch.

    space = dse.load_space("fabric_texture")
    study = dse.run(space)                 # or dse.run("quickstart"), or a mapping of its sections
    picked = study.pick(["energy_uj <= 50", "n_weights <= 100000"])
    picked.export("bundle")

Names are imported when first used, so that importing `dse` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dse import data as data
    from dse.api.classifier import Classifier as Classifier
    from dse.api.first import init as init
    from dse.api.study import Study as Study
    from dse.api.study import open as open
    from dse.api.study import run as run
    from dse.config import ConfigError as ConfigError
    from dse.config import load_space as load_space
    from dse.deploy.evaluate import evaluate as evaluate
    from dse.deploy.export import export as export
    from dse.deploy.verify import verify as verify
    from dse.show import figures as figures

__version__ = "0.1.0"

_home = {
    "Classifier": "dse.api.classifier",
    "ConfigError": "dse.config",
    "Study": "dse.api.study",
    "evaluate": "dse.deploy.evaluate",
    "export": "dse.deploy.export",
    "init": "dse.api.first",
    "load_space": "dse.config",
    "open": "dse.api.study",
    "run": "dse.api.study",
    "verify": "dse.deploy.verify",
}

_rooms = {"data": "dse.data", "figures": "dse.show.figures"}

__all__ = [
    "Classifier",
    "ConfigError",
    "Study",
    "__version__",
    "data",
    "evaluate",
    "export",
    "figures",
    "init",
    "load_space",
    "open",
    "run",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use.

    Raises:
        AttributeError: the name is not public.
    """
    if name in _rooms:
        return importlib.import_module(_rooms[name])
    if name not in _home:
        raise AttributeError(f"module 'dse' has no attribute '{name}'; public names: {', '.join(__all__)}")
    return getattr(importlib.import_module(_home[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
