"""Size of a network."""

from __future__ import annotations

from dse.measure.objectives import declare, objective
from dse.records import Network

declare("n_weights_dense", "", "min", "Number of weights, pruned weights included.")


@objective(unit="", direction="min")
def n_weights(network: Network) -> int:
    """Number W_t of nonzero weights, with recurrent weights and those of delayed inputs.

    Only pruning leaves weights at exactly 0: W_t of a network that was not pruned is the source's.

    Source: Brayshaw et al., texture and velocity, W_t = sum over layers of i_l i_(l+1) (REFERENCES.md).
    """
    return network.n_weights
