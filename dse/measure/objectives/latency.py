"""Time until the answer: what the sensor needs, and what the hardware adds."""

from __future__ import annotations

from numpy.typing import ArrayLike

from dse.hardware import latency
from dse.measure.objectives import declare, objective
from dse.records import Floats

declare("hardware_latency_ms", "ms", "min", "Computing time of the hardware per inference at full speed.")
declare(
    "t_p_ms", "ms", "min", "Shortest mean decision time among the settings (phi, theta) of best accuracy."
)
declare("t_h_ms", "ms", "min", "Shortest mean decision time among the settings that reach human accuracy.")
declare("t_c_ms", "ms", "min", "Shortest input length at which accuracy is within 10 % of its peak.")
declare(
    "decision_latency_ms",
    "ms",
    "min",
    "Mean time from the first touch to the decision, by the clock of the sensor.",
)
declare("undecided", "", "min", "Fraction of samples that never reach the confidence theta.")


@objective(unit="ms", direction="min")
def latency_ms(decision_ms: ArrayLike, step_ms: float, step_time_us: ArrayLike) -> Floats:
    """Time from the first touch until the hardware has computed the decision.

    The hardware starts a step when its input is complete and the step before is done. With n steps
    of period p that each take c to compute, the last one is done at p + (n - 1) max(p, c) + c.

    Args:
        decision_ms: decision time on the sensor's clock, n p, any shape.
        step_ms: period p of a step.
        step_time_us: computing time c of a step, broadcast against decision_ms.
    """
    return latency.latency_ms(decision_ms, step_ms, step_time_us)
