"""The layers of one depth on the device: forward and backward over a chunk of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dse.engine.gpu import scans
from dse.engine.gpu.layout import WIDTH, Stage
from dse.engine.gpu.numbers import SPIKE_TYPE, UNFUSED, Numbers
from dse.engine.gpu.weights import Stretch, Weights, on_device, weights_of
from dse.engine.member import Member


@dataclass(frozen=True)
class Tiles:
    """Tile numbers of the members that train, on the device: all, by kind of neuron, and with a ring."""

    every: Tensor
    hidden: Tensor
    output: Tensor
    ring: Tensor


@dataclass(frozen=True)
class Dropout:
    """What is silenced among a stage's neurons.

    kept: (tile, sample, WIDTH) uint8, or None where all are kept.
    factor: (tile,) float32 gain of the spikes that are kept.
    """

    kept: Tensor | None
    factor: Tensor


@dataclass(frozen=True)
class Trace:
    """What a forward pass leaves.

    slope: (tile, sample * step, WIDTH) surrogate gradient.
    passed, raw: like it, spikes one step later, as the next layer and the layer itself see them.
    n_fired, n_sent: (tile, sample, WIDTH) int32 spikes, and those before the last step.
    """

    slope: Tensor
    passed: Tensor
    raw: Tensor
    n_fired: Tensor
    n_sent: Tensor


class Level:
    """A stage on the device."""

    def __init__(
        self, stage: Stage, depth: int, members: Sequence[Member], numbers: Numbers, device: torch.device
    ) -> None:
        here = [m.layers[depth] for m in members if depth < len(m.layers)]
        rings = [x.recurrent for x in here if x.recurrent is not None]
        self.stage, self.numbers, self.device = stage, numbers, device
        self.feed_forward = weights_of(
            stage.feed_forward, [x.feed_forward for x in here], stage.unit, numbers, device
        )
        self.ring: Weights | None = None
        if rings:
            self.ring = weights_of(stage.recurrent, rings, stage.recurrent_unit, numbers, device)
        self.ones = torch.ones(stage.n_tiles, device=device)
        self._first, self._count = on_device(stage.first, device), on_device(stage.count, device)
        self._ahead = on_device(stage.ahead_first, device), on_device(stage.ahead_count, device)
        self._keep = on_device(stage.keep_u, device), on_device(stage.keep_v, device)
        self._threshold = on_device(stage.threshold, device)
        self._surrogate = on_device(stage.surrogate, device)
        owners = [members[i] for i in stage.owner]
        n_classes = np.asarray([m.layers[-1].feed_forward.shape[1] for m in owners])
        neuron = (np.arange(stage.n_tiles) - stage.first)[:, None] * WIDTH + np.arange(WIDTH)
        is_class = stage.is_output[:, None] & (neuron < n_classes[:, None])
        self._class = on_device(np.where(is_class, neuron, -1)[:, None], device)
        self._false = on_device(np.asarray([m.false_rate for m in owners])[:, None, None], device)
        self._true = on_device(np.asarray([m.true_rate for m in owners])[:, None, None], device)
        self._tiles: dict[frozenset[int], Tiles] = {}

    @property
    def weights(self) -> list[Weights]:
        """The weights of either kind."""
        return [self.feed_forward] if self.ring is None else [self.feed_forward, self.ring]

    def tiles(self, members: frozenset[int]) -> Tiles:
        """Return the tiles of some members."""
        if members not in self._tiles:
            live = np.isin(self.stage.owner, list(members))
            kinds = (live, ~self.stage.is_output, self.stage.is_output, self.stage.recurrent.n_sources > 0)
            of_kinds = [np.nonzero(live & kind)[0].astype(np.int32) for kind in kinds]
            self._tiles = {members: Tiles(*(on_device(x, self.device) for x in of_kinds))}
        return self._tiles[members]

    def forward(self, source: Tensor, n_steps: int, factor: Tensor, dropout: Dropout, tiles: Tiles) -> Trace:
        """Run some tiles from rest.

        Args:
            source: (source tile, sample * step, WIDTH) spikes that arrive.
            n_steps: steps per sample.
            factor: (tile,) float32 gain of those spikes.
            dropout: what the next stage does not see.
            tiles: tiles that run.
        """
        n_tiles, n_rows, ring = self.stage.n_tiles, source.shape[1], self.ring
        n = n_rows // n_steps
        state = torch.int64 if self.numbers.integer else self.numbers.real
        z = source.new_empty((n_tiles, n_rows, WIDTH), dtype=self.numbers.real)
        passed = torch.empty_like(z, dtype=SPIKE_TYPE)
        raw = passed if ring is None else torch.empty_like(passed)
        u, v = (z.new_empty((n_tiles, n, WIDTH) if ring is not None else (0,), dtype=state) for _ in range(2))
        n_fired, n_sent = (z.new_empty((n_tiles, n, WIDTH), dtype=torch.int32) for _ in range(2))
        self.feed_forward.product(source, z, factor, tiles.every, Stretch(0, 1, n_rows), add=False)
        for first in range(0, n_steps, n_steps if ring is None else 1):
            if ring is not None and first and tiles.ring.numel():
                ring.product(raw, z, self.ones, tiles.ring, Stretch(first, n_steps, n), add=True)
            scans.scan[(tiles.every.numel(), -(-n // scans.SAMPLES.value))](
                z,
                passed,
                raw,
                u,
                v,
                n_fired,
                n_sent,
                tiles.every,
                n_sent if dropout.kept is None else dropout.kept,
                *self._keep,
                self._threshold,
                self._surrogate,
                n_tiles,
                n,
                n_steps,
                first,
                n_steps if ring is None else first + 1,
                INTEGER=self.numbers.integer,
                MASKED=dropout.kept is not None,
                STEPWISE=ring is not None,
                num_warps=2,
                **UNFUSED,
            )
        return Trace(z, passed, raw, n_fired, n_sent)

    def arriving(self, ahead: Level, by_z: Tensor, tiles: Tiles) -> Tensor:
        """Return dL/d(spike) of the hidden tiles, as the next stage sees the spikes.

        Args:
            ahead: the next stage.
            by_z: its dL/dz, (part, tile, sample * step, WIDTH).
            tiles: tiles that run in this stage.
        """
        n_rows = by_z.shape[2]
        by_spike = by_z.new_empty((self.stage.n_tiles, n_rows, WIDTH), dtype=self.numbers.real)
        rows = Stretch(0, 1, n_rows)
        ahead.feed_forward.by_input(by_z, by_spike, tiles.hidden, self._first, self._ahead, rows)
        return by_spike

    def _by_output(self, n_sent: Tensor, labels: Tensor, n_steps: int) -> Tensor:
        """Return dL/d(output spike), (tile, sample, WIDTH), as dse.engine.loss.spike_rate computes it."""
        is_label = (self._class[..., None] == labels[None, :, None]).any(dim=-1)
        error = n_sent.double() / n_steps - self._false + is_label * (self._false - self._true)
        return torch.where(self._class >= 0, 2 / n_steps * error, 0.0).to(self.numbers.real)

    def backward(
        self,
        trace: Trace,
        arriving: Tensor | None,
        labels: Tensor,
        n_steps: int,
        dropout: Dropout,
        tiles: Tiles,
    ) -> Tensor:
        """Return dL/dz, (part, tile, sample * step, WIDTH).

        Args:
            trace: of the forward pass.
            arriving: what `arriving` returned; None where no tile is hidden.
            labels: (sample, head) output neurons of the labels.
            n_steps: steps per sample.
            dropout: what the next stage does not see.
            tiles: tiles that run.
        """
        numbers, ring, slope, n = self.numbers, self.ring, trace.slope, len(labels)
        by_z = slope.new_empty((numbers.n_parts, *slope.shape), dtype=numbers.part)
        lu, lv, by_ring = (torch.zeros_like(trace.n_sent, dtype=numbers.real) for _ in range(3))
        kinds: list[tuple[Tensor, Tensor, bool, Tensor | None]] = [
            (tiles.output, self._by_output(trace.n_sent, labels, n_steps), True, None)
        ]
        if arriving is not None:
            kinds.append((tiles.hidden, arriving, False, dropout.kept))
        for end in range(n_steps, 0, -n_steps if ring is None else -1):
            if ring is not None and end < n_steps and tiles.ring.numel():
                own = (self._first, self._count)
                ring.by_input(by_z, by_ring, tiles.ring, self._first, own, Stretch(end, n_steps, n))
            for of, by_spike, is_output, kept in kinds:
                if not of.numel():
                    continue
                scans.scan_back[(of.numel(), -(-n // scans.SAMPLES.value))](
                    slope,
                    by_spike,
                    by_ring,
                    by_z,
                    lu,
                    lv,
                    of,
                    trace.n_sent if kept is None else kept,
                    dropout.factor,
                    *self._keep,
                    n,
                    n_steps,
                    0 if ring is None else end - 1,
                    end,
                    slope.numel(),
                    N_PARTS=numbers.n_parts,
                    OUTPUT=is_output,
                    MASKED=kept is not None,
                    STEPWISE=ring is not None,
                    num_warps=2,
                    **UNFUSED,
                )
        return by_z

    def by_weight(
        self, source: Tensor, trace: Trace, by_z: Tensor, factor: Tensor, tiles: Tiles, *, add: bool
    ) -> None:
        """Set the gradients of the weights, or add to them (arguments as in `forward` and `backward`)."""
        self.feed_forward.by_weight(source, by_z, factor, tiles.every, add=add)
        if self.ring is not None and tiles.ring.numel():
            self.ring.by_weight(trace.raw, by_z, self.ones, tiles.ring, add=add)
