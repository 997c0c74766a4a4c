"""A cohort on the device: batches in chunks, members in slabs.

A batch is cut into chunks of whole samples by its own size alone, so that sums have one order in any cohort;
members are cut into slabs by what they hold, which changes nothing for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from dse.engine.events import Rows
from dse.engine.gpu.layout import WIDTH, tiles_for
from dse.engine.gpu.numbers import INTERPRETED, NUMBERS, SPIKE_TYPE
from dse.engine.gpu.slab import Counts, Slab
from dse.engine.layers import check_inputs
from dse.engine.member import Masters, Member, Report, State, Turn
from dse.records import Arithmetic, Array

INPUT_BYTES = 2**30
"""Largest dense input of a chunk of more than one sample."""
CHUNK_ROWS = 2**18
"""Most rows (sample and step) of such a chunk."""
SLAB_BYTES = 2**32
"""What the layers of a slab hold of a chunk; a member that holds more has a slab of its own."""


def device() -> torch.device:
    """Return where kernels run: the CUDA device, or the CPU under Triton's interpreter."""
    return torch.device("cpu" if INTERPRETED else "cuda")


def dense(rows: Rows, first: int, end: int, on: torch.device) -> Tensor:
    """Return the spikes of some samples as (input tile, sample * step, WIDTH) 0 or 1, built on the device."""
    low, high = first * rows.n_steps, end * rows.n_steps
    offsets = torch.tensor(rows.offsets[low : high + 1], device=on)
    index = torch.tensor(rows.index[rows.offsets[low] : rows.offsets[high]], device=on).long()
    n_rows = high - low
    row = torch.repeat_interleave(offsets.diff(), output_size=index.numel())
    x = torch.zeros((tiles_for(rows.n_inputs), n_rows, WIDTH), dtype=SPIKE_TYPE, device=on)
    x.view(-1)[((index // WIDTH) * n_rows + row) * WIDTH + index % WIDTH] = 1
    return x


def slabs(members: Sequence[Member], n_rows: int) -> list[list[int]]:
    """Return the numbers of the members that train side by side, given the rows of a chunk.

    Recurrent members have slabs of their own, since they go through a layer step by step.
    """
    of_kinds: dict[tuple[Arithmetic, bool], list[list[int]]] = {}
    held: dict[tuple[Arithmetic, bool], int] = {}
    for number, member in enumerate(members):
        kind = (member.arithmetic, any(x.recurrent is not None for x in member.layers))
        n_columns = WIDTH * sum(tiles_for(x.feed_forward.shape[1]) for x in member.layers)
        needed = n_columns * n_rows * NUMBERS[member.arithmetic].cell_bytes
        if kind not in of_kinds or held[kind] + needed > SLAB_BYTES:
            of_kinds.setdefault(kind, []).append([])
            held[kind] = 0
        of_kinds[kind][-1].append(number)
        held[kind] += needed
    return [slab for slabs_of_kind in of_kinds.values() for slab in slabs_of_kind]


class WideEngine:
    """Networks that train side by side on the device; see dse.engine.member.Engine."""

    def __init__(self, members: Sequence[Member], n_samples: int, n_steps: int, on: torch.device) -> None:
        inputs = sorted({m.layers[0].feed_forward.shape[0] for m in members})
        if len(inputs) != 1:
            raise ValueError(f"members of a cohort must have the same inputs, got {inputs}")
        self._n_inputs, self._device = inputs[0], on
        row_bytes = tiles_for(inputs[0]) * WIDTH * SPIKE_TYPE.itemsize
        n_rows = min(CHUNK_ROWS, INPUT_BYTES // row_bytes)
        self._chunk = max(1, min(n_samples, n_rows // max(1, n_steps)))
        self._slabs: list[Slab] = []
        self._place: dict[int, tuple[int, int]] = {}
        for of_slab in slabs(members, self._chunk * n_steps):
            self._place |= {number: (len(self._slabs), i) for i, number in enumerate(of_slab)}
            self._slabs.append(Slab([members[number] for number in of_slab], on))

    def step(self, rows: Rows, labels: Array, turns: Mapping[int, Turn]) -> dict[int, Report]:
        """Train the members named in `turns` on a batch; the others do not move.

        Raises:
            ValueError: the batch has other inputs than the members.
        """
        check_inputs(rows, self._n_inputs)
        of_slab: list[dict[int, Turn]] = [{} for _ in self._slabs]
        for number, turn in turns.items():
            slab, place = self._place[number]
            of_slab[slab][place] = turn
        counts: list[list[Counts]] = [[] for _ in self._slabs]
        for first in range(0, rows.n_samples, self._chunk):
            part = slice(first, min(first + self._chunk, rows.n_samples))
            x = dense(rows, part.start, part.stop, self._device)
            for slab_, own, counted in zip(self._slabs, of_slab, counts, strict=True):
                if own:
                    gains = {
                        place: tuple(None if gain is None else gain[part] for gain in turn.gains)
                        for place, turn in own.items()
                    }
                    soft = {k: turn.soft[part] for k, turn in own.items() if turn.soft is not None}
                    counted.append(
                        slab_.accumulate(x, labels[part], rows.n_steps, gains, soft, add=first > 0)
                    )
        reports = [
            slab_.finish(counted, labels, rows.n_steps, own) if own else {}
            for slab_, counted, own in zip(self._slabs, counts, of_slab, strict=True)
        ]
        return {number: reports[self._place[number][0]][self._place[number][1]] for number in turns}

    def prune(self, member: int, kept: Masters) -> None:
        """Set the weights of a member that are not kept to 0, for good."""
        slab, place = self._place[member]
        self._slabs[slab].prune(place, kept)

    def masters(self, member: int) -> Masters:
        """Return a copy of a member's master weights."""
        slab, place = self._place[member]
        return self._slabs[slab].masters(place)

    def state(self, member: int) -> State:
        """Return a copy of what a member's training goes on from."""
        slab, place = self._place[member]
        return self._slabs[slab].state(place)

    def restore(self, member: int, state: State) -> None:
        """Go on from a member's state."""
        slab, place = self._place[member]
        self._slabs[slab].restore(place, state)

    def gradients(self, member: int) -> Masters:
        """Return dL/d(weight as it ran) of the last batch that a member trained on."""
        slab, place = self._place[member]
        return self._slabs[slab].gradients(place)
