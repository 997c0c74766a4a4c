"""Time until the answer: what the sensor needs, and what the hardware adds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dse.records import Floats


def latency_ms(decision_ms: ArrayLike, step_ms: float, step_time_us: ArrayLike) -> Floats:
    """Time from the first touch until the hardware has computed the decision.

    The hardware starts a step when its input is complete and the step before is done. With n steps
    of period p that each take c to compute, the last one is done at p + (n - 1) max(p, c) + c.

    Args:
        decision_ms: decision time on the sensor's clock, n p, any shape.
        step_ms: period p of a step.
        step_time_us: computing time c of a step, broadcast against decision_ms.
    """
    compute_ms = np.asarray(step_time_us, dtype=np.float64) / 1e3
    steps_before = np.asarray(decision_ms, dtype=np.float64) / step_ms - 1
    return np.asarray(step_ms + steps_before * np.maximum(step_ms, compute_ms) + compute_ms)
