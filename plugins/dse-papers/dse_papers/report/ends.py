"""The ends of the front of accuracy, spikes S and weights W_t: what a paper prints of its designs.

Source: Brayshaw et al., texture and velocity, Table 3 (REFERENCES.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dse.skyline.admissible import honest, leave_out_unmeasured
from dse.skyline.table import Goal, costs_of

if TYPE_CHECKING:
    import pandas

ENDS = ("best accuracy", "least spikes", "least weights")


def front_ends(designs: pandas.DataFrame, spikes: str) -> dict[str, Any]:
    """Return each of `ENDS` and the index of its design; nothing where no design can be compared.

    Ties go to the better accuracy, then to the smaller S, then to the smaller W_t, then to the first row. An
    end by this rule is on the front itself.

    Args:
        designs: a row each, with columns accuracy and n_weights.
        spikes: column of S.

    Raises:
        ExpressionError: a column is missing, or holds no numbers.
    """
    rows, _ = leave_out_unmeasured(designs[honest(designs)], ["accuracy", spikes, "n_weights"])
    goals = Goal("accuracy", "max"), Goal(spikes, "min"), Goal("n_weights", "min")
    costs = costs_of(rows, goals).T
    order = [np.lexsort((*costs[::-1], cost)) for cost in costs]
    return {end: rows.index[of_end[0]] for end, of_end in zip(ENDS, order, strict=True) if len(of_end)}
