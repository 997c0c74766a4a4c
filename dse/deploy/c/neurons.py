"""The C of a layer: rows of weights that spikes add, and neurons that step."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dse.deploy.c.matrix import Matrix
from dse.deploy.c.memory import common, index, n_leading, states
from dse.deploy.c.plan import LayerPlan, Plan
from dse.deploy.c.text import filled, indented
from dse.neurons import resonator, xylo_lif
from dse.neurons.fixed_point import DECAY_SCALE

_SHORT_ROW = 16
"""Weights of a row up to which the C has no loop."""


def rows(plan: Plan) -> Iterator[str]:
    """Yield the functions that add a row of weights: one per form of rows, then one per matrix."""
    matrices = []
    for k, layer in enumerate(plan.layers, 1):
        matrices.append((f"reach_{k}", f"weights_{k}", layer.feed_forward, k, layer))
        if layer.recurrent is not None:
            matrices.append((f"return_{k}", f"recurrent_{k}", layer.recurrent, k, layer))
    shared = (_adder(matrix, layer) for _, _, matrix, _, layer in matrices if not is_short(matrix))
    yield from dict.fromkeys(shared)
    for name, table, matrix, k, layer in matrices:
        what = "an input of layer" if name.startswith("reach") else "a neuron of recurrent layer"
        yield f"/* Adds the weights of {what} {k}. */\n"
        body = indented(_added(table, matrix, k, layer))
        yield f"static APART void {name}(uint32_t source)\n{{\n{body}}}\n\n"


def _adder(matrix: Matrix, layer: LayerPlan) -> str:
    """Return the function that adds a row of a form: all rows of a form run the same instructions."""
    return filled(
        f"add_{_form(matrix)}.c",
        name=adder_name(matrix, layer),
        type=f"int{layer.state_bits}_t",
        column_type=index(int(matrix.weights.shape[1])),
        per_word=matrix.per_word,
        bits=matrix.bits,
        mask=2**matrix.bits - 1,
        sign=2 ** (matrix.bits - 1),
        unit=layer.unit << matrix.exponent,
    )


def is_short(matrix: Matrix) -> bool:
    """Return whether a row is added in a straight line, which a loop would hardly be shorter than."""
    return matrix.form == "bytes" and matrix.delays is None and matrix.row_length <= _SHORT_ROW


def _form(matrix: Matrix) -> str:
    return matrix.form if matrix.delays is None else f"{matrix.form}_later"


def adder_name(matrix: Matrix, layer: LayerPlan) -> str:
    """Return the name of the function that adds the rows of a matrix."""
    kind = {"bytes": "", "words": f"_of_{matrix.bits}", "sparse": f"_{8 * matrix.column_bytes}"}[matrix.form]
    wide = "_wide" if layer.state_bits == 64 else ""
    return f"dse_add_{_form(matrix)}{kind}{wide}_{layer.unit << matrix.exponent}"


def _added(table: str, matrix: Matrix, k: int, layer: LayerPlan) -> str:
    """Return the statements that add the row of `source` of a matrix."""
    n = int(matrix.weights.shape[1])
    state, busy = f"net.{states(layer)[0]}_{k}", ""
    if is_short(matrix):
        unit = layer.unit << matrix.exponent
        pointers = f"int{layer.state_bits}_t *restrict u = {state};\n"
        pointers += f"const int8_t *restrict w = {table} + source * {n}u;\n"
        return pointers + "".join(f"u[{i}] += w[{i}] * {unit};\n" for i in range(n))
    if matrix.delays is not None:
        state = f"net.later_{k}, net.now_{k}, {layer.n_later}u, {n}u"
        busy = f"net.busy_{k} = {layer.n_later};\n"
    if matrix.form == "sparse":
        lists = f"{table}_column, {table}" + (f", {table}_delay" if busy else "")
        row = f"{lists}, {table}_begin[source], {table}_begin[source + 1u]"
    elif matrix.form == "words":
        row = f"{table} + source * {matrix.words_per_row}u, {matrix.words_per_row}u"
    elif busy:
        row = f"{table} + source * {n}u, {table}_delay + source * {n}u"
    else:
        row = f"{table} + source * {n}u, {n // 4}u, {n % 4}u"
    return f"{adder_name(matrix, layer)}({state}, {row});\n{busy}"


_LEAK = """\
/* trunc(x * keep / unit) without more than 32 bits: exact, since both terms have the sign of x. */
#define LEAK(x, keep, unit) ((x) / (unit) * (keep) + (x) % (unit) * (keep) / (unit))

"""


_DECAYED = """\
#define SATURATED(x) ((x) < -32768 ? -32768 : (x) > 32767 ? 32767 : (int32_t)(x))

/* x less x / 2^shift, which rounds down, but at least 1 nearer to 0 where x is positive. */
static int32_t decayed(int32_t x, uint32_t shift)
{
    if (x > 0) {
        const int32_t lost = x >> shift;
        return x - (lost > 0 ? lost : 1);
    }
    return x + (int32_t)(((uint32_t)-x + ((uint32_t)1 << shift) - 1u) >> shift);
}

"""


def leaks(plan: Plan) -> str:
    """Return what the states of some layer leak by: a macro for 32 bits, a function for bit shifts."""
    texts = [_update(k, layer) for k, layer in enumerate(plan.layers, 1)]
    return "".join(
        text
        for name, text in (("LEAK(", _LEAK), ("decayed(", _DECAYED))
        if any(name in update for update in texts)
    )


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
        divisor = math.gcd(keep, DECAY_SCALE)
        number, unit = keep // divisor, DECAY_SCALE // divisor
    if layer.state_bits == 64:
        return f"{x} * {number} / {unit}"
    return f"LEAK({x}, {number}, {unit})"


def _update(k: int, layer: LayerPlan, spikes: str = "") -> str:
    """Return the statements that advance one neuron, given those that a spike runs."""
    population, kind = layer.population, f"int{layer.state_bits}_t"
    if isinstance(population, xylo_lif.Population):
        return _of_xylo(k, layer, population, spikes)
    if not isinstance(population, resonator.Population):
        keeps: list[int | str] = []
        for name, decay in (("u", population.decay_current), ("v", population.decay_voltage)):
            shared = common(decay)
            keeps.append(f"keep_{name}_{k}[i]" if shared is None else DECAY_SCALE - shared)
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


def _of_xylo(k: int, layer: LayerPlan, population: xylo_lif.Population, spikes: str) -> str:
    """Return the same for neurons that decay by bit shifts and saturate."""
    shifts = []
    for name, shift in (("u", population.current_shift), ("v", population.voltage_shift)):
        shared = common(shift)
        shifts.append(f"shift_{name}_{k}[i]" if shared is None else str(shared))
    threshold, most = layer.threshold, layer.most_spikes
    reset = f"    v -= {threshold};\n"
    if most > 1:
        number = f"(uint32_t)(v / {threshold} < {most} ? v / {threshold} : {most})"
        reset = f"    const uint32_t n = {number};\n    v -= (int32_t)n * {threshold};\n"
    return (
        f"const int32_t lost = (int32_t)v - decayed((int32_t)v, {shifts[1]});\n"
        f"u = decayed(SATURATED(u), {shifts[0]});\n"
        f"v += SATURATED(u - lost);\n"
        f"v = SATURATED(v);\n"
        f"if (v >= {threshold}) {{\n{reset}{spikes}}}\n"
    )


def _assigned(x: str, value: str) -> str:
    return "" if x == value else f"{x} = {value};\n"


def layer_text(plan: Plan, k: int) -> str:
    """Return the function that advances layer k, from 1."""
    layer, last = plan.layers[k - 1], k == len(plan.layers)
    a, b = states(layer)
    spikes = [f"SPIKE({k}, i);"]
    if last:
        rule = plan.rule
        counted = ["net.total++;", "net.changed = 1;"]
        if (rule.first, rule.n) != (0, layer.n_neurons):
            inside = f"i < {rule.n}u" if rule.first == 0 else f"i - {rule.first}u < {rule.n}u"
            counted = [f"if ({inside}) {{", *(f"    {line}" for line in counted), "}"]
        # Counts stay those that the answer was made from.
        spikes.append("if (net.answer == 0) {")
        spikes += [*(f"    {line}" for line in ("net.counts[i]++;", *counted)), "}"]
    else:
        spikes += [f"reach_{k + 1}(i);", f"net.awake_{k + 1} = 1;"]
    declare, after, several = "", "", layer.most_spikes > 1
    if several:
        declare = "    uint32_t j;\n"
        spikes = ["for (j = 0; j < n; j++) {", *(f"    {line}" for line in spikes), "}"]
    if layer.recurrent is not None:
        longest = max(x.n_neurons for x in plan.layers if x.recurrent is not None)
        spikes += ["net.times[n_fired] = (uint8_t)n;"] * several
        spikes.append(f"net.fired[n_fired++] = ({index(longest)})i;")
        declare += "    uint32_t n_fired = 0;\n"
        again = "for (j = 0; j < net.times[i]; j++) {\n            " if several else ""
        after = (
            "    for (i = 0; i < n_fired; i++) {\n"
            f"        {again}return_{k}(net.fired[i]);\n{'        }' + chr(10) if several else ''}"
            f"        net.awake_{k} = 1;\n    }}\n"
        )
    update = _update(k, layer, indented("\n".join(spikes) + "\n"))
    arriving, busy, arrived, rested = "", "", "", ""
    if layer.n_later:
        held = f"net.later_{k}[net.now_{k} * {layer.n_neurons}u + i]"
        arriving, arrived, busy = f" + {held}", f"{held} = 0;\n", f" && net.busy_{k} == 0"
        rested = f"net.{a}_{k}[i] = 0; /* what arrived may have cancelled it */\n"
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
        rested=indented(indented(indented(rested))),
        busy=busy,
        update=indented(indented(update)),
        after=after,
    )


def _kinds(layer: LayerPlan) -> str:
    if isinstance(layer.population, xylo_lif.Population):
        return "xylo_lif"
    if not isinstance(layer.population, resonator.Population):
        return "CUBA-LIF"
    n = int(np.count_nonzero(np.broadcast_to(layer.population.resonates, layer.n_neurons)))
    return f"{n} resonators, others CUBA-LIF" if n < layer.n_neurons else "resonators"
