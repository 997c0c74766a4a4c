"""Threshold encoding: a channel spikes while it is at or above its own mean, on the copy of its class.

Of channel c of a recording, over the steps that are kept (the window and the room of training crops):

    m_c = mean of P_c over all of them (level 'window'), or over those until t (level 'past')
    S_c[t] = 1 if P_c[t] >= m_c else 0
    S_(n, c)[t] = S_c[t] if c matches class n at t, else 0           spike channel n * n_in + c

As printed, c matches class n where the mean of c equals that of class n. Every recording is its own class's,
so this reads the label off the recording ('own_label'): leakage. Honest ways learn the mean and the standard
deviation of a statistic of every (class, channel) from the windows of training recordings: 'nearest' takes
the class whose mean is nearest (the lowest on a tie), 'tolerance' every class whose mean lies within
`tolerance` standard deviations, for equality of measured means has measure zero. 'none' makes no copies.
A constant channel is at its mean at every step, and spikes there, as printed.

Level 'window', as printed, uses the whole window from its first step on: a running sensor could not answer
before its end. Level 'past' is causal. Means carry no information once they are removed
(`window.remove_mean`), and reveal the class where the resting level does; 'std' depends on neither.

Source: threshold encoding for texture recognition, Algorithm 1 (REFERENCES.md).
"""

from __future__ import annotations

import dataclasses
import hashlib
from typing import ClassVar, Self

import numpy as np

from dse.base.records import Bools, Floats, Ints, Signals, Spikes
from dse.base.registry import fixed, param, register
from dse.data.encoders.sampled import OneByOne, smoothed

# A mean this small beside the standard deviation is the rounding of one that was removed.
_NO_MEAN = 1e-4


@register("encoders", "threshold")
@dataclasses.dataclass(frozen=True)
class Threshold(OneByOne):
    """A channel spikes while it is at or above its mean; one copy of the channels per class."""

    learns: ClassVar[bool] = True

    matching: str = param(
        "nearest",
        choices=("nearest", "tolerance", "own_label", "none"),
        doc="which copy of a channel is active: of the class with the nearest statistic, of all classes "
        "within tolerance, or of the true label (own_label, as published; leaks the label); none: no copies",
    )
    statistic: str = param(
        "mean", choices=("mean", "std"), doc="statistic of a channel that nearest and tolerance compare"
    )
    tolerance: float = param(
        1.0, low=0, unit="standard deviations", doc="largest distance from the mean of a class (tolerance)"
    )
    level: str = param(
        "window",
        choices=("window", "past"),
        doc="compute mean and statistic over the whole window, or over the past only",
    )
    smoothing_ms: float = param(
        0.0, low=0, unit="ms", doc="length of a causal moving average of the signal before encoding; 0: none"
    )
    n_classes: int = fixed(0, low=0, doc="fitted: number of classes")
    classes: tuple[int, ...] = fixed((), doc="fitted: classes in the training recordings")
    means: tuple[float, ...] = fixed((), doc="fitted: mean statistic of each class and channel")
    deviations: tuple[float, ...] = fixed(
        (), doc="fitted: standard deviation of the statistic of each class and channel"
    )
    labels: tuple[int, ...] = fixed((), doc="fitted by own_label: class of each recording")
    recordings: str = fixed("", doc="fitted by own_label: hash of those recordings")

    @property
    def transductive(self) -> bool:
        """Whether encoding a recording reads its own label."""
        return self.matching == "own_label"

    def fitted(
        self, signals: Signals, first: Ints, n_steps: int, target: Ints, n_classes: int, train: Ints
    ) -> Self:
        """Return the encoder with what matching needs: classes' statistics, or (own_label) the labels."""
        if self.matching == "none":
            return self
        if self.matching == "own_label":
            return dataclasses.replace(
                self,
                n_classes=int(n_classes),
                labels=tuple(int(x) for x in target),
                recordings=_hash(signals),
            )
        windows = (smoothed(signals, int(i), int(first[i]), n_steps, self.smoothing_ms) for i in train)
        measured = np.stack([np.concatenate(statistics(x, past=False)) for x in windows])
        # (recording, mean or std, channel)
        if self.statistic == "mean" and (np.abs(measured[:, 0]) <= _NO_MEAN * measured[:, 1]).all():
            raise ValueError(
                "encoder.statistic must be std if the mean of every channel is removed, got mean"
            )
        values, codes = measured[:, ("mean", "std").index(self.statistic)], target[train]
        classes = np.unique(codes)
        return dataclasses.replace(
            self,
            n_classes=int(n_classes),
            classes=tuple(classes.tolist()),
            means=tuple(np.concatenate([values[codes == n].mean(axis=0) for n in classes]).tolist()),
            deviations=tuple(np.concatenate([values[codes == n].std(axis=0) for n in classes]).tolist()),
        )

    def encode_all(self, signals: Signals, first: Ints, length: Ints) -> Spikes:
        """Return spikes as every encoder; own_label refuses recordings that it was not fitted to."""
        self._copies()
        if self.matching == "own_label":
            self._check_labels(signals, length)
        return super().encode_all(signals, first, length)

    def _encoded(self, signals: Signals, i: int, first: int, length: int) -> tuple[Ints, Ints]:
        values = smoothed(signals, i, first, length, self.smoothing_ms)
        mean, spread = statistics(values, past=self.level == "past")
        step, channel = np.nonzero(values >= mean)
        matched = self._matched(mean if self.statistic == "mean" else spread, i)
        k, copy = np.nonzero(matched[np.minimum(step, len(matched) - 1), :, channel])
        n_channels = self.n_channels(signals.n_channels)
        cells = np.sort(step[k] * n_channels + copy * signals.n_channels + channel[k])
        return np.bincount(cells // n_channels, minlength=length), cells % n_channels

    def _copies(self) -> int:
        if self.matching == "none":
            return 1
        if not self.n_classes:
            raise ValueError(
                f"encoder threshold with matching {self.matching} must be fitted to training recordings first"
            )
        return self.n_classes

    def _matched(self, statistic: Floats, i: int) -> Bools:
        """Return which classes the channels of recording i match, (1 or step, copy, channel) bool."""
        rows, n_in = statistic.shape
        if self.matching == "none":
            return np.ones((1, 1, n_in), dtype=bool)
        matched = np.zeros((rows, self.n_classes, n_in), dtype=bool)
        if self.matching == "own_label":
            matched[:, self.labels[i]] = True
            return matched
        means = np.array(self.means).reshape(len(self.classes), n_in)
        distance = np.abs(statistic[:, None] - means)
        if self.matching == "tolerance":
            near = distance <= self.tolerance * np.array(self.deviations).reshape(means.shape)
        else:
            near = distance.argmin(axis=1)[:, None] == np.arange(len(means))[:, None]
        matched[:, list(self.classes)] = near
        return matched

    def _check_labels(self, signals: Signals, length: Ints) -> None:
        if self.recordings != _hash(signals):
            raise ValueError(
                "encoder.matching must be nearest, tolerance or none for recordings outside its fit, "
                "got own_label, which reads their labels"
            )
        unknown = (np.array(self.labels) < 0) & (length > 0)
        if unknown.any():
            raise ValueError(
                f"encoder.matching own_label needs the label of recording {int(unknown.argmax())}, "
                "which is in no part of the split"
            )


def statistics(values: Floats, past: bool) -> tuple[Floats, Floats]:
    """Return mean and standard deviation of every channel, each (1, channel) or (step, channel).

    values: (step, channel) float64. past: until each step, the step itself included; else over all.
    """
    if not past:
        return values.mean(axis=0, keepdims=True), values.std(axis=0, keepdims=True)
    n = np.arange(1, len(values) + 1)[:, None]
    moved = values - values[:1]  # so that the difference of squares keeps its digits
    mean = moved.cumsum(axis=0) / n
    square = (moved**2).cumsum(axis=0) / n
    return values.cumsum(axis=0) / n, np.sqrt(np.maximum(square - mean**2, 0.0))


def _hash(signals: Signals) -> str:
    digest = hashlib.sha256(np.ascontiguousarray(signals.offsets).data)
    digest.update(np.ascontiguousarray(signals.values).data)
    return digest.hexdigest()
