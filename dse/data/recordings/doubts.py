"""What is doubtful about recordings before anything is trained: one sentence each, with the way out.

A doubt refuses nothing: recordings like these may be meant. `dse check` and `dse init` say all of them, and
preparing data those of the recordings. Shortcuts predict the label without any information about touch;
`dse.study.audit` probes more of them, and whether spikes show them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dse.base import seeds
from dse.base.records import Array, Floats, Ints, Signals
from dse.data.recordings import RecordingError, Recordings
from dse.data.recordings.splits import Labelled

_MISSING = ("", "nan", "none", "null", "na", "n/a")
_SHORT = 0.5  # of the median length
_SHORTEST_MS = 10.0  # no touch ends earlier
_FAR = 50.0  # times the widest range of a channel
_MOST_VALUES = 1_000_000
_LARGEST_SE = 0.1


@dataclass(frozen=True)
class Used:
    """Recordings of a split as doubts are about.

    n_steps: length of the windows. positions: (channel, 3), None of events. name: of the target.
    """

    recordings: Recordings
    labels: Labelled
    n_steps: int | None
    positions: Ints | None
    name: str


def doubts(of: Used) -> list[str]:
    """Return a sentence for each doubt about recordings and their labels."""
    return [sentence for check in _CHECKS for sentence in check(of)]


def few(n_validation: int, n_folds: int = 1) -> list[str]:
    """Return a sentence if the standard error of an accuracy on so few recordings is large.

    Each of the folds validates on so many.
    """
    se = 0.5 / np.sqrt(n_validation * n_folds)
    if se < _LARGEST_SE:
        return []
    return [
        f"an accuracy on {n_validation * n_folds} validation recordings has a standard error of up to "
        f"{se:.2f}, and designs that differ by less cannot be told apart: `split: {{k_fold: {{k: 5}}}}` "
        "validates on every recording, search.repeats averages over trainings"
    ]


def silent_windows(n_spikes: Ints) -> list[str]:
    """Return a sentence if most windows have no input spike.

    Args:
        n_spikes: (n,) input spikes of each window.
    """
    share = float((n_spikes == 0).mean())
    if share <= _SHORT:
        return []
    how_many = "no window has" if share == 1 else f"{100 * share:.0f} % of the windows do not have"
    return [
        f"no input spikes: {how_many} a spike, and a network learns nothing from such windows; lower the "
        "threshold of the encoder or of preprocessing"
    ]


def _labels(of: Used) -> Iterator[str]:
    names: dict[str, list[str]] = {}
    for name in of.labels.classes:
        names.setdefault(name.strip().casefold(), []).append(name)
    for alike in names.values():
        if len(alike) > 1:
            known = " and ".join(map(repr, alike))
            yield f"{of.name}: classes {known} differ only in case or blanks; rename one if they are the same"
    for name in of.labels.classes:
        if name.strip().casefold() in _MISSING:
            yield (
                f"{of.name}: class {name!r} reads like a missing label; leave its recordings out of the data "
                "or out of the split"
            )


def _axes(of: Used) -> Iterator[str]:
    signals = of.recordings
    if not isinstance(signals, Signals) or of.positions is None or np.ptp(of.positions[:, 1]):
        return
    longest = int(signals.lengths[of.labels.used].max())
    if longest < signals.n_channels:
        used = np.flatnonzero(of.labels.used)
        parts = signals.offsets[used[:: max(1, len(used) // SOME), None] + [0, 1]]
        some = [signals.values[begin:end] for begin, end in parts]
        steps, channels = (np.mean([smoothness(values, axis) for values in some]) for axis in (0, 1))
        if steps >= channels + CLEARLY:
            return
        yield (
            f"recordings have {longest} steps of {signals.n_channels} channels; if these are {longest} "
            "channels, name the axes in their order: data.axes of a file, `axes` of dse.data.from_arrays, "
            "such as 'recording channel step'"
        )


def smoothness(samples: Array, axis: int) -> float:
    """Return the correlation of neighbours on an axis, without what is constant along it; 0 of texts.

    Signals change smoothly along steps, and seldom along channels.
    """
    if samples.dtype.kind not in "biuf":
        return 0.0
    values = np.moveaxis(np.where(np.isfinite(samples), samples, 0).astype(float), axis, 0)
    values -= values.mean(axis=0)
    return float((values[1:] * values[:-1]).sum() / max((values**2).sum(), np.finfo(float).tiny))


def _lengths(of: Used) -> Iterator[str]:
    signals, labels = of.recordings, of.labels
    if not isinstance(signals, Signals):
        return
    lengths = signals.lengths[labels.used]
    median, shortest = float(np.median(lengths)), int(lengths.min())
    if of.n_steps in (None, shortest) and shortest < _SHORT * median:
        i = int(np.flatnonzero(labels.used)[lengths.argmin()])
        n = np.count_nonzero(lengths < _SHORT * median)
        others = f", as {n - 1} others are shorter than half of that" if n > 1 else ""
        yield (
            f"recording {i} (class '{labels.classes[labels.codes[i]]}') has {shortest} steps, the median is "
            f"{median:g}{others}; all windows are as short as it: leave it out of the data or of the split, "
            "and raise window.n_steps"
        )
    if (longest_ms := float(lengths.max() * signals.step_ms)) < _SHORTEST_MS:
        yield (
            f"the longest recording lasts {longest_ms:g} ms; step_ms is in milliseconds, got "
            f"{signals.step_ms:g}"
        )


def _glitches(of: Used) -> Iterator[str]:
    signals = of.recordings
    if not isinstance(signals, Signals):
        return
    values = signals.values
    some = values[:: max(1, values.size // _MOST_VALUES)]
    low, high = np.percentile(some, (1, 99), axis=0)
    widest = (high - low).max()  # a channel may be touched seldom, and then as others are
    farthest = np.maximum(values.max(axis=0) - high, low - values.min(axis=0))
    for channel, distance in enumerate(farthest):
        if distance > _FAR * widest > 0:
            row = int(
                np.maximum(values[:, channel] - high[channel], low[channel] - values[:, channel]).argmax()
            )
            i = int(np.searchsorted(signals.offsets, row, side="right")) - 1
            yield (
                f"channel {channel} reads {values[row, channel]:g} at step {row - signals.offsets[i]} of "
                f"recording {i}, and 98 % of its samples lie in {low[channel]:g} to {high[channel]:g}; if "
                "the sensor failed there, leave the recording out of the data or of the split"
            )


_CHECKS: tuple[Callable[[Used], Iterator[str]], ...] = (_labels, _axes, _lengths, _glitches)


_NEIGHBOURS = 5
_ROWS_AT_ONCE = 256

SOME = 32
"""Recordings that tell which axis has the steps."""

CLEARLY = 0.2
"""By how much more neighbours on an axis of steps correlate, where it is not the longest."""

MOST = 1000
"""Training and validation samples that are read, each; of more, a random draw."""


def guard(target_columns: Sequence[str], split_columns: Sequence[str]) -> None:
    """Refuse a split by the column that is predicted.

    Raises:
        RecordingError: a column is in both.
    """
    for column in split_columns:
        if column in target_columns:
            raise RecordingError(f"split cannot use column '{column}', which task.target predicts")


def drawn(samples: Ints, most: int = MOST) -> Ints:
    """Return some samples, in rising order; of more than `most`, a random draw."""
    if len(samples) <= most:
        return samples
    return np.sort(seeds.generator(0, {}, "audit samples").choice(samples, most, replace=False))


def shortcuts(
    lengths: Ints,
    levels: Floats | None,
    codes: Ints,
    train: Ints,
    validation: Ints,
    name: str,
    follow_levels: Callable[[], bool],
) -> list[str]:
    """Return a sentence for each of length and resting level that alone predicts the target.

    A shortcut is reported where 5 nearest neighbours on it close half of the gap between the largest
    class and a perfect score, on validation, and are above that class by three standard errors.
    lengths: (n,) steps. levels: (n, channel) mean over the window, None where there is none. codes: (n,)
    targets. name: of the target. follow_levels: returns whether the spikes change with the levels.
    """
    train, validation = drawn(train), drawn(validation)
    largest = float((codes[validation] == np.bincount(codes[train]).argmax()).mean())
    noise = 3 * np.sqrt(largest * (1 - largest) / len(validation))
    logs = np.log(np.maximum(lengths, 1.0))[:, None]
    sentences = []
    for shortcut, features in (("length", logs), ("level", levels)):
        if features is None or np.ptp(features[train], axis=0).max() == 0:
            continue
        guess = nearest_neighbours(features[train], codes[train], features[validation])
        accuracy = float((guess == codes[validation]).mean())
        if accuracy < (1 + largest) / 2 or accuracy <= largest + noise:
            continue
        if shortcut == "length":
            what, advice = "recording length", "windows of one length hide it"
        else:
            what = "resting level (mean of each channel)"
            advice = (
                "window.remove_mean: true or an encoder of changes (send_on_delta, start: sample) drops it, "
                "unless the level is what is to be felt (dse audit: whether readers need it)"
                if follow_levels()
                else "the encoder drops it already"
            )
        sentences.append(
            f"{what} alone predicts {name} with accuracy {accuracy:.3f} on validation "
            f"(largest class {largest:.3f}): {advice}"
        )
    return sentences


def nearest_neighbours(train: Floats, codes: Ints, query: Floats) -> Ints:
    """Return the majority class (lowest on a tie) of the 5 nearest training rows of every query row.

    Features, (n, feature) and (m, feature), are standardised by the training rows; fewer neighbours vote
    where a class has fewer rows. codes: (n,) classes of the training rows.
    """
    centre, spread = train.mean(axis=0), train.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    a, b = (train - centre) / spread, (query - centre) / spread
    k = min(_NEIGHBOURS, np.unique(codes, return_counts=True)[1].min())
    guess = np.zeros(len(b), dtype=np.int64)
    for first in range(0, len(b), _ROWS_AT_ONCE):
        rows = b[first : first + _ROWS_AT_ONCE]
        distance = (rows**2).sum(axis=1)[:, None] - 2 * rows @ a.T + (a**2).sum(axis=1)
        nearest = codes[np.argsort(distance, axis=1, kind="stable")[:, :k]]
        votes = (nearest[:, :, None] == np.arange(codes.max() + 1)).sum(axis=1)
        guess[first : first + len(rows)] = votes.argmax(axis=1)
    return guess
