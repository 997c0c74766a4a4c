"""What a classifier takes as C, known before it is written."""

from __future__ import annotations

from dataclasses import dataclass

from dse.deploy.bundle import Bundle
from dse.deploy.c.memory import ram_bytes, table_bytes
from dse.deploy.c.plan import plan_of


@dataclass(frozen=True)
class Footprint:
    """Memory of the C of a classifier.

    ram_bytes: all static data, exactly as a compiler lays it out; the stack holds a few words more.
    table_bytes: constant data of the network in flash: weights and parameters, without code.
    """

    ram_bytes: int
    table_bytes: int


def footprint(bundle: Bundle) -> Footprint:
    """Return the memory of the C of a bundle, which need not be stored.

    Raises:
        Unsupported: C cannot hold the classifier.
    """
    plan = plan_of(bundle)
    return Footprint(ram_bytes(plan), table_bytes(plan))
