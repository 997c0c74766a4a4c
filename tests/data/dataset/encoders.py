"""Encoders for tests: small enough that what they make can be said in a line."""

from __future__ import annotations

import dataclasses
from typing import ClassVar, Self

import numpy as np
import pytest

from dse.base import registry
from dse.base.records import Array, Signals, Spikes
from dse.config.contracts import Encoder


def spikes_of(rasters, n_channels, step_ms):
    """Return the spikes of (step, channel) rasters, those that are shorter with empty rows at their end."""
    n_steps = max(len(x) for x in rasters)
    dense = np.zeros((len(rasters), n_steps, n_channels), dtype=bool)
    for i, raster in enumerate(rasters):
        dense[i, : len(raster)] = raster
    offsets = np.concatenate([[0], np.cumsum(dense.sum(axis=2).ravel())]).astype(np.int64)
    return Spikes(offsets, np.nonzero(dense)[2].astype(np.int32), n_steps, n_channels, step_ms)


@dataclasses.dataclass(frozen=True)
class Counting(Encoder):
    """A spike at every k-th positive sample of a channel, counted from the first sample of the recording."""

    every: int = 1
    shown: ClassVar[list[tuple[int, int]]] = []  # recordings and bytes of every call

    def n_channels(self, n_in: int) -> int:
        return n_in

    def positions(self, inputs: Array) -> Array:
        return inputs

    def encode_all(self, signals: Signals, first: Array, length: Array) -> Spikes:
        self.shown.append((signals.n_recordings, signals.values.nbytes))
        rasters = []
        for i, x in enumerate(np.split(signals.values, signals.offsets[1:-1])):
            counted = np.cumsum(x > 0, axis=0) % self.every == 0
            rasters.append((counted & (x > 0))[first[i] : first[i] + length[i]])
        return spikes_of(rasters, signals.n_channels, signals.step_ms)


@dataclasses.dataclass(frozen=True)
class Silent(Counting):
    """No spike, whatever is encoded."""

    def encode_all(self, signals: Signals, first: Array, length: Array) -> Spikes:
        nothing = [np.zeros((n, signals.n_channels), dtype=bool) for n in length]
        return spikes_of(nothing, signals.n_channels, signals.step_ms)


@dataclasses.dataclass(frozen=True)
class Levels(Encoder):
    """A copy of the channels per class: spikes above the mean of that class in the training windows.

    levels: fitted, (class, channel); a class without training recordings has a level that nothing reaches.
    """

    learns: ClassVar[bool] = True
    peeks: bool = False
    levels: tuple[tuple[float, ...], ...] = ()
    seen: ClassVar[list[dict[str, Array]]] = []  # what every call of fitted was given

    @property
    def transductive(self) -> bool:
        return self.peeks

    def n_channels(self, n_in: int) -> int:
        if not self.levels:
            raise ValueError("levels must be fitted first")
        return n_in * len(self.levels)

    def positions(self, inputs: Array) -> Array:
        copies = self.n_channels(len(inputs)) // len(inputs)
        found = np.tile(inputs, (copies, 1))
        found[:, 2] += np.repeat(np.arange(copies), len(inputs)) * (inputs[:, 2].max() + 1)
        return found

    def fitted(
        self, signals: Signals, first: Array, n_steps: int, target: Array, n_classes: int, train: Array
    ) -> Self:
        lengths = np.diff(signals.offsets)
        self.seen.append({"target": target, "train": train, "first": first, "lengths": lengths})
        windows = np.stack(
            [signals.values[signals.offsets[i] + first[i] :][:n_steps].mean(axis=0) for i in train]
        )
        levels = np.full((n_classes, signals.n_channels), 1e9, dtype=np.float32)
        for c in np.unique(target[train]):
            levels[c] = windows[target[train] == c].mean(axis=0)
        return dataclasses.replace(self, levels=tuple(tuple(row) for row in levels))

    def encode_all(self, signals: Signals, first: Array, length: Array) -> Spikes:
        levels = np.array(self.levels)
        rasters = []
        for i, x in enumerate(np.split(signals.values, signals.offsets[1:-1])):
            above = x[:, None] > levels
            rasters.append(above.reshape(len(x), -1)[first[i] : first[i] + length[i]])
        return spikes_of(rasters, self.n_channels(signals.n_channels), signals.step_ms)


@pytest.fixture
def encoders():
    """Register the encoders of this file."""
    registry.known("encoders")
    own = {"counting": Counting, "silent": Silent, "levels": Levels}
    registry._components["encoders"].update(own)
    yield
    for name in own:
        registry._components["encoders"].pop(name)
    Counting.shown.clear()
    Levels.seen.clear()
