"""One row of an audit: what a reader reaches with a shortcut, and whether that is more than chance.

A row is a shortcut where two things hold. The effect is no accident: its exact binomial probability without
any effect is below `RARE`, divided by the number of readers that were tried. And it is large: at least `HALF`
of what readers of the whole spikes reach above chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Bools, Ints
from dse.measure.objectives.accuracy import wilson_se

RARE = 1e-3
HALF = 0.5


@dataclass(frozen=True)
class AuditRow:
    """What one probe says; None where a probe has no such number.

    task: what is predicted.
    probe: what the reader sees, or what changes between training and validation.
    reader: the classifier.
    accuracy: on the validation samples; se: its standard error (Wilson); samples: their number.
    chance: share of their largest class.
    without: accuracy of the same reader where the shortcut does not help; without_se: its standard error.
    shortcut: whether the probe has found one.
    verdict: the same in words.
    remedy: the key of the search space that removes the shortcut; '' without a shortcut.
    test, test_se: accuracy of a reader of counts over time on the test set, and its standard error.
    data: key of the data set that was read, as designs train on it.
    """

    task: str
    probe: str
    reader: str
    accuracy: float | None
    se: float | None
    chance: float | None
    without: float | None
    without_se: float | None
    samples: int
    shortcut: bool
    verdict: str
    remedy: str
    test: float | None = None
    test_se: float | None = None
    data: str = ""

    @property
    def columns(self) -> dict[str, object]:
        """The row as columns."""
        return dict(vars(self))


@dataclass(frozen=True)
class Score:
    """Which samples a reader answers correctly, (n,) bool, and the share of their largest class.

    repeats: how often each sample is among them; the standard error counts it once.
    """

    reader: str
    correct: Bools
    chance: float
    repeats: int = 1

    @property
    def n(self) -> int:
        return len(self.correct)

    @property
    def accuracy(self) -> float:
        return float(self.correct.mean())

    @property
    def se(self) -> float:
        return float(wilson_se(self.correct.sum() / self.repeats, self.n / self.repeats))

    def of(self, chosen: Bools, codes: Ints) -> Score:
        """Return the score on some of the samples, (n,) bool, whose true classes are `codes`, (n,)."""
        return Score(self.reader, self.correct[chosen], largest_class(codes[chosen]))


def largest_class(codes: Ints) -> float:
    """Return the share of the most frequent class: the best accuracy without reading anything."""
    return float(np.unique(codes, return_counts=True)[1].max() / len(codes))


def is_above(score: Score, readers: int = 1) -> bool:
    """Return whether a score is above chance by more than accident."""
    return _tail(int(score.correct.sum()), score.n, score.chance) < RARE / readers


def is_above_rate(events: Bools, rate: float) -> bool:
    """Return whether something happens more often than at a rate, by more than accident."""
    return _tail(int(events.sum()), len(events), rate) < RARE


def is_lower(before: Bools, after: Bools) -> bool:
    """Return whether answers to the same samples have become worse by more than accident.

    An exact sign test of the samples whose answer is correct in one case alone (McNemar).
    """
    lost, won = int((before & ~after).sum()), int((after & ~before).sum())
    return _tail(lost, lost + won, 0.5) < RARE


def share_explained(score: Score, best: float) -> float:
    """Return how much of the best reader's accuracy above chance a reader reaches, 0 to 1."""
    top = max(best, score.accuracy)
    return max(0.0, (score.accuracy - score.chance) / (top - score.chance)) if top > score.chance else 0.0


def share_lost(before: Score, after: Score) -> float:
    """Return how much of its accuracy above chance a reader loses, 0 to 1."""
    gain = before.accuracy - before.chance
    return float(np.clip((before.accuracy - after.accuracy) / gain, 0, 1)) if gain > 0 else 0.0


def loss(before: Score, after: Score, worse: bool, cause: str, known: str, met: str = "") -> tuple[bool, str]:
    """Return whether a reader owes half of its accuracy above chance to a shortcut, and a verdict.

    after: its score where the shortcut does not help; worse: whether that is worse by more than accident.
    cause: what the accuracy that it loses is. known: where a reader at chance is at chance. met: where it
    loses or holds.
    """
    if not is_above(before):
        return False, f"this reader is at chance{known}"
    if not worse:
        return False, f"it holds{met}"
    lost = share_lost(before, after)
    what = cause if lost >= HALF else f"lost{met}"
    return lost >= HALF, f"{percent(lost)} of the accuracy above chance is {what}"


def percent(share: float) -> str:
    """Return a share in words: '77 %'."""
    return f"{100 * share:.0f} %"


def _tail(successes: int, n: int, probability: float) -> float:
    """Return the probability of so many successes or more in n independent trials."""
    from scipy.stats import binom

    return float(binom.sf(successes - 1, n, probability)) if n else 1.0
