"""Spiking activity S, both ways it is reported.

    S = (1 / N) sum over samples n, neurons i of s_i,n           per inference, Eq. (3)

The source prints values that exceed what one inference can hold and fit the sum over its test set,
so both are recorded: the mean per inference, and the total over the set. Neurons include the input
layer ("the total number of neurons in the network"); a column of its own leaves it out.

Source: Brayshaw et al., texture and velocity, Eq. (3) (REFERENCES.md).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dse.measure.objectives import objective
from dse.records import Workload


@objective(unit="", direction="min")
def spikes_per_inference(workload: Workload) -> NDArray[np.float64]:
    """Mean spikes per inference, all layers (S of Eq. 3).

    Returns:
        (...,), the leading axes of `workload.spikes`.
    """
    return np.asarray(np.asarray(workload.spikes, dtype=np.float64).sum(axis=-1))


@objective(unit="", direction="min")
def spikes_per_inference_no_input(workload: Workload) -> NDArray[np.float64]:
    """Mean spikes per inference, without the input layer."""
    return np.asarray(np.asarray(workload.spikes, dtype=np.float64)[..., 1:].sum(axis=-1))


@objective(unit="", direction="min")
def spikes_total(spikes: ArrayLike, n_samples: int) -> NDArray[np.int64]:
    """Spikes of all layers, summed over all samples of the set (S as published).

    Args:
        spikes: (...,) mean spikes per inference.
        n_samples: size of the set.
    """
    return np.asarray(np.rint(np.asarray(spikes, np.float64) * n_samples).astype(np.int64))
