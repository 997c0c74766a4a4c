"""Libraries that a study can do without: what asks for one says so in one sentence."""

from __future__ import annotations

from importlib.util import find_spec


class MissingExtra(RuntimeError):
    """Something needs a library that is not installed; the message says how to install it."""


def require_torch(what: str) -> None:
    """Check that torch is installed, without importing it.

    Raises:
        MissingExtra: it is not.
    """
    if find_spec("torch") is None:
        raise MissingExtra(f"{what} needs torch: pip install 'dse-spiking[torch]'")
