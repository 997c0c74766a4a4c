"""The layers of one depth on the device: forward and backward over a chunk of a batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dse.engine.goal import by_spike
from dse.engine.gpu import scans
from dse.engine.gpu.layout import WIDTH, Stage, columns
from dse.engine.gpu.numbers import SPIKE_TYPE, UNFUSED, Numbers
from dse.engine.gpu.weights import Stretch, Weights, on_device, weights_of
from dse.engine.losses import Loss, Outputs
from dse.engine.member import Member
from dse.records import Array

Soft = Mapping[int, Tensor]
"""Member -> (sample, class) probabilities that it learns in place of the labels."""


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


@dataclass(frozen=True)
class Readers:
    """The outputs of a stage's members that have a loss, heads and a number of classes in common.

    members: their numbers.
    tiles: (member, tile of its outputs) int64 tile numbers.
    true_rate, false_rate: (member, 1, 1, 1) float64.
    """

    loss: Loss
    heads: tuple[int, ...]
    n_classes: int
    members: tuple[int, ...]
    tiles: Tensor
    true_rate: Tensor
    false_rate: Tensor

    def counts(self, trace: Trace, n_steps: int) -> Tensor:
        """Return the output spikes after each length of the loss, (member, sample, length, class) float64."""
        lengths = self.loss.lengths(n_steps)
        if len(lengths) == 1:
            of_lengths = [trace.n_sent[self.tiles].double()]
        else:
            passed = trace.passed.view(len(trace.passed), -1, n_steps, WIDTH)[self.tiles]
            of_lengths = [passed[:, :, :, :n].sum(dim=3, dtype=torch.float64) for n in lengths]
        of_tiles = torch.stack(of_lengths, dim=1)  # (member, length, tile, sample, WIDTH)
        return of_tiles.permute(0, 3, 1, 2, 4).flatten(3)[..., : self.n_classes]

    def by_output(self, trace: Trace, labels: Tensor, n_steps: int, soft: Soft) -> Tensor:
        """Return dL/d(output spike), (stretch, member, tile, sample, WIDTH) float64."""
        none = labels.new_zeros((len(labels), self.n_classes), dtype=torch.float64)
        is_label: Any = none.scatter_(1, labels, 1.0)
        if soft.keys() & set(self.members):
            is_label = torch.stack([soft.get(number, is_label) for number in self.members])
        counts: Any = self.counts(trace, n_steps)
        lengths = self.loss.lengths(n_steps)
        outputs = Outputs(is_label, lengths, self.heads, self.true_rate, self.false_rate)
        _, by_count = self.loss.gradient(counts, outputs)
        by_class = torch.nn.functional.pad(by_spike(by_count), (0, -self.n_classes % WIDTH))
        n_members, n, n_stretches, _ = by_class.shape
        return by_class.view(n_members, n, n_stretches, -1, WIDTH).permute(2, 0, 3, 1, 4)


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
        factors = (stage.keep_u, stage.keep_v, stage.cross)
        self._factors = tuple(on_device(x, device) for x in factors)
        self._turns = stage.cross.size > 0
        self._threshold = on_device(stage.threshold, device)
        self._surrogate = on_device(stage.surrogate, device)
        penalty = np.concatenate([_penalty(m, depth) for m in members if depth < len(m.layers)])
        self._is_penalised = bool(penalty.any())
        self._penalty = on_device(penalty, device).to(numbers.real)
        self.readers = _readers(stage, members, device)
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
                *self._factors,
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
                TURNS=self._turns,
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

    def _by_output(self, trace: Trace, labels: Tensor, n_steps: int, soft: Soft) -> Tensor:
        """Return dL/d(output spike), (tile, sample, WIDTH).

        Where it depends on the step, it goes into the surrogate gradients instead, and 1 is returned.
        """
        out = trace.slope.new_zeros(trace.n_sent.shape)
        slope = trace.slope.view(len(trace.slope), -1, n_steps, WIDTH)
        for readers in self.readers:
            stretches = readers.by_output(trace, labels, n_steps, soft).to(self.numbers.real)
            if len(stretches) == 1:
                out[readers.tiles] = stretches[0]
                continue
            out[readers.tiles] = 1.0
            first = 0
            for length, of_stretch in zip(readers.loss.lengths(n_steps), stretches, strict=True):
                slope[readers.tiles, :, first : length - 1] *= of_stretch[:, :, :, None]
                first = length - 1
        return out

    def backward(
        self,
        trace: Trace,
        arriving: Tensor | None,
        labels: Tensor,
        n_steps: int,
        dropout: Dropout,
        tiles: Tiles,
        soft: Soft,
    ) -> Tensor:
        """Return dL/dz, (part, tile, sample * step, WIDTH).

        Args:
            trace: of the forward pass.
            arriving: what `arriving` returned; None where no tile is hidden.
            labels: (sample, head) output neurons of the labels.
            n_steps: steps per sample.
            dropout: what the next stage does not see.
            tiles: tiles that run.
            soft: of the members that learn probabilities in place of the labels.
        """
        numbers, ring, slope, n = self.numbers, self.ring, trace.slope, len(labels)
        by_z = slope.new_empty((numbers.n_parts, *slope.shape), dtype=numbers.part)
        lu, lv, by_ring = (torch.zeros_like(trace.n_sent, dtype=numbers.real) for _ in range(3))
        kinds: list[tuple[Tensor, Tensor, bool, Tensor | None]] = [
            (tiles.output, self._by_output(trace, labels, n_steps, soft), True, None)
        ]
        if arriving is not None:
            kinds.append((tiles.hidden, arriving, False, dropout.kept))
        for end in range(n_steps, 0, -n_steps if ring is None else -1):
            if ring is not None and end < n_steps and tiles.ring.numel():
                own = (self._first, self._count)
                ring.by_input(by_z, by_ring, tiles.ring, self._first, own, Stretch(end, n_steps, n))
            for of, by_spikes, is_output, kept in kinds:
                if not of.numel():
                    continue
                scans.scan_back[(of.numel(), -(-n // scans.SAMPLES.value))](
                    slope,
                    by_spikes,
                    by_ring,
                    by_z,
                    lu,
                    lv,
                    of,
                    trace.n_sent if kept is None else kept,
                    dropout.factor,
                    self._penalty,
                    *self._factors,
                    self.stage.n_tiles,
                    n,
                    n_steps,
                    0 if ring is None else end - 1,
                    end,
                    slope.numel(),
                    N_PARTS=numbers.n_parts,
                    OUTPUT=is_output,
                    MASKED=kept is not None,
                    PENALISED=self._is_penalised and not is_output,
                    STEPWISE=ring is not None,
                    TURNS=self._turns,
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


def _penalty(member: Member, depth: int) -> Array:
    """Return what each spike of a layer adds to the loss, (tile, WIDTH); outputs add nothing."""
    of = member.hidden_spike_penalty if depth < len(member.layers) - 1 else 0.0
    return columns(np.full((1, member.layers[depth].feed_forward.shape[1]), of))[:, 0]


def _readers(stage: Stage, members: Sequence[Member], device: torch.device) -> list[Readers]:
    """Return the outputs of a stage, grouped by what their losses have in common."""
    groups: dict[tuple[Loss, tuple[int, ...], int], list[int]] = {}
    for number in dict.fromkeys(stage.owner[stage.is_output].tolist()):
        of = members[number]
        n_classes = of.layers[-1].feed_forward.shape[1]
        groups.setdefault((of.loss, of.heads or (n_classes,), n_classes), []).append(number)

    def rates(values: Sequence[float]) -> Tensor:
        return on_device(np.asarray(values)[:, None, None, None], device)

    return [
        Readers(
            loss,
            heads,
            n_classes,
            tuple(numbers),
            on_device(np.stack([np.flatnonzero(stage.owner == k) for k in numbers]), device),
            rates([members[k].true_rate for k in numbers]),
            rates([members[k].false_rate for k in numbers]),
        )
        for (loss, heads, n_classes), numbers in groups.items()
    ]
