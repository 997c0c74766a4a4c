"""The C of a classifier of counts: one source."""

from __future__ import annotations

import numpy as np

from dse.deploy.c.arrays import Member, Table, declared, struct_bytes
from dse.deploy.c.counting import CountingPlan
from dse.deploy.c.files import Code
from dse.deploy.c.front_end import begin, binned, floats, front_end, front_end_members, level_type
from dse.deploy.c.text import NAMES, TITLE, filled


def code(plan: CountingPlan) -> Code:
    """Return a classifier of counts as C."""
    variables, constants, classifier = members(plan), tables(plan), plan.classifier
    shared = {"n_features": plan.n_features, "n_places": len(plan.labels), "count": plan.counter}
    row = "(uint32_t)rows[net.window]"
    each = plan.per_window > 1 or plan.n_channels == 1
    source = filled(
        "counting.c",
        title=TITLE,
        ram_bytes=struct_bytes(variables),
        table_bytes=sum(table.n_bytes for table in constants),
        family=plan.family,
        n_steps=plan.n_steps,
        floats=floats(plan, [table.kind for table in constants]),
        tables="\n".join(table.text for table in constants) + level_type(plan),
        members=declared(variables),
        bound="" if plan.n_channels == 2**16 else f"channel >= {plan.n_channels}u || ",
        n_windows=len(plan.ends),
        place=f"{row} * {plan.per_window}u + channel" if each else row,
        classify=filled(classifier.template, **shared, **classifier.values),
        channel_words=plan.channel_words,
        front_end=front_end(plan),
        n_features=plan.n_features,
        init=begin(plan),
        **binned(plan),
        names=NAMES,
        n_classes=len(plan.classes),
    )
    what = f"A classifier of family {plan.family} on {plan.n_features} spike counts. "
    return Code(plan, source, 0, 1, variables, constants, what + classifier.arithmetic)


def members(plan: CountingPlan) -> list[Member]:
    """Return all variables."""
    return [
        Member(plan.counter, "counts", (plan.n_features,), "spikes by window and channel"),
        Member("uint32_t", "step", (), "steps since dse_reset()"),
        Member("uint32_t", "answered", (), "step of the answer"),
        Member("uint16_t", "window", (), "counting window"),
        Member("int16_t", "answer", (), "the class + 1; 0: none so far"),
        Member("uint32_t", "spikes", (1, plan.channel_words), "input spikes, a bit per channel"),
        Member("uint8_t", "pushed", (), "whether there are any in this step"),
        *plan.classifier.members,
        *front_end_members(plan),
    ]


def tables(plan: CountingPlan) -> list[Table]:
    """Return the constant data."""
    return [
        Table("uint32_t", "ends", np.array(plan.ends)),
        Table("int16_t", "rows", np.array(plan.rows)),
        Table("int16_t", "labels", np.array(plan.labels)),
        *plan.classifier.tables,
    ]
