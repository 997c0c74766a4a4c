"""The variables and the constant data of the C: what it takes, known from the plan alone."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.deploy.c.matrix import Matrix
from dse.deploy.c.plan import Frame, LayerPlan, Plan, ReceptorsPlan, SendOnDeltaPlan, is_endless
from dse.deploy.c.text import wrapped
from dse.neurons import resonator, xylo_lif
from dse.neurons.fixed_point import DECAY_SCALE
from dse.records import Array, Ints

_BYTES = {
    **{"double": 8, "int64_t": 8, "uint64_t": 8},
    **{"float": 4, "int32_t": 4, "uint32_t": 4, "level_t": 4},
    **{"uint16_t": 2, "int16_t": 2, "uint8_t": 1, "int8_t": 1},
}


@dataclass(frozen=True)
class Member:
    """A variable of the C: its type, name and lengths; `purpose` is its comment."""

    kind: str
    name: str
    lengths: tuple[int, ...] = ()
    purpose: str = ""

    @property
    def width(self) -> int:
        """Bytes of one number."""
        return _BYTES[self.kind]

    @property
    def n_bytes(self) -> int:
        return self.width * math.prod(self.lengths)

    @property
    def text(self) -> str:
        """Its declaration."""
        purpose = f" /* {self.purpose} */" if self.purpose else ""
        return f"    {self.kind} {self.name}{''.join(f'[{n}]' for n in self.lengths)};{purpose}\n"


@dataclass(frozen=True)
class Table:
    """Constant data of the C."""

    kind: str
    name: str
    values: Array

    @property
    def n_bytes(self) -> int:
        return _BYTES[self.kind] * int(self.values.size)

    @property
    def text(self) -> str:
        """Its definition."""
        if self.kind in ("float", "double"):
            numbers = [_exact(x, self.kind) for x in self.values.ravel()]
        elif self.kind == "uint32_t" and int(self.values.max(initial=0)) > 2**16:
            numbers = [f"0x{x:x}u" for x in self.values.tolist()]
        else:
            numbers = [str(x) for x in self.values.tolist()]
        return f"static const {self.kind} {self.name}[{self.values.size}] = {{\n{wrapped(numbers)}}};\n"


def _exact(x: np.floating[Any], kind: str) -> str:
    """Return a constant of exactly this number; numpy's shortest decimals read back as it."""
    text = str(np.float32(x) if kind == "float" else np.float64(x))
    number = text if any(c in text for c in ".en") else f"{text}.0"
    return f"{number}f" if kind == "float" else number


def members(plan: Plan) -> list[Member]:
    """Return all variables, the widest types first, so that nothing lies between them."""
    last = len(plan.layers)
    out = []
    for k, layer in enumerate(plan.layers, 1):
        kind = f"int{layer.state_bits}_t"
        a, b = states(layer)
        out += [
            Member(kind, f"{a}_{k}", (layer.n_places,), f"layer {k}"),
            Member(kind, f"{b}_{k}", (layer.n_neurons,)),
            Member("uint8_t", f"awake_{k}", (), "whether a state is not 0"),
        ]
        if layer.n_later:
            out += [
                Member(kind, f"later_{k}", (layer.n_later * layer.n_neurons,), "input from this step on"),
                Member("uint8_t", f"now_{k}", (), f"this step in later_{k}"),
                Member("uint8_t", f"busy_{k}", (), "steps for which there may be input"),
            ]
    longest = max((x.n_neurons for x in plan.layers if x.recurrent is not None), default=0)
    if longest:
        out.append(Member(index(longest), "fired", (longest,), "neurons of a recurrent layer in this step"))
        if often := repeating(plan):
            out.append(Member("uint8_t", "times", (often,), "how often they did"))
    counted = "uint16_t" if plan.counts_bytes == 2 else "uint32_t"
    out += [
        Member(counted, "counts", (plan.layers[last - 1].n_neurons,), "output spikes"),
        Member("uint32_t", "total", (), "of all outputs that answer"),
        Member("uint32_t", "step", (), "network steps since dse_reset()"),
        Member("uint32_t", "answered", (), "step of the answer"),
        Member("int16_t", "answer", (), "the class + 1; 0: none so far"),
        Member("uint8_t", "confident"),
        Member("uint8_t", "changed", (), "whether an output spiked since the last look"),
        Member("uint32_t", "spikes", (plan.n_slots, plan.channel_words), "input spikes, a bit per channel"),
        Member("uint8_t", "pushed", (), "whether there are any in this step"),
    ]
    if is_delayed(plan):
        out += [
            Member("uint32_t", "sample", (), "input steps since dse_reset()"),
            Member("uint16_t", "slot", (), "of this step in `spikes`"),
        ]
    out += front_end_members(plan)
    return sorted(out, key=lambda m: -m.width)


def repeating(plan: Plan) -> int:
    """Return the neurons of the largest recurrent layer whose neurons spike several times in a step."""
    several = (x.n_neurons for x in plan.layers if x.recurrent is not None and x.most_spikes > 1)
    return max(several, default=0)


def front_end_members(plan: Frame) -> list[Member]:
    """Return the variables of what makes the input spikes."""
    out = []
    if isinstance(plan.encoder, SendOnDeltaPlan):
        places = (len(plan.encoder.thresholds), plan.encoder.n_sensors)
        kind = "level_t" if plan.encoder.takes_whole else "double"  # level_t: of whole samples
        out += [Member(kind, "level", places, "last sent"), Member("uint8_t", "begun")]
    if isinstance(plan.encoder, ReceptorsPlan):
        places, n_totals = (len(plan.encoder.kinds), plan.encoder.n_sensors), plan.encoder.smoothed + 1
        out += [
            Member("double", "v", places, "potential of receptors, mV"),
            Member("double", "u", places, "their adaptation"),
            Member("double", "last", places[1:], "value of every sensor"),
            Member("uint8_t", "begun"),
        ]
        if n_totals > 2:
            out += [
                Member("double", "sums", (n_totals, places[1]), "of all samples, up to each of the last"),
                Member("uint32_t", "newest", (), "place of the last total"),
                Member("uint32_t", "n_totals", (), "that there are"),
            ]
    if plan.pooling is not None:
        out += [
            Member("int64_t", "begin_us", (), "first bin"),
            Member("int64_t", "end_us", (), "end of this bin"),
            Member("uint8_t", "started"),
        ]
        if not is_endless(plan.pooling):
            out.append(Member("int64_t", "stop_us", (), "events from here on are too late"))
        if plan.pooling.counts_needed:
            out.append(Member("uint8_t", "events", (plan.n_channels,), "of every pool in this bin"))
    return out


def ram_bytes(plan: Plan) -> int:
    """Return the size of all variables: what the compiler reports as data and bss."""
    return struct_bytes(members(plan))


def struct_bytes(listed: Sequence[Member], of_reals: bool = False) -> int:
    """Return the size of variables that lie in a row, each at a multiple of its width.

    Args:
        listed: the variables.
        of_reals: whether samples are real numbers, so that the levels of an encoder are double.
    """
    if of_reals:
        listed = [dataclasses.replace(m, kind="double") if m.kind == "level_t" else m for m in listed]
    used, widest = 0, max(m.width for m in listed)
    for m in listed:
        used = -(-used // m.width) * m.width + m.n_bytes
    return -(-used // widest) * widest


def tables(plan: Plan) -> list[Table]:
    """Return the weights, and the parameters that differ between neurons."""
    out = []
    for k, layer in enumerate(plan.layers, 1):
        out += matrix_tables(f"weights_{k}", layer.feed_forward)
        if layer.recurrent is not None:
            out += matrix_tables(f"recurrent_{k}", layer.recurrent)
        out += _neuron_tables(k, layer)
    if is_delayed(plan):
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


def table_bytes(plan: Plan) -> int:
    """Return the size of the constant data of the network, without that of the front end."""
    return sum(table.n_bytes for table in tables(plan))


def states(layer: LayerPlan) -> tuple[str, str]:
    """Return the names of a layer's states."""
    return ("x", "y") if isinstance(layer.population, resonator.Population) else ("u", "v")


def index(n: int) -> str:
    """Return the type that numbers n things."""
    return "uint8_t" if n <= 256 else "uint16_t"


def is_delayed(plan: Plan) -> bool:
    """Return whether there are delayed copies of the inputs."""
    return any(plan.delays)


def matrix_tables(name: str, matrix: Matrix) -> list[Table]:
    """Return a matrix as constant data."""
    q = matrix.q
    if matrix.form == "bytes":
        delays = [] if matrix.delays is None else [Table("uint8_t", f"{name}_delay", matrix.delays.ravel())]
        return [Table("int8_t", name, q.ravel()), *delays]
    if matrix.form == "words":
        return [Table("uint32_t", name, _packed(matrix).ravel())]
    row, column = np.nonzero(q)
    begin = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(q)))])
    lists = [q[row, column], column, *([] if matrix.delays is None else [matrix.delays[row, column]])]
    values, columns, *later = (x if x.size else np.zeros(1, np.int64) for x in lists)
    return [
        Table("uint16_t" if matrix.offset_bytes == 2 else "uint32_t", f"{name}_begin", begin),
        Table("uint8_t" if matrix.column_bytes == 1 else "uint16_t", f"{name}_column", columns),
        Table("int8_t", name, values),
        *(Table("uint8_t", f"{name}_delay", delay) for delay in later),
    ]


def _packed(matrix: Matrix) -> Ints:
    """Return the words of every row, (input, word)."""
    n_inputs, n = matrix.weights.shape
    fields = np.zeros((n_inputs, matrix.words_per_row * matrix.per_word), np.int64)
    fields[:, :n] = matrix.q & (2**matrix.bits - 1)
    of_words = fields.reshape(n_inputs, matrix.words_per_row, matrix.per_word)
    return np.asarray((of_words << (matrix.bits * np.arange(matrix.per_word))).sum(axis=2))


def _neuron_tables(k: int, layer: LayerPlan) -> list[Table]:
    population = layer.population
    if isinstance(population, resonator.Population):
        turns = np.broadcast_to(population.resonates, layer.n_neurons)
        first, second = (
            DECAY_SCALE - np.asarray(d) for d in (population.decay_current, population.decay_voltage)
        )
        out = [
            Table("int16_t", f"first_{k}", np.where(turns, population.cosine, first)),
            Table("int16_t", f"second_{k}", np.where(turns, population.sine, second)),
        ]
        if n_leading(turns) is None:
            out.append(Table("uint8_t", f"turns_{k}", turns.astype(np.int64)))
        return out
    if isinstance(population, xylo_lif.Population):
        return [
            Table("uint8_t", f"shift_{name}_{k}", np.asarray(shift))
            for name, shift in (("u", population.current_shift), ("v", population.voltage_shift))
            if common(shift) is None
        ]
    return [
        Table("int16_t", f"keep_{name}_{k}", DECAY_SCALE - np.asarray(decay))
        for name, decay in (("u", population.decay_current), ("v", population.decay_voltage))
        if common(decay) is None
    ]


def n_leading(turns: Array) -> int | None:
    """Return how many neurons resonate if they are the first ones, else None."""
    n = int(np.count_nonzero(turns))
    return n if turns[:n].all() else None


def common(parameter: Array) -> int | None:
    """Return the parameter that all neurons share, None where they differ."""
    values = np.unique(parameter)
    return int(values[0]) if values.size == 1 else None
