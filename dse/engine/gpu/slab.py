"""Members of one arithmetic that train side by side on the device."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dse.engine.adam import BETA_1, BETA_2
from dse.engine.goal import n_correct
from dse.engine.gpu.layout import WIDTH, columns, stages
from dse.engine.gpu.level import Dropout, Level, Tiles
from dse.engine.gpu.numbers import NUMBERS
from dse.engine.gpu.weights import Weights, on_device
from dse.engine.member import Masters, Member, Report, State, Turn, as_part, of_part
from dse.records import Array

Gains = Mapping[int, Sequence[Array | None]]
"""Per member that trains, its layers' gains (dse.engine.member.Turn)."""


@dataclass(frozen=True)
class Counts:
    """Spikes of a chunk.

    fired: per stage, (tile, WIDTH) all of them.
    sent: per stage, (tile, sample, WIDTH) those that were handed on.
    outputs: member -> (sample, length, class) output spikes, where its loss reads out several lengths.
    """

    fired: tuple[Tensor, ...]
    sent: tuple[Tensor, ...]
    outputs: Mapping[int, Tensor]


class Slab:
    """Members of one arithmetic, all or none of them recurrent, on the device."""

    def __init__(self, members: Sequence[Member], device: torch.device) -> None:
        self._members = members
        self._device = device
        numbers = NUMBERS[members[0].arithmetic]
        self._levels = [Level(s, d, members, numbers, device) for d, s in enumerate(stages(members))]
        self._n_updates = [0] * len(members)
        for level, tiles in zip(self._levels, self._tiles(range(len(members))), strict=True):
            level.feed_forward.deploy(tiles.every)
            if level.ring is not None:
                level.ring.deploy(tiles.ring)

    def _tiles(self, members: Sequence[int]) -> list[Tiles]:
        return [level.tiles(frozenset(members)) for level in self._levels]

    def accumulate(
        self,
        x: Tensor,
        labels: Array,
        n_steps: int,
        gains: Gains,
        soft: Mapping[int, Array],
        *,
        add: bool,
    ) -> Counts:
        """Run a chunk forward and back; set the gradients of the members in `gains`, or add to them.

        Args:
            x: (input tile, sample * step, WIDTH) 0 or 1.
            labels: output neurons of the labels, (sample,), or (sample, head).
            n_steps: steps per sample.
            gains: of the chunk.
            soft: of the chunk, of the members that learn probabilities in place of the labels.
            add: add to the gradients that are there.
        """
        depth = max(len(self._members[number].layers) for number in gains)
        levels, tiles = self._levels[:depth], self._tiles(tuple(gains))[:depth]
        target = on_device(np.asarray(labels, np.int64).reshape(len(labels), -1), self._device)
        likely = {k: on_device(np.asarray(x, np.float64), self._device) for k, x in soft.items()}
        dropouts = [self._dropout(d, len(labels), gains) for d in range(depth)]
        factors = [self._factor(d, gains) for d in range(depth)]
        sources, traces = [x], []
        for level, factor, dropout, on in zip(levels, factors, dropouts, tiles, strict=True):
            traces.append(level.forward(sources[-1], n_steps, factor, dropout, on))
            sources.append(traces[-1].passed)
        arriving = None
        for d in range(depth - 1, -1, -1):
            level, trace = levels[d], traces[d]
            by_z = level.backward(trace, arriving, target, n_steps, dropouts[d], tiles[d], likely)
            level.by_weight(sources[d], trace, by_z, factors[d], tiles[d], add=add)
            if d:
                arriving = levels[d - 1].arriving(level, by_z, tiles[d - 1])
        read_outs = {
            number: of_member
            for level, trace in zip(levels, traces, strict=True)
            for readers in level.readers
            if len(readers.loss.lengths(n_steps)) > 1
            for number, of_member in zip(readers.members, readers.counts(trace, n_steps), strict=True)
        }
        return Counts(tuple(t.n_fired.sum(dim=1) for t in traces), tuple(t.n_sent for t in traces), read_outs)

    def _factor(self, depth: int, gains: Gains) -> Tensor:
        """Return (tile,) the gain of the spikes that a stage's tiles read."""
        owner = self._levels[depth].stage.owner
        factor = np.ones(len(self._members), np.float32)
        for number, gain in _given(gains, depth).items():
            factor[number] = gain.max()
        return on_device(factor[owner], self._device)

    def _dropout(self, depth: int, n: int, gains: Gains) -> Dropout:
        """Return what the gains of the next stage silence in a stage."""
        level, given = self._levels[depth], _given(gains, depth + 1)
        if not given:
            return Dropout(None, level.ones)
        kept = np.ones((level.stage.n_tiles, n, WIDTH), np.uint8)
        factor = np.ones(level.stage.n_tiles, np.float32)
        for number, gain in given.items():
            own = level.stage.owner == number
            kept[own] = columns(gain != 0)
            factor[own] = gain.max()
        return Dropout(on_device(kept, self._device), on_device(factor, self._device))

    def finish(
        self, counts: Sequence[Counts], labels: Array, n_steps: int, turns: Mapping[int, Turn]
    ) -> dict[int, Report]:
        """Move the members in `turns` against their gradients; report on the batch.

        Args:
            counts: of the batch's chunks; where there are none, the gradients are 0.
            labels: of the batch, as in `accumulate`.
            n_steps: steps per sample.
            turns: what the members do.
        """
        tiles = self._tiles(tuple(turns))
        if not counts:
            for weights in (w for level in self._levels for w in level.weights):
                weights.gradients.zero_()
        for weights in (w for level in self._levels for w in level.weights):
            weights.keep_removed()
        norms = self._norms(tiles, turns)
        pace = self._pace(turns, norms)
        for level, on in zip(self._levels, tiles, strict=True):
            of_tile = on_device(pace[:, level.stage.owner], self._device)
            for weights in level.weights if on.every.numel() else ():
                weights.update(on.every, of_tile)
        for number in turns:
            self._n_updates[number] += 1
        depth = len(counts[0].fired) if counts else 0
        fired = [np.sum([c.fired[d].cpu().numpy() for c in counts], axis=0) for d in range(depth)]
        sent = [np.concatenate([c.sent[d].cpu().numpy() for c in counts], axis=1) for d in range(depth)]
        read = {
            k: np.concatenate([c.outputs[k].cpu().numpy() for c in counts])
            for k in (counts[0].outputs if counts else ())
        }
        return {
            k: self._report(k, fired, sent, read.get(k), labels, n_steps, norms[k], turn.soft)
            for k, turn in turns.items()
        }

    def _norms(self, tiles: Sequence[Tiles], turns: Mapping[int, Turn]) -> dict[int, float]:
        """Return each member's Euclidean norm of its gradient by the masters, over all weights."""
        squared = [
            (level.stage.owner, weights.panels.n_sources, weights.squared_norms(on.every))
            for level, on in zip(self._levels, tiles, strict=True)
            if on.every.numel()
            for weights in level.weights
        ]
        squares = dict.fromkeys(turns, 0.0)
        for owner, n_sources, blocks in squared:
            table = blocks.cpu().numpy()
            for number in turns:
                own = np.nonzero(owner == number)[0]
                if own.size:  # what others make the table wider by is left out: the sum has one order
                    squares[number] += float(table[own, : n_sources[own[0]]].sum())
        return {number: math.sqrt(square) for number, square in squares.items()}

    def _pace(self, turns: Mapping[int, Turn], norms: Mapping[int, float]) -> Array:
        """Return (3, member) float32 what updates.adam needs."""
        pace = np.zeros((3, len(self._members)))
        for number, turn in turns.items():
            step, limit, norm = self._n_updates[number] + 1, self._members[number].clip_norm, norms[number]
            pace[:, number] = (
                turn.learning_rate / (1 - BETA_1**step),
                1 / (1 - BETA_2**step),
                min(1.0, limit / norm) if limit is not None and norm > 0 else 1.0,
            )
        with np.errstate(over="ignore"):  # a rate beyond float32 is infinite, and so are the weights then
            return pace.astype(np.float32)

    def _report(
        self,
        number: int,
        fired: Sequence[Array],
        sent: Sequence[Array],
        read: Array | None,
        labels: Array,
        n_steps: int,
        norm: float,
        soft: Array | None,
    ) -> Report:
        member, n = self._members[number], len(labels)
        sizes = [x.feed_forward.shape[1] for x in member.layers]
        if not n:
            return Report(0.0, 0, (0.0,) * len(sizes), norm)
        own = [level.stage.owner == number for level in self._levels[: len(sizes)]]
        spikes = [int(f[o].sum()) for f, o in zip(fired, own, strict=False)]
        rates = [fired_ / (n * n_steps * h) for fired_, h in zip(spikes, sizes, strict=True)]
        counts = sent[len(sizes) - 1][own[-1]].swapaxes(0, 1).reshape(n, -1)[:, : sizes[-1]]
        goal = member.goal
        outputs = goal.outputs(labels, n_steps, sizes[-1], soft)
        loss, _ = goal.loss.gradient(counts[:, None] if read is None else read, outputs)
        total = float(loss)
        if goal.hidden_spike_penalty:
            total += goal.hidden_spike_penalty * sum(spikes[:-1])
        return Report(total, n_correct(counts, labels, member.heads), tuple(rates), norm)

    def prune(self, number: int, kept: Masters) -> None:
        """Set the weights of a member that are not kept to 0, for good."""
        every = self._tiles(range(len(self._members)))
        for level, tiles, w, r in zip(self._levels, every, kept.feed_forward, kept.recurrent, strict=False):
            first = int(np.argmax(level.stage.owner == number))
            level.feed_forward = level.feed_forward.without(w, first, tiles.every)
            if level.ring is not None and r is not None:
                level.ring = level.ring.without(r, first, tiles.ring)

    def masters(self, number: int) -> Masters:
        """Return a copy of a member's master weights."""
        return self._matrices(number, lambda weights: weights.masters)

    def state(self, number: int) -> dict[str, Array]:
        """Return what a member's training goes on from; see dse.engine.member.Engine."""
        arrays = {"steps": np.array(self._n_updates[number])}
        for depth, (level, layer) in enumerate(zip(self._levels, self._members[number].layers, strict=False)):
            first = int(np.argmax(level.stage.owner == number))
            part = level.feed_forward.panels_of(first, *layer.feed_forward.shape)
            arrays |= as_part(f"{depth}/feed_forward", level.feed_forward.state(part))
            if level.ring is not None and layer.recurrent is not None:
                part = level.ring.panels_of(first, *layer.recurrent.shape)
                arrays |= as_part(f"{depth}/recurrent", level.ring.state(part))
        return arrays

    def restore(self, number: int, state: State) -> None:
        """Go on from a member's state; see dse.engine.member.Engine."""
        self._n_updates[number] = int(state["steps"])
        every = self._tiles(range(len(self._members)))
        layers = self._members[number].layers
        for depth, (level, tiles, layer) in enumerate(zip(self._levels, every, layers, strict=False)):
            first, of_layer = int(np.argmax(level.stage.owner == number)), of_part(state, str(depth))
            part = level.feed_forward.panels_of(first, *layer.feed_forward.shape)
            arrays = of_part(of_layer, "feed_forward")
            level.feed_forward = level.feed_forward.restored(arrays, part, tiles.every)
            if level.ring is not None and layer.recurrent is not None:
                part = level.ring.panels_of(first, *layer.recurrent.shape)
                level.ring = level.ring.restored(of_part(of_layer, "recurrent"), part, tiles.ring)

    def gradients(self, number: int) -> Masters:
        """Return dL/d(weight as it ran) of a member's last batch, float64 in ideal arithmetic."""
        return self._matrices(number, lambda weights: weights.gradients)

    def _matrices(self, number: int, of: Callable[[Weights], Tensor]) -> Masters:
        layers = self._members[number].layers
        feed_forward, recurrent = [], []
        for level, layer in zip(self._levels, layers, strict=False):
            first = int(np.argmax(level.stage.owner == number))
            weights, shape = level.feed_forward, layer.feed_forward.shape
            feed_forward.append(weights.matrix(of(weights), first, *shape))
            ring = None
            if level.ring is not None and layer.recurrent is not None:
                ring = level.ring.matrix(of(level.ring), first, *layer.recurrent.shape)
            recurrent.append(ring)
        return Masters(tuple(feed_forward), tuple(recurrent))


def _given(gains: Gains, depth: int) -> dict[int, Array]:
    """Return the gains that members have for the inputs of a layer."""
    of_members = {number: of[depth] for number, of in gains.items() if depth < len(of)}
    return {number: gain for number, gain in of_members.items() if gain is not None}
