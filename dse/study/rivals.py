"""Should it spike? The question, asked of a study: of its points, their errors, and the chip's numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import pandas

from dse.config.expressions import named_columns
from dse.measure.hardware.duty import contacts_per_ms
from dse.measure.hardware.interval import is_open
from dse.search.racing import best
from dse.skyline import rivals
from dse.skyline.admissible import COST, fitting, honest, meeting
from dse.skyline.front import front_mask
from dse.skyline.table import Goal, costs_of, group_numbers, numbers
from dse.store import StoreError
from dse.study import pricing, resampling
from dse.study.question import DRAWS, Question
from dse.study.results import Study

if TYPE_CHECKING:
    from dse.base.records import Floats

_ACCURACIES = ("accuracy", "accuracy_shifted", "accuracy_unseen")
_UNITS = {"energy_uj": "uJ", "power_mw": "mW", "n_weights": "weights"}
_WHERE = {"accuracy_shifted": ", on moved windows", "accuracy_unseen": ", in unseen groups"}
_MOST = 400  # points of a family that are sampled


def of_study(
    study: Study,
    question: Question = Question(),  # noqa: B008 (frozen)
    budgets: Sequence[str] = (),
) -> Iterator[rivals.Rivals]:
    """Yield whether to spike, for each task and chip for which spiking and other families were trained.

    Args:
        study: finished, or not.
        question: hardware, contacts per hour, samples; on a schedule power is compared, else energy, and
            without a chip the number of weights.
        budgets: conditions for the points that are compared, beside those of the question; those on what
            targets take, which is known of few points, are left out.

    Raises:
        ExpressionError: a condition cannot be read.
        StoreError: an artefact is missing or damaged.
    """
    whole = question.points([study.folder])[0].reset_index(drop=True)
    known = [text for text in budgets if named_columns([text]) <= {*whole.columns}]
    points = whole[honest(whole) & meeting(whole, [*question.where, *known])]
    by = group_numbers(points, [name for name in ("task", "hardware") if name in points])
    by_cost: dict[str, list[tuple[pandas.DataFrame, list[str]]]] = {}
    for number in np.unique(by):
        group = points[by == number]
        is_spiking = rivals.spiking(group)
        if 0 < is_spiking.sum() < len(group):
            cost = _cost(group)
            able = np.isfinite(numbers(group, COST if cost == "energy_uj" else cost))
            able &= fitting(group) | question.oversize
            unable = [name for name in group["family"].unique() if not able[group["family"] == name].any()]
            if able.any():
                by_cost.setdefault(cost, []).append((_telling(group[able], cost), unable))
    for cost, groups in by_cost.items():
        accuracies, costs = _sampled(study, question, whole, [rows for rows, _ in groups], cost)
        for (rows, unable), of_rows, of_costs in zip(groups, accuracies, costs, strict=True):
            yield rivals.rivals(rows, rivals.spiking(rows), of_rows, cost, of_costs, unable)


def sentences(study: Study, question: Question = Question()) -> list[str]:  # noqa: B008 (frozen)
    """Return whether to spike, in words; that it is not known, and why, where that is so."""
    try:
        points = study.points()
        several = () if points.empty else of_study(study, question)
        texts = [text for one in several for text in worded(one)]
    except StoreError as error:  # a study of an earlier version, or a damaged one
        return [f"whether to spike is not known: {error}"]
    families = ", ".join(dict.fromkeys(points["family"].astype(str))) if "family" in points else ""
    if texts or not families:
        return texts
    return [f"{study.folder.name}: whether to spike is not known: there is no rival of {families}"]


def brief(study: Study, question: Question) -> list[str]:
    """Return all answers in one sentence, without numbers; nothing where spiking has no rival."""
    try:
        several = [] if study.points().empty else list(of_study(study, question))
    except StoreError:  # `sentences` says why
        return []
    named = {x.hardware: pricing.label_of(study.folder, x.hardware) for x in several if x.hardware}
    answers = [f"{_about(one, named)}: {one.answer}" for one in several]
    return [f"Should it spike? {'; '.join(answers)} (dse report has the numbers)"] if answers else []


def _about(of: rivals.Rivals, named: Mapping[str, str] = MappingProxyType({})) -> str:
    return " on ".join(filter(None, (of.task, named.get(of.hardware, of.hardware))))


def worded(of: rivals.Rivals) -> list[str]:
    """Return the answer in words and numbers, and a sentence on each accuracy."""
    about = _about(of)
    unable = f"{', '.join(of.unable)} {'do' if len(of.unable) > 1 else 'does'} not run or fit"
    each = [
        f"{one.family} {_in_range(one.cost, _UNITS.get(of.cost, of.cost))}, accuracy "
        f"{one.accuracy:.3f} ± {one.se:.2g}, trial {one.trial}"
        for one in of.finalists
    ]
    texts = [
        f"{about}: {of.answer}. The cheapest design of each family within one standard error of its "
        f"best: {'; '.join(each)}{f'; {unable}' if of.unable else ''}"
    ]
    what = rivals.WHAT.get(of.cost, of.cost)
    for odds in of.odds:
        cheaper, times = _share(odds.cheaper), _in_range(odds.times, f"times the {what}")
        texts.append(
            f"{about}{_WHERE.get(odds.on, '')}: the probability that a spiking design is cheaper at "
            f"equal accuracy is {cheaper}, at {times}; that it is more accurate at equal cost "
            f"{_share(odds.more_accurate)}, by {_points(odds.gain)}; that it is more accurate at any "
            f"cost {_share(odds.best)}, by {_points(odds.most)}"
        )
    return texts


def _share(probability: float) -> str:
    """Return a probability; samples are too few for more than two digits."""
    return "< 0.01" if probability < 0.01 else "> 0.99" if probability > 0.99 else f"{probability:.2f}"


def _in_range(spread: rivals.Spread, unit: str) -> str:
    if is_open(spread.low, spread.high):
        return f"at least {_short(spread.low)} {unit}"
    ends = "" if spread.low == spread.high else f" ({_short(spread.low)} to {_short(spread.high)})"
    return f"{_short(spread.median)} {unit}{ends}"


def _points(spread: rivals.Spread) -> str:
    """Return a difference of accuracies; infinite where one side has no design of such a cost."""
    if np.isinf(spread.median):
        return f"all: no {'spiking' if spread.median < 0 else 'other'} design costs as little"
    low, high = ("all" if np.isinf(x) else f"{x:+.3f}" for x in (spread.low, spread.high))
    return f"{spread.median:+.3f} ({low} to {high})"


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 1000 else f"{value:.3g}"


def _cost(points: pandas.DataFrame) -> str:
    """Return the column that is compared."""
    if "power_mw" in points and points["power_mw"].notna().any():
        return "power_mw"
    return "energy_uj" if COST in points and points[COST].notna().any() else "n_weights"


def _telling(points: pandas.DataFrame, cost: str) -> pandas.DataFrame:
    """Return the points on the front of their trial; of a family with many, its first fronts."""
    column = COST if cost == "energy_uj" else cost
    goals = [*(Goal(name, "max") for name in _ACCURACIES if name in points), Goal(column, "min")]
    filled = points.assign(**{name: points[name].fillna(0.0) for name, _ in goals})
    rows = points[front_mask(filled, goals, group_numbers(points, ["trial"]))]
    places = []
    for members in rows.groupby("family", sort=False).indices.values():
        costs = costs_of(filled.loc[rows.index[members]], goals)
        places.append(members[best(costs, _MOST)] if len(members) > _MOST else members)
    return rows.iloc[np.sort(np.concatenate(places))]


def _sampled(
    study: Study, question: Question, whole: pandas.DataFrame, groups: Sequence[pandas.DataFrame], cost: str
) -> tuple[list[dict[str, Floats]], list[Floats]]:
    """Return samples of accuracies and of the cost of each group, (draw, row); NaN where it was not measured.

    All groups are sampled together, so that the answers of a trial are read once.
    """
    n_draws = question.draws or DRAWS
    throttled = ["energy_throttled_uj"] if cost == "power_mw" else []
    rows = pandas.concat(groups)
    accuracies: dict[str, Floats] = {}
    costs = np.tile(numbers(rows, cost), (n_draws, 1))
    for name in (name for name in _ACCURACIES if name in rows):
        known = np.flatnonzero(np.isfinite(numbers(rows, name)))
        if not len(known):
            continue
        goals = [(name, "max"), (cost, "min")]
        drawing = resampling.draws(
            [study.folder], [whole], question.hardware, goals, n_draws, throttled, (name,)
        )
        drawn = drawing.of(rows.iloc[known])
        accuracies[name] = np.full((n_draws, len(rows)), np.nan)
        accuracies[name][:, known] = drawn[name]
        if name == "accuracy" and cost == "energy_uj":
            costs = drawn[cost]
        elif name == "accuracy" and throttled:
            more = drawn[throttled[0]] - numbers(rows, throttled[0])
            schedule = pricing.schedule_of(study.folder, question.contacts_per_hour)
            assert schedule is not None  # or nothing had a power
            times_ms = [numbers(rows, x) for x in ("hardware_latency_ms", "decision_latency_ms")]
            costs = costs + contacts_per_ms(schedule, np.fmax(*times_ms)) * more  # uJ per ms
    ends = np.cumsum([len(group) for group in groups])[:-1]
    parts = {name: np.split(drawn, ends, axis=1) for name, drawn in accuracies.items()}
    of_groups = [{name: each[k] for name, each in parts.items()} for k in range(len(groups))]
    return of_groups, np.split(np.maximum(costs, 0.0), ends, axis=1)
