"""Small data for the checks: a data set, signals, a trained run, a study."""

from __future__ import annotations

import atexit
import functools
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dse.base import seeds
from dse.base.records import Array, Dataset, Ints, Signals, Spikes
from dse.config import load_space
from dse.config.contracts import Generators
from dse.config.space import DecisionGrid
from dse.measure.hardware.profile import load
from dse.measure.objectives import FullReadOut, Points, Priced
from dse.measure.run import records_for_objectives
from dse.study import explore
from dse.study.results import Study

N_CLASSES = 3
CHIP = "loihi1_silicon"
GRID = DecisionGrid(np.array([0, 2]), np.array([0.25, 0.5, 0.75]))
SPACE = {
    "study": "small",
    "data": {
        **{"kind": "events", "file": "touch.npz", "width": 4, "height": 3, "x": "x", "y": "y"},
        **{"polarity": "polarity", "columns": {"fabric": "label"}, "class_names": {"fabric": "names"}},
    },
    "task": {"target": "fabric", "name": "texture"},
    "window": {"n_steps": {"choice": [16, 24]}},
    "split": {"stratified": {"validation": 0.25, "test": 0.25}},
    "preprocessing": {"bin_ms": 2},
    "model": {"kind": "snn", "hidden": {"choice": [4, 6, 9]}},
    "training": {"epochs": 3, "batch_size": 8},
    "decision": GRID.to_plain(),
    "precision": {"weight_bits": [4, 8]},
    "hardware": [CHIP],
    "objectives": ["accuracy", "energy_uj"],
}
"""The search space of `SmallStudy`."""


def generators(seed: int) -> Generators:
    """Return random generators by purpose, as a design of a study has them."""

    def rngs(purpose: str, *index: int) -> np.random.Generator:
        return seeds.generator(seed, {}, purpose, 0, *index)

    return rngs


def dataset(n_samples: int = 48, n_steps: int = 24, n_channels: int = 6, margin: int = 2) -> Dataset:
    """Return three classes that differ in which channels fire, with windows that may be cropped."""
    rng = np.random.default_rng(7)
    target = np.arange(n_samples) % N_CLASSES
    rate = np.full((n_samples, n_channels), 0.05)
    for i, label in enumerate(target):
        rate[i, label::N_CLASSES] = 0.5
    fired = rng.random((n_samples, n_steps + 2 * margin, n_channels)) < rate[:, None]
    start = np.full(n_samples, margin, np.int32)
    order = rng.permutation(n_samples)
    parts = np.split(order, [n_samples // 2, 3 * n_samples // 4])
    train, validation, test = (np.sort(part).astype(np.int64) for part in parts)
    return Dataset(
        spikes=spikes_of(fired, 5.0),
        target=target.astype(np.int64),
        classes=("felt", "linen", "silk"),
        start=start,
        start_low=start - margin,
        start_high=start + margin,
        n_steps=n_steps,
        train=train,
        validation=validation,
        test=test,
        positions=places(n_channels),
    )


spikes_of = Spikes.of_dense


def dense(spikes: Spikes) -> Array:
    """Return spikes as (sample, step, channel)."""
    fired = np.zeros((len(spikes.row_offsets) - 1, spikes.n_channels), bool)
    fired[np.repeat(np.arange(len(fired)), np.diff(spikes.row_offsets)), spikes.channel] = True
    return fired.reshape(spikes.n_samples, spikes.n_steps, spikes.n_channels)


def places(n_channels: int) -> Ints:
    """Return positions of channels that lie in a row."""
    positions = np.zeros((n_channels, 3), np.int32)
    positions[:, 0] = np.arange(n_channels)
    return positions


def without_spikes_after(data: Dataset, n_steps: int) -> Dataset:
    """Return the same windows, in which nothing happens after so many steps."""
    fired = dense(data.spikes)
    fired[np.arange(data.spikes.n_steps) >= data.start[:, None] + n_steps] = False
    return replace(data, spikes=spikes_of(fired, data.spikes.step_ms))


def one_step_later(data: Dataset) -> Dataset:
    """Return the same windows in recordings that begin with one more step, without spikes."""
    spikes = spikes_of(np.pad(dense(data.spikes), ((0, 0), (1, 0), (0, 0))), data.spikes.step_ms)
    starts = {name: getattr(data, name) + 1 for name in ("start", "start_low", "start_high")}
    return replace(data, spikes=spikes, **starts)


def signals(lengths: Sequence[int] = (40, 31, 40, 25, 40, 33), n_channels: int = 3) -> Signals:
    """Return recordings that walk up and down, each in a way of its own."""
    rng = np.random.default_rng(11)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    values = [np.cumsum(rng.normal(0, 4, (n, n_channels)), axis=0) + 100 for n in lengths]
    label = np.arange(len(lengths)) % 2
    return Signals(np.concatenate(values).astype(np.float32), offsets, 5.0, {"label": label})


def _write_touches(path: Path) -> None:
    """Write 48 recordings of 64 ms from a frame of 4 x 3 pixels: three fabrics, each with two busy pixels."""
    rng = np.random.default_rng(7)
    label = np.arange(48) % N_CLASSES
    rate_hz = np.where(np.arange(12) % N_CLASSES == label[:, None], 250, 25)
    recording, t_ms, pixel = np.nonzero(rng.random((48, 64, 12)) < rate_hz[:, None] / 1000)
    np.savez(
        path,
        t_us=1000 * t_ms,
        x=pixel % 4,
        y=pixel // 4,
        polarity=pixel % 2,
        offsets=np.searchsorted(recording, np.arange(49)),
        label=label,
        names=np.array(["felt", "linen", "silk"]),
    )


@functools.cache
def _trained() -> Path:
    """Return the folder of a study that is trained once and goes with the process."""
    folder = Path(tempfile.mkdtemp(prefix="dse-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _write_touches(folder / "touch.npz")
    space = load_space(SPACE, {"data.file": str(folder / "touch.npz")})
    return explore.run(space, folder, progress=False).folder


@dataclass(frozen=True)
class SmallStudy(Study):
    """A finished study of small networks: `dse.show.figures.Results`."""

    folder: Path = field(default_factory=_trained)


def records() -> dict[str, list[Points | FullReadOut | Priced]]:
    """Return what objectives are given, by what they need: of a spiking network and of other classifiers."""
    from dse.config.settings import Training
    from dse.models.counts.knn import KNN
    from dse.models.snn.family import SNN

    data = dataset()
    training = Training(epochs=2, batch_size=8)
    spiking = SNN(hidden=(5,)).fit(data, training, generators(1))
    other = KNN().fit(data, training, generators(1))
    by_needs: dict[str, list[Points | FullReadOut | Priced]] = {}
    for outcome in (spiking, other):
        chips = [load(CHIP), load("op_4.6_0.9")]
        for needs, record in records_for_objectives(outcome, data, GRID, chips):
            by_needs.setdefault(needs, []).append(_evaluated(record))
    return by_needs


def _evaluated(record: Points | FullReadOut | Priced) -> Points | FullReadOut | Priced:
    """Return a record of a study that moves windows and leaves groups out; the accuracies are made up."""
    if isinstance(record, Points):
        shifted = np.stack([record.accuracy, record.accuracy / 2])
        return replace(record, shifted=shifted, unshifted=record.accuracy, n_shifted=9)
    if isinstance(record, FullReadOut):
        return replace(record, unseen={"force": {"1": 0.5, "2": 0.75}})
    return record
