"""Recordings from Python: arrays, events or a data set of (sample, label), written to a file once.

    data = dse.data.from_arrays(signals, labels, step_ms=4)
    study = dse.run({"data": data, "task": {"target": "label"}, ...})

Each function returns section `data` of a search space. Workers, bundles and later sessions read the file,
which is named by its contents unless a name is given.
"""

from dse.data.given import from_arrays, from_dataset, from_events

__all__ = ["from_arrays", "from_dataset", "from_events"]
