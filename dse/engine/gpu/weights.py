"""A stage's weights of one kind on the device, and the kernels that work on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dse.engine.adam import BETA_1, BETA_2, EPSILON
from dse.engine.gpu import products, updates
from dse.engine.gpu.layout import WIDTH, Panels, matrix, panel, tiles_for
from dse.engine.gpu.numbers import UNFUSED, Numbers
from dse.engine.member import State
from dse.records import Array


def on_device(values: Array, device: torch.device) -> Tensor:
    """Return a copy of an array on the device."""
    return torch.tensor(np.ascontiguousarray(values), device=device)


class Stretch(NamedTuple):
    """Some rows (sample * step) of an array: `n` of them, from `first` on, `step` apart."""

    first: int
    step: int
    n: int


@dataclass(frozen=True)
class Weights:
    """Weights into a stage's tiles; what the tensors hold changes in place.

    panels: where they lie; source, n_sources, offset are its arrays on the device.
    numbers: of the members' arithmetic.
    masters, first, second: (panels.size,) float32 master weights and Adam's moments.
    gradients: (panels.size,) dL/d(weight as it runs).
    running: (part, panels.size) weights as they run.
    unit: (tile, WIDTH) float32, what a learning rate of 1 moves a weight by.
    kept: like the gradients, 0 where a weight was removed, else 1; None: none was.
    """

    panels: Panels
    numbers: Numbers
    masters: Tensor
    first: Tensor
    second: Tensor
    gradients: Tensor
    running: Tensor
    source: Tensor
    n_sources: Tensor
    offset: Tensor
    unit: Tensor
    kept: Tensor | None = None

    def _grid(self, tiles: Tensor) -> tuple[int, int]:
        return tiles.numel(), int(self.panels.n_sources.max())

    def product(
        self, spikes: Tensor, z: Tensor, factor: Tensor, tiles: Tensor, rows: Stretch, *, add: bool
    ) -> None:
        """Set z of some tiles and rows, or add to it (products.product)."""
        products.product[(tiles.numel(), -(-rows.n // products.ROWS.value))](
            spikes,
            self.running,
            z,
            tiles,
            self.source,
            self.n_sources,
            self.offset,
            factor,
            rows.n,
            rows.first,
            rows.step,
            z.shape[1],
            self.panels.size,
            N_PARTS=self.numbers.n_weight_parts,
            ADD=add,
            num_warps=8,
            num_stages=self.numbers.n_stages,
            **UNFUSED,
        )

    def by_input(
        self,
        by_z: Tensor,
        out: Tensor,
        tiles: Tensor,
        own_first: Tensor,
        readers: tuple[Tensor, Tensor],
        rows: Stretch,
    ) -> None:
        """Set dL/d(input spike) of some source tiles, read by the tiles `readers` (products.by_input)."""
        products.by_input[(tiles.numel(), -(-rows.n // products.ROWS.value))](
            by_z,
            self.running,
            out,
            tiles,
            own_first,
            *readers,
            self.offset,
            rows.n,
            rows.first,
            rows.step,
            by_z.shape[2],
            by_z[0].numel(),
            self.panels.size,
            N_PARTS=self.numbers.n_parts,
            N_WEIGHT_PARTS=self.numbers.n_weight_parts,
            num_warps=8,
            num_stages=self.numbers.n_stages,
            **UNFUSED,
        )

    def by_weight(self, spikes: Tensor, by_z: Tensor, factor: Tensor, tiles: Tensor, *, add: bool) -> None:
        """Set the gradients of some tiles' panels, or add to them (products.by_weight)."""
        products.by_weight[self._grid(tiles)](
            spikes,
            by_z,
            self.gradients,
            tiles,
            self.source,
            self.n_sources,
            self.offset,
            factor,
            by_z.shape[2],
            by_z[0].numel(),
            N_PARTS=self.numbers.n_parts,
            ADD=add,
            num_stages=self.numbers.n_stages,
            **UNFUSED,
        )

    def deploy(self, tiles: Tensor) -> None:
        """Set the weights that run from the masters (updates.deploy)."""
        updates.deploy[self._grid(tiles)](
            self.masters,
            self.running,
            tiles,
            self.n_sources,
            self.offset,
            self.panels.size,
            INTEGER=self.numbers.integer,
            N_PARTS=self.numbers.n_weight_parts,
            **UNFUSED,
        )

    def without(self, kept: Array, first: int, tiles: Tensor) -> Weights:
        """Return the weights with some of a member's set to 0 for good.

        Args:
            kept: (source, neuron) booleans.
            first: the member's first tile.
            tiles: tiles that are deployed anew.
        """
        mask = torch.ones_like(self.gradients) if self.kept is None else self.kept.clone()
        own = panel(kept).ravel()
        begin = int(self.panels.offset[first])
        mask[begin : begin + own.size] *= on_device(own, mask.device)
        for values in (self.masters, self.first, self.second):
            values *= mask
        pruned = replace(self, kept=mask)
        pruned.deploy(tiles)
        return pruned

    def state(self, part: slice) -> dict[str, Array]:
        """Return a copy of what an update reads and writes in a part of the panels."""
        arrays = {"weights": self.masters, "first": self.first, "second": self.second}
        kept = {} if self.kept is None else {"kept": self.kept[part].cpu().numpy() != 0}
        return {name: x[part].cpu().numpy().copy() for name, x in arrays.items()} | kept

    def restored(self, state: State, part: slice, tiles: Tensor) -> Weights:
        """Return the weights with the numbers of a state in a part of the panels.

        Args:
            state: of `state`.
            part: of the panels.
            tiles: tiles that are deployed anew.
        """
        arrays = {"weights": self.masters, "first": self.first, "second": self.second}
        for name, values in arrays.items():
            values[part] = on_device(state[name], values.device)
        self.deploy(tiles)
        if "kept" not in state:
            return self
        mask = torch.ones_like(self.gradients) if self.kept is None else self.kept.clone()
        mask[part] = on_device(state["kept"].astype(np.float32), mask.device).to(mask.dtype)
        return replace(self, kept=mask)

    def keep_removed(self) -> None:
        """Clear the gradient of removed weights; with their moments at 0 Adam leaves them at exactly 0."""
        if self.kept is not None:
            self.gradients.mul_(self.kept)

    def squared_norms(self, tiles: Tensor) -> Tensor:
        """Return squared norms of the gradients, (tile, source tile) float64, defined for `tiles` only."""
        n_most = int(self.panels.n_sources.max())
        norms = self.masters.new_empty((len(self.panels.offset), n_most), dtype=torch.float64)
        updates.squared_norms[self._grid(tiles)](
            self.gradients,
            self.masters,
            norms,
            tiles,
            self.n_sources,
            self.offset,
            n_most,
            INTEGER=self.numbers.integer,
            **UNFUSED,
        )
        return norms

    def update(self, tiles: Tensor, pace: Tensor) -> None:
        """Move the masters of some tiles' panels, (3, tile) `pace` as in updates.adam, and deploy them."""
        updates.adam[self._grid(tiles)](
            self.masters,
            self.gradients,
            self.first,
            self.second,
            tiles,
            self.n_sources,
            self.offset,
            self.unit,
            pace,
            pace.shape[1],
            INTEGER=self.numbers.integer,
            BETA_1=BETA_1,
            BETA_2=BETA_2,
            EPSILON=EPSILON,
            **UNFUSED,
        )
        self.deploy(tiles)

    def panels_of(self, first: int, n_in: int, n_out: int) -> slice:
        """Return where the panels of a (source, neuron) matrix lie, given its member's first tile."""
        begin = int(self.panels.offset[first])
        return slice(begin, begin + tiles_for(n_in) * WIDTH * tiles_for(n_out) * WIDTH)

    def matrix(self, values: Tensor, first: int, n_in: int, n_out: int) -> Array:
        """Return a copy of the (source, neuron) matrix of the member whose first tile is given.

        Args:
            values: (panels.size,) masters or gradients.
            first: tile number.
            n_in: source neurons.
            n_out: neurons.
        """
        flat = values[self.panels_of(first, n_in, n_out)].cpu().numpy()
        return matrix(flat.reshape(tiles_for(n_out), -1, WIDTH), n_in, n_out)


def weights_of(
    panels: Panels, matrices: Sequence[Array], unit: Array, numbers: Numbers, device: torch.device
) -> Weights:
    """Return weights at their start, from the members' (source, neuron) matrices in order."""
    masters = on_device(np.concatenate([panel(m.astype(np.float32)).ravel() for m in matrices]), device)
    return Weights(
        panels,
        numbers,
        masters,
        torch.zeros_like(masters),
        torch.zeros_like(masters),
        torch.zeros_like(masters, dtype=numbers.real),
        masters.new_zeros((numbers.n_weight_parts, panels.size), dtype=numbers.part),
        *(on_device(x, device) for x in (panels.source, panels.n_sources, panels.offset, unit)),
    )
