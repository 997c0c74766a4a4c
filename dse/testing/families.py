"""The contract of a model family, alone and in cohorts."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from dse import store
from dse.base.records import Answers, Dataset, Ints, Network, Outcome, Response
from dse.config.contracts import (
    CohortFamily,
    Family,
    FitRequest,
    Rung,
    RungFamily,
    Span,
    Teacher,
    has_rungs,
    placed,
    trains_in_cohorts,
)
from dse.config.settings import Training
from dse.measure.heads import head_sizes
from dse.testing import small
from dse.testing.expect import expect, expect_component, same, unchanged

TRAINING = Training(epochs=2, batch_size=8)


def check_family(family: Family, dataset: Dataset | None = None, training: Training = TRAINING) -> None:
    """Check a family.

    The result follows from the seed; `respond` gives the answers of the fit again, also after storing;
    answers do not depend on later input, and are those of the windows that the data set names; weights are
    counted; a design trains to the same bits alone and in a cohort, and with pauses where it can pause.

    Args:
        family: small enough to train in a second.
        dataset: with a test set; absent: a single target, three classes of 48 samples.
        training: settings of the training.

    Raises:
        AssertionError: what it violates.
    """
    name = expect_component(family)
    expect(
        isinstance(family, CohortFamily) or not trains_in_cohorts(family),
        f"{name} has `fit_cohort` and must have the other methods of `CohortFamily` too",
    )
    data = small.dataset() if dataset is None else dataset
    outcome = unchanged(f"{name}.fit", family.fit, data, training, small.generators(1))
    again = family.fit(data, training, small.generators(1))
    expect(same(_results(outcome), _results(again)), f"{name} must train to the same result by the same seed")
    expect(outcome.test is not None, f"{name} must answer on the test set where there is one")
    _check_counts(name, family, outcome, data)
    _check_answers(name, family, outcome, data)
    _check_causal(name, family, outcome, data)
    moved = family.respond(outcome.network, small.one_step_later(data), data.validation)
    expect(
        same(moved, outcome.validation),
        f"{name}.respond must answer the windows that begin at `dataset.start`, wherever that is",
    )
    if isinstance(family, Teacher):
        _check_scores(name, family, outcome, data)
    if trains_in_cohorts(family):
        _check_cohort(name, family, outcome, data, training)


def _results(outcome: Outcome) -> list[Any]:
    """Return what of an outcome does not depend on the machine's speed."""
    history = {key: x for key, x in outcome.history.items() if "second" not in key}
    return [outcome.network, outcome.validation, outcome.test, history, dict(outcome.health)]


def _check_counts(name: str, family: Family, outcome: Outcome, data: Dataset) -> None:
    answers = outcome.validation
    if isinstance(answers, Answers):
        stored = np.asarray(answers.n_weights)
        expect((stored > 0).all(), f"{name} must count the numbers that it stores, got {stored}")
        for what, counts in (("macs", answers.macs), ("additions", answers.additions)):
            expect(
                (np.asarray(counts) >= 0).all() and (np.diff(counts) >= 0).all(),
                f"{name}: {what} must be >= 0 and must not fall as the input grows",
            )
        return
    n_samples, _, n_outputs = answers.output.shape
    expect(
        (n_samples, n_outputs) == (len(data.validation), sum(head_sizes(data))),
        f"{name} must answer every validation sample by an output per class, got {answers.output.shape}",
    )
    network = outcome.network
    expect(network.n_weights > 0, f"{name} must count its weights")
    expect(network.n_channels == data.spikes.n_channels, f"{name} must be of the data set's channels")
    if not isinstance(network, Network):
        expect(answers.synapses is not None, f"{name} must count the synapses that a spike reaches")
    elif trains_in_cohorts(family):
        sizes = placed(family, data.positions)
        predicted = sizes.n_weights(data.spikes.n_channels, sum(head_sizes(data)))
        expect(
            predicted == network.n_weights_dense,
            f"{name}.n_weights must be that of the network, {network.n_weights_dense}, got {predicted}",
        )


def _check_answers(name: str, family: Family, outcome: Outcome, data: Dataset) -> None:
    sets = (("validation", data.validation, outcome.validation), ("test", data.test, outcome.test))
    stored = store.fitted_of(store.record_arrays(outcome.network))
    for what, samples, answers in sets:
        if isinstance(answers, Answers):
            _check_labels(name, answers, data)
        expect(
            same(family.respond(outcome.network, data, samples), answers),
            f"{name}.respond must give the {what} answers of its fit",
        )
        expect(
            same(family.respond(stored, data, samples), answers),
            f"{name}.respond must give the {what} answers after what was trained is stored and loaded",
        )


def _check_labels(name: str, answers: Answers, data: Dataset) -> None:
    label, time_ms = np.asarray(answers.label), np.asarray(answers.time_ms, float)
    expect(
        label.dtype.kind in "iu" and ((label >= 0) & (label < len(data.classes))).all(),
        f"{name} must answer with classes 0..{len(data.classes) - 1}",
    )
    whole_ms = data.n_steps * data.spikes.step_ms
    expect(
        (np.diff(time_ms) > 0).all() and time_ms[-1] == whole_ms,
        f"{name}: time_ms must rise to the whole window, {whole_ms} ms, got {time_ms}",
    )
    expect(label.shape[1] == len(time_ms), f"{name} must have an answer for each of {len(time_ms)} lengths")


def _check_scores(name: str, family: Teacher, outcome: Outcome, data: Dataset) -> None:
    scores = family.scores(outcome.network, data, data.validation)
    shape = len(data.validation), sum(head_sizes(data))
    expect(scores.shape == shape, f"{name}.scores must have the shape {shape}, got {scores.shape}")
    expect(not np.isnan(scores).any(), f"{name}.scores must be numbers")
    if not data.heads:
        answers = outcome.validation
        if isinstance(answers, Response):
            label = answers.output.sum(axis=1, dtype=np.int64).argmax(axis=1)
        else:
            label = answers.label[:, -1]
        expect(same(scores.argmax(axis=1), label), f"{name}.scores must be largest where {name} answers")


def _check_causal(name: str, family: Family, outcome: Outcome, data: Dataset) -> None:
    """Take away the second half of the input: what was answered before must stay."""
    half = data.n_steps // 2
    cut = small.without_spikes_after(data, half)
    samples: Ints = data.validation
    whole, part = (family.respond(outcome.network, x, samples) for x in (data, cut))
    text = f"{name} must be causal: an answer may not depend on later input"
    if isinstance(whole, Response) and isinstance(part, Response):
        steps = half * (whole.output.shape[1] // data.n_steps)
        expect(same(whole.output[:, :steps], part.output[:, :steps]), text)
    elif isinstance(whole, Answers) and isinstance(part, Answers):
        early = np.asarray(whole.time_ms) <= half * data.spikes.step_ms
        expect(same(whole.label[:, early], part.label[:, early]), text)


def _check_cohort(name: str, family: CohortFamily, alone: Outcome, data: Dataset, training: Training) -> None:
    n_channels, n_classes, n_steps = data.spikes.n_channels, sum(head_sizes(data)), data.n_steps
    expect(hash(family.shares(training)) is not None, f"{name}.shares must be hashable")
    sizes = placed(family, data.positions)
    expect(
        sizes.memory_bytes(n_channels, n_classes, n_steps, training) > 0
        and sizes.workspace_bytes(n_channels, n_classes, n_steps, training) >= 0,
        f"{name} must say how much memory a design takes",
    )
    seconds = sizes.cost(n_channels, n_classes, n_steps, 100.0, len(data.train), training)
    expect(seconds > 0, f"{name}.cost must be > 0 seconds, got {seconds}")
    own, other = small.generators(1), small.generators(2)
    slower = dataclasses.replace(training, learning_rate=training.learning_rate / 2)
    requests = [FitRequest(family, slower, other), FitRequest(family, training, own)]
    together = dict(family.fit_cohort(data, requests, own))
    expect(set(together) == {0, 1}, f"{name}.fit_cohort must yield every design, got {sorted(together)}")
    outcome = together[1]
    if isinstance(outcome, Exception):
        raise AssertionError(f"{name}.fit_cohort must train what trains alone, got {outcome!r}") from outcome
    expect(
        same(_results(outcome), _results(alone)),
        f"{name} must train to the same result alone and in a cohort",
    )
    if has_rungs(family):
        _check_rungs(name, family, alone, data, training)


def _check_rungs(name: str, family: RungFamily, whole: Outcome, data: Dataset, training: Training) -> None:
    own = small.generators(1)
    requests = [FitRequest(family, training, own)]
    states: list[Callable[[], Mapping[str, Any]]] = []
    for until in range(1, training.epochs):
        ((_, rung),) = family.fit_span(data, requests, own, span=Span(states, until))
        expect(
            isinstance(rung, Rung) and rung.epochs == until and rung.outcome is not None,
            f"{name}.fit_span must yield a rung with an outcome after {until} epochs, got {rung!r}",
        )
        assert isinstance(rung, Rung)
        states = [functools.partial(dict, rung.state)]
    ((_, ended),) = family.fit_span(data, requests, own, span=Span(states))
    expect(
        isinstance(ended, Outcome) and same(_results(ended), _results(whole)),
        f"{name} must train to the same result in spans and without a pause",
    )
