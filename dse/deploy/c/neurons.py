"""The C of a layer: its variables and constant data, rows of weights that spikes add, neurons that step."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dse.deploy.c.arrays import Matrix, Member, Table, index
from dse.deploy.c.plan import LayerPlan, Plan
from dse.deploy.c.text import filled, indented
from dse.neurons import cuba_lif, resonator, xylo_lif
from dse.neurons.fixed_point import DECAY_SCALE
from dse.records import Array

_SHORT_ROW = 16
"""Weights of a row up to which the C has no loop."""


def states(layer: LayerPlan) -> tuple[str, str]:
    """Return the names of a layer's states."""
    return ("x", "y") if isinstance(layer.population, resonator.Population) else ("u", "v")


def layer_members(k: int, layer: LayerPlan) -> list[Member]:
    """Return the variables of layer k, from 1."""
    kind, (a, b) = f"int{layer.state_bits}_t", states(layer)
    out = [
        Member(kind, f"{a}_{k}", (layer.n_places,), f"layer {k}", True),
        Member(kind, f"{b}_{k}", (layer.n_neurons,), is_cleared=True),
        Member("uint8_t", f"awake_{k}", (), "whether a state is not 0", True),
    ]
    if layer.n_later:
        held = (layer.n_later * layer.n_neurons,)
        out += [
            Member(kind, f"later_{k}", held, "input from this step on", True),
            Member("uint8_t", f"now_{k}", (), f"this step in later_{k}", True),
            Member("uint8_t", f"busy_{k}", (), "steps for which there may be input", True),
        ]
    return out


def layer_tables(k: int, layer: LayerPlan) -> list[Table]:
    """Return the weights of layer k, and the parameters that differ between its neurons."""
    out, population = layer.forward.tables(f"weights_{k}"), layer.population
    if layer.back is not None:
        out += layer.back.tables(f"recurrent_{k}")
    if isinstance(population, resonator.Population):
        turns = np.broadcast_to(population.resonates, layer.n_neurons)
        for name, turning, decay in (
            ("first", population.cosine, population.decay_current),
            ("second", population.sine, population.decay_voltage),
        ):
            out.append(Table("int16_t", f"{name}_{k}", np.where(turns, turning, DECAY_SCALE - decay)))
        if _n_leading(turns) is None:
            out.append(Table("uint8_t", f"turns_{k}", turns.astype(np.int64)))
        return out
    kind, name, parameters = _parameters(population)
    return out + [
        Table(kind, f"{name}_{state}_{k}", values)
        for state, values in zip("uv", parameters, strict=True)
        if _common(values) is None
    ]


def _parameters(
    population: cuba_lif.Population | xylo_lif.Population,
) -> tuple[str, str, tuple[Array, Array]]:
    """Return what the states leak by: its type and name in C, and the numbers of both states."""
    if isinstance(population, xylo_lif.Population):
        return "uint8_t", "shift", (population.current_shift, population.voltage_shift)
    decays = population.decay_current, population.decay_voltage
    return "int16_t", "keep", (DECAY_SCALE - decays[0], DECAY_SCALE - decays[1])


def _leaks_by(k: int, population: cuba_lif.Population | xylo_lif.Population) -> list[int | str]:
    """Return the same as numbers where all neurons share them, else as expressions of C."""
    _, name, parameters = _parameters(population)
    shared = [(state, _common(values)) for state, values in zip("uv", parameters, strict=True)]
    return [f"{name}_{state}_{k}[i]" if value is None else value for state, value in shared]


def _n_leading(turns: Array) -> int | None:
    """Return how many neurons resonate if they are the first ones, else None."""
    n = int(np.count_nonzero(turns))
    return n if turns[:n].all() else None


def _common(parameter: Array) -> int | None:
    """Return the parameter that all neurons share, None where they differ."""
    values = np.unique(parameter)
    return int(values[0]) if values.size == 1 else None


def rows(plan: Plan) -> Iterator[str]:
    """Yield the functions that add a row of weights: one per form of rows, then one per matrix."""
    matrices = []
    for k, layer in enumerate(plan.layers, 1):
        matrices.append((f"reach_{k}", f"weights_{k}", layer.forward, k, layer))
        if layer.back is not None:
            matrices.append((f"return_{k}", f"recurrent_{k}", layer.back, k, layer))
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
    n_bits = 8 if matrix.weights.shape[1] <= 256 else 16
    kind = {"bytes": "", "words": f"_of_{matrix.bits}", "sparse": f"_{n_bits}"}[matrix.form]
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


def leaks(plan: Plan) -> str:
    """Return what the states of some layer leak by: a macro for 32 bits, a function for bit shifts."""
    text = "".join(_update(k, layer) for k, layer in enumerate(plan.layers, 1))
    return filled("leaks.c", leak="LEAK(" in text, decayed="decayed(" in text)


def _leaked(x: str, keep: int | str, layer: LayerPlan) -> str:
    """Return the expression of a state after a leak; '' if it stays.

    Every leak of 32-bit states takes the same instructions, whatever the weights: work follows from counts.

    Args:
        x: the state.
        keep: 4096 - decay, or an expression of it.
        layer: of the state.
    """
    number, unit = keep, DECAY_SCALE
    if isinstance(keep, int):
        if keep in (0, DECAY_SCALE):
            return "0" if keep == 0 else ""
        divisor = math.gcd(keep, DECAY_SCALE)
        number, unit = keep // divisor, DECAY_SCALE // divisor
    if layer.state_bits == 64:
        return f"{x} * {number} / {unit}"
    return f"LEAK({x}, {number}, {unit})"


def _update(k: int, layer: LayerPlan, spikes: str = "") -> str:
    """Return the statements that advance one neuron, given those that a spike runs."""
    population, (a, b) = layer.population, states(layer)
    values = {"k": k, "a": a, "b": b, "threshold": layer.threshold, "spikes": spikes}
    if not isinstance(population, resonator.Population):
        leak = dict(zip(("of_a", "of_b"), _leaks_by(k, population), strict=True))
        if isinstance(population, xylo_lif.Population):
            most = layer.most_spikes
            return filled("xylo_lif.c", **values, **leak, most=most, several=most > 1)
        leaked = {name: _leaked(x, leak[name], layer) for name, x in (("of_a", a), ("of_b", b))}
        return filled("leaking.c", **values, **leaked)
    kind, wide = f"int{layer.state_bits}_t", max(layer.bounds.first, layer.bounds.second) >= 2**19
    product = "int64_t" if wide else "int32_t"
    cast = f"({kind})" if product != kind else ""
    turning = filled(
        "turning.c", **values, product=product, cast=cast, reset=population.reset, scale=DECAY_SCALE
    )
    leaked = {"of_a": _leaked(a, f"first_{k}[i]", layer), "of_b": _leaked(b, f"second_{k}[i]", layer)}
    leaking = filled("leaking.c", **values, **leaked)
    n = _n_leading(np.broadcast_to(population.resonates, layer.n_neurons))
    if n in (0, layer.n_neurons):
        return turning if n else leaking
    condition = f"turns_{k}[i]" if n is None else f"i < {n}u"
    return f"if ({condition}) {{\n{indented(turning)}}} else {{\n{indented(leaking)}}}\n"


def layer_text(plan: Plan, k: int) -> str:
    """Return the function that advances layer k, from 1."""
    layer, rule, several = plan.layers[k - 1], plan.rule, plan.layers[k - 1].most_spikes > 1
    (a, b), recurrent = states(layer), layer.back is not None
    inside = ""
    if (rule.first, rule.n) != (0, layer.n_neurons):
        inside = f"i < {rule.n}u" if rule.first == 0 else f"i - {rule.first}u < {rule.n}u"
    spikes = filled(
        "spike.c",
        k=k,
        next=k + 1,
        last=k == len(plan.layers),
        inside=inside,
        several=several,
        recurrent=recurrent,
        fired=index(max((x.n_neurons for x in plan.layers if x.back is not None), default=0)),
        **{"in": "    " if several else ""},
    )
    held = f"net.later_{k}[net.now_{k} * {layer.n_neurons}u + i]" if layer.n_later else ""
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
        several=several,
        recurrent=recurrent,
        held=held,
        n_later=layer.n_later,
        arriving=f" + {held}" if held else "",
        busy=f" && net.busy_{k} == 0" if held else "",
        update=indented(indented(_update(k, layer, indented(spikes)))),
    )


def _kinds(layer: LayerPlan) -> str:
    if isinstance(layer.population, xylo_lif.Population):
        return "xylo_lif"
    if not isinstance(layer.population, resonator.Population):
        return "CUBA-LIF"
    n = int(np.count_nonzero(np.broadcast_to(layer.population.resonates, layer.n_neurons)))
    return f"{n} resonators, others CUBA-LIF" if n < layer.n_neurons else "resonators"
