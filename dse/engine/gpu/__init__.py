"""The GPU engine: a cohort's layers side by side in one wide network of tensor-core products and scans.

Contract: `start` as in dse.engine.member. In integer arithmetic states and spikes equal dse.neurons bit
for bit; a member's numbers do not depend on which other members train beside it. torch and triton are
imported only once a cohort starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dse.config.device import missing
from dse.engine.member import Member

if TYPE_CHECKING:
    from dse.engine.gpu.wide import WideEngine


class DeviceUnavailable(RuntimeError):
    """The GPU engine cannot run here; the message names what is missing."""


def start(members: Sequence[Member], n_samples: int, n_steps: int) -> WideEngine:
    """Return a cohort on the CUDA device, for batches of at most `n_samples` samples of `n_steps` steps.

    Under Triton's interpreter (TRITON_INTERPRET=1 when triton is first imported) it runs on the CPU,
    slowly: for tests.

    Raises:
        DeviceUnavailable: torch, triton or a CUDA device that multiplies bfloat16 is missing.
        ValueError: members differ in their inputs.
    """
    if lack := missing("cuda"):
        raise DeviceUnavailable(f"device 'cuda' {lack}")
    from dse.engine.gpu.wide import WideEngine, device

    return WideEngine(members, n_samples, n_steps, device())
