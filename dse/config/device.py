"""Whether the device that a search space names is available; a check of the CPU imports no library."""

from __future__ import annotations

from importlib.util import find_spec

DEVICES = ("cpu", "cuda")


def missing(device: str) -> str | None:
    """Return what a device lacks here, as the end of a sentence; None if it can be used."""
    if device == "cpu":
        return None
    if lack := missing_package("torch", "torch"):
        return lack
    import torch

    if not torch.cuda.is_available():
        return "needs a CUDA device, but torch finds none; execution.device: cpu needs none"
    return None


def missing_package(package: str, extra: str) -> str | None:
    """Return that a package of an extra is not installed, as the end of a sentence; None where it is."""
    if find_spec(package) is not None:
        return None
    return f"needs the package {package}, which is not installed: pip install 'dse[{extra}]'"
