"""Columns shared across taxels: one small group of neurons per taxel, with the same weights everywhere.

A column reads its taxel and the K nearest ones, rank by rank: the taxel itself, then the others by distance,
then by y, then by x. All inputs of a taxel (polarities or thresholds, and their delayed copies) are inputs of
their own. The weight from the taxel of rank k, plane p and delay d to feature f is one number in all columns,
and so are the parameters of neuron f. Where fewer than K other taxels exist, a rank has no synapse.

The columns' spikes reach the next layer by weights of their own (dense), or every column by the same ones
(shared), so that the next layer sees what was felt, not where.

What is trained, run and exported is one layered `Network`, the columns side by side in its first layer, whose
synapses hold copies of the shared weights. `n_weights` counts a shared weight once. Prices count every
synapse: chips hold each copy, and processors are priced as if they did.

Source: MultiBarrel (REFERENCES.md), whose read-in and read-out do not spike; here all layers spike.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import ClassVar, Literal

import numpy as np

from dse.base.records import Ints
from dse.base.registry import param, register
from dse.models.snn.family import SNN, OwnFirstLayer
from dse.models.snn.settings import Stack
from dse.models.training import Training

# The numbers of a matrix's weights, at the start, in training and as copies in the engine.
_SHARED_BYTES = 24


@register("models", "columns")
@dataclass(frozen=True)
class Columns(OwnFirstLayer):
    """One small spiking column per taxel, all with the same weights; W_t counts a shared weight once."""

    cpu_only: ClassVar[bool] = True
    hidden_layers: ClassVar[tuple[int, int]] = (0, 2)
    threshold_exponents: ClassVar[tuple[int, ...]] = ()  # type: ignore[misc]

    features: int = param(16, low=1, doc="neurons of a column; there is a column for each taxel")
    neighbours: int = param(8, low=0, doc="taxels that a column receives beside its own, nearest first")
    read_out: Literal["dense", "shared"] = param(
        "dense",
        choices=("dense", "shared"),
        doc="dense: each column has weights of its own to the next layer; shared: all columns have the same",
    )
    hidden: tuple[int, ...] = param(
        (), low=1, doc="neurons of each dense hidden layer between columns and outputs, 0 to 2 layers"
    )

    def __post_init__(self) -> None:
        """Check what one key alone cannot say."""
        super().__post_init__()
        if self.read_out == "shared" and self.whitened != "none":
            raise ValueError(f"whitened must be none where read_out is shared, got {self.whitened}")

    def placed(self, positions: Ints) -> Stack:
        """Return the stack of the columns over channels at (n_channels, 3) x, y and plane."""
        n_taxels = len(taxels(positions))
        settings = {x.name: getattr(self, x.name) for x in fields(Stack) if x.name != "hidden"}
        hidden = (n_taxels * self.features, *self.hidden)
        return _Placed(**settings, hidden=hidden, n_taxels=n_taxels, columns=self, positions=positions)


@dataclass(frozen=True, eq=False)
class _Placed(SNN):
    """The columns of `n_taxels` taxels as the first hidden layer of a stack."""

    n_taxels: int = field(kw_only=True)
    columns: Columns = field(kw_only=True)
    positions: Ints = field(kw_only=True)

    @property
    def copies(self) -> int:
        return self.n_taxels

    @property
    def _is_shared(self) -> bool:
        return self.columns.read_out == "shared"

    @property
    def _of_columns(self) -> Ints:
        return of_columns(self.positions, len(self.input_delays), self.columns.neighbours)

    def sharing(self, n_outputs: int) -> list[Ints | None]:
        """Return the numbers of each layer's shared weights (`dse.engine.shared`), or None."""
        features, n_next = self.columns.features, (*self.hidden, n_outputs)[1]
        read_out = repeated(self.n_taxels, features, n_next) if self._is_shared else None
        return [of_features(self._of_columns, features), read_out, *(None for _ in self.hidden[1:])]

    def n_weights(self, n_channels: int, n_classes: int) -> int:
        """Return W_t: the weights of one column and those behind the columns, shared ones once."""
        read_out, *deeper = (a * b for a, b in self.matrices(n_channels, n_classes)[1:])
        of_column = (int(self._of_columns.max()) + 1) * self.columns.features
        return of_column + read_out // (self.n_taxels if self._is_shared else 1) + sum(deeper)

    def memory_bytes(self, n_channels: int, n_classes: int, n_steps: int, training: Training) -> int:
        """Return what a design holds at most while it trains in a cohort, without what its cohort shares."""
        matrices = self.matrices(n_channels, n_classes)
        shared = sum(a * b for a, b in matrices[: 1 + self._is_shared])
        return super().memory_bytes(n_channels, n_classes, n_steps, training) + _SHARED_BYTES * shared


def taxels(positions: Ints) -> Ints:
    """Return x and y of every taxel, (taxel, 2): the distinct places, by y, then x.

    Args:
        positions: (n_channels, 3) x, y and plane.
    """
    return np.unique(np.asarray(positions, np.int64)[:, 1::-1], axis=0)[:, ::-1]


def nearest(places: Ints, neighbours: int) -> Ints:
    """Return the taxels that each column receives by rank, (taxel, 1 + neighbours or all): itself first.

    Args:
        places: (taxel, 2) x and y, by y, then x: the order among equally distant ones.
        neighbours: most taxels beside its own.
    """
    squared = ((places[:, None] - places) ** 2).sum(axis=2)
    return np.asarray(np.argsort(squared, axis=1, kind="stable")[:, : neighbours + 1])


def of_columns(positions: Ints, n_delays: int, neighbours: int) -> Ints:
    """Return which input of its column every input is, (input, column); -1: the column does not receive it.

    Input d * n_channels + c is channel c by delay number d; columns lie as `taxels`. Numbers run over delays,
    ranks and planes, without gaps.

    Args:
        positions: (n_channels, 3) x, y and plane of the channels.
        n_delays: copies of the channels.
        neighbours: most taxels beside its own.
    """
    places = taxels(positions)
    taxel = [int(np.flatnonzero((places == place).all(axis=1))[0]) for place in positions[:, :2]]
    planes, plane = np.unique(positions[:, 2], return_inverse=True)
    received = nearest(places, neighbours)
    rank = np.full((len(places), len(places)), -1)  # (column, taxel)
    np.put_along_axis(rank, received, np.arange(received.shape[1])[None], axis=1)
    of_channel = rank[:, taxel].T
    kind = of_channel * len(planes) + plane.reshape(-1, 1)
    used = np.unique(kind[of_channel >= 0])  # a rank may lack a plane
    number = np.searchsorted(used, kind)
    return np.concatenate([np.where(of_channel < 0, -1, number + d * used.size) for d in range(n_delays)])


def of_features(number: Ints, features: int) -> Ints:
    """Return the numbers of the weights of every feature, (input, neuron) int32, from (input, column) ones.

    Neuron t * features + f is feature f of column t.
    """
    weight = np.where(number[:, :, None] < 0, -1, number[:, :, None] * features + np.arange(features))
    return weight.reshape(len(number), -1).astype(np.int32)


def repeated(n_taxels: int, features: int, n_next: int) -> Ints:
    """Return the numbers of a shared read-out, (neuron, next neuron) int32: those of one column, repeated."""
    return np.tile(np.arange(features * n_next, dtype=np.int32).reshape(features, n_next), (n_taxels, 1))
