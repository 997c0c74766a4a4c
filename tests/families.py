"""Components of a test, and a search space in which encoder and model are choices with axes of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base import registry
from dse.base.records import Ints, Signals, Spikes
from dse.base.registry import param
from dse.config.contracts import Encoder

SPACE = """\
study: families
seed: 5
data:
  kind: time_series
  file: touch.npz
  step_ms: 10
  columns: {fabric: label, speed: speed, repetition: repetition}
task: {target: fabric}
window: {n_steps: 16, at: middle}
split:
  train: {repetition: [0]}
  validation: {repetition: [1]}
encoder:
  choice:
    - {kind: send_on_delta, thresholds: {choice: [[1, 2], [1, 2, 4]]}}
    - loud_of_a_test
model:
  choice:
    - snn
    - kind: wide_of_a_test
      width: {choice: [4, 8, 12]}
      gain: {range: [0.5, 2.0], step: 0.5}
      name: {choice: [near, far]}
    - {kind: near_of_a_test, k: {range: [1, 5]}}
training: {epochs: {choice: [1, 2]}, batch_size: 8}
objectives: [accuracy:max, n_weights:min]
search: {sampler: grid, batch: 4}
"""
N_DESIGNS = (2 + 1) * (1 + 3 * 4 * 2 + 5) * 2


@dataclass(frozen=True)
class Wide:
    """A model with keys of several types, and a rule between two of them."""

    width: int = param(5, low=1, doc="width")
    gain: float = param(1.0, low=0, low_open=True, doc="gain")
    name: str = param("near", choices=("near", "far"), doc="name")
    flag: bool = param(False, doc="flag")
    most: int = param(100, doc="most width")

    def __post_init__(self) -> None:
        if self.width > self.most:
            raise ValueError(f"width must be at most {self.most}, got {self.width}")


@dataclass(frozen=True)
class Near:
    """A model with one key."""

    k: int = param(3, low=1, doc="neighbours")


@dataclass(frozen=True)
class Strict:
    """A model that cannot do without a key."""

    size: int = param(low=1, doc="its size")


@dataclass(frozen=True)
class Loud(Encoder):
    """An encoder without keys that are required."""

    volume: float = param(1.0, low=0, doc="volume")

    def n_channels(self, n_in: int) -> int:
        """Return the number of channels."""
        return 3 * n_in

    def positions(self, inputs: Ints) -> Ints:
        """Return x, y and plane of the channels: three planes of each."""
        return np.concatenate([inputs + np.array([0, 0, plane]) for plane in range(3)])

    def encode_all(self, signals: Signals, first: Ints, length: Ints) -> Spikes:
        """Raise: nothing is trained with this encoder."""
        raise ValueError("an encoder of a test encodes nothing")


MODELS = {"wide_of_a_test": Wide, "near_of_a_test": Near, "strict_of_a_test": Strict}
ENCODERS = {"loud_of_a_test": Loud}


def register():
    """Make the components known."""
    registry._components.setdefault("models", {}).update(MODELS)
    registry._components.setdefault("encoders", {}).update(ENCODERS)
