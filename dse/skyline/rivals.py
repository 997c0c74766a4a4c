"""Should it spike? Spiking designs and their rivals, at equal accuracy and at equal cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from dse.base.records import Bools, Floats
from dse.skyline.table import numbers

_SURE, _EVEN = 0.9, 0.5
_QUANTILES = (0.05, 0.5, 0.95)
WHAT = {"energy_uj": "energy", "power_mw": "power", "n_weights": "size"}
"""What a cost is of, in words."""
_OWN_SPIKES = "spikes_per_inference_no_input"


class Spread(NamedTuple):
    """The 5 %, 50 % and 95 % quantiles over the samples."""

    low: float
    median: float
    high: float


@dataclass(frozen=True)
class Finalist:
    """The cheapest design of a family within one standard error of the family's best.

    place: of its row in the table. accuracy, se: as measured, and its standard error. cost: over the samples.
    """

    family: str
    is_spiking: bool
    place: int
    trial: int
    accuracy: float
    se: float
    cost: Spread


@dataclass(frozen=True)
class Odds:
    """How spiking designs stand against the others, over the samples of an accuracy and of a cost.

    on: the accuracy. cheaper: the probability that the cheapest spiking design of equal accuracy costs less.
    more_accurate: that the best spiking design of equal cost is more accurate. best: that the one that is
    expected to be the best at any cost is. times, gain, most: the ratio of these costs, and the differences
    of these accuracies; infinite where one side has no such design.
    """

    on: str
    cheaper: float
    more_accurate: float
    best: float
    times: Spread
    gain: Spread
    most: Spread


@dataclass(frozen=True)
class Rivals:
    """Whether to spike for one task on one chip.

    cost: the column that is compared. finalists: the cheapest first. odds: of each accuracy that was measured
    on both sides; none where a side has no design. unable: families whose designs do not run or fit there.
    """

    task: str
    hardware: str
    cost: str
    finalists: tuple[Finalist, ...]
    odds: tuple[Odds, ...]
    unable: tuple[str, ...] = ()

    @property
    def answer(self) -> str:
        """The answer in words: by both probabilities, and by the accuracy that one side alone reaches."""
        if not self.odds:
            ours = any(one.is_spiking for one in self.finalists)
            return (
                f"{'' if ours else 'do not '}spike: no {'other' if ours else 'spiking'} family runs and fits"
            )
        odds, what = self.odds[0], WHAT.get(self.cost, self.cost)
        low, high = sorted((odds.cheaper, odds.more_accurate))
        if low >= _EVEN and high >= _SURE:
            return "spike" if odds.best > 1 - _SURE else f"spike for {what}, not for accuracy"
        if high <= _EVEN and low <= 1 - _SURE:
            return "do not spike" if odds.best < _SURE else f"spike for accuracy, not for {what}"
        return "it is open whether to spike"

    @property
    def rows(self) -> list[dict[str, object]]:
        """The finalists as rows, each with the answer and the probabilities."""
        stated = {
            f"spiking_{name}{odds.on.removeprefix('accuracy')}": getattr(odds, name)
            for odds in self.odds
            for name in ("cheaper", "more_accurate", "best")
        }
        return [
            {
                **({"task": self.task} if self.task else {}),
                **({"hardware": self.hardware} if self.hardware else {}),
                **{"family": one.family, "spikes": one.is_spiking, "trial": one.trial},
                **{"accuracy": one.accuracy, "accuracy_se": one.se},
                self.cost: one.cost.median,
                f"{self.cost}_low": one.cost.low,
                f"{self.cost}_high": one.cost.high,
                "answer": self.answer,
                **stated,
            }
            for one in self.finalists
        ]


def spiking(points: pd.DataFrame) -> Bools:
    """Return which rows are of a family that spikes: some design of it has spikes of its own, (row,)."""
    if _OWN_SPIKES not in points:
        return np.zeros(len(points), bool)
    own = pd.Series(np.nan_to_num(numbers(points, _OWN_SPIKES)), points.index)
    return (own.groupby(points["family"]).transform("max") > 0).to_numpy(bool)


def rivals(
    points: pd.DataFrame,
    is_spiking: Bools,
    accuracies: Mapping[str, Floats],
    cost: str,
    costs: Floats,
    unable: Sequence[str] = (),
) -> Rivals:
    """Return whether to spike, from design points of one task on one chip.

    Args:
        points: with columns family, trial, accuracy; perhaps task and hardware.
        is_spiking: (row,).
        accuracies: column -> (draw, row) samples of true accuracies; `accuracy` is one of them.
        cost: the column that is compared.
        costs: (draw, row) samples of it, finite and positive.
        unable: families that the chip does not run or hold.
    """
    first = points.iloc[0]
    family, measured = points["family"].to_numpy(str), numbers(points, "accuracy")
    finalists = []
    for name in dict.fromkeys(family.tolist()):
        rows = np.flatnonzero(family == name)
        top = rows[measured[rows].argmax()]
        se = float(accuracies["accuracy"][:, top].std())
        near = rows[measured[rows] >= measured[top] - se]
        median = np.median(costs[:, near], axis=0)
        place = int(near[np.lexsort((-measured[near], median))[0]])
        se = float(accuracies["accuracy"][:, place].std())
        one = (name, bool(is_spiking[place]), place, int(points["trial"].iloc[place]), float(measured[place]))
        finalists.append(Finalist(*one, se, _spread(costs[:, place])))
    odds = []
    for on, drawn in accuracies.items():
        known = np.isfinite(drawn).all(axis=0)
        sides = is_spiking & known, ~is_spiking & known
        if all(side.any() for side in sides):
            (ours, our_costs), (theirs, their_costs) = ((drawn[:, x], costs[:, x]) for x in sides)
            error = max(float(x[:, x.mean(axis=0).argmax()].std()) for x in (ours, theirs))
            odds.append(odds_of(on, ours, theirs, our_costs, their_costs, error))
    return Rivals(
        task=str(first.get("task", "")),
        hardware=str(first.get("hardware", "")),
        cost=cost,
        finalists=tuple(sorted(finalists, key=lambda one: one.cost.median)),
        odds=tuple(odds),
        unable=tuple(unable),
    )


def odds_of(
    on: str, ours: Floats, theirs: Floats, our_costs: Floats, their_costs: Floats, error: float
) -> Odds:
    """Return how one side stands against the other, from joint samples, (draw, row) each.

    At any cost, the designs with the highest means compete: in a sample, the side with more designs has the
    luckier one. In each sample, equal accuracy is the highest that both sides reach, less a standard error;
    equal cost is what the cheaper side needs for its own best accuracy, less the same. Equal ones count half.
    """
    ours_best, theirs_best = ours.max(axis=1), theirs.max(axis=1)
    most = ours[:, ours.mean(axis=0).argmax()] - theirs[:, theirs.mean(axis=0).argmax()]
    level = np.minimum(ours_best, theirs_best) - error
    our_cost, their_cost = _least(our_costs, ours, level), _least(their_costs, theirs, level)
    limit = np.minimum(
        _least(our_costs, ours, ours_best - error), _least(their_costs, theirs, theirs_best - error)
    )
    our_accuracy, their_accuracy = -_least(-ours, -our_costs, -limit), -_least(-theirs, -their_costs, -limit)
    gain = our_accuracy - their_accuracy
    return Odds(
        on,
        _half(their_cost - our_cost),
        _half(gain),
        _half(most),
        _spread(our_cost / their_cost),
        _spread(gain),
        _spread(most),
    )


def _least(values: Floats, reached: Floats, level: Floats) -> Floats:
    """Return the least value among the rows that reach a level in each sample; infinite where none does."""
    return np.asarray(np.where(reached >= level[:, None], values, np.inf).min(axis=1))


def _half(margin: Floats) -> float:
    return float(np.mean((margin > 0) + 0.5 * (margin == 0)))


def _spread(values: Floats) -> Spread:
    return Spread(*(float(x) for x in np.quantile(values, _QUANTILES, method="inverted_cdf")))
