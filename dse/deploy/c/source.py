"""The C of a spiking network: one source."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dse.deploy.c.arrays import Member, Table, declared, index, struct_bytes
from dse.deploy.c.files import Code
from dse.deploy.c.front_end import begin, binned, floats, front_end, front_end_members, level_type
from dse.deploy.c.neurons import layer_members, layer_tables, layer_text, leaks, rows
from dse.deploy.c.plan import Plan
from dse.deploy.c.text import NAMES, TITLE, filled

_ALL_CHANNELS = 2**16


def code(plan: Plan) -> Code:
    """Return a spiking network as C."""
    variables, constants = members(plan), tables(plan)
    sizes = "-".join(str(n) for n in (plan.n_channels, *(layer.n_neurons for layer in plan.layers)))
    source = filled(
        "dse.c",
        title=TITLE,
        ram_bytes=struct_bytes(variables),
        table_bytes=sum(table.n_bytes for table in constants),
        network_steps=plan.network_steps,
        floats=floats(plan),
        tables="\n".join(table.text for table in constants) + level_type(plan),
        members=declared(variables),
        leaks=leaks(plan),
        rows="".join(rows(plan)),
        layers="".join(layer_text(plan, k) for k in range(len(plan.layers), 0, -1)),
        front_end=front_end(plan),
        init=begin(plan),
        **_decision(plan),
        **_step(plan),
        **_rest(variables),
        **binned(plan),
        n_outputs=plan.layers[-1].n_neurons,
        names=NAMES,
        n_classes=len(plan.classes),
    )
    what = f"A {sizes} network of spiking neurons: integers only"
    return Code(plan, source, plan.layers[-1].n_neurons, plan.steps_per_sample, variables, constants, what)


def members(plan: Plan) -> list[Member]:
    """Return all variables."""
    out = [member for k, layer in enumerate(plan.layers, 1) for member in layer_members(k, layer)]
    recurrent = [x for x in plan.layers if x.back is not None]
    if recurrent:
        longest = max(x.n_neurons for x in recurrent)
        out.append(Member(index(longest), "fired", (longest,), "neurons of a recurrent layer in this step"))
    if often := max((x.n_neurons for x in recurrent if x.most_spikes > 1), default=0):
        out.append(Member("uint8_t", "times", (often,), "how often they did"))
    counted = "uint16_t" if plan.network_steps < 2**16 else "uint32_t"
    places = plan.n_slots, plan.channel_words
    out += [
        Member(counted, "counts", (plan.layers[-1].n_neurons,), "output spikes", True),
        Member("uint32_t", "total", (), "of all outputs that answer"),
        Member("uint32_t", "step", (), "network steps since dse_reset()"),
        Member("uint32_t", "answered", (), "step of the answer"),
        Member("int16_t", "answer", (), "the class + 1; 0: none so far"),
        Member("uint8_t", "confident"),
        Member("uint8_t", "changed", (), "whether an output spiked since the last look"),
        Member("uint32_t", "spikes", places, "input spikes, a bit per channel", True),
    ]
    if plan.is_delayed:
        out += [
            Member("uint32_t", "sample", (), "input steps since dse_reset()", True),
            Member("uint16_t", "slot", (), "of this step in `spikes`", True),
        ]
    pushed = Member("uint8_t", "pushed", (), "whether there are any in this step", True)
    return [*out, pushed, *front_end_members(plan)]


def tables(plan: Plan) -> list[Table]:
    """Return the constant data of the network, without that of the front end."""
    out = [table for k, layer in enumerate(plan.layers, 1) for table in layer_tables(k, layer)]
    if plan.is_delayed:
        later = [(d, copy) for copy, d in enumerate(plan.delays) if d]
        k = plan.steps_per_sample
        out += [
            Table("uint16_t", "lags", np.array([d // k for d, _ in later])),
            Table("uint16_t", "copies", np.array([copy * plan.n_channels for _, copy in later])),
        ]
        if k > 1:
            out.append(Table("uint16_t", "parts", np.array([d % k for d, _ in later])))
    if plan.rule.joint:
        joint = np.array([x if x >= 0 else -2 for x in plan.rule.joint])
        out.append(Table("int16_t", "joint", joint))
    return out


def _decision(plan: Plan) -> dict[str, Any]:
    """Return the values of the decision in dse.c."""
    rule, confidence = plan.rule, plan.rule.confidence
    sure = ""
    if confidence:
        largest = plan.network_steps * plan.layers[-1].n_neurons
        wide = largest * max(confidence.numerator, confidence.denominator) >= 2**32
        cast = "(uint64_t)" if wide else ""
        sure = (
            f" && {cast}net.counts[best] * {confidence.denominator}u >= "
            f"{cast}net.total * {confidence.numerator}u"
        )
    heads = [{**_of_outputs(first, n), "n": n} for first, n in rule.heads]
    values = {"joint": bool(rule.joint), "heads": heads, "last": rule.last, "sure": sure}
    return {**values, "least": rule.least_total, **_of_outputs(rule.first, rule.n)}


def _of_outputs(first: int, n: int) -> dict[str, Any]:
    """Return the values by which the most active of some outputs is found, the lowest on ties."""
    return {"first": first, "second": first + 1, "end": first + n, "less": f" - {first}u" if first else ""}


def _step(plan: Plan) -> dict[str, Any]:
    """Return the values of a step and its input spikes in dse.c."""
    copies = [copy * plan.n_channels for copy, delay in enumerate(plan.delays) if delay == 0]
    several_parts = plan.steps_per_sample > 1
    return {
        "bound": "" if plan.n_channels == _ALL_CHANNELS else f"channel >= {plan.n_channels}u || ",
        "slot": "net.slot" if plan.n_slots > 1 else "0",
        "several_slots": plan.n_slots > 1,
        "n_slots": plan.n_slots,
        "channel_words": plan.channel_words,
        "at_once": [{"copy": f"{first}u + " if first else ""} for first in copies],
        "delayed": plan.is_delayed,
        "n_later": len(plan.delays) - len(copies),
        "part": ", part" if several_parts else "",
        "of_part": " && parts[i] == part" if several_parts else "",
        "in": " " * (8 if several_parts else 4),
        "per_sample": plan.steps_per_sample,
        "steps": [{"k": k} for k in range(len(plan.layers), 0, -1)],
    }


def _rest(variables: Sequence[Member]) -> dict[str, Any]:
    """Return the values by which dse.c sets the network to rest: arrays, then single numbers."""
    arrays = [x for x in variables if x.is_cleared and x.lengths]
    calls = []
    for x in arrays:
        slots = x.lengths[0] if len(x.lengths) > 1 else 1
        slot = "" if len(x.lengths) == 1 else "[i]" if slots > 1 else "[0]"
        place = f"net.{x.name}{slot}"
        calls.append(
            {"name": _clear_name(x), "place": place, "n": x.lengths[-1], "slots": slots if slots > 1 else 0}
        )
    return {
        "clearing": [
            {"name": name, "kind": kind} for kind, name in {x.kind: _clear_name(x) for x in arrays}.items()
        ],
        "arrays": calls,
        "numbers": [{"name": x.name} for x in variables if x.is_cleared and not x.lengths],
    }


def _clear_name(array: Member) -> str:
    return f"dse_clear_{array.kind.removesuffix('_t')}"
