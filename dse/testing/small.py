"""Small data for the checks: a data set, signals, a trained run, a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dse import seeds, store
from dse.config.contracts import Generators
from dse.hardware.profile import Profile, load
from dse.measure.objectives import FullReadOut, Points, Priced
from dse.measure.run import Measurement, measure, records_for_objectives
from dse.preprocessing.stages import Stages
from dse.records import Array, Block, Dataset, Ints, Outcome, Signals, Spikes

if TYPE_CHECKING:
    import pandas

N_CLASSES = 3
CHIP = "loihi1_silicon"
HIDDEN = (4, 6, 9)
"""Hidden neurons of the trials of `SmallStudy`."""
PHI, THETA = np.array([0, 2]), np.array([0.25, 0.5, 0.75])
"""Decision grid."""


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


def spikes_of(fired: Array, step_ms: float) -> Spikes:
    """Return dense spikes (sample, step, channel) as sparse ones."""
    rows = fired.reshape(-1, fired.shape[2])
    offsets = np.concatenate([[0], np.cumsum(rows.sum(axis=1))]).astype(np.int64)
    channel = np.nonzero(rows)[1].astype(np.int32)
    return Spikes(offsets, channel, fired.shape[1], fired.shape[2], step_ms)


def places(n_channels: int) -> Ints:
    """Return positions of channels that lie in a row."""
    positions = np.zeros((n_channels, 3), np.int32)
    positions[:, 0] = np.arange(n_channels)
    return positions


def without_spikes_after(data: Dataset, n_steps: int) -> Dataset:
    """Return the same windows, in which nothing happens after so many steps."""
    spikes = data.spikes
    row = np.repeat(np.arange(len(spikes.row_offsets) - 1), np.diff(spikes.row_offsets))
    sample, step = row // spikes.n_steps, row % spikes.n_steps
    keep = step - data.start[sample] < n_steps
    counts = np.bincount(row[keep], minlength=len(spikes.row_offsets) - 1)
    cut = Spikes(
        row_offsets=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        channel=spikes.channel[keep],
        n_steps=spikes.n_steps,
        n_channels=spikes.n_channels,
        step_ms=spikes.step_ms,
    )
    return replace(data, spikes=cut)


def one_step_later(data: Dataset) -> Dataset:
    """Return the same windows in recordings that begin with one more step, without spikes."""
    spikes = data.spikes
    begins = spikes.row_offsets[:-1].reshape(-1, spikes.n_steps)
    later = np.append(np.concatenate([begins[:, :1], begins], axis=1), spikes.row_offsets[-1])
    return replace(
        data,
        spikes=replace(spikes, row_offsets=later, n_steps=spikes.n_steps + 1),
        start=data.start + 1,
        start_low=data.start_low + 1,
        start_high=data.start_high + 1,
    )


def signals(lengths: Sequence[int] = (40, 31, 40, 25, 40, 33), n_channels: int = 3) -> Signals:
    """Return recordings that walk up and down, each in a way of its own."""
    rng = np.random.default_rng(11)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    values = [np.cumsum(rng.normal(0, 4, (n, n_channels)), axis=0) + 100 for n in lengths]
    label = np.arange(len(lengths)) % 2
    return Signals(np.concatenate(values).astype(np.float32), offsets, 5.0, {"label": label})


@dataclass(frozen=True)
class SmallStudy:
    """A finished study of three trials of small networks, in memory: `dse.figures.Results`."""

    @property
    def objectives(self) -> list[tuple[str, str]]:
        return [("accuracy", "max"), ("energy_uj", "min")]

    @cached_property
    def _data(self) -> Dataset:
        return dataset()

    @cached_property
    def _runs(self) -> list[tuple[Outcome, Measurement]]:
        from dse.config.settings import Training
        from dse.models.snn.family import SNN

        chip = self.chip(CHIP)
        runs = []
        for hidden in HIDDEN:
            model, training = SNN(hidden=(hidden,)), Training(epochs=3, batch_size=8)
            outcome = model.fit(self._data, training, generators(hidden))
            runs.append((outcome, measure(outcome, self._data, PHI, THETA, [chip])))
        return runs

    @cached_property
    def trials(self) -> pandas.DataFrame:
        """One row per trial."""
        import pandas

        return pandas.DataFrame(
            [
                {
                    **self._about(trial),
                    "repeats": 1,
                    "hardware": CHIP,
                    **measured.columns,
                    **measured.hardware[CHIP],
                    "status": "finished",
                    "reason": "",
                }
                for trial, (_, measured) in enumerate(self._runs)
            ]
        )

    def points(self) -> pandas.DataFrame:
        """Return one row per full read-out, per setting of phi and theta, and a cheaper one of the best."""
        import pandas

        from dse.measure.on_chips import columns_on

        rows = [self.trials.assign(point=0, phi=np.nan, theta=np.nan, read_out_ms=np.nan)]
        for trial, (_, measured) in enumerate(self._runs):
            assert measured.points_load is not None
            costs = columns_on(self.chip(CHIP), measured.points_load)
            phi, theta = np.meshgrid(PHI.astype(float), THETA, indexing="ij")
            columns = {"phi": phi, "theta": theta, **measured.points, **costs}
            frame = pandas.DataFrame({name: np.ravel(x) for name, x in columns.items()})
            about = {
                **self._about(trial),
                "repeats": 1,
                "hardware": CHIP,
                "point": np.arange(1, phi.size + 1),
            }
            rows.append(frame.assign(**about, n_weights=measured.columns["n_weights"]))
        frame = pandas.concat(rows, ignore_index=True)
        best = frame.loc[[frame["accuracy"].idxmax()]]
        cheaper = {"accuracy": best["accuracy"] - 0.03, "energy_uj": best["energy_uj"] / 2}
        frame = pandas.concat(
            [frame, best.assign(**cheaper, point=PHI.size * len(THETA) + 1)], ignore_index=True
        )
        return frame.assign(weight_bits=8, pruned_after=0.0)

    def best_trial(self) -> int:
        """Return the most accurate trial."""
        return int(self.trials["accuracy"].to_numpy().argmax())

    def classes(self, trial: int) -> tuple[str, ...]:
        """Return the names of the classes."""
        return self._data.classes

    def sections(self, trial: int) -> dict[str, object]:
        """Return no sections: nothing was read from a file."""
        return {}

    def arrays(self, trial: int, name: str) -> list[dict[str, Array]]:
        """Return what a file of a trial's artefacts holds."""
        outcome, measured = self._runs[trial]
        assert measured.points_load is not None and measured.read_outs_load is not None
        response = store.response_arrays(outcome.validation, self._data.validation)
        grid = {"phi": PHI, "theta": THETA}
        files: dict[str, dict[str, Array]] = {
            "response.npz": {**response, "target": self._data.target[self._data.validation]},
            "history.npz": dict(outcome.history),
            "confusion.npz": {"validation": measured.confusion},
            "read_out.npz": measured.read_outs | store.work_arrays(measured.read_outs_load),
            "surface.npz": grid | measured.points | store.work_arrays(measured.points_load),
        }
        return [files[name]] if name in files else []

    def stages(self, trial: int, sample: int) -> Stages:
        """Return a recording of 20 events on a frame of 4 x 3 pixels, whose middle is pooled."""
        t_us = np.arange(20) * 1000
        events = Block(t_us, np.arange(20) % 4, np.arange(20) % 3, np.arange(20) % 2)
        return Stages(
            name="felt",
            events=events,
            frame=(4, 3),
            crop=(1, 0, 2, 3),
            counts=np.ones(10, np.int64),
            channels=np.arange(10) % 2,
            n_channels=2,
            bin_us=2000,
            begin_us=0,
            end_us=16_000,
        )

    def dataset(self, trial: int) -> Dataset:
        """Return what a trial was trained on."""
        return self._data

    def chip(self, name: str) -> Profile:
        """Return a shipped hardware profile."""
        return load(name)

    def _about(self, trial: int) -> dict[str, str | int]:
        return {
            "trial": trial,
            "task": "texture",
            "family": "snn",
            "model.hidden": HIDDEN[trial],
            "training.epochs": 3,
            "window.n_steps": (16, 24, 24)[trial],
        }


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
        for needs, record in records_for_objectives(outcome, data, PHI, THETA, chips):
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
