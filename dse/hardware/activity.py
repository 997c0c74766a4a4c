"""How often neurons are updated, expected from mean rates alone.

A neuron is updated in a step in which an input arrives or its state is not zero. With a leak that never
reaches exact zero that is from the first arriving input on; a spike arrives one step after it was sent.
Every source fires at random, independently in every step (Bernoulli):

    h_l = 1 - (1 - r_(l-1)) ** n_l                                      something arrives at layer l
    a_l[t] = a_l[t-1] + h_l (a_(l-1)[t-1] - a_l[t-1])                   layer l is awake at step t
    updates_l = size_l sum_t a_l[t]

r_(l-1) mean rate of the layer before, n_l inputs of a neuron; steps count from 1, a_0 = 1 and a_l[1] = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dse.records import Floats


def expected_updates(
    sizes: tuple[int, ...], rates: ArrayLike, n_steps: int, fan_in: tuple[float, ...] | None = None
) -> Floats:
    """Return the expected neuron updates of each layer after the input in an inference, (..., layer - 1).

    Args:
        sizes: neurons per layer, input first.
        rates: (..., layer) mean spikes per neuron and step, input first; the last layer's do not matter.
        n_steps: steps of an inference.
        fan_in: inputs of a neuron of each layer after the input; None: the whole layer before.
    """
    rate = np.asarray(rates, np.float64)
    if rate.shape[-1:] != (len(sizes),):
        raise ValueError(f"rates must have shape (..., {len(sizes)}) as sizes, got {rate.shape}")
    if not ((rate >= 0) & (rate <= 1)).all():
        raise ValueError("rates must be between 0 and 1 spikes per neuron and step")
    arrives = 1 - (1 - rate[..., :-1]) ** np.array(sizes[:-1] if fan_in is None else fan_in)
    # A step takes (1, awake, totals) to the next: total += awake, awake += arrives * (awake before - awake).
    n_layers = len(sizes) - 1
    layer = np.arange(n_layers)
    step = np.tile(np.eye(1 + 2 * n_layers), (*rate.shape[:-1], 1, 1))
    step[..., 1 + layer, 1 + layer] -= arrives
    step[..., 1 + layer, layer] += arrives
    step[..., 1 + n_layers + layer, 1 + layer] = 1
    total = np.linalg.matrix_power(step, n_steps)[..., 1 + n_layers :, 0]
    return np.asarray(total * np.array(sizes[1:]))
