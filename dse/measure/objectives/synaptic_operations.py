"""Synaptic operations: what a spike costs in additions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dse.measure.objectives import objective
from dse.records import Workload


@objective(unit="", direction="min")
def synaptic_operations(workload: Workload) -> NDArray[np.float64]:
    """Mean synaptic operations per inference: each spike counts once per target neuron.

        sum over layers l of spikes_l (n_(l+1) + n_l where l is recurrent)

    Effective accumulates in the sense of NeuroBench for binary inputs: weights that pruning removed do not
    count (`Workload.synapses` in place of the brackets), those that 8 bits round to 0 do. Output spikes have
    no targets.

    Returns:
        (...,), the leading axes of `workload.spikes`.
    """
    reached = workload.fan_out if workload.synapses is None else workload.synapses
    return np.asarray(workload.spikes, dtype=np.float64) @ np.array(reached, dtype=np.float64)
