"""One training run -> the record's columns, as the registered objectives measure them.

The full read-out answers at the end of the window: a spiking network by argmax of its output spike counts
(lowest class on ties), any other classifier as it does. Earlier read-outs answer after a shorter input. Every
(phi, theta) setting of a spiking network answers when it is confident; what that costs is the mean work that
was done up to each sample's own decision, never a share of the whole.

A joint target has a measurement for each of its heads; its own accuracy counts samples with every head right.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dse import registry
from dse.hardware.cost import NotApplicable, cost
from dse.hardware.profile import Profile
from dse.measure import decision
from dse.measure.confusion import confusion
from dse.measure.heads import head_answers, head_slices, joint_label
from dse.measure.objectives import FullReadOut, Needs, Points, Priced, flat, measured
from dse.measure.objectives.accuracy import accuracy
from dse.measure.objectives.accuracy_unseen import Unseen
from dse.measure.on_chips import columns_on
from dse.neurons import neuron_of
from dse.neurons.cuba_lif import CubaLif
from dse.records import (
    Answers,
    Array,
    Dataset,
    DecisionSurface,
    Floats,
    Head,
    Ints,
    Network,
    Operations,
    Outcome,
    Parameters,
    Response,
    Workload,
    sum_of_products,
)

READ_OUTS = 20
"""Input lengths, evenly spaced, after which a spiking network is read out unless their distance is given."""

Columns = dict[str, Array]

# What the decision maker reaches when the input ends after each length, and the settings that do it.
_OF_DECISIONS = (
    *("accuracy_best", "t_p_ms", "phi_p", "theta_p", "t_h_ms", "phi_h", "theta_h"),
    *("accuracy_best_strict", "t_p_strict_ms", "t_h_strict_ms"),
)


@dataclass(frozen=True)
class Measurement:
    """What one run measured, on the validation set unless the name says test.

    columns: the full read-out, column -> number.
    points: column -> (phi, theta); empty without a decision grid.
    read_outs: column -> (k,), after time_ms[j] of the input.
        In both, `unseen_name` names the accuracies of a fold.
    points_load, read_outs_load: mean work of the same answers, which any hardware can be asked the cost of.
    hardware: profile -> `columns_on` of the full read-out.
    confusion, confusion_test: (true class, answered class) counts of the full read-out.
    heads: of a joint target, head -> its own measurement.
    unseen: label column -> fold of its values -> accuracy after a training without the fold.
    shifted: (shift,) accuracy of the full read-out on moved windows; None where none were moved.
    """

    columns: dict[str, Any]
    points: Columns
    read_outs: Columns
    points_load: Workload | Operations | None
    read_outs_load: Workload | Operations | None
    hardware: dict[str, dict[str, Any]]
    confusion: Ints
    confusion_test: Ints | None
    heads: dict[str, Measurement] = field(default_factory=dict)
    unseen: Unseen = field(default_factory=dict)
    shifted: Floats | None = None


@dataclass(frozen=True)
class Accuracies:
    """Accuracies of one target: of the full read-out, after k input lengths, and at every (phi, theta).

    read_outs: (k,); None of a joint target as a whole. grid: None without a grid.
    """

    full: float
    read_outs: Floats | None = None
    grid: Floats | None = None


OfTargets = Mapping[str, Accuracies]
"""Accuracies of the target, '', and of a joint one also of each head, by name."""
UnseenTargets = Mapping[str, Mapping[str, OfTargets]]
"""Label column -> fold of its values -> accuracies after a training without the fold."""


@dataclass(frozen=True)
class _Target:
    """What is to be answered: true classes of both sets, their number, and the outputs that answer.

    joint_of: (n_joint,) class of each joint class, where answers are joint classes; None where they are not.
    """

    validation: Ints
    test: Ints
    n_classes: int
    outputs: slice
    joint_of: Ints | None = None


@dataclass(frozen=True)
class _Answered:
    """What a run answers to one target.

    read_outs: after k input lengths. grid: at every (phi, theta); None without a grid.
    label, label_test: (n,) classes of the full read-out.
    of_lengths: further columns (k,) of the read-outs.
    decisions_test: the test set's surface over the grid; None without a grid or a test set.
    most_output_spikes: of these outputs in a validation sample; None of what has no output spikes.
    """

    read_outs: Points
    grid: Points | None
    label: Ints
    label_test: Ints | None
    of_lengths: Columns
    decisions_test: DecisionSurface | None = None
    most_output_spikes: int | None = None


@dataclass(frozen=True)
class _How:
    """How a run is evaluated: the arguments of `measure` of these names."""

    phi: Array
    theta: Array
    weight_bits: int
    read_out_every_ms: float | None


@dataclass
class _Moved:
    """Accuracies of one target on windows of n samples: first unmoved, then at every shift.

    read_outs: per shift (k,). grids: per shift (phi, theta); empty without a grid.
    """

    n: int = 0
    read_outs: list[Floats] = field(default_factory=list)
    grids: list[Floats] = field(default_factory=list)

    def add(self, answers: Response | Answers, truth: Ints, target: _Target, how: _How) -> None:
        """Add what a run answers at one shift; truth: (n,) classes."""
        read_outs, grid = _accuracies_of_answers(answers, truth, target, how)
        self.n = len(truth)
        self.read_outs.append(read_outs)
        if grid is not None:
            self.grids.append(grid)

    def beside(self, answered: _Answered) -> _Answered:
        """Return what a run answers to the evaluated windows, with the accuracies on the moved ones."""
        if not self.read_outs:
            return answered
        grid = answered.grid
        if grid is not None:
            grid = _with_shifts(grid, self.grids, self.n)
        return replace(
            answered, read_outs=_with_shifts(answered.read_outs, self.read_outs, self.n), grid=grid
        )


def _with_shifts(points: Points, accuracies: Sequence[Floats], n: int) -> Points:
    """Return points with accuracies of n samples, unmoved and at every shift."""
    return replace(points, shifted=np.stack(accuracies[1:]), unshifted=accuracies[0], n_shifted=n)


def _and_unmoved(
    moved: Iterable[tuple[Ints, Response | Answers]], outcome: Outcome, dataset: Dataset
) -> Iterator[tuple[Ints, Response | Answers]]:
    """Yield what a run answers to the unmoved windows of the moved samples, then to the moved ones."""
    for number, (samples, answers) in enumerate(moved):
        if not number:
            among, unmoved = np.isin(dataset.validation, samples), outcome.validation
            if isinstance(unmoved, Answers):
                yield samples, replace(unmoved, label=unmoved.label[among])
            else:
                yield samples, replace(unmoved, output=unmoved.output[among])
        yield samples, answers


def measure(
    outcome: Outcome,
    dataset: Dataset,
    phi: Array,
    theta: Array,
    hardware: Sequence[Profile],
    weight_bits: int = 8,
    read_out_every_ms: float | None = None,
    moved: Iterable[tuple[Ints, Response | Answers]] = (),
    unseen: UnseenTargets | None = None,
) -> Measurement:
    """Measure one run.

    Args:
        outcome: what the model family returned.
        dataset: what it was trained on.
        phi: spike offsets of the decision grid.
        theta: its confidences; both empty for the full read-out only. Spiking families alone have one.
        hardware: profiles that the full read-out is priced on.
        weight_bits: bits per weight of a spiking network.
        read_out_every_ms: distance of the input lengths after which a spiking network is read out; None:
            `READ_OUTS` of them, evenly spaced.
        moved: per shift, validation samples (n,), rising and the same at each, and what the run answers to
            their moved windows.
        unseen: accuracies on groups after trainings without them; None: there were none.

    Raises:
        ValueError: a response holds no samples, or the grid is out of range.
    """
    how = _How(phi, theta, weight_bits, read_out_every_ms)
    targets = _targets(dataset)
    at_shifts = {name: _Moved() for name in targets}
    jointly = _Moved()
    for samples, answers in _and_unmoved(moved, outcome, dataset):
        classes = dataset.target[samples]
        for name, target in targets.items():
            true = classes if target.joint_of is None else target.joint_of[classes]
            at_shifts[name].add(answers, true, target, how)
        if dataset.heads:
            jointly.n = len(samples)
            jointly.read_outs.append(np.array([accuracy(_joint_label(answers, dataset), classes)]))
    measurements = {}
    for name, target in targets.items():
        answered = at_shifts[name].beside(_answers_to(target, outcome, dataset.spikes.n_channels, how))
        of_target = _of_target(unseen or {}, name)
        measurements[name] = _measured(outcome, target, answered, hardware, of_target)
    if not dataset.heads:
        return measurements[""]
    end = _at_end(answered.read_outs)  # the work is that of the whole net, whichever head is asked
    if jointly.read_outs:
        end = _with_shifts(end, jointly.read_outs, jointly.n)
    return _measured_jointly(outcome, dataset, measurements, end, _full(_of_target(unseen or {}, "")))


def accuracies(
    answers: Response | Answers,
    dataset: Dataset,
    samples: Ints,
    phi: Array,
    theta: Array,
    read_out_every_ms: float | None = None,
) -> dict[str, Accuracies]:
    """Return the accuracies of answers, '' of the target, and of a joint one also of each head, by name.

    Args:
        answers: to the samples.
        dataset: their classes and heads.
        samples: (n,) sample numbers, n >= 1.
        phi: spike offsets of the decision grid.
        theta: its confidences.
        read_out_every_ms: as of `measure`.
    """
    how, truth = _How(phi, theta, 8, read_out_every_ms), dataset.target[samples]
    of_targets = {}
    if dataset.heads:
        of_targets[""] = Accuracies(accuracy(_joint_label(answers, dataset), truth))
    for name, target in _targets(dataset).items():
        true = truth if target.joint_of is None else target.joint_of[truth]
        read_outs, grid = _accuracies_of_answers(answers, true, target, how)
        of_targets[name] = Accuracies(float(read_outs[-1]), read_outs, grid)
    return of_targets


def _accuracies_of_answers(
    answers: Response | Answers, truth: Ints, target: _Target, how: _How
) -> tuple[Floats, Floats | None]:
    """Return the accuracies after k input lengths, (k,), and at every (phi, theta); None without a grid.

    Args:
        answers: to n samples.
        truth: (n,) their classes of the target.
        target: which outputs or classes answer.
        how: read-outs and grid.
    """
    if isinstance(answers, Answers):
        label = answers.label if target.joint_of is None else target.joint_of[answers.label]
        return _accuracies(label, truth), None
    output = answers.output[..., target.outputs]
    read_outs = _accuracies(
        _labels_after(output, read_out_steps(output.shape[1], answers.step_ms, how.read_out_every_ms)), truth
    )
    if not (len(how.phi) and len(how.theta)):
        return read_outs, None
    return read_outs, decision.surface(output, truth, how.phi, how.theta, answers.step_ms).accuracy


def _targets(dataset: Dataset) -> dict[str, _Target]:
    """Return what is to be answered: '' of a single target, the heads of a joint one by name."""
    truth, truth_test = dataset.target[dataset.validation], dataset.target[dataset.test]
    if not dataset.heads:
        return {"": _Target(truth, truth_test, len(dataset.classes), slice(None))}
    return {
        head.name: _of_head(head, outputs, truth, truth_test)
        for head, outputs in zip(dataset.heads, head_slices(dataset), strict=True)
    }


def _of_target(unseen: UnseenTargets, name: str) -> dict[str, dict[str, Accuracies]]:
    """Return the accuracies of one target on groups after trainings without them."""
    return {
        column: {fold: of_targets[name] for fold, of_targets in folds.items()}
        for column, folds in unseen.items()
    }


def _full(unseen: Mapping[str, Mapping[str, Accuracies]]) -> dict[str, dict[str, float]]:
    return {column: {fold: x.full for fold, x in folds.items()} for column, folds in unseen.items()}


def unseen_name(number: int) -> str:
    """Return the name of an array of accuracies of a fold, by its number among the folds of `unseen`."""
    return f"unseen/{number}"


def records_for_objectives(
    outcome: Outcome, dataset: Dataset, phi: Array, theta: Array, hardware: Sequence[Profile]
) -> list[tuple[Needs, Points | FullReadOut | Priced]]:
    """Return what objectives measure of one run of a single target, each with what needs it.

    Args:
        outcome: what the model family returned.
        dataset: what it was trained on, without heads.
        phi: spike offsets of the decision grid.
        theta: its confidences.
        hardware: profiles; one that cannot run the classifier adds nothing.
    """
    truth, truth_test = dataset.target[dataset.validation], dataset.target[dataset.test]
    target = _Target(truth, truth_test, len(dataset.classes), slice(None))
    answered = _answers_to(target, outcome, dataset.spikes.n_channels, _How(phi, theta, 8, None))
    points = [answered.read_outs, *([] if answered.grid is None else [answered.grid])]
    records: list[tuple[Needs, Points | FullReadOut | Priced]] = [("points", one) for one in points]
    records.append(("full_read_out", _full_read_out(outcome, target, answered, {})))
    for chip in hardware:
        for one in points:
            with contextlib.suppress(NotApplicable):
                records.append(("hardware", Priced(cost(chip, one.load), one.load)))
    return records


def read_out(output: Array) -> Ints:
    """Return the class with most output spikes over the window, (n,); the lowest class on ties."""
    return np.asarray(output.sum(axis=1, dtype=np.int64).argmax(axis=1))


def _measured(
    outcome: Outcome,
    target: _Target,
    answered: _Answered,
    hardware: Sequence[Profile],
    unseen: Mapping[str, Mapping[str, Accuracies]],
) -> Measurement:
    """Return the measurement of one target."""
    of_lengths = measured("points", answered.read_outs)
    of_grid = {} if answered.grid is None else measured("points", answered.grid)
    answer = _full_read_out(outcome, target, answered, _full(unseen))
    folds = [fold for of_column in unseen.values() for fold in of_column.values()]
    lengths = {unseen_name(i): x.read_outs for i, x in enumerate(folds) if x.read_outs is not None}
    settings = {unseen_name(i): x.grid for i, x in enumerate(folds) if x.grid is not None}
    full = _at_end(answered.read_outs).load.mapped(lambda counts: counts[-1])
    declared = registry.columns("points")
    return Measurement(
        columns=_columns({name: x[-1] for name, x in of_lengths.items()}, answer),
        points={name: x for name, x in of_grid.items() if not declared[name].of_design} | settings,
        read_outs={**of_lengths, **answered.of_lengths, **lengths},
        points_load=None if answered.grid is None else answered.grid.load,
        read_outs_load=answered.read_outs.load,
        hardware={chip.name: flat(columns_on(chip, full)) for chip in hardware},
        confusion=answer.confusion,
        confusion_test=answer.confusion_test,
        unseen=answer.unseen,
        shifted=None if answered.read_outs.shifted is None else answered.read_outs.shifted[:, -1],
    )


def _full_read_out(outcome: Outcome, target: _Target, answered: _Answered, unseen: Unseen) -> FullReadOut:
    return FullReadOut(
        outcome=outcome,
        label=answered.label,
        target=target.validation,
        confusion=confusion(answered.label, target.validation, target.n_classes),
        decision_latency_ms=answered.read_outs.decision_latency_ms[-1].item(),
        read_outs=answered.read_outs,
        decisions=None if answered.grid is None else answered.grid.decisions,
        decisions_test=answered.decisions_test,
        confusion_test=None
        if answered.label_test is None
        else confusion(answered.label_test, target.test, target.n_classes),
        most_output_spikes=answered.most_output_spikes,
        target_test=None if answered.label_test is None else target.test,
        unseen=unseen,
    )


def _measured_jointly(
    outcome: Outcome, dataset: Dataset, heads: dict[str, Measurement], end: Points, unseen: Unseen
) -> Measurement:
    """Return the measurement of a joint net, whose answer is right where those of all its heads are.

    Args:
        outcome: of the net.
        dataset: with heads.
        heads: their measurements.
        end: the full read-out of any head.
        unseen: of the joint classes.
    """
    n_classes = len(dataset.classes)
    truth, truth_test = dataset.target[dataset.validation], dataset.target[dataset.test]
    label = _joint_label(outcome.validation, dataset)
    label_test = None if outcome.test is None else _joint_label(outcome.test, dataset)
    matrix = _with_unnamed(label, truth, n_classes)
    matrix_test = None if label_test is None else _with_unnamed(label_test, truth_test, n_classes)
    points = replace(
        end,
        accuracy=np.array([accuracy(label, truth)]),
        accuracy_test=None if label_test is None else np.array([(label_test == truth_test).mean()]),
    )
    answer = FullReadOut(
        outcome=outcome,
        label=label,
        target=truth,
        confusion=matrix,
        decision_latency_ms=end.decision_latency_ms[-1].item(),
        read_outs=None,
        decisions=None,
        confusion_test=matrix_test,
        unseen=unseen,
    )
    columns = _columns({name: x[-1] for name, x in measured("points", points).items()}, answer)
    columns |= {f"accuracy_{name}": head.columns["accuracy"] for name, head in heads.items()}
    if label_test is not None:
        columns |= {f"accuracy_test_{name}": head.columns["accuracy_test"] for name, head in heads.items()}
    return Measurement(
        columns=columns,
        points={},
        read_outs={},
        points_load=None,
        read_outs_load=None,
        hardware=next(iter(heads.values())).hardware,
        confusion=matrix[:, :-1],
        confusion_test=None if matrix_test is None else matrix_test[:, :-1],
        heads=heads,
        unseen=unseen,
        shifted=None if end.shifted is None else end.shifted[:, -1],
    )


def _with_unnamed(label: Ints, target: Ints, n_classes: int) -> Ints:
    """Return the confusion of joint classes, with a column of the combinations that are no class (-1)."""
    named = label >= 0
    unnamed = np.bincount(target[~named], minlength=n_classes)
    return np.column_stack([confusion(label[named], target[named], n_classes), unnamed])


def _columns(of_points: dict[str, Any], answer: FullReadOut) -> dict[str, Any]:
    """Return the columns of the full read-out; health that is one number is a column as well."""
    of_answer = measured("full_read_out", answer)
    train_s = of_answer.pop("train_s")
    health = {name: x for name, x in answer.outcome.health.items() if isinstance(x, bool | int | float)}
    return {**flat(of_points), **flat(of_answer), **health, "train_s": train_s}


def _at_end(points: Points) -> Points:
    """Return the last of k read-outs, as one point."""
    return replace(
        points,
        accuracy=points.accuracy[-1:],
        accuracy_test=None if points.accuracy_test is None else points.accuracy_test[-1:],
        decision_latency_ms=points.decision_latency_ms[-1:],
        spikes=points.spikes[-1:],
        n_weights=points.n_weights[-1:],
        load=points.load.mapped(lambda counts: counts[-1:]),
        spikes_test=None if points.spikes_test is None else points.spikes_test[-1:],
        shifted=None if points.shifted is None else points.shifted[:, -1:],
        unshifted=None if points.unshifted is None else points.unshifted[-1:],
    )


def _of_head(head: Head, outputs: slice, truth: Ints, truth_test: Ints) -> _Target:
    of_class = head.of_class
    return _Target(of_class[truth], of_class[truth_test], len(head.classes), outputs, of_class)


def _joint_label(answers: Response | Answers, dataset: Dataset) -> Ints:
    """Return the joint class that is answered, (n,); -1 where the heads name none."""
    if isinstance(answers, Answers):
        return answers.label[:, -1]
    return joint_label(head_answers(dataset, answers.output.sum(axis=1, dtype=np.int64)), dataset.heads)


def _answers_to(target: _Target, outcome: Outcome, n_channels: int, how: _How) -> _Answered:
    """Return what a run answers to a target; a family answers in one way, on validation and on test."""
    validation, test = outcome.validation, outcome.test
    if isinstance(validation, Response):
        assert not isinstance(test, Answers)
        return _of_spikes(outcome.network, validation, test, target, how)
    assert not isinstance(test, Response)
    return _of_answers(validation, test, target, n_channels)


def _of_answers(answers: Answers, test: Answers | None, target: _Target, n_channels: int) -> _Answered:
    def labels(answers: Answers) -> Ints:
        return answers.label if target.joint_of is None else target.joint_of[answers.label]

    label, label_test = labels(answers), None if test is None else labels(test)
    time_ms = np.asarray(answers.time_ms, np.float64)
    macs = np.asarray(answers.macs, np.float64)
    n_weights = np.asarray(answers.n_weights)
    read_outs = Points(
        n_samples=len(label),
        accuracy=_accuracies(label, target.validation),
        accuracy_test=None if label_test is None else _share_right(label_test, target.test),
        decision_latency_ms=time_ms,
        spikes=answers.input_spikes.mean(axis=0)[:, None],
        n_weights=n_weights,
        load=Operations(
            macs=macs,
            additions=np.asarray(answers.additions, np.float64),
            updates=np.zeros_like(macs),
            n_weights=n_weights,
            duration_ms=time_ms,
            event_macs=answers.event_macs,
            event_additions=answers.event_additions,
            program=answers.program,
            stored_bits=answers.stored_bits,
        ),
        spikes_test=None if test is None else np.zeros(len(time_ms), np.int64),  # it has no neurons
        n_inputs=n_channels,
    )
    return _Answered(
        read_outs=read_outs,
        grid=None,
        label=label[:, -1],
        label_test=None if label_test is None else label_test[:, -1],
        of_lengths={},
    )


def _of_spikes(
    network: Network | Parameters,
    response: Response,
    test: Response | None,
    target: _Target,
    how: _How,
) -> _Answered:
    output = response.output[..., target.outputs]
    output_test = None if test is None else test.output[..., target.outputs]
    n, n_steps = output.shape[:2]
    if not n or not n_steps:
        raise ValueError(
            f"a response must have at least one sample and one step, got output of shape {output.shape}"
        )
    phi, theta = how.phi, how.theta
    lengths = read_out_steps(n_steps, response.step_ms, how.read_out_every_ms)
    label = _labels_after(output, lengths)
    label_test = None if output_test is None else _labels_after(output_test, lengths)
    counted = [response.spikes, response.updates, response.updates > 0]
    done = np.concatenate(counted, axis=2, dtype=np.int32).cumsum(axis=1, dtype=np.int64)
    fired_test = None if test is None else test.spikes[..., 1:].sum(axis=2, dtype=np.int64).cumsum(axis=1)
    sizes = network.sizes if isinstance(network, Network) else None

    def points(
        accuracy: Floats,
        accuracy_test: Floats | None,
        latency_ms: Floats,
        n_steps: Array,
        work: Floats,
        spikes_test: Ints | None,
        decisions: DecisionSurface | None = None,
    ) -> Points:
        return Points(
            n_samples=n,
            accuracy=accuracy,
            accuracy_test=accuracy_test,
            decision_latency_ms=latency_ms,
            spikes=work[..., : response.spikes.shape[2]],
            n_weights=np.full(np.shape(accuracy), network.n_weights),
            load=load_of(network, response, work, n_steps, how.weight_bits),
            decisions=decisions,
            spikes_test=spikes_test,
            n_inputs=None if sizes is None else sizes[0],
            n_neurons=None if sizes is None else sum(sizes[1:]),
        )

    read_outs = points(
        _accuracies(label, target.validation),
        None if label_test is None else _share_right(label_test, target.test),
        lengths * response.step_ms,
        lengths,
        done[:, lengths - 1].mean(axis=0),
        None if fired_test is None else fired_test[:, lengths - 1].sum(axis=0),
    )
    grid, of_lengths, of_test = None, {}, None
    if len(phi) and len(theta):
        step_ms = response.step_ms
        decisions = decision.surface(output, target.validation, phi, theta, step_ms, done)
        total_test = None
        if output_test is not None and fired_test is not None:
            of_test = decision.surface(output_test, target.test, phi, theta, step_ms, fired_test[..., None])
            total_test = np.rint(of_test.work[..., 0] * len(output_test)).astype(np.int64)
        latency_ms = decisions.decision_latency_ms
        grid = points(
            decisions.accuracy,
            None if of_test is None else of_test.accuracy,
            latency_ms,
            latency_ms / step_ms,
            decisions.work,
            total_test,
            decisions,
        )
        early = decision.early(output, target.validation, lengths, phi, theta, step_ms)
        of_lengths = {name: getattr(early, name) for name in _OF_DECISIONS}
        if output_test is not None:
            for name, chosen in (
                ("t_p", (early.phi_p, early.theta_p)),
                ("t_h", (early.phi_h, early.theta_h)),
            ):
                time_ms, right = decision.early_at(
                    output_test, target.test, lengths, step_ms, np.transpose(chosen)
                )
                of_lengths |= {f"{name}_test_ms": time_ms, f"accuracy_at_{name}_test": right}
    return _Answered(
        read_outs=read_outs,
        grid=grid,
        label=label[:, -1],
        label_test=None if label_test is None else label_test[:, -1],
        of_lengths=of_lengths,
        decisions_test=of_test,
        most_output_spikes=int(output.sum(axis=(1, 2), dtype=np.int64).max()),
    )


def read_out_steps(n_steps: int, step_ms: float, every_ms: float | None) -> Ints:
    """Return the steps after which a spiking network is read out, (k,) rising to `n_steps`."""
    if every_ms is None:
        ends = np.linspace(n_steps / READ_OUTS, n_steps, READ_OUTS)
    else:
        ends = np.append(np.arange(every_ms, n_steps * step_ms, every_ms) / step_ms, n_steps)
    lengths = np.unique(np.rint(ends).astype(int))
    return lengths[lengths > 0]


def _accuracies(label: Ints, target: Ints) -> Floats:
    """Return the accuracy of each of k read-outs; label: (n, k)."""
    return np.array([accuracy(column, target) for column in label.T])


def _share_right(label: Ints, target: Ints) -> Floats:
    """Return the fraction that is right of each of k read-outs of any number of samples; label: (n, k)."""
    return np.asarray((label == target[:, None]).mean(axis=0))


def _labels_after(output: Array, lengths: Ints) -> Ints:
    """Return argmax of the output spikes of the first steps, (n, k); the lowest class on ties."""
    counts = np.stack([output[:, :length].sum(axis=1, dtype=np.int64) for length in lengths], axis=1)
    return np.asarray(counts.argmax(axis=2))


def load_of(
    network: Network | Parameters, response: Response, work: Floats, n_steps: Array, weight_bits: int
) -> Workload | Operations:
    """Return the mean work of a spiking classifier as hardware is asked for its cost.

    Args:
        network: what was trained.
        response: of its samples.
        work: (..., layer + 2 (layer - 1)) spikes and updates of the layers, steps in which they are awake.
        n_steps: (...) network steps.
        weight_bits: bits per weight.

    One that is no stack of layers, or whose neurons no chip runs, is operations to hardware. The response has
    the synapses of the former counted.
    """
    n_layers = response.spikes.shape[2]
    ends = [n_layers, n_layers + response.updates.shape[2]]
    spikes, updates, awake = np.split(work, ends, axis=-1)
    additions: Floats
    bits = weight_bits
    if isinstance(network, Network):
        workload = Workload(
            sizes=network.sizes,
            recurrent=tuple(layer.recurrent is not None for layer in network.layers),
            n_steps=n_steps,
            spikes=spikes,
            updates=updates,
            step_ms=response.step_ms,
            weight_bits=weight_bits,
            synapses=response.synapses,
            stored=network.stored,
            delay_bits=network.delay_bits,
            awake=awake,
            copies=len(network.delays),
            peak_state=response.peak_state,
        )
        neurons = [neuron_of(layer.neuron) for layer in network.layers]
        pairs = zip(neurons, network.layers, strict=True)
        resonators = tuple(neuron.resonators(layer.parameters) for neuron, layer in pairs)
        if any(resonators):
            workload = replace(workload, resonators=resonators)
        if network.delay_bits:
            workload = replace(workload, delayed=tuple(x.delay is not None for x in network.layers))
        if all(neuron.on_chips for neuron in neurons):
            return workload
        additions = workload.synaptic_operations
        # Hardware counts updates of neurons with as many states as CUBA-LIF.
        updates = updates * np.array([n.state_updates / CubaLif.state_updates for n in neurons])
        bits = weight_bits if network.arithmetic == "integer" else 32
    else:
        assert response.synapses is not None  # the family counts what no stack says
        additions = sum_of_products(spikes, np.array(response.synapses))
        updates = updates * np.array(response.update_work or 1.0)
    return Operations(
        macs=np.zeros_like(additions),
        additions=additions,
        updates=updates.sum(axis=-1),
        n_weights=np.full(additions.shape, network.n_weights),
        duration_ms=np.asarray(n_steps * response.step_ms, np.float64),
        number_bits=bits,
    )
