"""The CPU engine: the networks of a cohort, trained one after another on each batch they share."""

from __future__ import annotations

import math
from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from dse.base.records import Arithmetic, Array, Ints
from dse.engine.batch import Batch, batch_of, chunk_samples
from dse.engine.decays import Decays
from dse.engine.delays import Delays
from dse.engine.events import Rows, pooled
from dse.engine.layers import GRID, NO_DELAY, KernelLayer, layer_of, padded_ring, precision
from dse.engine.layout import aligned, packed, padded, unpacked
from dse.engine.learning import Workspace, common_factor, learn
from dse.engine.member import (
    Masters,
    Member,
    Report,
    State,
    TrainedLayer,
    Turn,
    as_part,
    of_part,
)
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.fixed_point import DECAY_SCALE, HIGHEST_WEIGHT, LOWEST_WEIGHT
from dse.engine.parameters import (
    Form,
    Parameters,
    Tied,
    WeightNorm,
    Whitened,
    lengths,
    pass_rounding,
    round_to,
)
from dse.engine.shared import copies_of

_NOTHING = np.zeros(0, np.float32)
_LOWEST, _HIGHEST = LOWEST_WEIGHT * GRID, HIGHEST_WEIGHT * GRID


@dataclass(frozen=True)
class _Matrix:
    """A matrix as trained: its parameters, its gradient in blocks, and the weights as they run.

    table: int8 in integer arithmetic, else float32.
    form: how the matrix follows from its parameters; None: they are its weights.
    weights: float32, where the parameters are others.
    """

    n_rows: int
    n_columns: int
    parameters: tuple[Parameters, ...]
    gradient: Array
    table: Array
    form: Form | None = None
    weights: Array = field(default_factory=lambda: _NOTHING)

    @property
    def unit(self) -> Array:
        """What a learning rate of 1 moves the first parameters of each neuron by, (neuron,)."""
        return self.parameters[0].unit[: self.n_columns]

    @property
    def _is_rounded(self) -> bool:
        """Whether weights that are no parameters are rounded."""
        return self.weights.size > 0 and self.table is not self.weights

    def masters(self) -> Array:
        """Return a copy of the weights before rounding, (input, neuron), within the range of 8 bits if so."""
        values = [x.values for x in self.parameters]
        weights = values[0]
        if self.form is not None:
            weights = np.empty(self.gradient.size, np.float32)
            self.form.expand(values, weights)
        out = unpacked(weights, self.n_rows, self.n_columns)
        return np.clip(out, _LOWEST / GRID, _HIGHEST / GRID) if self._is_rounded else out

    def run_anew(self) -> _Matrix:
        """Compute the weights as they run from the parameters; return the matrix."""
        if self.form is not None and self.form.are_weights:
            self.form.expand([x.table for x in self.parameters], self.table)
        elif self.form is not None:
            self.form.expand([x.values for x in self.parameters], self.weights)
            if self._is_rounded:
                round_to(self.weights, GRID, _LOWEST, _HIGHEST, self.table)
        return self

    def without(self, kept: Array) -> _Matrix:
        """Return the matrix with the weights that are not kept, (row, column), set to 0 for good."""
        first, *others = self.parameters
        if isinstance(self.form, WeightNorm):  # what is left keeps its values
            directions = unpacked(first.values, self.n_rows, self.n_columns)
            others[0].values[: self.n_columns] *= (lengths(directions * kept) / lengths(directions))[0]
        return replace(self, parameters=(first.without(kept), *others)).run_anew()

    def state(self) -> dict[str, Array]:
        """Return a copy of what an update reads and writes."""
        parts = [as_part(str(k), x.state()) for k, x in enumerate(self.parameters[1:], 1)]
        return dict(ChainMap(self.parameters[0].state(), *parts))

    def restored(self, state: State) -> _Matrix:
        """Return the matrix with the numbers of a state; layers read its arrays, which change in place."""
        first, *others = self.parameters
        after = [x.restored(of_part(state, str(k))) for k, x in enumerate(others, 1)]
        return replace(self, parameters=(first.restored(state), *after)).run_anew()

    def pull(self) -> None:
        """Go from the gradient by the weights to that by the parameters."""
        if self.form is not None:
            if self._is_rounded:
                pass_rounding(self.weights, GRID, _LOWEST, _HIGHEST, self.gradient)
            values, gradients = ([getattr(x, n) for x in self.parameters] for n in ("values", "gradient"))
            self.form.pull(values, self.gradient, gradients)
            if self.gradient is not gradients[0]:
                self.gradient[:] = 0
        for part in self.parameters:
            part.keep_removed()

    def squared_norm(self, factor: float) -> float:
        """Return the squared norm of the gradient by the parameters times a factor."""
        return sum(x.squared_norm(factor) for x in self.parameters)

    def update(self, factor: float, learning_rate: float, steps: int) -> float:
        """Take Adam's step `steps`, from 1; return the squared norm of the gradient times its factor."""
        once = self.squared_norm(factor) if isinstance(self.form, Tied) else None
        squared = sum(x.update(factor, learning_rate, steps) for x in self.parameters)
        self.run_anew()
        return squared if once is None else once


def _matrix(
    weights: Array,
    unit: Array,
    arithmetic: Arithmetic,
    shared: Ints | None = None,
    norm_unit: Array | None = None,
    basis: Array | None = None,
) -> _Matrix:
    """Return a matrix at its start, (input, neuron); arguments as in TrainedLayer."""
    (n_rows, n), kind = weights.shape, precision(arithmetic)
    rounding = (float(GRID), _LOWEST, _HIGHEST) if arithmetic == "integer" else ()
    gradient, size = aligned(n_rows * padded(n), kind), n_rows * padded(n)
    if shared is not None:
        # Columns that pad hold 0, which is no weight where numbers count from 1.
        copies = copies_of(packed(shared + 1, np.int32) - 1)
        once = np.append(packed(weights, np.float32)[copies.first], np.float32(0))
        units = np.append(packed(np.broadcast_to(unit, weights.shape), np.float32)[copies.first], 0)
        own = Parameters.of(once[None], units, None, kind, *rounding)
        tied = _Matrix(n_rows, n, (own,), gradient, aligned(size, own.table.dtype), Tied(copies))
        return tied.run_anew()
    if basis is None and norm_unit is None:
        own = Parameters.of(weights, unit, gradient, kind, *rounding)
        return _Matrix(n_rows, n, (own,), gradient, own.table)
    form: Form = WeightNorm(n_rows, n)
    others: tuple[Parameters, ...] = ()
    if basis is not None:
        own = Parameters.of(np.zeros((basis.shape[1], n)), unit, None, kind)
        form = Whitened(packed(weights, np.float32), np.ascontiguousarray(basis, np.float32), n)
    elif norm_unit is not None:
        own = Parameters.of(weights, unit, gradient, kind)
        norms = lengths(weights.astype(np.float64)).astype(np.float32)
        others = (Parameters.of(norms, norm_unit, None, kind),)
    masters = aligned(size, np.float32)
    table = aligned(size, np.int8) if rounding else masters
    return _Matrix(n_rows, n, (own, *others), gradient, table, form, masters).run_anew()


class _Network:
    """A member in training: its matrices, and the layers that read them."""

    def __init__(self, member: Member) -> None:
        # Not the member itself, whose initial weights would stay in memory.
        self.goal = member.goal
        self.clip_norm, self.arithmetic = member.clip_norm, member.arithmetic
        self.sizes = [x.feed_forward.shape[1] for x in member.layers]
        kind = member.arithmetic
        self.is_rounded = [x.is_rounded for x in member.layers]
        self.matrices = [
            _matrix(x.feed_forward, x.unit, self._weights_in(d), x.shared, x.norm_unit, x.basis)
            for d, x in enumerate(member.layers)
        ]
        self.rings = [_ring(x, kind) for x in member.layers]
        self.delays = [
            None if x.delay is None else Delays.of(x.delay, x.longest_delay, precision(kind), x.axonal)
            for x in member.layers
        ]
        self.decays = [_decays(x) for x in member.layers]
        # Layers read the matrices' tables, which change in place.
        parts = zip(member.layers, self.matrices, self.rings, self.delays, strict=True)
        self.layers = [_layer(x, m, r, late, kind) for x, m, r, late in parts]
        self._run_decays()
        self.steps = self.delay_steps = self.decay_steps = 0

    def _weights_in(self, depth: int) -> Arithmetic:
        """Return the arithmetic of a layer's weights, which need not be rounded where states are integers."""
        is_real = self.arithmetic == "integer" and not self.is_rounded[depth]
        return "float32" if is_real else self.arithmetic

    def step(
        self,
        batch: Batch,
        labels: Array,
        turn: Turn,
        spaces: Sequence[Workspace],
        threads: Executor | None,
    ) -> Report:
        """Train on a batch."""
        self.steps += 1
        factors = [common_factor(gain) for gain in turn.gains]
        delays = self.delays
        by_decays = [
            np.zeros((2, 0 if d is None or not turn.decay_learning_rate else x.n_columns))
            for d, x in zip(self.decays, self.layers, strict=True)
        ]
        done = learn(
            self.layers,
            self.sizes,
            batch,
            labels,
            self.goal,
            turn.gains,
            1,
            spaces,
            [m.gradient for m in self.matrices],
            [_NOTHING if r is None else r.gradient for r in self.rings],
            [_NOTHING if d is None or not turn.delay_learning_rate else d.gradient for d in delays],
            threads,
            turn.soft,
            by_decays,
        )
        parts = [
            *zip(self.matrices, factors, strict=True),
            *((ring, 1.0) for ring in self.rings if ring is not None),
        ]
        for matrix, _ in parts:
            matrix.pull()
        clip = 1.0
        if self.clip_norm is not None:
            norm = math.sqrt(sum(m.squared_norm(f) for m, f in parts))
            clip = min(1.0, self.clip_norm / norm) if norm > 0 else 1.0
        squared = sum(m.update(clip * f, turn.learning_rate, self.steps) for m, f in parts)
        if turn.delay_learning_rate:
            self.delay_steps += 1
            for late in delays:
                if late is not None:
                    late.update(turn.delay_learning_rate, self.delay_steps)
        if turn.decay_learning_rate:
            self.decay_steps += 1
            for decays, by_keep in zip(self.decays, by_decays, strict=True):
                if decays is not None:
                    decays.update(by_keep, turn.decay_learning_rate, self.decay_steps)
            self._run_decays()
        cells = batch.rows.n_samples * batch.rows.n_steps
        fired = zip(done.n_fired, self.sizes, strict=True)
        return Report(
            done.loss,
            done.correct,
            tuple(float(f) / max(1, cells * n) for f, n in fired),
            math.sqrt(squared) / clip if clip else math.nan,
        )

    def _run_decays(self) -> None:
        """Have the layers run the decays that were learnt."""
        for decays, layer in zip(self.decays, self.layers, strict=True):
            if decays is not None:
                keeps = ((layer.keep_u, layer.back_u), (layer.keep_v, layer.back_v))
                for row, both in zip((DECAY_SCALE - decays.whole) / DECAY_SCALE, keeps, strict=True):
                    for keep in both:
                        keep[: layer.n_neurons] = row

    def prune(self, kept: Masters) -> None:
        """Set weights to 0 for good; see dse.engine.member.Engine."""
        self.matrices = [m.without(k) for m, k in zip(self.matrices, kept.feed_forward, strict=True)]
        self.rings = [
            None if r is None or k is None else r.without(padded_ring(k))
            for r, k in zip(self.rings, kept.recurrent, strict=True)
        ]

    def masters(self) -> Masters:
        """Return a copy of the master weights."""
        return Masters(
            tuple(m.masters() for m in self.matrices),
            tuple(None if r is None else r.masters()[: r.n_columns] for r in self.rings),
            tuple(
                None if d is None else unpacked(d.table, d.n_rows, n)
                for d, n in zip(self.delays, self.sizes, strict=True)
            ),
            tuple(
                None if d is None else np.broadcast_to(d.whole, (2, n))
                for d, n in zip(self.decays, self.sizes, strict=True)
            ),
        )

    def state(self) -> dict[str, Array]:
        """Return what training goes on from; see dse.engine.member.Engine."""
        arrays = {"steps": np.array([self.steps, self.delay_steps, self.decay_steps])}
        parts = zip(self.matrices, self.rings, self.delays, self.decays, strict=True)
        for depth, (matrix, ring, late, decays) in enumerate(parts):
            arrays |= as_part(f"{depth}/feed_forward", matrix.state())
            arrays |= {} if ring is None else as_part(f"{depth}/recurrent", ring.state())
            arrays |= {} if late is None else as_part(f"{depth}/delay", late.state())
            arrays |= {} if decays is None else as_part(f"{depth}/decays", decays.state())
        return arrays

    def restore(self, state: State) -> None:
        """Go on from a state; see dse.engine.member.Engine."""
        self.steps, self.delay_steps, self.decay_steps = state["steps"].tolist()
        for depth, (late, decays) in enumerate(zip(self.delays, self.decays, strict=True)):
            of_layer = of_part(state, str(depth))
            ring = self.rings[depth]
            self.matrices[depth] = self.matrices[depth].restored(of_part(of_layer, "feed_forward"))
            if ring is not None:
                self.rings[depth] = ring.restored(of_part(of_layer, "recurrent"))
            if late is not None:
                late.restore(of_part(of_layer, "delay"))
            if decays is not None:
                decays.restore(of_part(of_layer, "decays"))
        self._run_decays()


def _decays(layer: TrainedLayer) -> Decays | None:
    if layer.learnt_decays == "no":
        return None
    assert isinstance(layer.population, cuba_lif.Population)  # no other has decays
    return Decays.of(layer.population, layer.feed_forward.shape[1], layer.learnt_decays)


def _ring(layer: TrainedLayer, arithmetic: Arithmetic) -> _Matrix | None:
    if layer.recurrent is None:
        return None
    unit = layer.unit if layer.recurrent_unit is None else layer.recurrent_unit
    return _matrix(padded_ring(layer.recurrent), unit, arithmetic)


def _layer(
    layer: TrainedLayer,
    matrix: _Matrix,
    ring: _Matrix | None,
    delays: Delays | None,
    arithmetic: Arithmetic,
) -> KernelLayer:
    return layer_of(
        matrix.table,
        matrix.table[:0] if ring is None else ring.table,
        matrix.n_rows,
        layer.feed_forward.shape[1],
        layer.population,
        arithmetic,
        layer.surrogate,
        NO_DELAY if delays is None else delays.table,
        layer.axonal,
    )


class CpuEngine:
    """Networks that share each batch's rows and their transpose; see dse.engine.member.Engine."""

    def __init__(self, members: Sequence[Member], n_samples: int, n_steps: int, threads: int) -> None:
        self._networks = [_Network(member) for member in members]
        self._pools = [member.pool for member in members]
        self._threads = ThreadPoolExecutor(threads) if threads > 1 else None
        n_rows = chunk_samples(n_samples, n_steps) * n_steps
        kinds = [precision(member.arithmetic) for member in members]
        spaces = {
            kind: [
                _workspace(
                    [x for x, k in zip(self._networks, kinds, strict=True) if k is kind], n_rows, thread
                )
                for thread in range(threads)
            ]
            for kind in set(kinds)
        }
        self._spaces = [spaces[kind] for kind in kinds]

    def step(self, rows: Rows, labels: Array, turns: Mapping[int, Turn]) -> dict[int, Report]:
        """Train the members named in `turns` on a batch; the others do not move."""
        batches: dict[bytes, Batch] = {}
        reports = {}
        for number, turn in turns.items():
            pool = self._pools[number]
            key = b"" if pool is None else pool.tobytes()
            if key not in batches:
                batches[key] = batch_of(pooled(rows, pool))
            network, space = self._networks[number], self._spaces[number]
            reports[number] = network.step(batches[key], labels, turn, space, self._threads)
        return reports

    def prune(self, member: int, kept: Masters) -> None:
        """Set the weights of a member that are not kept to 0, for good."""
        self._networks[member].prune(kept)

    def masters(self, member: int) -> Masters:
        """Return a copy of a member's master weights."""
        return self._networks[member].masters()

    def state(self, member: int) -> State:
        """Return a copy of what a member's training goes on from."""
        return self._networks[member].state()

    def restore(self, member: int, state: State) -> None:
        """Go on from a member's state."""
        self._networks[member].restore(state)


def _workspace(networks: Sequence[_Network], n_rows: int, thread: int) -> Workspace:
    """Return buffers that are large enough for each of some networks."""
    depths = range(max(len(network.sizes) for network in networks))

    def largest(elements: Callable[[_Network, int], int]) -> list[int]:
        return [max(elements(x, d) for x in networks if d < len(x.sizes)) for d in depths]

    def ring(network: _Network, depth: int) -> int:
        matrix = network.rings[depth]
        return 0 if matrix is None else matrix.gradient.size

    def late(network: _Network, depth: int) -> int:
        delays = network.delays[depth]
        return 0 if delays is None else delays.gradient.size

    weights = largest(lambda network, depth: network.matrices[depth].gradient.size)
    if thread == 0:
        weights[0] = 0  # written in place
    kind = networks[0].matrices[0].gradient.dtype
    return Workspace(
        n_rows,
        largest(lambda network, depth: network.sizes[depth]),
        weights,
        largest(ring),
        largest(late),
        kind,
    )


def start(members: Sequence[Member], n_samples: int, n_steps: int, threads: int = 1) -> CpuEngine:
    """Return a cohort, ready for batches of at most `n_samples` samples of `n_steps` steps.

    Threads share a batch's samples (chunk by chunk) and change no result.
    """
    return CpuEngine(members, n_samples, n_steps, threads)
