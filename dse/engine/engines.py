"""Which engine trains a cohort: kernels of the CPU where its neurons have one, else torch."""

from __future__ import annotations

from collections.abc import Sequence

from dse.base.native.extras import require_torch
from dse.engine import cpu
from dse.engine.layers import has_kernel
from dse.engine.member import Engine, Member


def start(
    members: Sequence[Member], n_samples: int, n_steps: int, device: str = "cpu", threads: int = 1
) -> Engine:
    """Return an engine that trains some members, all or none of whose neurons have a kernel.

    Args:
        members: networks at their start.
        n_samples: most samples of a batch.
        n_steps: steps of a sample.
        device: 'cpu' or 'cuda'.
        threads: of the CPU, over the samples of a batch; a definition runs in one.

    Raises:
        MissingExtra: the neurons have no kernel or the device is no CPU, and torch is not installed.
        ValueError: synapses have delays or decays are learnt, which only the kernels of the CPU do.
    """
    neurons = {type(layer.population) for member in members for layer in member.layers}
    runs_kernels = all(has_kernel(kind) for kind in neurons)
    layers = [layer for member in members for layer in member.layers]
    for what, is_there in (
        ("delays of synapses", any(layer.delay is not None for layer in layers)),
        ("learnt decays", any(layer.learnt_decays != "no" for layer in layers)),
    ):
        if is_there and not (runs_kernels and device == "cpu"):
            raise ValueError(
                f"{what} need device cpu and neurons with a kernel, got "
                + (f"device {device}" if runs_kernels else "neurons without one")
            )
    if runs_kernels and device == "cpu":
        return cpu.start(members, n_samples, n_steps, threads)
    require_torch("device cuda" if runs_kernels else "training neurons without a kernel")
    from dse.engine import autograd

    return autograd.start(members, device)
