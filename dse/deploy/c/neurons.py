"""The C of a layer: rows of weights that spikes add, and neurons that step."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dse.deploy.c.bounds import UNITS_PER_STEP
from dse.deploy.c.matrix import Matrix
from dse.deploy.c.memory import common_decay, index, n_leading, states
from dse.deploy.c.plan import LayerPlan, Plan
from dse.deploy.c.text import filled, indented
from dse.neurons import resonator
from dse.neurons.fixed_point import DECAY_SCALE


def rows(plan: Plan) -> Iterator[str]:
    """Yield the functions that add a row of weights, layer by layer."""
    for k, layer in enumerate(plan.layers, 1):
        yield f"/* Adds the weights of an input of layer {k} to its neurons. */\n"
        yield _row(f"reach_{k}", f"weights_{k}", layer.feed_forward, k, layer)
        if layer.recurrent is not None:
            yield f"/* Adds the weights of a neuron of layer {k} to the layer's own neurons. */\n"
            yield _row(f"return_{k}", f"recurrent_{k}", layer.recurrent, k, layer)


def _row(name: str, table: str, matrix: Matrix, k: int, layer: LayerPlan) -> str:
    state, unit = f"{states(layer)[0]}_{k}", UNITS_PER_STEP << matrix.exponent
    if matrix.form == "bytes" and matrix.delays is None:
        return _row_of_bytes(
            name, table, int(matrix.weights.shape[1]), state, f"int{layer.state_bits}_t", unit
        )
    form = matrix.form if matrix.delays is None else f"{matrix.form}_later"
    return filled(
        f"row_{form}.c",
        name=name,
        k=k,
        n=matrix.weights.shape[1],
        n_later=layer.n_later,
        table=table,
        state=state,
        type=f"int{layer.state_bits}_t",
        unit=unit,
        words=matrix.words_per_row,
        per_word=matrix.per_word,
        bits=matrix.bits,
        mask=2**matrix.bits - 1,
        sign=2 ** (matrix.bits - 1),
    )


def _row_of_bytes(name: str, table: str, n: int, state: str, kind: str, unit: int) -> str:
    """Return the function that adds a row of n weights, four at a time: rows of any length take alike."""
    whole, rest = divmod(n, 4)
    added = [f"u[{i}] += w[{i}] * {unit};\n" for i in range(4)]
    loop = indented("".join(added) + "u += 4;\nw += 4;\n")
    body = f"const int8_t *w = {table} + source * {n}u;\n{kind} *u = net.{state};\n"
    if whole:
        body += f"uint32_t i;\nfor (i = 0; i < {whole}u; i++) {{\n{loop}}}\n"
    return f"static void {name}(uint32_t source)\n{{\n{indented(body + ''.join(added[:rest]))}}}\n\n"


_LEAK = """\
/* trunc(x * keep / unit) without more than 32 bits: exact, since both terms have the sign of x. */
#define LEAK(x, keep, unit) ((x) / (unit) * (keep) + (x) % (unit) * (keep) / (unit))

"""


def leaks(plan: Plan) -> str:
    """Return the macro that leaks a state of 32 bits, where a layer needs it."""
    texts = [_update(k, layer) for k, layer in enumerate(plan.layers, 1)]
    return _LEAK if any("LEAK(" in text for text in texts) else ""


def _leaked(x: str, keep: int | str, layer: LayerPlan) -> str:
    """Return the expression of a state after a leak.

    Every leak of 32-bit states takes the same instructions, whatever the weights: work follows from counts.

    Args:
        x: the state.
        keep: 4096 - decay, or an expression of it.
        layer: of the state.
    """
    number, unit = keep, DECAY_SCALE
    if isinstance(keep, int):
        if keep in (0, DECAY_SCALE):
            return "0" if keep == 0 else x
        common = math.gcd(keep, DECAY_SCALE)
        number, unit = keep // common, DECAY_SCALE // common
    if layer.state_bits == 64:
        return f"{x} * {number} / {unit}"
    return f"LEAK({x}, {number}, {unit})"


def _update(k: int, layer: LayerPlan, spikes: str = "") -> str:
    """Return the statements that advance one neuron, given those that a spike runs."""
    population, kind = layer.population, f"int{layer.state_bits}_t"
    if not isinstance(population, resonator.Population):
        keeps: list[int | str] = []
        for name, decay in (("u", population.decay_current), ("v", population.decay_voltage)):
            common = common_decay(decay)
            keeps.append(f"keep_{name}_{k}[i]" if common is None else DECAY_SCALE - common)
        return (
            f"v += u;\nif (v > {layer.threshold}) {{\n    v = 0;\n{spikes}}}\n"
            + _assigned("u", _leaked("u", keeps[0], layer))
            + _assigned("v", _leaked("v", keeps[1], layer))
        )
    turns = np.broadcast_to(population.resonates, layer.n_neurons)
    n = n_leading(turns)
    reset = "    y = 0;\n" if population.reset else ""
    wide = layer.state_bits == 64 or max(layer.bounds.first, layer.bounds.second) >= 2**19
    product = "int64_t" if wide else "int32_t"
    cast = f"({kind})" if product != kind else ""
    turning = (
        f"const {product} c = first_{k}[i], s = second_{k}[i], before = x;\n"
        f"if (y > {layer.threshold}) {{\n{reset}{spikes}}}\n"
        f"x = {cast}((c * before - s * y) / {DECAY_SCALE});\n"
        f"y = {cast}((s * before + c * y) / {DECAY_SCALE});\n"
    )
    leaking = (
        f"y += x;\nif (y > {layer.threshold}) {{\n    y = 0;\n{spikes}}}\n"
        + _assigned("x", _leaked("x", f"first_{k}[i]", layer))
        + _assigned("y", _leaked("y", f"second_{k}[i]", layer))
    )
    if n in (0, layer.n_neurons):
        return turning if n else leaking
    condition = f"turns_{k}[i]" if n is None else f"i < {n}u"
    return f"if ({condition}) {{\n{indented(turning)}}} else {{\n{indented(leaking)}}}\n"


def _assigned(x: str, value: str) -> str:
    return "" if x == value else f"{x} = {value};\n"


def layer_text(plan: Plan, k: int) -> str:
    """Return the function that advances layer k, from 1."""
    layer, last = plan.layers[k - 1], k == len(plan.layers)
    a, b = states(layer)
    spikes = [f"SPIKE({k}, i);"]
    if last:
        spikes.append("net.counts[i]++;")
        rule = plan.rule
        if (rule.first, rule.n) == (0, layer.n_neurons):
            spikes += ["net.total++;", "net.changed = 1;"]
        else:
            inside = f"i < {rule.n}u" if rule.first == 0 else f"i - {rule.first}u < {rule.n}u"
            spikes += [f"if ({inside}) {{", "    net.total++;", "    net.changed = 1;", "}"]
    else:
        spikes += [f"reach_{k + 1}(i);", f"net.awake_{k + 1} = 1;"]
    declare, after = "", ""
    if layer.recurrent is not None:
        longest = max(x.n_neurons for x in plan.layers if x.recurrent is not None)
        spikes.append(f"net.fired[n_fired++] = ({index(longest)})i;")
        declare = "    uint32_t n_fired = 0;\n"
        after = (
            "    for (i = 0; i < n_fired; i++) {\n"
            f"        return_{k}(net.fired[i]);\n        net.awake_{k} = 1;\n    }}\n"
        )
    update = _update(k, layer, indented("\n".join(spikes) + "\n"))
    arriving, busy, arrived = "", "", ""
    if layer.n_later:
        held = f"net.later_{k}[net.now_{k}][i]"
        arriving, arrived, busy = f" + {held}", f"{held} = 0;\n", f" && net.busy_{k} == 0"
        now = f"net.now_{k} + 1u < {layer.n_later}u ? net.now_{k} + 1u : 0u"
        after = f"    net.now_{k} = (uint8_t)({now});\n    net.busy_{k} -= net.busy_{k} != 0;\n{after}"
    return filled(
        "layer.c",
        k=k,
        n_layers=len(plan.layers),
        n=layer.n_neurons,
        kinds=_kinds(layer),
        a=a,
        b=b,
        first=layer.bounds.first,
        second=layer.bounds.second,
        type=f"int{layer.state_bits}_t",
        declare=declare,
        arriving=arriving,
        arrived=indented(indented(arrived)),
        busy=busy,
        update=indented(indented(update)),
        after=after,
    )


def _kinds(layer: LayerPlan) -> str:
    if not isinstance(layer.population, resonator.Population):
        return "CUBA-LIF"
    n = int(np.count_nonzero(np.broadcast_to(layer.population.resonates, layer.n_neurons)))
    return f"{n} resonators, others CUBA-LIF" if n < layer.n_neurons else "resonators"
