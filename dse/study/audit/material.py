"""What probes read: spikes as classifiers get them, labels, and signals before the encoder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dse.base.records import Array, Dataset, Floats, Ints, Spikes
from dse.config.settings import Window
from dse.data.dataset.shifts import shifted
from dse.models.counts.rate_windows import as_features, window_counts
from dse.study.audit.readers import COUNT_READERS, NEAREST, TREES, distances, regions
from dse.study.audit.rows import AuditRow, Score, largest_class

SEEN: Mapping[str, tuple[tuple[int, int], ...]] = {
    TREES: ((1, 100), (6, 40), (12, 8)),
    NEAREST: ((12, 8),),
}
"""What readers of counts over time see: regions along each axis of the frame, and equal bins of the window.

With a window of 1 s the first two are totals of 10 ms, and 6 x 6 cells of 25 ms.
"""


@dataclass(frozen=True)
class Levels:
    """Sampled signals before the encoder.

    level: (n, channel) mean over the window. slope: (n, channel) per step, least squares.
    encoded: returns the spikes of the windows, from step 0, of signals less `constant` (n, channel), less
        `trend` (n, channel) times the steps since the start of the window.
    """

    level: Floats
    slope: Floats
    encoded: Callable[[Floats, Floats], Spikes]


@dataclass(frozen=True)
class Material:
    """One task of a search space: its spikes, and the training and validation samples that the probes use.

    dataset: as prepared.
    train, validation, test: samples that are read; of the test set only what the recordings hold is told.
    columns: label columns, each (n,).
    lengths: (n,) steps of the recordings.
    target_columns, split_columns: the label columns that the target and the split read.
    window: how recordings were cut, and where windows lie.
    levels: of sampled signals; None of other recordings.
    leak: why the evaluation has seen its answers; '' where it has not.
    reads_labels: whether the encoder reads the labels of what it encodes.
    data: key of the data set on which designs train.
    drawn_from: training and validation samples of the split, from which these were drawn.
    """

    task: str
    dataset: Dataset
    train: Ints
    validation: Ints
    columns: Mapping[str, Array]
    lengths: Ints
    target_columns: tuple[str, ...]
    split_columns: tuple[str, ...]
    window: Window = field(default_factory=Window)
    levels: Levels | None = None
    leak: str = ""
    reads_labels: bool = False
    drawn_from: tuple[int, int] = (0, 0)
    test: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    data: str = ""

    @property
    def codes(self) -> Ints:
        """(train,) classes of the training samples."""
        return self.dataset.target[self.train]

    @property
    def truth(self) -> Ints:
        """(validation,) classes of the validation samples."""
        return self.dataset.target[self.validation]

    def counts(
        self, samples: Ints, bins: int, steps: int = 0, spikes: Spikes | None = None, side: int = 12
    ) -> Floats:
        """Return spikes per bin and region, (samples, bins * region), of windows moved by some steps.

        bins: equal ones of the window. spikes: whose windows begin at step 0, in place of the data set's.
        side: regions along each axis (`readers.regions`).
        """
        group, n_steps = regions(self.dataset.positions, side), self.dataset.n_steps
        if spikes is not None:
            return counts(spikes, samples, np.zeros_like(samples), n_steps, bins, group)
        moved = shifted(self.dataset, steps) if steps else self.dataset
        return counts(moved.spikes, samples, moved.start[samples], n_steps, bins, group)

    def seen(self, reader: str, samples: Ints, steps: int = 0, spikes: Spikes | None = None) -> Floats:
        """Return what a reader of counts over time sees of windows, (samples, feature); see `counts`."""
        views = [self.counts(samples, bins, steps, spikes, side) for side, bins in SEEN[reader]]
        return views[0] if reader == NEAREST else np.sqrt(np.hstack(views))

    @cached_property
    def distances(self) -> Floats:
        """Squared distances (validation, train) of the counts that nearest neighbours see."""
        return distances(self.seen(NEAREST, self.train), self.seen(NEAREST, self.validation))

    @cached_property
    def _answers(self) -> dict[str, Ints]:
        """What readers of counts over time answer to the validation samples, then to those of the test."""
        evaluated = np.concatenate([self.validation, self.test])
        return {
            name: reader(self.seen(name, self.train), self.codes, self.seen(name, evaluated))
            for name, reader in COUNT_READERS.items()
        }

    @cached_property
    def scores(self) -> dict[str, Score]:
        """Readers of counts over time by name: what they reach on the windows of the split."""
        n = len(self.validation)
        return {name: self.score(name, answers[:n]) for name, answers in self._answers.items()}

    def on_test(self, reader: str) -> Score | None:
        """Return what a reader of counts over time reaches on the test set; None without one."""
        if not len(self.test):
            return None
        truth = self.dataset.target[self.test]
        correct = self._answers[reader][len(self.validation) :] == truth
        return Score(reader, correct, largest_class(truth))

    @property
    def best(self) -> Score:
        """The more accurate reader of counts over time."""
        return max(self.scores.values(), key=lambda score: score.accuracy)

    def score(self, reader: str, predicted: Ints) -> Score:
        """Return the score of predictions for the validation samples."""
        return Score(reader, predicted == self.truth, largest_class(self.truth))

    def row(
        self,
        probe: str,
        score: Score,
        verdict: str,
        *,
        shortcut: bool = False,
        remedy: str = "",
        without: Score | None = None,
        test: Score | None = None,
    ) -> AuditRow:
        """Return a row of the audit; the remedy is stated for a shortcut alone."""
        (without_accuracy, without_se), (test_accuracy, test_se) = (
            (None, None) if other is None else (other.accuracy, other.se) for other in (without, test)
        )
        return AuditRow(
            self.task, probe, score.reader, score.accuracy, score.se, score.chance,
            without_accuracy, without_se, score.n, shortcut, verdict, remedy if shortcut else "",
            test_accuracy, test_se, self.data,
        )  # fmt: skip


def counts(spikes: Spikes, samples: Ints, start: Ints, n_steps: int, bins: int, group: Ints) -> Floats:
    """Return spikes per bin and group of channels, (samples, bins * group) float64.

    Bins, at most one per step, are equal; the steps that are left over at the end of a window are not
    counted. start: (samples,) first step of each window. group: (n_channels,) of each channel, from 0.
    """
    bins = min(bins, n_steps)
    edges = np.arange(bins + 1) * (n_steps // bins)
    return as_features(window_counts(spikes, samples, start, edges, group)).astype(np.float64)


def spikes_per_step(spikes: Spikes, samples: Ints, start: Ints, n_steps: int) -> Ints:
    """Return how many spikes each step of each window has, (samples, n_steps) int64."""
    rows = (samples * spikes.n_steps + start)[:, None] + np.arange(n_steps + 1)
    return np.asarray(np.diff(spikes.row_offsets[rows], axis=1))
