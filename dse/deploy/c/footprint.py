"""What a classifier takes as C, known before it is written."""

from __future__ import annotations

from dataclasses import dataclass

from dse.deploy.c import counting_source, memory
from dse.deploy.c.counting import CountingPlan
from dse.deploy.c.plan import Plan


@dataclass(frozen=True)
class Footprint:
    """Memory of the C of a classifier.

    ram_bytes: all static data, exactly as a compiler lays it out; the stack holds a few words more.
    table_bytes: constant data of the classifier in flash: weights and parameters, without code.
    """

    ram_bytes: int
    table_bytes: int


def footprint(plan: Plan | CountingPlan) -> Footprint:
    """Return the memory of the C of a plan."""
    if isinstance(plan, Plan):
        return Footprint(memory.ram_bytes(plan), memory.table_bytes(plan))
    tables = counting_source.tables(plan)
    return Footprint(
        memory.struct_bytes(counting_source.members(plan)), sum(table.n_bytes for table in tables)
    )
