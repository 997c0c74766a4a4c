"""The CPU engine: the networks of a cohort, trained one after another on each batch they share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from dse.engine import kernels
from dse.engine.adam import BETA_1, BETA_2, EPSILON
from dse.engine.batch import Batch, batch_of, chunk_samples
from dse.engine.delays import Delays
from dse.engine.events import Rows, pooled
from dse.engine.layers import GRID, NO_DELAY, KernelLayer, layer_of, padded_ring, precision
from dse.engine.layout import aligned, packed, padded, unpacked
from dse.engine.learning import Workspace, common_factor, learn
from dse.engine.member import Masters, Member, Report, State, TrainedLayer, Turn, as_part, of_part
from dse.engine.shared import Copies, copies_of
from dse.neurons.fixed_point import HIGHEST_WEIGHT, LOWEST_WEIGHT
from dse.records import Arithmetic, Array, Ints

_NOTHING = np.zeros(0, np.float32)
_LOWEST, _HIGHEST = LOWEST_WEIGHT * GRID, HIGHEST_WEIGHT * GRID


@dataclass(frozen=True)
class _Matrix:
    """Master weights of a matrix in blocks, their gradient, Adam's moments, and the weights as they run.

    table: int8 in integer arithmetic, else the master weights themselves.
    unit: (column,) what a learning rate of 1 moves a weight by.
    kept: like the gradient, 0 where a weight was removed, else 1; None: none was.
    copies: of shared weights among the elements; None: none is shared.
    """

    n_rows: int
    weights: Array
    gradient: Array
    first: Array
    second: Array
    table: Array
    unit: Array
    kept: Array | None = None
    copies: Copies | None = None

    @property
    def grid(self) -> float:
        return float(GRID) if self.table.dtype == np.int8 else 0.0

    def without(self, kept: Array) -> _Matrix:
        """Return the matrix with the weights that are not kept, (row, column), set to 0 for good."""
        before = 1 if self.kept is None else self.kept
        mask = packed(kept, self.gradient.dtype) * before
        for values in (self.weights, self.first, self.second, self.table):
            values *= mask.astype(values.dtype)
        return replace(self, kept=mask)

    @property
    def _changed(self) -> tuple[str, ...]:
        """Names of the arrays that an update reads and writes."""
        return ("weights", "first", "second", *(() if self.table is self.weights else ("table",)))

    def state(self) -> dict[str, Array]:
        """Return a copy of what an update reads and writes."""
        kept = {} if self.kept is None else {"kept": self.kept.astype(bool)}
        return {name: getattr(self, name).copy() for name in self._changed} | kept

    def restored(self, state: State) -> _Matrix:
        """Return the matrix with the numbers of a state; layers read its arrays, which change in place."""
        for name in self._changed:
            np.copyto(getattr(self, name), state[name], casting="no")
        return replace(self, kept=state["kept"].astype(self.gradient.dtype)) if "kept" in state else self

    def keep_removed(self) -> None:
        """Clear the gradient of removed weights; with their moments at 0 Adam leaves them at exactly 0."""
        if self.kept is not None:
            np.multiply(self.gradient, self.kept, out=self.gradient)

    def sum_copies(self) -> None:
        """Give every copy of a shared weight the gradient of all of them."""
        if self.copies is not None:
            self.copies.sum_gradient(self.gradient)

    def squared_norm(self, factor: float) -> float:
        """Return the squared norm of the gradient times a factor, where it passes the rounding."""
        gradient, weights = self.gradient, self.weights
        if self.copies is not None:
            gradient, weights = (_once(x, self.copies) for x in (gradient, weights))
        return float(kernels.squared_norm(gradient, factor, weights, self.grid, _LOWEST, _HIGHEST))

    def update(self, factor: float, learning_rate: float, steps: int) -> float:
        """Take Adam's step `steps`, from 1; return the squared norm of the gradient times its factor."""
        once = None if self.copies is None else self.squared_norm(factor)
        squared = float(
            kernels.adam(
                self.weights,
                self.gradient,
                self.first,
                self.second,
                self.n_rows,
                len(self.unit),
                self.unit,
                factor,
                learning_rate / (1 - BETA_1**steps),
                BETA_1,
                BETA_2,
                1 / (1 - BETA_2**steps),
                EPSILON,
                self.table,
                self.grid,
                _LOWEST,
                _HIGHEST,
            )
        )
        return squared if once is None else once


def _once(values: Array, copies: Copies) -> Array:
    """Return the values of shared weights, one copy each, filled up with 0 to whole vectors."""
    out = aligned(padded(copies.n_weights), values.dtype)
    out[: copies.n_weights] = values[copies.first]
    return out


def _matrix(weights: Array, unit: Array, arithmetic: Arithmetic, shared: Ints | None = None) -> _Matrix:
    n_rows, n_columns = weights.shape
    masters = packed(weights, np.float32)
    units = aligned(padded(n_columns), np.float32)
    units[:n_columns] = unit
    table = masters
    if arithmetic == "integer":
        table = packed(np.clip(np.rint(weights * np.float32(GRID)), _LOWEST, _HIGHEST), np.int8)
    first, second = (aligned(masters.size, np.float32) for _ in range(2))
    # Columns that pad hold 0, which is no weight where numbers count from 1.
    copies = None if shared is None else copies_of(packed(shared + 1, np.int32) - 1)
    gradient = aligned(masters.size, precision(arithmetic))
    return _Matrix(n_rows, masters, gradient, first, second, table, units, None, copies)


class _Network:
    """A member in training: its matrices, and the layers that read them."""

    def __init__(self, member: Member) -> None:
        # Not the member itself, whose initial weights would stay in memory.
        self.goal = member.goal
        self.clip_norm = member.clip_norm
        self.sizes = [x.feed_forward.shape[1] for x in member.layers]
        kind = member.arithmetic
        self.matrices = [_matrix(x.feed_forward, x.unit, kind, x.shared) for x in member.layers]
        self.rings = [_ring(x, kind) for x in member.layers]
        self.delays = [
            None if x.delay is None else Delays.of(x.delay, x.longest_delay, precision(kind))
            for x in member.layers
        ]
        # Layers read the matrices' tables, which change in place.
        parts = zip(member.layers, self.matrices, self.rings, self.delays, strict=True)
        self.layers = [_layer(x, m, r, late, kind) for x, m, r, late in parts]
        self.steps = self.delay_steps = 0

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
            [_NOTHING if d is None or not turn.delay_learning_rate else d.gradient for d in self.delays],
            threads,
            turn.soft,
        )
        parts = [
            *zip(self.matrices, factors, strict=True),
            *((ring, 1.0) for ring in self.rings if ring is not None),
        ]
        for matrix, _ in parts:
            matrix.sum_copies()
            matrix.keep_removed()
        clip = 1.0
        if self.clip_norm is not None:
            norm = math.sqrt(sum(m.squared_norm(f) for m, f in parts))
            clip = min(1.0, self.clip_norm / norm) if norm > 0 else 1.0
        squared = sum(m.update(clip * f, turn.learning_rate, self.steps) for m, f in parts)
        if turn.delay_learning_rate:
            self.delay_steps += 1
            for late in self.delays:
                if late is not None:
                    late.update(turn.delay_learning_rate, self.delay_steps)
        cells = batch.rows.n_samples * batch.rows.n_steps
        return Report(
            done.loss,
            done.correct,
            tuple(float(f) / max(1, cells * n) for f, n in zip(done.n_fired, self.sizes, strict=True)),
            math.sqrt(squared) / clip if clip else math.nan,
        )

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
            tuple(unpacked(m.weights, m.n_rows, n) for m, n in zip(self.matrices, self.sizes, strict=True)),
            tuple(
                None if r is None else unpacked(r.weights, r.n_rows, n)[:n]
                for r, n in zip(self.rings, self.sizes, strict=True)
            ),
            tuple(
                None if d is None else unpacked(d.table, d.n_rows, n)
                for d, n in zip(self.delays, self.sizes, strict=True)
            ),
        )

    def state(self) -> dict[str, Array]:
        """Return what training goes on from; see dse.engine.member.Engine."""
        arrays = {"steps": np.array([self.steps, self.delay_steps])}
        parts = zip(self.matrices, self.rings, self.delays, strict=True)
        for depth, (matrix, ring, late) in enumerate(parts):
            arrays |= as_part(f"{depth}/feed_forward", matrix.state())
            arrays |= {} if ring is None else as_part(f"{depth}/recurrent", ring.state())
            arrays |= {} if late is None else as_part(f"{depth}/delay", late.state())
        return arrays

    def restore(self, state: State) -> None:
        """Go on from a state; see dse.engine.member.Engine."""
        self.steps, self.delay_steps = state["steps"].tolist()
        for depth, late in enumerate(self.delays):
            of_layer = of_part(state, str(depth))
            ring = self.rings[depth]
            self.matrices[depth] = self.matrices[depth].restored(of_part(of_layer, "feed_forward"))
            if ring is not None:
                self.rings[depth] = ring.restored(of_part(of_layer, "recurrent"))
            if late is not None:
                late.restore(of_part(of_layer, "delay"))


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
