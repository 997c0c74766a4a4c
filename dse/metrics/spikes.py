"""Spiking activity S, both ways it is reported.

    S = (1 / N) sum over samples n, neurons i of s_i,n           per inference, Eq. (3)

The source prints values that exceed what one inference can hold and fit the sum over its test set,
so both are recorded: the mean per inference, and the total over the set. Neurons include the input
layer ("the total number of neurons in the network"); `with_input=False` leaves it out.

Source: Brayshaw et al., texture and velocity, Eq. (3) (REFERENCES.md).
"""

from __future__ import annotations

import numpy as np

from dse.metrics import declare, objective
from dse.records import Response

declare(
    "spikes_per_inference_no_input", "", "min", "Mean spikes per inference without those of the input layer."
)


@objective(unit="", direction="min")
def spikes_per_inference(response: Response, with_input: bool = True) -> float:
    """Mean spikes per inference, all layers (S of Eq. 3)."""
    return spikes_total(response, with_input) / len(response.spikes)


@objective(unit="", direction="min")
def spikes_total(response: Response, with_input: bool = True) -> int:
    """Spikes summed over the whole set, all layers (S as the source prints it).

    Raises:
        ValueError: the response holds no samples.
    """
    if len(response.spikes) == 0:
        raise ValueError("spikes need a response with at least one sample, got none")
    return int(response.spikes[:, :, 0 if with_input else 1 :].sum(dtype=np.int64))
