"""Size of a network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Points
from dse.records import Ints
from dse.registry import Column, register


@register("objectives", "n_weights")
@dataclass(frozen=True)
class NWeights:
    """Number W_t of nonzero weights, with recurrent weights and those of delayed inputs.

    Copies of a shared weight count once. Only pruning leaves weights at exactly 0: W_t of a network that was
    not pruned is the source's. `n_weights_dense` is what a family that prunes reports of its training,
    `n_synapses` what one that shares weights does.

    Source: Brayshaw et al., texture and velocity, W_t = sum over layers of i_l i_(l+1) (REFERENCES.md).
    """

    needs = "points"
    columns = (
        Column(
            "n_weights",
            "",
            "min",
            "Number W_t of nonzero weights, with recurrent weights and those of delayed inputs; shared ones "
            "count once.",
            of_design=True,
            known="exact",
        ),
        Column(
            "n_weights_dense",
            "",
            "min",
            "Number of weights, pruned weights included.",
            of_design=True,
        ),
        Column(
            "n_synapses",
            "",
            "min",
            "Number of synapses, of which several share a weight; chips hold and price each.",
            of_design=True,
        ),
    )

    def measure(self, points: Points) -> Mapping[str, Ints]:
        return {"n_weights": points.n_weights}
