"""One training run -> the record's columns, as the registered objectives measure them.

A run answers to targets (one, or the heads of a joint net and all of them together), on parts of the samples
(validation, test, moved windows, groups that a training left out), at places: after each input length, and at
every (phi, theta). `_Target` and `DecisionGrid` are these keys; accuracies of all are computed alike.

The full read-out answers at the end of the window: a spiking network by argmax of its output spike counts
(lowest class on ties), any other classifier as it does. Earlier read-outs answer after a shorter input. Every
(phi, theta) setting of a spiking network answers when it is confident; what that costs is the mean work that
was done up to each sample's own decision, never a share of the whole.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dse import store
from dse.base import registry
from dse.base.records import (
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
from dse.config.space import DecisionGrid
from dse.engine.neurons import neuron_of
from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.fixed_point import in_steps, needed_bits, quantise
from dse.measure import decision
from dse.measure.confusion import confusion
from dse.measure.hardware.cost import NotApplicable
from dse.measure.hardware.profile import Profile
from dse.measure.heads import head_answers, head_slices, joint_label
from dse.measure.numbers import Numbers
from dse.measure.objectives import FullReadOut, Needs, Points, Priced, flat, measured
from dse.measure.objectives.accuracy_unseen import unseen_name
from dse.measure.on_chips import columns_on

READ_OUTS = 20
"""Input lengths, evenly spaced, after which a spiking network is read out unless their distance is given."""

Columns = dict[str, Array]
Moved = tuple[int, Ints, Response | Answers]
"""A shift, validation samples (n,), rising and the same at each, and the answers to their moved windows."""


@dataclass(frozen=True)
class Measurement:
    """What one run measured, on the validation set unless the name says test.

    numbers: of the full read-out; of the whole classifier, and of each head of a joint one.
    files: name, of a head with `_<head>` before .npz -> arrays:
        confusion.npz   validation, test: (true class, answered class) counts of the full read-out
        shifts.npz      shift, accuracy: (shift,) of the full read-out on moved windows
        read_out.npz    column -> (k,), after k input lengths; not of a joint net, whose heads have them
        surface.npz     phi, theta, column -> (phi, theta); with a decision grid
        The last two hold the mean work of the answers too, which any hardware can be asked the cost of
        (`store.work_of`), and `unseen_name` names the accuracies of a fold.
    """

    numbers: Numbers
    files: dict[str, Columns]


@dataclass(frozen=True)
class Accuracies:
    """Accuracies of one target on some samples, at all places.

    read_outs: (k,) after k input lengths, the last of which is the full read-out.
    grid: (phi, theta); None without a grid.
    """

    read_outs: Floats
    grid: Floats | None


OfTargets = Mapping[str, Accuracies]
"""Accuracies of the target, '', and of a joint one also of each head, by name."""
UnseenTargets = Mapping[str, Mapping[str, OfTargets]]
"""Label column -> fold of its values -> accuracies after a training without the fold."""


@dataclass(frozen=True)
class _Target:
    """What is to be answered: the classes of a data set, or one head of them.

    head: None: the classes themselves; of a joint target they are right where all heads are.
    outputs: output neurons that answer.
    """

    dataset: Dataset
    head: Head | None = None
    outputs: slice = field(default_factory=lambda: slice(None))

    @property
    def is_joint(self) -> bool:
        """Whether several heads are to be right together; they answer at the end of the window alone."""
        return self.head is None and bool(self.dataset.heads)

    @property
    def n_classes(self) -> int:
        return len((self.head or self.dataset).classes)

    @property
    def lengths(self) -> slice:
        """Those of the input lengths after which it is answered."""
        return slice(-1, None) if self.is_joint else slice(None)

    def decides(self, grid: DecisionGrid) -> bool:
        """Return whether it is decided before the end of the window too."""
        return bool(len(grid.phi) and len(grid.theta)) and not self.is_joint

    def truth(self, samples: Ints) -> Ints:
        """Return the true classes of some samples, (n,)."""
        classes = self.dataset.target[samples]
        return classes if self.head is None else self.head.of_class[classes]

    def output(self, response: Response) -> Array:
        """Return the output spikes that answer, (n, T, output)."""
        return response.output[..., self.outputs]

    def steps(self, response: Response, grid: DecisionGrid) -> Ints:
        """Return the steps after which a response is read out, (k,)."""
        steps = read_out_steps(response.output.shape[1], response.step_ms, grid.read_out_every_ms)
        return steps[self.lengths]

    def label(self, answers: Response | Answers, grid: DecisionGrid) -> Ints:
        """Return the class that is answered after k input lengths, (n, k); -1 where heads name no class."""
        if isinstance(answers, Answers):
            label = answers.label[:, self.lengths]
            return label if self.head is None else self.head.of_class[label]
        if self.is_joint:
            counts = answers.output.sum(axis=1, dtype=np.int64)
            return joint_label(head_answers(self.dataset, counts), self.dataset.heads)[:, None]
        output = self.output(answers)
        counts = [output[:, :n].sum(axis=1, dtype=np.int64) for n in self.steps(answers, grid)]
        return np.asarray(np.stack(counts, axis=1).argmax(axis=2))

    def accuracies(self, answers: Response | Answers, samples: Ints, grid: DecisionGrid) -> Accuracies:
        """Return the accuracies of the answers to some samples."""
        truth, decided = self.truth(samples), None
        if self.decides(grid) and isinstance(answers, Response):
            surface = decision.surface(self.output(answers), truth, grid.phi, grid.theta, answers.step_ms)
            decided = surface.accuracy
        return Accuracies(_share_right(self.label(answers, grid), truth), decided)

    def confusion(self, label: Ints, truth: Ints) -> Ints:
        """Return the confusion of (n,) answers; of joint classes, a last column counts the labels -1."""
        if not self.is_joint:
            return confusion(label, truth, self.n_classes)
        named = label >= 0
        unnamed = np.bincount(truth[~named], minlength=self.n_classes)
        return np.column_stack([confusion(label[named], truth[named], self.n_classes), unnamed])


@dataclass(frozen=True)
class _Answered:
    """What a run answers to one target, as objectives take it.

    read_outs: after k input lengths. grid: at every (phi, theta); None without a grid.
    of_lengths: further columns (k,) of the read-outs.
    """

    read_outs: Points
    grid: Points | None
    full: FullReadOut
    of_lengths: Columns


def measure(
    outcome: Outcome,
    dataset: Dataset,
    grid: DecisionGrid,
    hardware: Sequence[Profile],
    weight_bits: int = 8,
    moved: Iterable[Moved] = (),
    unseen: UnseenTargets | None = None,
) -> Measurement:
    """Measure one run.

    Args:
        outcome: what the model family returned.
        dataset: what it was trained on.
        grid: of decisions, with numbers of phi; empty for the read-outs only. Spiking families alone have it.
        hardware: profiles that the full read-out is priced on.
        weight_bits: bits per weight of a spiking network.
        moved: of each shift.
        unseen: accuracies on groups after trainings without them; None: there were none.

    Raises:
        ValueError: a response holds no samples, or the grid is out of range.
    """
    targets = _targets(dataset)
    shifts: dict[str, list[Accuracies]] = {name: [] for name in targets}
    at, n_shifted = [], 0
    for shift, samples, answers in _and_unmoved(moved, outcome, dataset):
        at.append(shift)
        n_shifted = len(samples)
        for name, target in targets.items():
            shifts[name].append(target.accuracies(answers, samples, grid))
    files: dict[str, Columns] = {}
    of_targets = {}
    for name, target in targets.items():
        folds = {
            column: {fold: of_fold[name] for fold, of_fold in of_column.items()}
            for column, of_column in (unseen or {}).items()
        }
        answered = _with_shifts(_answered(outcome, target, grid, folds, weight_bits), shifts[name], n_shifted)
        of_targets[name] = _numbers(answered, hardware)
        suffix = f"_{name}.npz" if name else ".npz"
        files |= {f"{x}{suffix}": y for x, y in _files(answered, target, grid, at[1:], folds).items()}
    numbers = of_targets.pop("")
    if of_targets:
        names = [name for name in ("accuracy", "accuracy_test") if name in numbers.columns]
        of_heads = {f"{x}_{name}": head.columns[x] for x in names for name, head in of_targets.items()}
        numbers = replace(numbers, columns={**numbers.columns, **of_heads}, of_heads=of_targets)
    return Measurement(numbers, files)


def accuracies(answers: Response | Answers, dataset: Dataset, samples: Ints, grid: DecisionGrid) -> OfTargets:
    """Return the accuracies of answers, '' of the target, and of a joint one also of each head, by name.

    Args:
        answers: to the samples.
        dataset: their classes and heads.
        samples: (n,) sample numbers, n >= 1.
        grid: as of `measure`.
    """
    return {name: x.accuracies(answers, samples, grid) for name, x in _targets(dataset).items()}


def _targets(dataset: Dataset) -> dict[str, _Target]:
    """Return what is to be answered: the heads of a joint target by name, and ''."""
    pairs = zip(dataset.heads, head_slices(dataset), strict=bool(dataset.heads))
    return {head.name: _Target(dataset, head, outputs) for head, outputs in pairs} | {"": _Target(dataset)}


def _and_unmoved(moved: Iterable[Moved], outcome: Outcome, dataset: Dataset) -> Iterator[Moved]:
    """Yield what a run answers to the unmoved windows of the moved samples, then to the moved ones."""
    for number, (shift, samples, answers) in enumerate(moved):
        if not number:
            among, unmoved = np.isin(dataset.validation, samples), outcome.validation
            if isinstance(unmoved, Answers):
                yield 0, samples, replace(unmoved, label=unmoved.label[among])
            else:
                yield 0, samples, replace(unmoved, output=unmoved.output[among])
        yield shift, samples, answers


def _with_shifts(answered: _Answered, shifts: Sequence[Accuracies], n: int) -> _Answered:
    """Return answers with the accuracies on windows of n samples: unmoved, then at every shift."""
    if not shifts:
        return answered

    def beside(points: Points, of: Sequence[Floats]) -> Points:
        return replace(points, shifted=np.stack(of[1:]), unshifted=of[0], n_shifted=n)

    grid, grids = answered.grid, [x.grid for x in shifts if x.grid is not None]
    return replace(
        answered,
        read_outs=beside(answered.read_outs, [x.read_outs for x in shifts]),
        grid=None if grid is None else beside(grid, grids),
    )


def records_for_objectives(
    outcome: Outcome, dataset: Dataset, grid: DecisionGrid, hardware: Sequence[Profile]
) -> list[tuple[Needs, Points | FullReadOut | Priced]]:
    """Return what objectives measure of one run of a single target, each with what needs it.

    Args:
        outcome: what the model family returned.
        dataset: what it was trained on, without heads.
        grid: as of `measure`.
        hardware: profiles; one that cannot run the classifier adds nothing.
    """
    answered = _answered(outcome, _Target(dataset), grid, {})
    points = [one for one in (answered.read_outs, answered.grid) if one is not None]
    records: list[tuple[Needs, Points | FullReadOut | Priced]] = [("points", one) for one in points]
    records.append(("full_read_out", answered.full))
    for chip in hardware:
        for one in points:
            with contextlib.suppress(NotApplicable):
                records.append(("hardware", Priced.on(chip, one.load)))
    return records


def read_out(output: Array) -> Ints:
    """Return the class with most output spikes over the window, (n,); the lowest class on ties."""
    return np.asarray(output.sum(axis=1, dtype=np.int64).argmax(axis=1))


def _numbers(answered: _Answered, hardware: Sequence[Profile]) -> Numbers:
    """Return the numbers of the full read-out; health that is one number is a column as well."""
    answer, of_lengths = answered.full, measured("points", answered.read_outs)
    of_answer = measured("full_read_out", answer)
    train_s = of_answer.pop("train_s")
    health = {name: x for name, x in answer.outcome.health.items() if isinstance(x, bool | int | float)}
    last = answered.read_outs.load.mapped(lambda counts: counts[-1])
    return Numbers(
        {
            **flat({name: x[-1] for name, x in of_lengths.items()}),
            **flat(of_answer),
            **health,
            "train_s": train_s,
        },
        {chip.name: flat(columns_on(chip, last)) for chip in hardware},
        unseen=answer.unseen,
    )


def _files(
    answered: _Answered,
    target: _Target,
    grid: DecisionGrid,
    shifts: Sequence[int],
    unseen: Mapping[str, Mapping[str, Accuracies]],
) -> dict[str, Columns]:
    """Return the arrays of a target, as in `Measurement.files`, without head and suffix in their names."""
    read_outs, answer = answered.read_outs, answered.full
    matrices = {"validation": answer.confusion, "test": answer.confusion_test}
    files: dict[str, Columns] = {
        "confusion": {name: x[:, : target.n_classes] for name, x in matrices.items() if x is not None}
    }
    if read_outs.shifted is not None:
        files["shifts"] = {"shift": np.array(shifts), "accuracy": read_outs.shifted[:, -1]}
    if target.is_joint:
        return files
    folds = {unseen_name(i): x for i, x in enumerate(x for of in unseen.values() for x in of.values())}
    files["read_out"] = {
        **measured("points", read_outs),
        **answered.of_lengths,
        **{name: x.read_outs for name, x in folds.items()},
        **store.work_arrays(read_outs.load),
    }
    if answered.grid is not None:
        declared, decided = registry.columns("points"), measured("points", answered.grid)
        files["surface"] = {
            **{"phi": grid.phi, "theta": grid.theta},
            **{name: x for name, x in decided.items() if not declared[name].of_design},
            **{name: x.grid for name, x in folds.items() if x.grid is not None},
            **store.work_arrays(answered.grid.load),
        }
    return files


def _answered(
    outcome: Outcome,
    target: _Target,
    grid: DecisionGrid,
    unseen: Mapping[str, Mapping[str, Accuracies]],
    weight_bits: int = 8,
) -> _Answered:
    """Return what a run answers to a target; a family answers in one way, on validation and on test."""
    validation, test, dataset = outcome.validation, outcome.test, target.dataset
    if isinstance(validation, Response) and not (validation.output.shape[0] and validation.output.shape[1]):
        shape = target.output(validation).shape
        raise ValueError(
            f"a response must have at least one sample and one step, got output of shape {shape}"
        )
    truth, label = target.truth(dataset.validation), target.label(validation, grid)
    right, of_test = _share_right(label, truth), None
    label_test = truth_test = None
    if test is not None:
        truth_test, label_test = target.truth(dataset.test), target.label(test, grid)
        of_test = _share_right(label_test, truth_test)
    if isinstance(validation, Response):
        spiking = _of_spikes(outcome, target, grid, weight_bits, right, of_test)
        read_outs, decided, of_lengths, decisions_test = spiking
        most = int(target.output(validation).sum(axis=(1, 2), dtype=np.int64).max())
    else:
        read_outs = _of_answers(validation, right, of_test, target)
        decided, of_lengths, decisions_test, most = None, {}, None, None
    joint = target.is_joint
    full = FullReadOut(
        outcome=outcome,
        label=label[:, -1],
        target=truth,
        confusion=target.confusion(label[:, -1], truth),
        decision_latency_ms=read_outs.decision_latency_ms[-1].item(),
        read_outs=None if joint else read_outs,
        decisions=None if decided is None else decided.decisions,
        decisions_test=decisions_test,
        confusion_test=None
        if label_test is None or truth_test is None
        else target.confusion(label_test[:, -1], truth_test),
        most_output_spikes=None if joint else most,
        target_test=None if joint else truth_test,
        unseen={
            column: {fold: float(x.read_outs[-1]) for fold, x in of.items()} for column, of in unseen.items()
        },
    )
    return _Answered(read_outs, decided, full, of_lengths)


def _share_right(label: Ints, truth: Ints) -> Floats:
    """Return the fraction that is right of each of k read-outs, (k,); label: (n, k)."""
    return np.asarray((label == truth[:, None]).mean(axis=0))


def _of_answers(answers: Answers, right: Floats, of_test: Floats | None, target: _Target) -> Points:
    """Return the read-outs of a classifier without output spikes, with their accuracies."""
    time_ms, macs = np.asarray(answers.time_ms, np.float64), np.asarray(answers.macs, np.float64)
    load = Operations(
        macs=macs,
        additions=np.asarray(answers.additions, np.float64),
        updates=np.zeros_like(macs),
        n_weights=np.asarray(answers.n_weights),
        duration_ms=time_ms,
        number_bits=answers.stored_bits or 32,
        event_macs=answers.event_macs,
        event_additions=answers.event_additions,
        program=answers.program,
        stored_bits=answers.stored_bits,
    ).mapped(lambda counts: counts[target.lengths])
    return Points(
        n_samples=len(answers.label),
        accuracy=right,
        accuracy_test=of_test,
        decision_latency_ms=load.duration_ms,
        spikes=answers.input_spikes[:, target.lengths].mean(axis=0)[:, None],
        n_weights=np.asarray(answers.n_weights)[target.lengths],
        load=load,
        spikes_test=None if of_test is None else np.zeros(len(right), np.int64),  # it has no neurons
        n_inputs=target.dataset.spikes.n_channels,
    )


def _of_spikes(
    outcome: Outcome,
    target: _Target,
    grid: DecisionGrid,
    weight_bits: int,
    right: Floats,
    of_test: Floats | None,
) -> tuple[Points, Points | None, Columns, DecisionSurface | None]:
    """Return the read-outs of a spiking classifier and the grid, as `_Answered`, and the test set's surface.

    Args:
        outcome: of the training, which answers with spikes.
        target: what is answered.
        grid: of decisions.
        weight_bits: bits per weight.
        right: (k,) accuracy of the read-outs.
        of_test: (k,) the same of the test set.
    """
    network, response, test = outcome.network, outcome.validation, outcome.test
    assert isinstance(response, Response) and not isinstance(test, Answers)
    output, truth = target.output(response), target.truth(target.dataset.validation)
    lengths, step_ms = target.steps(response, grid), response.step_ms
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
            n_samples=len(output),
            accuracy=accuracy,
            accuracy_test=accuracy_test,
            decision_latency_ms=latency_ms,
            spikes=work[..., : response.spikes.shape[2]],
            n_weights=np.full(np.shape(accuracy), network.n_weights),
            load=load_of(network, response, work, n_steps, weight_bits),
            decisions=decisions,
            spikes_test=spikes_test,
            n_inputs=None if sizes is None else sizes[0],
            n_neurons=None if sizes is None else sum(sizes[1:]),
        )

    summed_test = None if fired_test is None else fired_test[:, lengths - 1].sum(axis=0)
    work = done[:, lengths - 1].mean(axis=0)
    read_outs = points(right, of_test, lengths * step_ms, lengths, work, summed_test)
    if not target.decides(grid):
        return read_outs, None, {}, None
    decisions = decision.surface(output, truth, grid.phi, grid.theta, step_ms, done)
    early = decision.early(output, truth, lengths, grid.phi, grid.theta, step_ms)
    of_lengths: Columns = {name: x for name, x in early.items() if name not in ("time_ms", "accuracy")}
    surface_test = None
    if test is not None and fired_test is not None:
        output_test, truth_test = target.output(test), target.truth(target.dataset.test)
        surface_test = decision.surface(
            output_test, truth_test, grid.phi, grid.theta, step_ms, fired_test[..., None]
        )
        summed_test = np.rint(surface_test.work[..., 0] * len(output_test)).astype(np.int64)
        for end in ("p", "h"):
            chosen = np.transpose((early[f"phi_{end}"], early[f"theta_{end}"]))
            times = decision.early_at(output_test, truth_test, lengths, step_ms, chosen)
            of_lengths |= zip((f"t_{end}_test_ms", f"accuracy_at_t_{end}_test"), times, strict=True)
    latency_ms = decisions.decision_latency_ms
    accuracy_test = None if surface_test is None else surface_test.accuracy
    decided = points(
        decisions.accuracy,
        accuracy_test,
        latency_ms,
        latency_ms / step_ms,
        decisions.work,
        summed_test,
        decisions,
    )
    return read_outs, decided, of_lengths, surface_test


def read_out_steps(n_steps: int, step_ms: float, every_ms: float | None) -> Ints:
    """Return the steps after which a spiking network is read out, (k,) rising to `n_steps`."""
    if every_ms is None:
        ends = np.linspace(n_steps / READ_OUTS, n_steps, READ_OUTS)
    else:
        ends = np.append(np.arange(every_ms, n_steps * step_ms, every_ms) / step_ms, n_steps)
    lengths = np.unique(np.rint(ends).astype(int))
    return lengths[lengths > 0]


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
        layers = network.layers
        neurons = [neuron_of(layer.neuron) for layer in layers]
        pairs = zip(neurons, layers, strict=True)
        resonators = tuple(neuron.resonators(layer.parameters) for neuron, layer in pairs)
        steps = (in_steps(quantise(m)) for layer in layers for m in layer.matrices)
        workload = Workload(
            sizes=network.sizes,
            recurrent=tuple(layer.recurrent is not None for layer in layers),
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
            steps_per_sample=network.steps_per_sample,
            n_slots=network.n_slots,
            resonators=resonators if any(resonators) else None,
            delayed=tuple(layer.delay is not None for layer in layers) if network.delay_bits else None,
            needed_bits=tuple(map(needed_bits, steps)) if network.arithmetic == "integer" else None,
        )
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
