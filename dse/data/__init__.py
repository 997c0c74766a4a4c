"""Recordings from Python: arrays, events or a data set of (sample, label), written to a file once.

    data = dse.data.from_arrays(signals, labels, step_ms=4)
    study = dse.run({"data": data, "task": {"target": "label"}, ...})

Each function returns section `data` of a search space. Workers, bundles and later sessions read the file,
which is named by its contents unless a name is given.

The room: files become recordings (`recordings`), recordings spikes (`preprocessing`, `encoders`), and those
data sets that are prepared once (`dataset`); `look` and `starter` guess what files hold, for `dse init`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dse.data.given import from_arrays as from_arrays
    from dse.data.given import from_dataset as from_dataset
    from dse.data.given import from_events as from_events

__all__ = ["from_arrays", "from_dataset", "from_events"]


def __getattr__(name: str) -> Any:
    """Import a public name on first use: who reads spikes needs none of them.

    Raises:
        AttributeError: the name is not public.
    """
    if name not in __all__:
        raise AttributeError(
            f"module 'dse.data' has no attribute '{name}'; public names: {', '.join(__all__)}"
        )
    return getattr(importlib.import_module("dse.data.given"), name)
