"""Whether the device that a search space names is available; a check of the CPU imports no library."""

from __future__ import annotations

import os
from importlib.util import find_spec

DEVICES = ("cpu", "cuda")
_CAPABILITY = (8, 0)


def missing(device: str) -> str | None:
    """Return what a device lacks here, as the end of a sentence; None if it can be used.

    Under Triton's interpreter (TRITON_INTERPRET=1) 'cuda' needs no CUDA device: for tests.
    """
    if device == "cpu":
        return None
    for package in ("torch", "triton"):
        if lack := missing_package(package, "gpu"):
            return lack
    if os.environ.get("TRITON_INTERPRET") == "1":
        return None
    import torch

    if not torch.cuda.is_available():
        return "needs a CUDA device, but torch finds none; execution.device: cpu needs none"
    major, minor = torch.cuda.get_device_capability()
    if (major, minor) < _CAPABILITY:
        return f"needs compute capability 8.0 or later (for bfloat16 products), got {major}.{minor}"
    return None


def missing_package(package: str, extra: str) -> str | None:
    """Return that a package of an extra is not installed, as the end of a sentence; None where it is."""
    if find_spec(package) is not None:
        return None
    return f"needs the package {package}, which is not installed: pip install 'dse[{extra}]'"
