"""Shortcuts that predict the label of a recording without any information about touch.

These are checked whenever data are prepared; `dse.audit` probes more, and whether spikes show them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dse import seeds
from dse.recordings import RecordingError
from dse.records import Floats, Ints

_NEIGHBOURS = 5
_ROWS_AT_ONCE = 256

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


def warnings(
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

    Args:
        lengths: (n,) steps per recording.
        levels: (n, channel) mean level over the window, or None where recordings have no level.
        codes: (n,) targets.
        train: indices of the training recordings.
        validation: indices of the validation recordings.
        name: of the target, for the sentence.
        follow_levels: returns whether the spikes change with the levels.
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
                "window.remove_mean: true or an encoder of changes, such as send_on_delta, drops it, unless "
                "the level is what is to be felt (dse audit: whether readers need it)"
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

    Features are standardised by the training rows; fewer neighbours vote where a class has fewer rows.

    Args:
        train: (n, feature).
        codes: (n,) classes of the training rows.
        query: (m, feature).
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
