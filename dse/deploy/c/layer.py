"""A layer as C: its weights in flash, its variables, rows of weights that spikes add, neurons that step."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.deploy.bounds import Bounds
from dse.deploy.c.arrays import Matrix, Table, stored
from dse.deploy.c.text import filled, indented
from dse.deploy.form import LayerForm
from dse.engine.neurons import cuba_lif, resonator, xylo_lif
from dse.engine.neurons.fixed_point import DECAY_SCALE

Population = cuba_lif.Population | resonator.Population | xylo_lif.Population
_SHORT_ROW = 16
"""Weights of a row up to which the C has no loop."""


@dataclass(frozen=True)
class Row:
    """The function that adds a row of a matrix: the weights from one input to all neurons.

    name: of the function. table: of the constant data.
    """

    name: str
    table: str
    matrix: Matrix
    layer: LayerPlan

    @property
    def is_short(self) -> bool:
        """Whether a row is added in a straight line, which a loop would hardly be shorter than."""
        return self.matrix.kind == "bytes" and self.matrix.row_length <= _SHORT_ROW

    @property
    def unit(self) -> int:
        """Units of a state per step of the stored numbers."""
        return self.layer.unit << self.matrix.exponent

    @property
    def adder(self) -> str:
        """Name of the function that adds rows of this kind."""
        n_bits = 8 if self.matrix.n_columns <= 256 else 16
        kind = {"bytes": "", "words": f"_of_{self.matrix.bits}", "sparse": f"_{n_bits}"}[self.matrix.form]
        wide = "_wide" if self.layer.state_bits == 64 else ""
        return f"dse_add_{self.matrix.kind}{kind}{wide}_{self.unit}"

    @property
    def adder_text(self) -> str:
        """That function: all rows of a kind run the same instructions."""
        matrix = self.matrix
        return filled(f"add_{matrix.kind}.c", self, matrix, type=self.layer.type, name=self.adder)

    @property
    def text(self) -> str:
        what = "an input of layer" if self.name.startswith("reach") else "a neuron of recurrent layer"
        body = indented(self._body())
        comment = f"/* Adds the weights of {what} {self.layer.k}. */\n"
        return f"{comment}static APART void {self.name}(dse_t *net, uint32_t source)\n{{\n{body}}}\n\n"

    def _body(self) -> str:
        """Return the statements that add the row of `source`."""
        matrix, layer, table, n = self.matrix, self.layer, self.table, self.matrix.n_columns
        state, busy = f"net->{layer.a}_{layer.k}", ""
        if self.is_short:
            pointers = f"{layer.type} *u = {state};\n"
            pointers += f"const int8_t *w = &{table}[source * {n}u];\n"
            return pointers + "".join(f"u[{i}] += w[{i}] * {self.unit};\n" for i in range(n))
        if matrix.delays is not None:
            state = f"net->later_{layer.k}, net->now_{layer.k}, {layer.n_later}u, {n}u"
            busy = f"net->busy_{layer.k} = {layer.n_later};\n"
        if matrix.form == "sparse":
            lists = f"{table}_column, {table}" + (f", {table}_delay" if busy else "")
            row = f"{lists}, {table}_begin[source], {table}_begin[source + 1u]"
        elif matrix.form == "words":
            row = f"{table} + source * {matrix.words_per_row}u, {matrix.words_per_row}u"
        elif busy:
            row = f"{table} + source * {n}u, {table}_delay + source * {n}u"
        else:
            row = f"{table} + source * {n}u, {n // 4}u, {n % 4}u"
        return f"{self.adder}({state}, {row});\n{busy}"


@dataclass(frozen=True)
class LayerPlan(LayerForm):
    """A layer and its weights in flash.

    forward: from the delayed copies of the inputs, or from the layer before.
    back: from the layer itself; None: not recurrent.
    """

    population: Population
    bounds: Bounds
    forward: Matrix
    back: Matrix | None

    @classmethod
    def of(cls, layer: LayerForm, fixed: bool = False) -> LayerPlan:
        """Return a layer whose weights are stored; fixed: in a form that follows from none."""
        back = None if layer.recurrent is None else stored(layer.ring_steps, fixed=fixed)
        forward = stored(layer.forward_steps, layer.delays, fixed)
        return cls(**vars(layer), forward=forward, back=back)

    @property
    def type(self) -> str:
        """Type of a state."""
        return f"int{self.state_bits}_t"

    @property
    def a(self) -> str:
        """Name of the state that input is added to."""
        return "x" if isinstance(self.population, resonator.Population) else "u"

    @property
    def b(self) -> str:
        """Name of the state that spikes."""
        return "y" if isinstance(self.population, resonator.Population) else "v"

    @property
    def several(self) -> bool:
        """Whether neurons spike more than once in a step."""
        return self.most_spikes > 1

    @property
    def n_later(self) -> int:
        """Network steps whose input must be held for delays of synapses, this one included; 0: none has."""
        delays = self.forward.delays
        return 0 if delays is None else 1 + int(delays.max(initial=0))

    @property
    def n_held(self) -> int:
        """Numbers that are held for them."""
        return self.n_later * self.n_neurons

    @property
    def held(self) -> str:
        """What arrives at neuron i in this step where synapses have delays; '' where none has."""
        return f"net->later_{self.k}[net->now_{self.k} * {self.n_neurons}u + i]" if self.n_later else ""

    @property
    def n_places(self) -> int:
        """Length of the array of u or x: its neurons, and those that fill packed rows."""
        return max(self.n_neurons, *(row.matrix.row_length for row in self.rows), 0)

    @property
    def rows(self) -> tuple[Row, ...]:
        """How spikes reach the layer."""
        forward = Row(f"reach_{self.k}", f"weights_{self.k}", self.forward, self)
        if self.back is None:
            return (forward,)
        return forward, Row(f"return_{self.k}", f"recurrent_{self.k}", self.back, self)

    @property
    def kinds(self) -> str:
        """Its neurons in words."""
        if isinstance(self.population, xylo_lif.Population):
            return "xylo_lif"
        if not isinstance(self.population, resonator.Population):
            return "CUBA-LIF"
        n = int(np.count_nonzero(self.turns))
        return f"{n} resonators, others CUBA-LIF" if n < self.n_neurons else "resonators"

    def tables(self) -> Iterator[Table]:
        """Yield its weights, and the parameters that differ between its neurons."""
        for row in self.rows:
            yield from row.matrix.tables(row.table)
        for kind, name, values, shared in self._parameters():
            if shared is None:
                yield Table(kind, name, values)
        if isinstance(self.population, resonator.Population) and self._n_turning is None:
            yield Table("uint8_t", f"turns_{self.k}", self.turns.astype(np.int64))

    def update(self, spikes: str = "") -> str:
        """Return the statements that advance one neuron, given those that a spike runs."""
        population, values = self.population, {"spikes": spikes}
        by = [f"{name}[i]" if shared is None else shared for _, name, _, shared in self._parameters()]
        if isinstance(population, xylo_lif.Population):
            times = population.threshold
            products = {"per_threshold": f" / {times}", "by_threshold": f" * {times}"} if times > 1 else {}
            values |= {"per_threshold": "", "by_threshold": "", **products}
            return filled("xylo_lif.c", self, **values, of_a=by[0], of_b=by[1])
        of_a, of_b = (self._leaked(state, keep) for state, keep in zip((self.a, self.b), by, strict=True))
        leaking = filled("leaking.c", self, **values, of_a=of_a, of_b=of_b)
        if not isinstance(population, resonator.Population):
            return leaking
        product = "int64_t" if max(self.bounds.first, self.bounds.second) >= 2**19 else "int32_t"
        cast = f"({self.type})" if product != self.type else ""
        turning = filled(
            "turning.c", self, population, **values, product=product, cast=cast, scale=DECAY_SCALE
        )
        n = self._n_turning
        if n in (0, self.n_neurons):
            return turning if n else leaking
        condition = f"turns_{self.k}[i] != 0u" if n is None else f"i < {n}u"
        return f"if ({condition}) {{\n{indented(turning)}}} else {{\n{indented(leaking)}}}\n"

    def _parameters(self) -> list[tuple[str, str, Array, int | None]]:
        """Return what each state leaks or turns by: type and name of the table, numbers, that of all neurons.

        The last is None where neurons differ, and of layers with resonators.
        """
        population, k = self.population, self.k
        if isinstance(population, xylo_lif.Population):
            kind, name, numbers = "uint8_t", "shift", (population.current_shift, population.voltage_shift)
        else:
            decays = population.decay_current, population.decay_voltage
            kind, name, numbers = "int16_t", "keep", (DECAY_SCALE - decays[0], DECAY_SCALE - decays[1])
        if isinstance(population, resonator.Population):
            turning = zip(("first", "second"), (population.cosine, population.sine), numbers, strict=True)
            return [(kind, f"{x}_{k}", np.where(self.turns, turn, keep), None) for x, turn, keep in turning]
        return [
            (kind, f"{name}_{state}_{k}", values, _common(values))
            for state, values in zip("uv", numbers, strict=True)
        ]

    @property
    def _n_turning(self) -> int | None:
        """How many neurons resonate if they are the first ones, else None."""
        n = int(np.count_nonzero(self.turns))
        return n if self.turns[:n].all() else None

    def _leaked(self, x: str, keep: int | str) -> str:
        """Return the expression of a state after a leak; '' if it stays.

        Every leak of 32-bit states takes the same instructions, whatever the weights: work follows from
        counts.

        Args:
            x: the state.
            keep: 4096 - decay, or an expression of it.
        """
        number, unit = keep, DECAY_SCALE
        if isinstance(keep, int):
            if keep in (0, DECAY_SCALE):
                return "0" if keep == 0 else ""
            divisor = math.gcd(keep, DECAY_SCALE)
            number, unit = keep // divisor, DECAY_SCALE // divisor
        if self.state_bits == 64:
            return f"({x} * {number}) / {unit}"
        return f"LEAK({x}, {number}, {unit})"


def _common(parameter: Array) -> int | None:
    """Return the parameter that all neurons share, None where they differ."""
    values = np.unique(parameter)
    return int(values[0]) if values.size == 1 else None
