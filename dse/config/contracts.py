"""Protocols of the components of sections data, encoder, model and search, which the rest of `dse` calls.

A component is a frozen dataclass, registered in its section (`dse.base.registry`); its fields are its YAML
keys.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import (
    Any,
    ClassVar,
    Generic,
    NamedTuple,
    Protocol,
    Self,
    TypeGuard,
    TypeVar,
    runtime_checkable,
)

import numpy as np

from dse.base import registry
from dse.base.records import (
    Answers,
    Array,
    Block,
    Dataset,
    Floats,
    FrontEnd,
    Ints,
    Network,
    Operations,
    Outcome,
    Parameters,
    Rasters,
    Response,
    Signals,
    Spikes,
    Workload,
)
from dse.config.parts import KeyFault, Part, Written
from dse.config.settings import Training, missing_package

PLACES = ("file", "folder", "labels", "scene")
"""Fields of a `Source` that name the place of recordings; the cache depends on their content, not on it."""

Generators = Callable[..., np.random.Generator]
"""`rngs(purpose, *index)`: the random generator of one purpose of one design."""


class EventSource(Protocol):
    """Event recordings that need not all be in memory; `records.Events` is one that is."""

    front_end: ClassVar[FrontEnd | None] = "preprocessing"
    """The section that turns the events into spikes."""

    simulated: ClassVar[bool] = False
    """Whether the recordings are trials of a simulator (`dse.data.recordings.Simulated`)."""

    @property
    def width(self) -> int:
        """Addresses x are below."""

    @property
    def height(self) -> int:
        """Addresses y are below."""

    @property
    def columns(self) -> Mapping[str, Array]:
        """Label columns, each (n,)."""

    @property
    def n_recordings(self) -> int:
        """Number n of recordings."""

    def blocks(self, i: int) -> Iterator[Block]:
        """Yield recording i from its start, block by block; time never falls. It can be read again.

        Raises:
            ValueError: anything wrong with the recording.
        """

    def notes(self) -> list[str]:
        """Return what was repaired in the recordings that were read so far, one sentence each."""


Recordings = Signals | Rasters | EventSource


class Source(Protocol):
    """A component of section `data`: where recordings lie and how they are read.

    A fault is a `ValueError` of one sentence (`dse.data.recordings.RecordingError`).
    """

    @property
    def columns(self) -> Mapping[str, str]:
        """Label column -> its name in the file."""

    def check(self, base: Path) -> list[str]:
        """Return the faults that the file's headers show; no samples are read."""

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only those label columns that its file holds."""

    def content(self, base: Path) -> str:
        """Return a hash of what lies at the component's `PLACES`, or of more that the recordings follow from.

        Raises:
            ValueError: a file is not found.
        """

    def read(self, base: Path) -> Recordings:
        """Return the recordings.

        Raises:
            ValueError: anything wrong with the file.
        """

    def channel_positions(self, base: Path) -> Ints | None:
        """Return x, y and plane of every channel, (n_channels, 3) int32, or None: events have addresses.

        Raises:
            ValueError: the file cannot be read, or positions are given for another number of taxels.
        """


class Encoder(Protocol):
    """A component of section `encoder`: sampled signals in, spikes out; a step of one is a step of the other.

    An encoder inherits from this class, which defines `learns`, `transductive` and `fitted` for an encoder
    that learns nothing, and `running` for one that cannot run sample by sample. Recordings that are spikes
    already, rasters and events after preprocessing, may pass an encoder too: they are signals of 0 and 1,
    without label columns. An encoder raises a `ValueError` of one sentence for what it cannot do.
    """

    @property
    def learns(self) -> bool:
        """Whether `fitted` learns from training recordings."""
        return False

    @property
    def transductive(self) -> bool:
        """Whether the encoder reads the label of the recording that it encodes.

        Such an encoder is given the labels of all recordings of the split, and the same signals in `fitted`
        and in one call of `encode_all`.
        """
        return False

    def n_channels(self, n_in: int) -> int:
        """Return the number of spike channels that n_in sampled channels become.

        Raises:
            ValueError: it follows from what the encoder learns, and the encoder has not been fitted.
        """

    def positions(self, inputs: Ints) -> Ints:
        """Return x, y and plane of the spike channels, (n_channels, 3) int32.

        Args:
            inputs: (n_in, 3) int32, those of the sampled channels; planes tell copies of a channel apart.
        """

    def rises(self, n_in: int) -> Ints | None:
        """Return what a spike of each channel adds to the level of its place, (n_channels,) int32.

        It is in the least step of the encoder, and no number is 0. None: spikes do not add up to a signal.

        Args:
            n_in: sampled channels.
        """
        return None

    def fitted(
        self, signals: Signals, first: Ints, n_steps: int, target: Ints, n_classes: int, train: Ints
    ) -> Self:
        """Return the encoder with what it learns, in fields of its own, `registry.fixed`.

        An encoder learns numbers, texts or nested tuples of them: they are recorded with the design, and new
        recordings are encoded with them.

        Args:
            signals: n recordings.
            first: (n,) first step of the evaluated windows.
            n_steps: length of the windows.
            target: (n,) classes of the training recordings; -1 for all others.
            n_classes: number of classes.
            train: indices of the training recordings.

        Raises:
            ValueError: nothing can be learnt from them.
        """
        return self

    def encode_all(self, signals: Signals, first: Ints, length: Ints) -> Spikes:
        """Return the spikes of the steps first[i] .. first[i] + length[i] - 1 of every recording.

        Args:
            signals: n recordings. What an encoder does at a step follows from the steps up to it.
            first: (n,) first step to keep.
            length: (n,) steps to keep; rows after them are empty, so 0 is a recording without spikes.

        Raises:
            ValueError: the encoder has not been fitted.
        """

    def running(self, n_in: int, step_ms: float) -> RunningEncoder:
        """Return the encoder at the start of a recording; sample by sample it spikes as `encode_all` does.

        Args:
            n_in: sampled channels.
            step_ms: sampling period.

        Raises:
            ValueError: the encoder must see samples before it can encode earlier ones, or was not fitted.
        """
        name = registry.name_of("encoders", self)
        raise ValueError(f"encoder {name} must see a whole window and cannot run sample by sample")


class RunningEncoder(Protocol):
    """An encoder within one recording."""

    def step(self, values: Floats) -> Ints:
        """Return the channels that spike, int32, rising, given the next sample (n_in,) float32."""


class Family(Protocol):
    """A component of section `model`: a classifier that trains and responds.

    A family with a class variable `takes_events` that is true also takes spikes with times of their own
    (`Spikes.t_us`). One with a class variable `draws_crops` that is true trains on crops between `start_low`
    and `start_high`; any other trains on the evaluated windows, and may be given crops as further samples. A
    family with a class variable `cpu_only` that is true cannot train on another device. A class variable
    `no_c` is the sentence that says why no C is written for the family. One whose kernels
    read the arrays of `Parameters` has a method `check_fitted(fitted, n_outputs)` that raises a ValueError
    where their shapes or numbers are wrong: a bundle that is read may hold anything.

    A family whose answer is a `Response` spikes; any other gives `Answers` after several input lengths, with
    the numbers that it stores and the operations that it does, counted by a rule that it states. A family
    with a method `scores` is a `Teacher`. A method `least_work(n_channels, n_outputs, step_ms, n_steps)` says
    what hardware needs to know of a design before it is trained (`LeastWork`).
    """

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        """Train on `dataset.train`; answer on validation and, where there is one, on test.

        The result follows from the arguments alone: all chance comes from `rngs`.

        Raises:
            ValueError: the family cannot be trained on these data.
            TrainingDiverged: loss, gradient or weights are beyond use (`dse.models.training`).
        """

    def respond(self, fitted: Network | Parameters, dataset: Dataset, samples: Ints) -> Response | Answers:
        """Answer on the evaluated windows of some samples with what `fit` returned as `Outcome.network`.

        The windows begin at `dataset.start`, which may be elsewhere than in training. On the windows of the
        fit and `dataset.validation` the answer is that of the `Outcome`.

        Raises:
            ValueError: the data set has other channels or another length than was trained on.
        """


@runtime_checkable
class Teacher(Family, Protocol):
    """A family that networks can learn from (`training.teacher`)."""

    def scores(self, fitted: Network | Parameters, dataset: Dataset, samples: Ints) -> Floats:
        """Return log-odds of the classes in the whole windows of some samples, (n, output).

        Outputs are the classes of each head side by side; the softmax over a head are its probabilities. A
        class that was not in training may have -inf.
        """


class SamplerSettings(Protocol):
    """A component of section `search.samplers`; a sampler inherits from this class."""

    conditional: ClassVar[bool] = True
    """Whether the sampler searches axes that only some designs have (those of one component of a choice)."""

    requires: ClassVar[str] = ""
    """The package that the sampler imports, which the extra of the same name installs; '' for none."""

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield what a search space lacks for the sampler: packages, a number of designs, other axes.

        Args:
            part: section `search`.
            space: as it is written.
        """
        (name,) = part.range("sampler")
        if (axis := next((x for x in space.axes.values() if x.condition), None)) and not cls.conditional:
            able = ", ".join(x for x, other in registry.known("search.samplers").items() if other.conditional)  # type: ignore[attr-defined]
            text = f"cannot search {axis.name}, an axis that only some designs have; these can: {able}"
            yield part.fault("sampler", f"'{name}' {text}")
        if space.is_run and cls.requires and (lack := missing_package(cls.requires, cls.requires)):
            yield part.fault("sampler", f"'{name}' {lack}")
        if part.range("n_trials") == (None,):
            yield part.fault("n_trials", f"is required for sampler '{name}'")

    def start(self, space: Any, directions: Sequence[str]) -> Any:
        """Return the sampler (`dse.search.proposals.Sampler`) at the start of a search.

        Args:
            space: the `SearchSpace`.
            directions: 'max' or 'min' of each objective.
        """


class LeastWork(NamedTuple):
    """What the shortest inference of a trained design takes at least, known before training.

    load: its counts are lower bounds.
    is_exact: whether sizes, stored weights and bits are those of the trained design, or bounds as well.
    """

    load: Workload | Operations
    is_exact: bool


def trains_in_cohorts(family: Family) -> TypeGuard[CohortFamily]:
    """Return whether a family's designs can train on the same batches: it has `fit_cohort`.

    Such a family is a whole `CohortFamily`; `dse.testing.check_family` says so where it is not.
    """
    return hasattr(family, "fit_cohort")


def has_rungs(family: object) -> TypeGuard[RungFamily]:
    """Return whether trainings of a family, or of a class of families, can pause: it has `fit_span`."""
    return callable(getattr(family, "fit_span", None))


def placed(family: CohortFamily, positions: Ints) -> CohortFamily:
    """Return a family as it trains on channels at (n_channels, 3) x, y and plane.

    That is the family itself, unless its network depends on where its channels lie: such a family has a
    method `placed`, whose result has the sizes of `CohortFamily`.
    """
    on_channels: CohortFamily = family.placed(positions) if hasattr(family, "placed") else family
    return on_channels


def check_channels(family: Family, positions: Ints) -> None:
    """Check that a family can train on channels at (n_channels, 3) x, y and plane.

    Most can, wherever their channels lie; one that cannot has a method `check_channels`.

    Raises:
        ValueError: it cannot.
    """
    if hasattr(family, "check_channels"):
        family.check_channels(positions)


F = TypeVar("F")


@dataclass(frozen=True)
class Rung:
    """A training that has not ended.

    epochs: that it has trained, or those asked for, where outputs that learn alone have had more.
    state: named arrays from which it goes on to the same bits, alone or in any cohort.
    outcome: what it would be if it ended here; None where nobody needs it.
    """

    epochs: int
    state: Mapping[str, Array]
    outcome: Outcome | None = None


@dataclass(frozen=True)
class Span:
    """From where to where the designs of a cohort train.

    states: read each design's state, all after the same number of epochs; empty: they train from the start.
    until: epochs after which every training that has not ended by then pauses; None: none pauses.
    is_due: called after every epoch; true: each training yields its state, and goes on.
    """

    states: Sequence[Callable[[], Mapping[str, Array]]] = ()
    until: int | None = None
    is_due: Callable[[], bool] = lambda: False


class FitRequest(NamedTuple, Generic[F]):
    """A design in a cohort: its family F, the settings of its training, its own random generators."""

    model: F
    training: Training
    rngs: Generators


@runtime_checkable
class CohortFamily(Family, Protocol):
    """A family whose designs can train on the same batches; a design gives the same result in any cohort.

    Sizes: n_channels are input channels, delayed copies not counted; n_classes are the outputs of all heads;
    n_steps is the window's length in input steps.
    """

    @property
    def input_delays(self) -> tuple[int, ...]:
        """Input steps by which copies of the input are delayed."""

    @property
    def steps_per_sample(self) -> int:
        """Network steps per input step."""

    def shares(self, training: Training) -> tuple[Hashable, ...]:
        """Return what designs must have in common to train in one cohort."""

    def n_weights(self, n_channels: int, n_classes: int) -> int:
        """Return the number of weights W_t before pruning; weights that synapses share count once."""

    def memory_bytes(self, n_channels: int, n_classes: int, n_steps: int, training: Training) -> int:
        """Return the memory that a design holds while its cohort trains, without what the cohort shares."""

    def workspace_bytes(
        self, n_channels: int, n_classes: int, n_steps: int, training: Training, threads: int = 1
    ) -> int:
        """Return the memory that the designs of a cohort use one at a time."""

    def cost(
        self, n_channels: int, n_classes: int, n_steps: int, n_events: float, n_train: int, training: Training
    ) -> float:
        """Return an estimate of the CPU seconds of a training.

        Args:
            n_channels: input channels.
            n_classes: outputs.
            n_steps: length of the window.
            n_events: mean input spikes of a window.
            n_train: training samples.
            training: settings of the training.
        """

    def fit_cohort(
        self,
        dataset: Dataset,
        designs: Sequence[FitRequest[Any]],
        shared: Generators,
        device: str = "cpu",
        threads: int = 1,
    ) -> Iterator[tuple[int, Outcome | Exception]]:
        """Train designs on the same batches; yield the place of a design and its outcome, or why it has none.

        A static method: the designs bring their families along.

        Args:
            dataset: what they train on.
            designs: what `shares` returns is the same for all of them.
            shared: random generators of what they share, such as the order of samples.
            device: 'cpu' or 'cuda'.
            threads: on the CPU; they change no bit of a result.
        """


@runtime_checkable
class RungFamily(CohortFamily, Protocol):
    """A family whose trainings can pause after any epoch and go on elsewhere; any other has one rung."""

    def fit_span(
        self,
        dataset: Dataset,
        designs: Sequence[FitRequest[Any]],
        shared: Generators,
        device: str = "cpu",
        threads: int = 1,
        span: Span = Span(),
    ) -> Iterator[tuple[int, Outcome | Rung | Exception]]:
        """Do as `fit_cohort` from where designs stand; yield a `Rung` of each that pauses, with an outcome.

        A static method. States that are yielded on the way have no outcome. In however many spans designs
        train, and with whatever others, the results are those of one `fit_cohort`. Generators of requests and
        of what designs share are new in every span: a state holds how far they were.
        """
