"""The sections of a search space that name no component: one frozen dataclass each.

Other packages apply the settings: windows and splits in `dse.data.recordings`, training in `dse.models`.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Literal

from dse.base import registry
from dse.base.registry import fixed, param
from dse.config.bounds import MOST_EPOCHS, MOST_SAMPLES
from dse.config.faults import known_names
from dse.config.parts import KeyFault, Part, Written, named, target_columns
from dse.config.values import refuse
from dse.config.yaml_lines import Raw

DEVICES = ("cpu", "cuda")
POLARITIES = ("split", "merge", "ignore_off", "ignore_on")

CUT_COLUMNS = ("recording", "window")
"""Label columns of the windows that recordings are cut into (`window.cut_steps`)."""


@dataclass(frozen=True)
class Column:
    """A label column as (part of) the target."""

    column: str = param(doc="name of a label column")
    abs: bool = param(False, doc="its absolute value")


Target = str | Column | tuple[str | Column, ...]
"""What is predicted: a label column, or a combination of several."""


@dataclass(frozen=True)
class Task:
    """What is predicted."""

    target: Target = param(  # noqa: RUF009
        doc="label column to predict, `{column: NAME, abs: true}` for its absolute value, or a list of "
        "these, whose combination is predicted"
    )
    joint: bool = fixed(
        False,
        doc="if target is a list: also report each of its columns; networks get one output group per column",
    )
    name: str = fixed("", doc="name of the task in tables (default: the columns of the target)")


@dataclass(frozen=True)
class Window:
    """A window of fixed length; training windows are shifted by up to `jitter_steps` in either direction."""

    n_steps: int | None = param(None, doc="window length (default: whole recordings)", unit="steps", low=1)
    at: str = param(
        "middle", doc="position of the window in the recording", choices=("start", "middle", "contact_onset")
    )
    jitter_steps: int = param(
        0, doc="training windows are shifted at random by up to this many steps", unit="steps", low=0
    )
    onset_threshold: float = param(
        3.0,
        doc="contact begins when a channel differs this much from its first sample, or a bin has this many "
        "events",
        low=0,
        low_open=True,
    )
    remove_mean: bool = param(
        False,
        doc="subtract the mean of each channel over the window (sampled signals; encoders of changes do not "
        "need it)",
    )
    cut_steps: int | None = param(
        None,
        doc="first cut every recording into windows of this length, which then count as recordings; the "
        "label columns 'recording' and 'window' number the original and the window (default: no cutting)",
        unit="steps",
        low=1,
    )
    every_steps: int | None = param(
        None,
        doc="steps from the start of one such window to the next (default: cut_steps)",
        unit="steps",
        low=1,
    )
    pad: bool = param(
        False, doc="recordings shorter than n_steps hold their last sample until then (sampled signals)"
    )

    def __post_init__(self) -> None:
        """Check the rules across keys."""
        if self.pad and (self.n_steps is None or self.cut_steps is not None):
            raise ValueError("window.pad needs window.n_steps, and no window.cut_steps")
        if self.cut_steps is None and self.every_steps is not None:
            raise ValueError("window.every_steps needs window.cut_steps")
        if self.cut_steps is not None and self.n_steps is not None and self.n_steps > self.cut_steps:
            raise ValueError(
                f"window.n_steps must be at most window.cut_steps = {self.cut_steps}, got {self.n_steps}"
            )


@dataclass(frozen=True)
class Stratified:
    """A random draw of the same fraction of every class."""

    validation: float = param(doc="fraction of every class", low=0, low_open=True, high=1, high_open=True)
    test: float | Mapping[str, Raw] = param(
        0.0,
        doc="fraction of every class, or column -> value or values, of a test set that is given",
        low=0,
        high=1,
        high_open=True,
    )
    seed: int = param(0, doc="seed of the random split", low=0)
    group: str | None = param(
        None, doc="label column; recordings of one value stay together, fractions as near as that allows"
    )


@dataclass(frozen=True)
class KFold:
    """Every recording outside the test set validates in one of k folds and trains in the others.

    The test set is the same in all folds.
    """

    k: int = param(10, doc="number of folds", low=2)
    group: str | None = param(None, doc="label column; recordings of one value are in one part")
    test: float | Mapping[str, Raw] | None = param(
        None,
        doc="fraction of every class, or column -> value or values, of a separate test set",
        low=0,
        low_open=True,
        high=1,
        high_open=True,
    )
    seed: int = param(1, doc="seed of the random split", low=0)
    fold: int = param(
        0, doc="fold that validates; a study validates repeat r of a design on fold r modulo k", low=0
    )

    def __post_init__(self) -> None:
        """Check the rules across keys."""
        if self.fold >= self.k:
            raise ValueError(f"split.k_fold.fold must be below k = {self.k}, got {self.fold}")


@dataclass(frozen=True)
class LeaveOut:
    """One group validates, the rest trains."""

    column: str = param(doc="label column that defines the groups")
    value: Raw = param(doc="value of the group that is left out")  # noqa: RUF009


@dataclass(frozen=True)
class Split:
    """How recordings are split: by label values (`train`, `validation`, `test`) or by another key."""

    train: Mapping[str, Raw] | None = param(
        None, doc="training set: mapping from label column to value or list of values"
    )
    validation: Mapping[str, Raw] | None = param(
        None, doc="validation set: mapping from label column to value or list of values"
    )
    test: Mapping[str, Raw] | None = param(
        None, doc="test set: mapping from label column to value or list of values"
    )
    stratified: Stratified | None = param(  # noqa: RUF009
        None, doc="random split with the same fraction of every class; keys validation, test, seed, group"
    )
    k_fold: KFold | None = param(  # noqa: RUF009
        None, doc="cross-validation: one fold validates, the others train; keys k, group, test, seed"
    )
    leave_out: LeaveOut | None = param(  # noqa: RUF009
        None, doc="one group validates, all others train; keys column, value"
    )

    def __post_init__(self) -> None:
        """Check that there is one rule, and that it is complete."""
        by_column = self.train is not None or self.validation is not None or self.test is not None
        others = (self.stratified, self.k_fold, self.leave_out)
        if by_column + sum(rule is not None for rule in others) != 1:
            raise ValueError(
                "split must be one of: train and validation by column, stratified, k_fold, leave_out"
            )
        if by_column and not (self.train and self.validation):
            raise ValueError(
                "split needs both train and validation; where recordings are given as train and test, "
                "{stratified: {validation: 0.2, test: {COLUMN: test}}} draws validation from the former"
            )

    @property
    def has_test(self) -> bool:
        """Whether a part of the recordings is the test set."""
        return any(rule is not None and rule.test for rule in (self, self.stratified, self.k_fold))

    def columns(self) -> tuple[str, ...]:
        """Return the label columns that the split reads."""
        named: list[str | None] = [*(self.train or {}), *(self.validation or {}), *(self.test or {})]
        for rule in (self.stratified, self.k_fold):
            if rule is not None:
                named += [rule.group, *(rule.test if isinstance(rule.test, Mapping) else ())]
        if self.leave_out is not None:
            named.append(self.leave_out.column)
        return tuple(dict.fromkeys(name for name in named if name is not None))


@dataclass(frozen=True)
class Groups:
    """The values of a label column, which are left out of training in turn."""

    column: str = param(doc="label column that defines the groups")
    folds: int | None = param(
        None, doc="number of folds that the values are dealt to (default: one fold per value)", low=2
    )
    seed: int = param(1, doc="seed of the folds", low=0)


@dataclass(frozen=True)
class Evaluation:
    """What else a trained design is tested on: moved windows, and groups that training leaves out."""

    shifts: tuple[int, ...] | None = param(
        None,
        doc="moves of the evaluated window, without further training (negative: towards the start): columns "
        "accuracy_shifted and accuracy_shifted_min. Shifts up to window.jitter_steps lie inside the training "
        "crops of spiking networks, and of all families with training.crops; larger ones lie outside. "
        "Validation recordings without room for every shift are left out; n_shifted counts the rest, and "
        "accuracy_unshifted is of their unmoved windows. A run's shifts.npz has the accuracy at each shift",
        unit="steps",
    )
    leave_out: str | Groups | tuple[str | Groups, ...] | None = param(  # noqa: RUF009
        None,
        doc="label column, `{column: NAME, folds: N, seed: S}`, or a list of these: each fold of its values "
        "is left out of training once, and its validation recordings are answered: column accuracy_unseen, "
        "and accuracy_unseen_NAME for each label column. The folds are shared out among search.repeats",
    )

    def __post_init__(self) -> None:
        """Check that something is evaluated, once."""
        if self.shifts is None and self.leave_out is None:
            raise ValueError("evaluation needs shifts or leave_out")
        if self.shifts is not None and not self.shifts:
            raise ValueError("evaluation.shifts must hold at least one shift, got []")
        if self.leave_out == ():
            raise ValueError("evaluation.leave_out must hold at least one column, got []")
        for key, entries in (("shifts", self.shifts or ()), ("leave_out", [x.column for x in self.groups])):
            if twice := [x for i, x in enumerate(entries) if x in entries[:i]]:
                raise ValueError(f"evaluation.{key} must hold each entry once, got {twice[0]!r} twice")

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield what the windows, the columns and the split lack for shifts and groups."""
        if not part.good:
            return
        evaluation: Evaluation = part.fixed
        if evaluation.shifts is not None:
            if None in space.range("window", "n_steps"):
                text = "needs window.n_steps: a window of a whole recording has no room to move"
                yield part.fault("shifts", text)
            if any(space.range("preprocessing", "rate_floor_hz")):
                text = "needs preprocessing.rate_floor_hz 0: the floor reads steps around a window"
                yield part.fault("shifts", text)
        predicted = [x for target in space.range("task", "target") for x in target_columns(target)]
        known = [name for data in space.each("data") if data.good for name in data.fixed.columns]
        if known and any(space.range("window", "cut_steps")):
            known += CUT_COLUMNS
        for name in (groups.column for groups in evaluation.groups):
            if known and name not in known:
                text = f"must be among data.columns, got '{name}'; {known_names(name, known)}"
                yield part.fault("leave_out", text)
            elif name in predicted:
                yield part.fault(
                    "leave_out", f"must not be the target, got '{name}', which task.target predicts"
                )
        if evaluation.groups and any(space.range("split", "k_fold")):
            yield part.fault("leave_out", "needs a split without k_fold, whose folds the repeats are")

    @property
    def groups(self) -> tuple[Groups, ...]:
        """The groups that are left out, a column each."""
        entries = self.leave_out if isinstance(self.leave_out, tuple) else (self.leave_out,)
        return tuple(Groups(x) if isinstance(x, str) else x for x in entries if x is not None)

    @property
    def reach(self) -> int:
        """Largest distance by which a window is moved, in steps."""
        return max(map(abs, self.shifts or (0,)))


@dataclass(frozen=True)
class Preprocessing:
    """How event recordings become spikes; pairs are [along x, along y], one number stands for both."""

    bin_ms: float = param(doc="duration of a time bin (one step), a multiple of 1 us", unit="ms", low=0.001)
    pool: int | tuple[int, int] = param(1, doc="sides of the pooling kernel", unit="pixels", low=1)
    stride: int | tuple[int, int] | None = param(
        None, doc="step from one pool to the next (default: the sides of the kernel)", unit="pixels", low=1
    )
    padding: int | tuple[int, int] = param(
        0, doc="empty pixels added on every side, fewer than the sides of the kernel", unit="pixels", low=0
    )
    pool_threshold: int = param(
        1,
        doc="number of events in a pool and bin that makes a spike; counts saturate at 255",
        unit="events",
        low=1,
        high=254,
    )
    exceeds: bool = param(False, doc="true: a spike needs strictly more events than pool_threshold")
    polarity: str = param(
        "split",
        doc="split: ON and OFF are separate channels; merge: they are counted together; ignore_off, "
        "ignore_on: only the other",
        choices=POLARITIES,
    )
    every_event: bool = param(
        False,
        doc="true: every event of a channel is a spike at its own microsecond, for classifiers and encoders "
        "that count spikes or read their times; bins only place windows and answers",
    )
    crop: Literal["pins"] | tuple[int, int, int, int] | None = param(
        None,
        doc="[x, y, width, height] of the pixels to keep, or pins: the rectangle that contains the pins (of "
        "recorded events: the pixels with events in the training recordings)",
        unit="pixels",
        low=0,
    )
    time_ms: tuple[float, float] | None = param(
        None,
        doc="[from, to): keep the events in this interval, counted from the first event of a recording (of "
        "a simulated trial: from its start)",
        unit="ms",
        low=0,
    )
    rate_floor_hz: float = param(
        0.0,
        doc="silence the pooled channels of a recording whose mean rate over the whole window is below "
        "this; a device that decides during the touch cannot apply it",
        unit="Hz",
        low=0,
    )

    def __post_init__(self) -> None:
        """Check the rules across keys."""
        pool, padding = pair(self.pool), pair(self.padding)
        if any(edge >= side for edge, side in zip(padding, pool, strict=True)):
            raise ValueError(
                f"padding must be smaller than pool ({_shown(self.pool)}), so that every pool contains a "
                f"pixel; got {_shown(self.padding)}"
            )
        if self.every_event and (self.pool_threshold + self.exceeds > 1 or self.rate_floor_hz):
            raise ValueError(
                "every_event needs pool_threshold 1, exceeds false and rate_floor_hz 0, got "
                f"{self.pool_threshold}, {str(self.exceeds).lower()} and {self.rate_floor_hz:g}"
            )
        if isinstance(self.crop, tuple) and min(self.crop[2:]) < 1:
            raise ValueError(
                f"crop must be [x, y, width, height] of at least one pixel, got {_shown(self.crop)}"
            )
        if self.time_ms is not None and self.time_ms[1] - self.time_ms[0] < 0.001:
            raise ValueError(
                f"time_ms must end at least 0.001 ms after it begins, got [{self.time_ms[0]:g}, "
                f"{self.time_ms[1]:g}]"
            )

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield the models that cannot take every event as a spike."""
        if "encoder" in space.parts or True not in part.range("every_event"):
            return
        for model in space.each("model"):
            if not getattr(model.cls, "takes_events", False):
                text = "without an encoder, which takes one spike per channel and bin, got true"
                yield part.fault("every_event", f"must be false for model {model.kind} {text}")

    @property
    def step_ms(self) -> float:
        """Duration of an input step: a bin."""
        return self.bin_ms

    @property
    def bin_us(self) -> int:
        """Width of a bin in whole microseconds."""
        return round(self.bin_ms * 1000)


def pair(value: int | tuple[int, int]) -> tuple[int, int]:
    """Return one number as the same number along x and y."""
    return (value, value) if isinstance(value, int) else (value[0], value[1])


def _shown(value: int | tuple[int, ...]) -> str:
    return str(value if isinstance(value, int) else list(value))


@dataclass(frozen=True)
class Training:
    """Adam with a step schedule; every default is a published or a measured value."""

    epochs: int = param(60, low=1, high=MOST_EPOCHS, doc="passes over the training samples")
    batch_size: int = param(
        32,
        low=1,
        high=MOST_SAMPLES,
        doc="samples per weight update; the last batch of an epoch may be smaller",
    )
    learning_rate: float = param(0.03, low=0, low_open=True, doc="step size of Adam, in units of `step_unit`")
    step_unit: str = param(
        "initial",
        choices=("initial", "weight"),
        doc="initial: the initial root mean square weight of each neuron; weight: weight units, as in SLAYER",
    )
    hidden_lr_factor: float = param(
        1.0, low=0, doc="factor on the learning rate of all layers before the outputs (spiking networks)"
    )
    warmup_epochs: float = param(
        0.0, low=0, unit="epochs", doc="the learning rate rises from 0 during these epochs"
    )
    lr_schedule: Literal["steps", "cosine"] = param(
        "steps",
        choices=("steps", "cosine"),
        doc="steps: the learning rate is multiplied by lr_factor every lr_every epochs; cosine: it falls to "
        "0 along half a cosine",
    )
    lr_factor: float = param(
        0.67, low=0, low_open=True, high=1, doc="factor on the learning rate at each step of the schedule"
    )
    lr_every: int = param(20, low=1, unit="epochs", doc="epochs between steps of the schedule")
    output_epochs: int = param(
        0,
        low=0,
        unit="epochs",
        doc="first epochs, in which the outputs learn alone: the spikes of hidden layers are computed once, "
        "in the windows that are evaluated. Outputs begin as a softmax readout of their counts; moments and "
        "schedule of the learning rate begin anew afterwards (spiking networks)",
    )
    output_learning_rate: float | None = param(
        None,
        low=0,
        low_open=True,
        doc="step size of Adam in these epochs (default: learning_rate)",
    )
    average_epochs: int = param(
        1, low=1, unit="epochs", doc="the final weights are the mean over this many last epochs"
    )
    keep: str = param(
        "last",
        choices=("last", "best"),
        doc="best: keep weights, delays and decays of the epoch with the best validation accuracy, of equal "
        "ones the latest; accuracy on validation is then that of the best of many (spiking networks)",
    )
    dropout: float = param(
        0.1, low=0, high=1, high_open=True, doc="fraction of hidden neurons silenced per sample"
    )
    input_dropout: float = param(
        0.0, low=0, high=1, high_open=True, doc="fraction of input channels silenced per sample"
    )
    event_dropout: float = param(
        0.0,
        low=0,
        high=1,
        high_open=True,
        doc="fraction of input spikes dropped, other ones in every epoch (spiking networks)",
    )
    dilation: tuple[float, float] = param(
        (1.0, 1.0),
        low=0.5,
        high=2,
        doc="least and largest factor by which the time of a training window is stretched about its middle, "
        "drawn in every epoch; needs dilation_keeps_label (spiking networks)",
    )
    dilation_keeps_label: bool = fixed(
        False, doc="true: you state that the label depends neither on speed nor on duration"
    )
    channel_shift: int = param(
        0,
        low=0,
        unit="places",
        doc="training windows are moved over the array by up to this many places along x and y, drawn in "
        "every epoch; what leaves the array is lost. Without positions the taxels are a row in the order of "
        "their numbers (spiking networks)",
    )
    blend: float = param(
        0.0,
        low=0,
        high=1,
        doc="fraction of training windows that go on, from a random step, as the window of another sample of "
        "their class, drawn in every epoch (spiking networks)",
    )
    clip_norm: float | None = param(
        None,
        low=0,
        low_open=True,
        doc="gradients with a larger norm are scaled down to this norm (default: never)",
    )
    crops: int = param(
        1,
        low=1,
        doc="training windows per recording, evenly spaced over window.jitter_steps, of families that do not "
        "draw crops (spiking networks draw one per epoch)",
    )
    teacher: str | Mapping[str, Raw] | None = param(
        None,
        doc="family whose probabilities spiking networks learn beside the labels: mlp, or a mapping such as "
        "{kind: mlp, channels: each, window_ms: 50}; it is trained first, on the same training samples",
    )
    teacher_weight: float = param(
        0.5, low=0, high=1, doc="the loss is (1 - w) of the labels and w of the teacher's probabilities"
    )
    teacher_temperature: float = param(
        2.0, low=0, low_open=True, doc="the teacher's log-odds are divided by it: higher is softer"
    )
    silent_epochs: int = param(
        20,
        low=0,
        unit="epochs",
        doc="stop a training in which a layer is silent or saturated for this many epochs; 0: never",
    )

    def __post_init__(self) -> None:
        """Check the rules across keys."""
        if self.keep == "best" and self.average_epochs > 1:
            raise ValueError(
                f"average_epochs must be 1 where the best epoch is kept (keep), got {self.average_epochs}"
            )
        low, high = self.dilation
        if low > high:
            raise ValueError(f"dilation must be in increasing order, got [{low:g}, {high:g}]")
        if (low, high) != (1, 1) and not self.dilation_keeps_label:
            raise ValueError(
                "dilation changes speeds and durations: it needs dilation_keeps_label: true, your statement "
                f"that the label does not depend on them, got [{low:g}, {high:g}]"
            )
        if self.output_epochs > self.epochs:
            raise ValueError(
                f"output_epochs must be at most epochs ({self.epochs}), got {self.output_epochs}"
            )

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield crops without jitter, and what is wrong with teachers."""
        if max(part.range("crops"), default=1) > 1 and not max(
            space.range("window", "jitter_steps"), default=1
        ):
            yield part.fault("crops", "needs window.jitter_steps > 0, got 0")
        of_teachers: list[KeyFault] = []
        is_axis = bool(part.axes.get("training.teacher"))
        for index, teacher in enumerate(part.range("teacher")):
            path = ("training", "teacher", *(("choice", index) if is_axis else ()))
            if teacher is not None:
                named(path, teacher, teachers(), lambda where, text: of_teachers.append((where, text)))
        yield from of_teachers

    def teaching(self) -> Any:
        """Return the family that the training learns from, a `Teacher`; None: from labels alone.

        Raises:
            ValueError: no family of that name can teach, or it refuses its keys.
        """
        if self.teacher is None or not self.teacher_weight:
            return None
        return named(("training", "teacher"), self.teacher, teachers(), refuse)

    @property
    def augmentation(self) -> tuple[Hashable, ...]:
        """How training windows are changed; empty: not at all."""
        ways = (self.event_dropout, self.dilation, self.channel_shift, self.blend)
        return () if ways == (0, (1, 1), 0, 0) else ways

    def rate(self, epoch: float) -> float:
        """Return the learning rate at a time in epochs; its schedule begins anew after the outputs' own."""
        rate, length = self.learning_rate, self.epochs - self.output_epochs
        if epoch < self.output_epochs:
            rate, length = self.output_learning_rate or rate, self.output_epochs
        else:
            epoch -= self.output_epochs
        rising = min(1.0, (epoch + 1e-3) / self.warmup_epochs) if self.warmup_epochs else 1.0
        if self.lr_schedule == "cosine":
            return rate * rising * (1 + math.cos(math.pi * epoch / length)) / 2
        return rate * rising * self.lr_factor ** (int(epoch) // self.lr_every)


def teachers() -> dict[str, Any]:
    """Return the families that networks can learn from, by name (`dse.config.contracts.Teacher`)."""
    return {name: cls for name, cls in registry.known("models").items() if hasattr(cls, "scores")}


@dataclass(frozen=True)
class Reach:
    """phi = 0, step, 2 step, ... up to the first that no training sample exceeds."""

    up_to: Literal["outputs"] = param(doc="outputs: the most output spikes of a training sample")
    step: int = param(25, doc="distance of two values", unit="spikes", low=1)


@dataclass(frozen=True)
class Decision:
    """Decision parameters, each a value, a list, a choice or a stepped range; evaluated after training."""

    phi: int | Reach = param(  # noqa: RUF009
        0,
        doc="a decision needs more output spikes than this (phi); {up_to: outputs, step: 25}: 0, 25, 50, ... "
        "up to the most output spikes of a run's training samples, 1024 of them at most",
        unit="spikes",
        low=0,
    )
    theta: float = param(
        0.5,
        doc="a decision needs at least this fraction of the output spikes in the leading class (theta)",
        low=0,
        high=1,
    )
    read_out_every_ms: float | None = fixed(
        None,
        doc="spiking networks are also read out after every so much of the input (default: 20 times, evenly "
        "spaced)",
        unit="ms",
        low=0,
        low_open=True,
    )

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield ranges that are no grid, and outputs beside numbers."""
        for axis in part.axes.values():
            if axis.values is None:
                text = "is evaluated on a grid, so its range needs a step"
                yield ("decision", axis.place[1], "range"), f"{axis.name} {text}"
            elif any(isinstance(value, Mapping) for value in axis.values):
                yield part.fault(axis.place[1], "must be integers, or up_to and step alone")


@dataclass(frozen=True)
class Precision:
    """Weights of fewer bits and pruned weights, evaluated on trained spiking networks (default: none)."""

    weight_bits: tuple[int, ...] = param(
        doc="bits per weight, with one scale per layer; networks train with 8", unit="bits", low=2, high=8
    )
    pruned: tuple[float, ...] = param(
        (0.0,),
        doc="fraction of each matrix to prune by magnitude after training",
        low=0,
        high=1,
        high_open=True,
    )
    within: float = param(
        0.02,
        doc="evaluate designs whose accuracy (the first objective that is one) is at most this far below the "
        "front of their task and family",
        low=0,
        high=1,
    )

    def __post_init__(self) -> None:
        """Check that there is something to evaluate."""
        for key in ("weight_bits", "pruned"):
            if not getattr(self, key):
                raise ValueError(f"{key} must hold at least one value, got []")

    @property
    def settings(self) -> tuple[tuple[int, float], ...]:
        """Every (bits, pruned) but the one that is trained, 8 bits and nothing pruned; each once, rising."""
        pairs = {(b, p) for b in self.weight_bits for p in self.pruned}
        return tuple(sorted(pairs - {(8, 0.0)}))


@dataclass(frozen=True)
class Schedule:
    """How often a device answers and what it runs on: adds power_mw, energy_per_hour_mj and battery_days."""

    contacts_per_hour: float | None = param(
        None, doc="inferences per hour, one per contact; the chip idles in between", low=0
    )
    continuous: bool = param(False, doc="one inference after the other, in place of contacts_per_hour")
    awake_ms: float | None = param(
        None,
        doc="time that the device is on at each contact, if that is longer than the inference; in between it "
        "is asleep (default: it is always on, and idles)",
        unit="ms",
        low=0,
    )
    asleep_uw: float = param(0.0, doc="power while it is asleep, that of sensor and chip", unit="uW", low=0)
    battery_mwh: float | None = param(
        None, doc="capacity of the battery (default: no battery_days)", unit="mWh", low=0, low_open=True
    )

    def __post_init__(self) -> None:
        """Check that the rate is stated once, and that what is asleep wakes at contacts."""
        if self.continuous == (self.contacts_per_hour is not None):
            given = "both" if self.continuous else "neither"
            raise ValueError(f"contacts_per_hour or continuous: true must be given, got {given}")
        if self.awake_ms is None and self.asleep_uw:
            raise ValueError("asleep_uw needs awake_ms: what is always on never sleeps")
        if self.awake_ms is not None and self.continuous:
            raise ValueError("awake_ms needs contacts_per_hour: what is continuous never sleeps")


@dataclass(frozen=True)
class ExecutionSettings:
    """How the work is distributed; results are bit-identical for any number of processes and threads."""

    backend: str = param(
        "loky",
        choices=("loky", "dask"),
        doc="workers on this machine (loky), or of a Dask cluster (dask, extra dask)",
    )
    address: str | None = param(
        None, doc="with dask: scheduler, e.g. tcp://node1:8786 (default: a cluster on this machine)"
    )
    scheduler_file: str | None = param(None, doc="with dask: file that a scheduler wrote, instead of address")
    jobs: int = param(1, doc="number of worker processes; a Dask scheduler that runs has its own", low=1)
    threads: int = param(1, doc="CPU threads of each process; they share the samples of a batch", low=1)
    device: str = param(
        "cpu", choices=DEVICES, doc="device for training; with cuda all processes share the first GPU"
    )
    checkpoint_s: float = param(
        60.0,
        doc="time between two checkpoints of a training, from which it goes on if it is killed",
        unit="s",
        low=0,
    )
    memory_gib: float | None = param(
        None,
        doc="device memory that each process may use; a design that needs more is not trained (default: "
        "three quarters of the memory, divided by jobs)",
        unit="GiB",
        low=0,
        low_open=True,
    )

    def __post_init__(self) -> None:
        """Check that Dask is told where it runs at most once."""
        named = [key for key in ("address", "scheduler_file") if getattr(self, key) is not None]
        if named and self.backend != "dask":
            raise ValueError(f"{named[0]} needs execution.backend dask, got {self.backend}")
        if len(named) == 2:
            raise ValueError("scheduler_file must be absent where execution.address says the same")

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield devices that are not there or that no model trains on."""
        for device in part.range("device"):
            if space.is_run and (lack := missing(device)):
                yield part.fault("device", f"{device} {lack}")
            for model in space.each("model") if device != "cpu" else ():
                if getattr(model.cls, "cpu_only", False):
                    yield part.fault("device", f"must be cpu for model {model.kind}, got {device}")


def missing(device: str) -> str | None:
    """Return what a device lacks here, as the end of a sentence; None if it can be used.

    A check of the CPU imports no library.
    """
    if device == "cpu":
        return None
    if lack := missing_package("torch", "torch"):
        return lack
    import torch

    if not torch.cuda.is_available():
        return "needs a CUDA device, but torch finds none; execution.device: cpu needs none"
    return None


def missing_package(package: str, extra: str) -> str | None:
    """Return that a package of an extra is not installed, as the end of a sentence; None where it is."""
    if find_spec(package) is not None:
        return None
    return f"needs the package {package}, which is not installed: pip install 'dse-spiking[{extra}]'"
