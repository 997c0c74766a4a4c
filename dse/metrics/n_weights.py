"""Size of a network."""

from __future__ import annotations

from dse.metrics import objective
from dse.records import Network


@objective(unit="", direction="min")
def n_weights(network: Network) -> int:
    """Number of weights W_t, recurrent and delayed-input weights included.

    Source: Brayshaw et al., texture and velocity, W_t = sum over layers of i_l i_(l+1) (REFERENCES.md).
    """
    return network.n_weights
