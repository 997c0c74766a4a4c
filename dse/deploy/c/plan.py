"""What the C of a bundle does, in whole numbers, and what it takes: known before a line of it is written."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from dse.config.resolved import Sections
from dse.deploy.bundle import Bundle, Input
from dse.deploy.c.bounds import UNITS_PER_STEP, Bounds, bounds
from dse.deploy.c.confidence import simplest_fraction
from dse.deploy.c.matrix import Matrix, stored
from dse.encoders.receptors import Receptors, parameters
from dse.encoders.send_on_delta import SendOnDelta
from dse.measure.heads import joint_label
from dse.neurons import cuba_lif, neuron_of, population_of, resonator, xylo_lif
from dse.neurons.fixed_point import WEIGHT_SCALE, quantise
from dse.preprocessing import END_OF_TIME_US, Pooling
from dse.recordings.pooling import pooling
from dse.recordings.raster import RasterFile
from dse.recordings.scene import SceneTrials, Trials
from dse.records import Floats, Ints, Layer, Network

FrontEnd = Literal["samples", "events", "spikes"]

Population = cuba_lif.Population | resonator.Population | xylo_lif.Population
_WRITTEN = (cuba_lif.Population, resonator.Population, xylo_lif.Population)
_MOST_CHANNELS = 2**16
_MOST_SHIFT = 5  # samples of 24 bits, shifted by this, differ within int32


class Unsupported(ValueError):
    """A classifier that the C cannot hold, in one sentence."""


@dataclass(frozen=True)
class LayerPlan:
    """One layer.

    feed_forward: weights from the delayed copies of the inputs, or from the layer before.
    recurrent: from the layer itself; None: not recurrent.
    population: the neurons. n_neurons: how many.
    bounds: of the states within the window.
    """

    feed_forward: Matrix
    recurrent: Matrix | None
    population: Population
    n_neurons: int
    bounds: Bounds

    @property
    def threshold(self) -> int:
        """Threshold in integer units of the states."""
        of_xylo = isinstance(self.population, xylo_lif.Population)
        return int(self.population.threshold) * (1 if of_xylo else WEIGHT_SCALE)

    @property
    def unit(self) -> int:
        """Integer units of a state per step of an 8-bit weight."""
        if isinstance(self.population, xylo_lif.Population):
            return 1 << int(self.population.weight_shift)
        return UNITS_PER_STEP

    @property
    def most_spikes(self) -> int:
        """Of a neuron in a step."""
        return most_spikes(self.population)

    @property
    def state_bits(self) -> int:
        """Bits of a state: 32 where they hold its bounds."""
        return 32 if max(self.bounds.first, self.bounds.second) < 2**31 else 64

    @property
    def n_later(self) -> int:
        """Network steps whose input must be held for delays of synapses, this one included; 0: none has."""
        delays = self.feed_forward.delays
        return 0 if delays is None else 1 + int(delays.max(initial=0))

    @property
    def n_places(self) -> int:
        """Length of the array of u or x: its neurons, and those that fill packed rows."""
        matrices = [self.feed_forward, *([] if self.recurrent is None else [self.recurrent])]
        return max(self.n_neurons, *(m.row_length for m in matrices), 0)


@dataclass(frozen=True)
class SendOnDeltaPlan:
    """Send-on-delta from raw samples.

    n_sensors: sampled channels.
    thresholds: as in the encoder.
    whole: the thresholds in 2^-shift, where whole samples are encoded in integers exactly; None: they need
        floating point.
    rule: how the level moves: step, value or level. merged: ON and OFF share a channel.
    """

    n_sensors: int
    thresholds: tuple[float, ...]
    whole: tuple[int, ...] | None
    shift: int
    rule: str
    merged: bool

    @property
    def takes_whole(self) -> bool:
        """Whether samples may be integers."""
        return self.whole is not None


@dataclass(frozen=True)
class ReceptorsPlan:
    """Receptors of raw samples, in double precision.

    n_sensors: sampled channels. encoder: with the range of each.
    step_ms: sampling period.
    """

    n_sensors: int
    encoder: Receptors
    step_ms: float

    takes_whole: ClassVar[bool] = True

    @property
    def kinds(self) -> Floats:
        """a, b, c, d of every kind of receptor."""
        return parameters(self.encoder.sa)

    @property
    def smoothed(self) -> int:
        """Samples of the moving average; 1: none."""
        return max(1, round(self.encoder.smoothing_ms / self.step_ms))


@dataclass(frozen=True)
class Rule:
    """The decision.

    first, n: the output neurons that count.
    least_total: output spikes that a decision by confidence needs; None: the answer comes at a fixed time.
    confidence: smallest share of them for the answer.
    last: network step that ends with an answer, at the latest.
    heads: (first, n) of each head of a joint answer, and joint: its class of every combination, -1: none.
    """

    first: int
    n: int
    least_total: int | None
    confidence: Fraction
    last: int
    heads: tuple[tuple[int, int], ...] = ()
    joint: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What surrounds a classifier: its input, its window and the names of its answers.

    n_channels: of the input spikes. n_steps: input steps of the window. step_ms: duration of an input step.
    window: where it begins in a recording: start, middle or contact_onset. onset_threshold: of the contact.
    cut_steps, every_steps: length and distance of the recordings that a stream is cut into; None: into none.
    front_end: what is pushed. no_front_end: why spikes are pushed although the design has an encoder or
        preprocessing; '' where it does not apply.
    t0_us, n_bins: of simulated trials, the time that bins are counted from, and how many there are; None:
        from the first event to the last.
    """

    n_channels: int
    n_steps: int
    step_ms: float
    classes: tuple[str, ...]
    window: str
    onset_threshold: float
    front_end: FrontEnd
    no_front_end: str
    encoder: SendOnDeltaPlan | ReceptorsPlan | None = None
    pooling: Pooling | None = None
    t0_us: int | None = None
    n_bins: int | None = None
    cut_steps: int | None = None
    every_steps: int | None = None

    @property
    def channel_words(self) -> int:
        """Words of 32 bits with a bit per channel."""
        return -(-self.n_channels // 32)


@dataclass(frozen=True, kw_only=True)
class Plan(Frame):
    """All that the C of a spiking network needs of a bundle.

    steps_per_sample: network steps per input step.
    delays: of the copies of the inputs, network steps.
    """

    layers: tuple[LayerPlan, ...]
    steps_per_sample: int
    delays: tuple[int, ...]
    rule: Rule

    @property
    def network_steps(self) -> int:
        """Network steps of the window."""
        return self.n_steps * self.steps_per_sample

    @property
    def n_slots(self) -> int:
        """Input steps whose spikes must be remembered."""
        return max(self.delays) // self.steps_per_sample + 1

    @property
    def counts_bytes(self) -> int:
        """Bytes of an output's spike count."""
        return 2 if self.network_steps < 2**16 else 4


def plan_of(bundle: Bundle) -> Plan:
    """Return the plan of a bundle of a spiking network.

    Raises:
        Unsupported: C cannot hold its classifier; the reason.
    """
    network = bundle.fitted
    if not isinstance(network, Network):
        kind = bundle.sections.kinds["model"]
        raise Unsupported(f"family {kind} is no single spiking network")
    frame = frame_of(bundle)
    step_ms = frame.step_ms / network.steps_per_sample
    rule = _rule(bundle, frame.n_steps * network.steps_per_sample, network.sizes[-1], step_ms)
    return plan_on(frame, network, rule)


def plan_on(frame: Frame, network: Network, rule: Rule) -> Plan:
    """Return the plan of a network with what surrounds it.

    Raises:
        Unsupported: C cannot hold the network; the reason.
    """
    if network.arithmetic != "integer":
        raise Unsupported(f"C needs a network in integer arithmetic, got {network.arithmetic} arithmetic")
    for layer in network.layers:
        if not issubclass(neuron_of(layer.neuron).Populations, _WRITTEN):
            names = "CUBA-LIF neurons, resonators and xylo_lif"
            raise Unsupported(f"C is written for {names}, got neuron {layer.neuron}")
    if max(*network.sizes, network.n_channels) > _MOST_CHANNELS:
        raise Unsupported(f"C numbers neurons with 16 bits, and a layer has {max(network.sizes)}")
    layers, arriving = [], 1
    for layer in network.layers:
        layers.append(_layer(layer, frame.n_steps * network.steps_per_sample, arriving))
        arriving = layers[-1].most_spikes
    if arriving > 1:
        raise Unsupported(f"C counts one spike of an output in a step, and these fire up to {arriving}")
    return Plan(
        **vars(frame),
        layers=tuple(layers),
        steps_per_sample=network.steps_per_sample,
        delays=network.delays,
        rule=rule,
    )


def frame_of(bundle: Bundle) -> Frame:
    """Return what surrounds the classifier of a bundle.

    Raises:
        Unsupported: the bundle does not say what recordings it takes.
    """
    if bundle.input is None:
        raise Unsupported("the bundle does not say what recordings it takes: export it again beside its data")
    front_end, no_front_end, encoder, pools = front_end_of(bundle.sections, bundle.input)
    trials, window = _trials(bundle), bundle.sections.window
    return Frame(
        n_channels=bundle.fitted.n_channels,
        n_steps=bundle.input.n_steps,
        step_ms=bundle.input.step_ms,
        classes=next((x.classes for x in bundle.heads if x.name == bundle.head), bundle.classes),
        window=window.at,
        onset_threshold=window.onset_threshold,
        front_end=front_end,
        no_front_end=no_front_end,
        encoder=encoder,
        pooling=pools,
        t0_us=None if trials is None else 0,
        n_bins=None if trials is None or pools is None else pools.n_bins(trials.duration_us),
        cut_steps=window.cut_steps,
        every_steps=window.every_steps or window.cut_steps,
    )


def most_spikes(population: Population) -> int:
    """Return how often a neuron can spike in a step."""
    return int(population.most_spikes) if isinstance(population, xylo_lif.Population) else 1


def _layer(layer: Layer, network_steps: int, arriving: int) -> LayerPlan:
    """Return the plan of a layer whose inputs spike up to `arriving` times in a step."""
    population = population_of(layer.neuron, layer.parameters)
    assert isinstance(population, _WRITTEN)
    forward = _in_steps(layer.weight)
    back = None if layer.recurrent is None else _in_steps(layer.recurrent)
    both = forward * arriving
    if back is not None:
        both = np.concatenate([both, back * most_spikes(population)])
    planned = bounds(both, population, network_steps)
    if max(planned.first, planned.second) >= 2**50:
        raise Unsupported("the states of a layer may exceed 50 bits within its window")
    return LayerPlan(
        feed_forward=stored(forward, None if layer.delay is None else layer.delay.T),
        recurrent=None if back is None else stored(back),
        population=population,
        n_neurons=int(layer.weight.shape[0]),
        bounds=planned,
    )


def _in_steps(weight: Floats) -> Ints:
    """Return a matrix as deployed, (input, neuron), in 8-bit steps."""
    return np.rint(quantise(weight).astype(np.float64) * (WEIGHT_SCALE / 2)).astype(np.int64).T


def _rule(bundle: Bundle, network_steps: int, n_outputs: int, step_ms: float) -> Rule:
    sizes = [len(head.classes) for head in bundle.heads]
    firsts = np.cumsum([0, *sizes]).tolist()
    first, n = 0, n_outputs
    for head, begin, size in zip(bundle.heads, firsts, sizes, strict=False):
        if head.name == bundle.head:
            first, n = begin, size
    if bundle.phi is not None and bundle.theta is not None:
        total = math.floor(bundle.phi) + 1
        return Rule(first, n, total, simplest_fraction(bundle.theta, network_steps * n), network_steps - 1)
    steps = network_steps
    if bundle.read_out_ms is not None:
        steps = min(steps, max(1, round(bundle.read_out_ms / step_ms)))
    if bundle.heads and not bundle.head:
        combinations = np.stack([x.ravel() for x in np.indices(sizes)], axis=1)
        joint = tuple(joint_label(combinations, bundle.heads).tolist())
        return Rule(
            0, n_outputs, None, Fraction(0), steps - 1, tuple(zip(firsts, sizes, strict=False)), joint
        )
    return Rule(first, n, None, Fraction(0), steps - 1)


def front_end_of(
    sections: Sections, taken: Input
) -> tuple[FrontEnd, str, SendOnDeltaPlan | ReceptorsPlan | None, Pooling | None]:
    """Return what is pushed, why it is spikes where recordings are none, and what makes them in C."""
    encoder, preprocessing = sections.encoder, sections.preprocessing
    if encoder is not None and preprocessing is not None:
        return "spikes", "an encoder of pooled events is not written in C", None, None
    if encoder is not None:
        if not isinstance(encoder, SendOnDelta | Receptors):
            kind = sections.kinds["encoder"]
            return "spikes", f"encoder {kind} is not written in C", None, None
        if sections.window.remove_mean:
            return "spikes", "window.remove_mean needs the whole window before its first spike", None, None
        if isinstance(sections.data, RasterFile):
            return "spikes", "an encoder of spikes is not written in C", None, None
        if isinstance(encoder, Receptors):
            return "samples", "", ReceptorsPlan(taken.n_channels, encoder, taken.step_ms), None
        return "samples", "", send_on_delta_plan(encoder, taken.n_channels), None
    if preprocessing is not None:
        pools = pooling(preprocessing, taken.width, taken.height)
        if pools.rate_floor_hz > 0:
            return (
                "spikes",
                "preprocessing.rate_floor_hz needs the whole window before its first spike",
                None,
                None,
            )
        return "events", "", None, pools
    return "spikes", "", None, None


def send_on_delta_plan(encoder: SendOnDelta, n_sensors: int) -> SendOnDeltaPlan:
    """Return how an encoder runs; in integers where whole samples of up to 24 bits give the same spikes.

    Thresholds that are multiples of 2^-shift keep every level on that grid, in float64 as in integers. A
    level that moves to the sample itself stays whole: then a threshold is as good as the next whole one.
    """
    shift, whole = 0, None
    if encoder.reference == "value":
        whole = tuple(math.ceil(theta) for theta in encoder.thresholds)
    else:
        shifts = (
            s for s in range(_MOST_SHIFT + 1) if all((x * 2**s).is_integer() for x in encoder.thresholds)
        )
        shift = next(shifts, -1)
        if shift >= 0:
            whole = tuple(int(x * 2**shift) for x in encoder.thresholds)
    if whole is not None and max(whole) >= 2**30:
        whole = None
    return SendOnDeltaPlan(
        n_sensors, encoder.thresholds, whole, max(shift, 0), encoder.reference, encoder.polarity == "merged"
    )


def is_endless(pools: Pooling) -> bool:
    """Return whether no event is too late for the temporal crop."""
    return pools.end_us >= END_OF_TIME_US


def _trials(bundle: Bundle) -> Trials | None:
    """Return the simulated trials of a bundle of a scene, without simulating any."""
    data = bundle.sections.data
    return data.read(Path()) if isinstance(data, SceneTrials) else None
