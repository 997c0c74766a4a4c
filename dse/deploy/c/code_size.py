"""Flash of the C on Cortex-M before it is compiled: constant data, exactly, and code, from measured parts.

The parts are a least-squares fit to 60 compiled networks (ziglang 0.17.1, -O2), those of `xylo_lif` to 9,
and the code of encoders and pooling that of one or two designs each, of `receptors` with the
arithmetic of doubles. On networks left out of the fit, flash is off by 0.6 % in the mean, at most by 4.3 % or
400 bytes. Those of classifiers of counts are fitted to 50; of 20 others, flash is off by at most 197 bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from dse.deploy.c import counting_source, source
from dse.deploy.c.arrays import struct_bytes
from dse.deploy.c.counting import CountingPlan
from dse.deploy.c.neurons import adder_name, is_short
from dse.deploy.c.plan import Plan
from dse.deploy.form import Frame, ReceptorsForm
from dse.neurons import resonator, xylo_lif

_PARTS = {
    "base": (1245.0, 1276.9),
    "delayed_copies": (397.7, 496.0),
    "confidence": (40.3, 67.0),
    "cuba_lif": (317.2, 347.5),
    "xylo_lif": (360.0, 350.0),
    "xylo_output": (94.0, 140.0),
    "resonators": (318.1, 421.0),
    "mixed": (424.8, 512.6),
    "recurrent": (101.3, 94.1),
    "short_matrix": (-163.3, -250.9),
    "short_row": (31.4, 39.8),
    "add_bytes": (628.4, 607.6),
    "add_words": (376.7, 345.8),
    "add_sparse": (264.0, 264.2),
    "add_later": (517.2, 424.2),
    "held": (254.4, 170.5),
    "many_classes": (165.6, 135.9),
    "samples": (290.0, 385.0),
    "events": (390.0, 395.0),
    "receptors": (4400.0, 4680.0),
    "counting": (650.0, 600.0),
    "many_places": (263.0, 243.0),
    "two_places": (-179.0, -221.0),
    "several_words": (186.0, 144.0),
    "nearest": (455.0, 432.0),
    "neighbours": (327.0, 239.0),
    "bayes": (4272.0, 4491.0),
    "bayes_halves": (1080.0, 754.0),
    "perceptron": (1039.0, 3008.0),
    "extreme": (1123.0, 2961.0),
    "extreme_double": (4234.0, 4254.0),
    "doubles_again": (-1850.0, -1950.0),
}
"""Bytes of each part: on cores with the Thumb-2 instructions, and on a Cortex-M0+."""
CORTEX_M, CORTEX_M0_PLUS = ({name: sizes[k] for name, sizes in _PARTS.items()} for k in range(2))


def footprint(plan: Plan | CountingPlan) -> dict[str, float]:
    """Return ram_bytes, all static data as a compiler lays it out, and table_bytes, constants.

    The stack holds a few words more.
    """
    if isinstance(plan, Plan):
        members, tables = source.members(plan), source.tables(plan)
    else:
        members, tables = counting_source.members(plan), counting_source.tables(plan)
    return {"ram_bytes": float(struct_bytes(members)), "table_bytes": float(sum(x.n_bytes for x in tables))}


def constant_bytes(plan: Plan | CountingPlan) -> float:
    """Return the bytes of all constants of a plan."""
    return footprint(plan)["table_bytes"] + other_constants(plan)


def flash_bytes(plan: Plan | CountingPlan, bytes_of_part: Mapping[str, float]) -> float:
    """Return code and constant data, in bytes."""
    code = sum(n * bytes_of_part[part] for part, n in parts(plan).items())
    return float(round(constant_bytes(plan) + code))


def parts(plan: Plan | CountingPlan) -> Counter[str]:
    """Return how often each part of the code occurs."""
    n = _classifier_parts(plan) if isinstance(plan, CountingPlan) else _network_parts(plan)
    if plan.front_end != "spikes":
        n["receptors" if isinstance(plan.encoder, ReceptorsForm) else plan.front_end] = 1
    return n


def _classifier_parts(plan: CountingPlan) -> Counter[str]:
    n = Counter(counting=1, **plan.classifier.parts)
    n["many_places"], n["two_places"] = len(plan.labels) > 4, len(plan.labels) <= 2  # unrolled loops
    n["several_words"] = plan.channel_words > 1
    # Encoder and classifier call the same routines.
    n["doubles_again"] = plan.classifier.has_doubles and isinstance(plan.encoder, ReceptorsForm)
    return n


def _network_parts(plan: Plan) -> Counter[str]:
    adders: dict[str, str] = {}
    n = Counter(base=1, delayed_copies=any(plan.delays), confidence=plan.rule.least_total is not None)
    n["many_classes"] = len(plan.classes) > 4  # their names are searched with a longer loop
    for layer in plan.layers:
        turning = np.broadcast_to(getattr(layer.population, "resonates", False), layer.n_neurons)
        is_mixed = isinstance(layer.population, resonator.Population) and turning.any() and not turning.all()
        kind = "mixed" if is_mixed else "resonators" if turning.all() else "cuba_lif"
        if isinstance(layer.population, xylo_lif.Population):
            kind = "xylo_lif" if layer.most_spikes > 1 else "xylo_output"
        n[kind] += 1
        n["recurrent"] += layer.back is not None
        n["held"] += layer.n_later > 0
        for matrix in (layer.forward, layer.back):
            if matrix is None:
                continue
            if is_short(matrix):
                n["short_matrix"] += 1
                n["short_row"] += matrix.row_length
            else:
                adders[adder_name(matrix, layer)] = "later" if matrix.delays is not None else matrix.form
    n.update(f"add_{form}" for form in adders.values())
    return n


def other_constants(plan: Frame) -> int:
    """Return the bytes of constants beside the tables: names of classes, pools of pixels."""
    names = sum(len(name.encode()) + 1 for name in plan.classes)
    if isinstance(plan.encoder, ReceptorsForm):
        return names + 8 * (2 * plan.encoder.n_sensors + plan.encoder.kinds.size)
    if plan.pooling is None:
        return names
    _, _, columns, rows = plan.pooling.crop
    pools = plan.pooling
    return names + columns * (1 if pools.width <= 256 else 2) + rows * (1 if pools.height <= 256 else 2)
