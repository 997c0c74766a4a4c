"""Checks catch components that break their contract, one deliberate mistake each."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest

from dse.base.records import (
    Answers,
    Array,
    Dataset,
    Events,
    Operations,
    Outcome,
    Parameters,
    Signals,
    Spikes,
    Workload,
)
from dse.base.registry import Column, param
from dse.config.contracts import Encoder, Generators, Recordings
from dse.config.settings import Training
from dse.data.encoders.send_on_delta import SendOnDelta
from dse.data.recordings.time_series import TimeSeries
from dse.engine.losses import Outputs
from dse.engine.losses.spike_rate import SpikeRate
from dse.engine.neurons.lif import Lif
from dse.measure.hardware.kinds.linear import CountedOperations
from dse.measure.hardware.plan import Plan, energy_only
from dse.measure.hardware.profile import Figures, load
from dse.measure.objectives import FullReadOut, Points
from dse.models.counts.knn import KNN
from dse.search.samplers.random import Random
from dse.show.figures.confusion import Confusion, ConfusionFigure
from dse.testing import (
    check_chip_kind,
    check_encoder,
    check_family,
    check_figure,
    check_loss,
    check_neuron,
    check_objective,
    check_sampler,
    check_source,
    check_view,
)


@dataclass(frozen=True)
class UnseededKNN(KNN):
    """Its answers depend on more than the seed."""

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        outcome = super().fit(dataset, training, rngs)
        return dataclasses.replace(outcome, health={"noise": np.random.default_rng().random()})


@dataclass(frozen=True)
class ForgetfulKNN(KNN):
    """What it returns cannot give the answers of its fit again."""

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        outcome = super().fit(dataset, training, rngs)
        other = (outcome.validation.label + 1) % len(dataset.classes)
        return dataclasses.replace(outcome, validation=dataclasses.replace(outcome.validation, label=other))


@dataclass(frozen=True)
class UncountedKNN(KNN):
    """It trains in cohorts, and does not say what that takes."""

    fit_cohort = None


@dataclass(frozen=True)
class RootedKNN(KNN):
    """It answers the same steps wherever the windows are."""

    def respond(self, fitted: Parameters, dataset: Dataset, samples: Array) -> Answers:
        return super().respond(fitted, dataclasses.replace(dataset, start=0 * dataset.start + 2), samples)


@dataclass(frozen=True)
class Mean(Encoder):
    """A channel spikes while it is above the mean of its whole recording."""

    def n_channels(self, n_in: int) -> int:
        return n_in

    def positions(self, inputs: Array) -> Array:
        return inputs

    def encode_all(self, signals: Signals, first: Array, length: Array) -> Spikes:
        fired = np.zeros((signals.n_recordings, int(length.max()), signals.n_channels), bool)
        for i in range(signals.n_recordings):
            values = signals.values[signals.offsets[i] : signals.offsets[i + 1]]
            piece = values[first[i] : first[i] + length[i]]
            fired[i, : length[i]] = piece > values.mean(axis=0)
        rows = fired.reshape(-1, fired.shape[2])
        offsets = np.concatenate([[0], np.cumsum(rows.sum(axis=1))])
        channel = np.nonzero(rows)[1]
        return Spikes(offsets, channel, fired.shape[1], fired.shape[2], signals.step_ms)


@dataclass(frozen=True)
class Miscounted(Mean):
    """It announces a channel that it does not have."""

    def n_channels(self, n_in: int) -> int:
        return n_in + 1


@dataclass(frozen=True)
class Weightless(Mean):
    """Its spikes add nothing to a level."""

    def rises(self, n_in: int) -> Array:
        return np.zeros(n_in, np.int32)


class Impure(NamedTuple):
    """State of `Counting`."""

    v: Array


@dataclass(frozen=True)
class CountingPopulation:
    """It writes into the state that it is given."""

    threshold: float = 1.0
    to_threshold: ClassVar[float] = 1.0

    def initial_state(self, shape: tuple[int, ...], calculus: Any) -> Impure:
        return Impure(calculus.zeros(shape))

    def step(self, state: Impure, drive: Array, calculus: Any) -> Any:
        from dse.engine.neurons import Step

        state.v[...] += drive
        return Step(state, state.v, calculus.fire(state.v, self.threshold))


@dataclass(frozen=True)
class Counting(Lif):
    """A neuron whose step is no function."""

    Populations = CountingPopulation

    def population(self, layer: Any, rng: np.random.Generator) -> Any:
        return CountingPopulation()


class Repeating:
    """A started sampler that proposes one design for ever."""

    def __init__(self, started: Any) -> None:
        self._started = started
        self._first: list[Any] = []

    def ask(self, n: int) -> list[Any]:
        self._first = self._first or self._started.ask(n)
        return list(self._first)

    def tell(self, designs: Any, values: Any) -> None:
        pass


@dataclass(frozen=True)
class Stuck(Random):
    """A sampler that never learns."""

    def start(self, space: Any, directions: Any) -> Any:
        return Repeating(super().start(space, directions))


@dataclass(frozen=True)
class Loose:
    """A sampler that does not declare what it can search."""

    def start(self, space: Any, directions: Any) -> Any:
        return Random().start(space, directions)


@dataclass(frozen=True)
class Undeclared:
    """An objective that returns another column than it declares."""

    needs = "full_read_out"
    columns = (Column("errors", "", "min", "Share of wrong answers."),)

    def measure(self, answer: FullReadOut) -> Mapping[str, float]:
        return {"error": float((answer.label != answer.target).mean())}


@dataclass(frozen=True)
class Infinite:
    """An objective that divides by nothing."""

    needs = "points"
    columns = (Column("slowness_ms", "ms", "min", "Time without end."),)

    def measure(self, points: Points) -> Mapping[str, Array]:
        return {"slowness_ms": np.full(np.shape(points.accuracy), np.inf)}


@dataclass(frozen=True)
class Unitless:
    """An objective whose name lacks its unit."""

    needs = "points"
    columns = (Column("slowness", "ms", "min", "Time."),)

    def measure(self, points: Points) -> Mapping[str, Array]:
        return {"slowness": points.decision_latency_ms}


@dataclass(frozen=True)
class Generous(CountedOperations):
    """A chip that gives energy back."""

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        return energy_only({"addition": -np.ones((3, load.counts.shape[-1]))})

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        return energy_only({"addition": -np.ones((3, load.counts.shape[-1]))})


def test_chip_kind():
    counted = load("op_4.6_0.9")
    fields = {field.name: getattr(counted, field.name) for field in dataclasses.fields(counted)}
    with pytest.raises(AssertionError, match="Generous: energy of addition must be >= 0 per count"):
        check_chip_kind(Generous(**fields))


@dataclass(frozen=True)
class Handed(ConfusionFigure):
    """A figure that draws no figure."""

    def draw(self, record: Confusion) -> Any:
        return record


@dataclass(frozen=True)
class Greedy(ConfusionFigure):
    """A figure that gathers what no JSON can hold."""

    def gather(self, results: Any) -> Any:
        return (object(),)


@dataclass(frozen=True)
class Silent:
    """A view that adds nothing."""

    script: ClassVar[str] = "const Other = (() => ({ view(root, app) { return { render() {} }; } }))();"


def test_view():
    with pytest.raises(AssertionError, match=r"its script must add itself, Views.silent"):
        check_view("silent", Silent())


@dataclass(frozen=True)
class Faulty:
    """A source that finds fault with itself."""

    file: str = param("touch.npz", doc="file")

    def check(self, base: Any) -> list[str]:
        return ["there is no such file"]


@dataclass(frozen=True)
class Vague(TimeSeries):
    """A source that does not say what it returns before it reads."""

    def read(self, base: Any) -> Recordings:
        return super().read(base)


@dataclass(frozen=True)
class Misleading(TimeSeries):
    """A source that returns signals, and says that it returns events."""

    def read(self, base: Any) -> Events:
        return super().read(base)


@pytest.mark.parametrize(
    ("source", "text"),
    [
        (Faulty(), "Faulty.check must find no fault in sound recordings"),
        (Vague("x.npz", 5.0), "Vague.read must be annotated with the one class .* returns, Signals"),
        (Misleading("x.npz", 5.0), "Misleading.read must return what its annotation says: .* got Signals"),
    ],
)
def test_source(source, text, tmp_path):
    np.savez(tmp_path / "x.npz", signal=np.zeros((2, 4, 3)))
    with pytest.raises(AssertionError, match=text):
        check_source(source, tmp_path)


@dataclass
class Thawed:
    """An encoder that can be changed."""


@dataclass(frozen=True)
class Mute(SendOnDelta):
    """An encoder with a key that nobody explains."""

    gain: float = 1.0


@dataclass(frozen=True)
class HalvedLoss(SpikeRate):
    """Its gradient is not its slope."""

    def gradient(self, counts: Array, outputs: Outputs) -> tuple[Array, Array]:
        value, by_count = super().gradient(counts, outputs)
        return value, by_count / 2


@dataclass(frozen=True)
class EarlyLoss(SpikeRate):
    """It leaves out the end of the input."""

    def lengths(self, n_steps: int) -> tuple[int, ...]:
        return (max(1, n_steps // 2),)


@dataclass(frozen=True)
class MeanLoss(SpikeRate):
    """What it says of a sample depends on how many others there are."""

    def value(self, counts: Array, outputs: Outputs) -> Array:
        return super().value(counts, outputs) / len(counts)

    def gradient(self, counts: Array, outputs: Outputs) -> tuple[Array, Array]:
        value, by_count = super().gradient(counts, outputs)
        return value / len(counts), by_count / len(counts)


CASES = (
    (check_family, RootedKNN(), "respond must answer the windows that begin at `dataset.start`"),
    (check_family, UncountedKNN(), "has `fit_cohort` and must have the other methods of `CohortFamily` too"),
    (check_family, UnseededKNN(), "must train to the same result by the same seed"),
    (check_family, ForgetfulKNN(), "respond must give the validation answers of its fit"),
    (check_encoder, Mean(), "Mean must be causal: a spike may not depend on later values"),
    (check_encoder, Miscounted(), "n_channels must be that of its spikes, 3, got 4"),
    (check_encoder, Weightless(), "rises must be .* whole numbers that are not 0"),
    (check_sampler, Stuck(), "Stuck.ask must return designs that it did not return before"),
    (check_sampler, Loose(), "Loose must inherit `SamplerSettings`"),
    (check_objective, Undeclared(), "must declare every column that it returns, got error"),
    (check_objective, Infinite(), "slowness_ms must be finite or NaN"),
    (check_objective, Unitless(), "the name of slowness must contain its unit, '_ms'"),
    (check_figure, Handed(), "Handed.draw must return a plotly figure, got Confusion"),
    (check_figure, Greedy(), "Greedy.gather must return plain numbers, arrays and texts, got a object"),
    (check_neuron, Counting(), "what a step of Counting is given must not be changed"),
    (check_loss, HalvedLoss(), "HalvedLoss.gradient must be the slope of its value"),
    (check_loss, EarlyLoss(), r"EarlyLoss.lengths\(2\) must rise from at least 1 to 2, got \(1,\)"),
    (check_loss, MeanLoss(), "MeanLoss must be a sum over samples"),
    (check_encoder, Thawed(), "Thawed must be a frozen dataclass"),
    (check_encoder, Mute(thresholds=(1.0,)), r"key Mute.gain must say what it means"),
)


@pytest.mark.parametrize(("check", "component", "text"), CASES, ids=[type(x[1]).__name__ for x in CASES])
def test_a_mistake_is_named(check, component, text):
    with pytest.raises(AssertionError, match=text):
        check(component)
