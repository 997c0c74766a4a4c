"""The intermediate form: a classifier in typed numbers, between a bundle and the files of any target.

A bundle has float weights, sections and plugins. A target needs what runs: weights on their grid, decays,
delays, the decision in whole numbers, how recordings become spikes, and how far every state can go. It walks

    Net      layers of neurons, input copies, steps, arithmetic: what a chip or a graph holds
    Rule     the decision of a network, in whole numbers
    Frame    the input, window and answers of any classifier; its encoder or pooling
    Spiking  a frame with the layers and the rule of its network: all that runs

and refuses by `Unsupported` what it cannot hold. Nothing here knows a target.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from dse.base.records import Arithmetic, Array, Bools, Floats, Ints, Layer, Network
from dse.config.resolved import Sections
from dse.data.encoders.receptors import Receptors, parameters
from dse.data.encoders.send_on_delta import Deltas
from dse.data.preprocessing import Pooling
from dse.data.recordings.pooling import pooling
from dse.data.recordings.raster import RasterFile
from dse.data.recordings.scene import SceneTrials
from dse.deploy.bounds import UNITS_PER_STEP, Bounds, bounds
from dse.deploy.classifier import Classifier, Input
from dse.engine.neurons import Population, cuba_lif, population_of, resonator, xylo_lif
from dse.engine.neurons.fixed_point import WEIGHT_SCALE, in_steps, quantise
from dse.measure.heads import joint_label

FrontEnd = Literal["samples", "events", "spikes"]
_BOUNDED = (cuba_lif.Population, resonator.Population, xylo_lif.Population)
_MOST_SHIFT = 5  # samples of 24 bits, shifted by this, differ within int32


class Unsupported(ValueError):
    """A classifier that a target cannot hold, in one sentence."""


@dataclass(frozen=True)
class LayerForm:
    """One layer of a network, as it runs.

    k: its number, from 1.
    neuron: name of its kind. population: the neurons.
    weights: (input, neuron) float32, weight units, on the 8-bit grid in integer arithmetic.
    recurrent: (neuron, neuron) likewise, row = presynaptic, one step later; None: none.
    delays: (input, neuron) network steps that each weight acts later; None: none does.
    bounds: of the states within the window; None of neurons or windows that do not tell.
    """

    k: int
    neuron: str
    population: Population[Any]
    weights: Floats
    recurrent: Floats | None
    delays: Array | None
    bounds: Bounds | None

    @property
    def n_neurons(self) -> int:
        return int(self.weights.shape[1])

    @property
    def threshold(self) -> int:
        """Threshold in integer units of the states."""
        of_xylo = isinstance(self.population, xylo_lif.Population)
        return int(self.population.threshold) * (1 if of_xylo else WEIGHT_SCALE)  # type: ignore[attr-defined]

    @property
    def unit(self) -> int:
        """Integer units of a state per step of an 8-bit weight."""
        if isinstance(self.population, xylo_lif.Population):
            return 1 << int(self.population.weight_shift)
        return UNITS_PER_STEP

    @property
    def forward_steps(self) -> Ints:
        """Weights from the layer before, (input, neuron) in steps of the 8-bit grid, -128 to 127."""
        return in_steps(self.weights)

    @property
    def ring_steps(self) -> Ints:
        """Recurrent weights likewise, (neuron, neuron); without any, no rows."""
        return in_steps(np.zeros((0, self.n_neurons)) if self.recurrent is None else self.recurrent)

    @property
    def most_spikes(self) -> int:
        """Of a neuron in a step."""
        return int(getattr(self.population, "most_spikes", 1))

    @property
    def turns(self) -> Bools:
        """Which neurons resonate, (n_neurons,)."""
        return np.broadcast_to(getattr(self.population, "resonates", False), self.n_neurons)

    @property
    def state_bits(self) -> int:
        """Bits of a state: 32 where they hold its bounds."""
        assert self.bounds is not None
        return 32 if max(self.bounds.first, self.bounds.second) < 2**31 else 64


@dataclass(frozen=True)
class Net:
    """A spiking network, as it runs.

    n_channels: of the input spikes. delays: of the copies of the inputs, network steps: input
        d * n_channels + c is channel c, delays[d] steps ago.
    steps_per_sample: network steps per input step.
    """

    layers: tuple[LayerForm, ...]
    n_channels: int
    delays: tuple[int, ...]
    steps_per_sample: int
    arithmetic: Arithmetic

    @property
    def sizes(self) -> tuple[int, ...]:
        """Neurons per layer, input copies first."""
        return (len(self.layers[0].weights), *(layer.n_neurons for layer in self.layers))


def net_of(network: Network, n_steps: int | None = None) -> Net:
    """Return the form of a network; its states are bounded within a window of so many network steps."""
    layers, arriving = [], 1
    for k, layer in enumerate(network.layers, 1):
        layers.append(_layer(k, layer, network.arithmetic, n_steps, arriving))
        arriving = layers[-1].most_spikes
    return Net(
        tuple(layers), network.n_channels, network.delays, network.steps_per_sample, network.arithmetic
    )


def network_in(bundle: Classifier, holder: str) -> Network:
    """Return the network of a bundle; `holder` begins what refuses any other: 'Loihi holds'."""
    if isinstance(bundle.fitted, Network):
        return bundle.fitted
    kind = bundle.sections.kinds["model"]
    raise Unsupported(f"{holder} networks of neurons, and family {kind} is none")


def _layer(k: int, layer: Layer, arithmetic: Arithmetic, n_steps: int | None, arriving: int) -> LayerForm:
    """Return layer k, whose inputs spike up to `arriving` times in a step."""
    population = population_of(layer.neuron, layer.parameters)
    rounding = quantise if arithmetic == "integer" else np.asarray
    back = None if layer.recurrent is None else rounding(layer.recurrent).T
    delays = None if layer.delay is None else layer.delay.T
    form = LayerForm(k, layer.neuron, population, rounding(layer.weight).T, back, delays, None)
    if n_steps is None or arithmetic != "integer" or not isinstance(population, _BOUNDED):
        return form
    both = np.concatenate([form.forward_steps * arriving, form.ring_steps * form.most_spikes])
    return replace(form, bounds=bounds(both, population, n_steps))


@dataclass(frozen=True)
class Rule:
    """The decision of a network.

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

    @property
    def parts(self) -> tuple[tuple[int, int], ...]:
        """First output neuron and number of them, of each part that answers."""
        return self.heads or ((self.first, self.n),)

    def is_met(self, counts: Sequence[int]) -> bool:
        """Return whether output spikes suffice; they always do where the answer comes at a fixed time."""
        if self.least_total is None:
            return True
        total, confidence = sum(counts), self.confidence
        is_sure = max(counts) * confidence.denominator >= total * confidence.numerator
        return total >= self.least_total and is_sure

    def label(self, counts: Sequence[Sequence[int]]) -> int:
        """Return the class by the most output spikes of each part, the lowest on ties; -1: there is none."""
        at = 0
        for part in counts:
            at = at * len(part) + part.index(max(part))
        return self.joint[at] if self.joint else at


def rule_of(bundle: Classifier, network_steps: int, n_outputs: int, step_ms: float) -> Rule:
    """Return the decision of a bundle of a network, given its window in network steps and their duration."""
    sizes = [len(head.classes) for head in bundle.heads]
    heads = tuple(zip(np.cumsum([0, *sizes]).tolist(), sizes, strict=False))
    named = {head.name: part for head, part in zip(bundle.heads, heads, strict=True)}
    first, n = named.get(bundle.head, (0, n_outputs))
    if bundle.phi is not None and bundle.theta is not None:
        total = math.floor(bundle.phi) + 1
        return Rule(first, n, total, simplest_fraction(bundle.theta, network_steps * n), network_steps - 1)
    steps = network_steps
    if bundle.read_out_ms is not None:
        steps = min(steps, max(1, round(bundle.read_out_ms / step_ms)))
    if bundle.heads and not bundle.head:
        combinations = np.stack([x.ravel() for x in np.indices(sizes)], axis=1)
        joint = tuple(joint_label(combinations, bundle.heads).tolist())
        return Rule(0, n_outputs, None, Fraction(0), steps - 1, heads, joint)
    return Rule(first, n, None, Fraction(0), steps - 1)


@functools.lru_cache(maxsize=1024)
def simplest_fraction(theta: float, largest_total: int) -> Fraction:
    """Return the fraction f with m / S >= f exactly where float64(m / S) >= theta, for 0 <= m <= S.

    The engine divides in float64 and compares with theta in [0, 1]. Rounding keeps order, so among all
    fractions m / S with S up to the largest total, at least 1, those that pass lie above those that do not.
    Any fraction between the two sides decides alike; the simplest is taken: 7 / 20 for theta = 0.35.
    """
    if theta <= 0:
        return Fraction(0)
    total = np.arange(1, max(1, largest_total) + 1, dtype=np.int64)
    least = np.ceil(theta * total).astype(np.int64) + 1
    while (lower := (least > 0) & ((least - 1) / total >= theta)).any():
        least -= lower
    high = _extreme(least, total, largest=False)
    low = _extreme(least - 1, total, largest=True)
    # The smallest denominator d with a fraction n / d in (low, high], of which it has one.
    n = total * high.numerator // high.denominator
    first = int(np.argmax(n * low.denominator > total * low.numerator))
    return Fraction(int(n[first]), int(total[first]))


def _extreme(numerator: Ints, denominator: Ints, *, largest: bool) -> Fraction:
    """Return the smallest or largest of some fractions, exactly."""
    quotient = numerator / denominator
    edge = quotient.max() if largest else quotient.min()
    near = np.flatnonzero(np.abs(quotient - edge) <= 1e-12)
    choose = max if largest else min
    return choose(Fraction(int(numerator[i]), int(denominator[i])) for i in near)


@dataclass(frozen=True)
class SendOnDeltaForm:
    """Send-on-delta from raw samples.

    n_sensors: sampled channels.
    thresholds: as in the encoder.
    whole: the thresholds in 2^-shift, where whole samples are encoded in integers exactly; None: they need
        floating point.
    rule: how the level moves (`dse.data.encoders.send_on_delta`). merged: ON and OFF share a channel.
    first: (sensor,) level that a recording begins at; empty: its first sample.
    """

    n_sensors: int
    thresholds: tuple[float, ...]
    whole: tuple[int, ...] | None
    shift: int
    rule: str
    merged: bool
    first: tuple[float, ...] = ()

    @property
    def n_thresholds(self) -> int:
        return len(self.thresholds)

    @property
    def n_levels(self) -> int:
        """Levels of a channel."""
        return 1 if self.rule == "digits" else self.n_thresholds

    @property
    def takes_whole(self) -> bool:
        """Whether samples may be integers."""
        return self.whole is not None


@dataclass(frozen=True)
class ReceptorsForm:
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
    def n_kinds(self) -> int:
        """Kinds of receptors."""
        return len(self.kinds)

    @property
    def n_totals(self) -> int:
        """Sums that the moving average needs, of all samples up to each of its own; 0: there is none."""
        smoothed = max(1, round(self.encoder.smoothing_ms / self.step_ms))
        return smoothed + 1 if smoothed > 1 else 0


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What surrounds a classifier: its input, its window and the names of its answers.

    n_channels: of the input spikes. n_steps: input steps of the window. step_ms: duration of an input step.
    window: where it begins in a recording: start, middle or contact_onset. onset_threshold: of the contact.
    cut_steps, every_steps: length and distance of the recordings that a stream is cut into; None: into none.
    no_front_end: why spikes are pushed although the design has an encoder or preprocessing; '' where it does
        not apply.
    t0_us, n_bins: of simulated trials, the time that bins are counted from, and how many there are; None:
        from the first event to the last.
    """

    n_channels: int
    n_steps: int
    step_ms: float
    classes: tuple[str, ...]
    window: str
    onset_threshold: float
    no_front_end: str
    encoder: SendOnDeltaForm | ReceptorsForm | None = None
    pooling: Pooling | None = None
    t0_us: int | None = None
    n_bins: int | None = None
    cut_steps: int | None = None
    every_steps: int | None = None

    @property
    def front_end(self) -> FrontEnd:
        """What is pushed."""
        return "samples" if self.encoder else "events" if self.pooling else "spikes"

    @property
    def channel_words(self) -> int:
        """Words of 32 bits with a bit per channel."""
        return -(-self.n_channels // 32)


@dataclass(frozen=True, kw_only=True)
class Spiking(Frame, Net):
    """A spiking network with its input, its window and its decision: all that runs.

    Its layers have the bounds of their states within a window.
    """

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
    def is_delayed(self) -> bool:
        """Whether there are delayed copies of the inputs."""
        return any(self.delays)


def spiking_of(bundle: Classifier) -> Spiking:
    """Return all that runs of a bundle of a network."""
    network, frame = bundle.fitted, frame_of(bundle)
    assert isinstance(network, Network)
    per_sample = network.steps_per_sample
    rule = rule_of(bundle, frame.n_steps * per_sample, network.sizes[-1], frame.step_ms / per_sample)
    net = net_of(network, frame.n_steps * per_sample)
    return Spiking(**{**vars(net), **vars(frame)}, rule=rule)


def frame_of(bundle: Classifier) -> Frame:
    """Return what surrounds the classifier of a bundle."""
    if bundle.input is None:
        raise Unsupported("the bundle does not say what recordings it takes: export it again beside its data")
    taken, window, data = bundle.input, bundle.sections.window, bundle.sections.data
    encoder, pools, no_front_end = _front_end(bundle.sections, taken)
    t0_us = n_bins = None
    if isinstance(data, SceneTrials):
        trials, t0_us = data.read(Path()), 0  # nothing is simulated
        n_bins = None if pools is None else pools.n_bins(trials.duration_us)
    return Frame(
        n_channels=bundle.fitted.n_channels,
        n_steps=taken.n_steps,
        step_ms=taken.step_ms,
        classes=bundle.answers,
        window=window.at,
        onset_threshold=window.onset_threshold,
        no_front_end=no_front_end,
        encoder=encoder,
        pooling=pools,
        t0_us=t0_us,
        n_bins=n_bins,
        cut_steps=window.cut_steps,
        every_steps=window.every_steps or window.cut_steps,
    )


def _front_end(
    sections: Sections, taken: Input
) -> tuple[SendOnDeltaForm | ReceptorsForm | None, Pooling | None, str]:
    """Return what makes spikes of what is pushed; else why spikes are pushed where recordings are none."""
    encoder, preprocessing = sections.encoder, sections.preprocessing
    if encoder is None:
        pools = None if preprocessing is None else pooling(preprocessing, taken.width, taken.height)
        if pools is None or pools.rate_floor_hz <= 0:
            return None, pools, ""
        why = "preprocessing.rate_floor_hz needs the whole window before its first spike"
    elif preprocessing is not None:
        why = "an encoder of pooled events is not written in C"
    elif not isinstance(encoder, Deltas | Receptors):
        why = f"encoder {sections.kinds['encoder']} is not written in C"
    elif sections.window.remove_mean:
        why = "window.remove_mean needs the whole window before its first spike"
    elif isinstance(sections.data, RasterFile):
        why = "an encoder of spikes is not written in C"
    elif isinstance(encoder, Receptors):
        return ReceptorsForm(taken.n_channels, encoder, taken.step_ms), None, ""
    else:
        return send_on_delta_form(encoder, taken.n_channels), None, ""
    return None, None, why


def send_on_delta_form(encoder: Deltas, n_sensors: int) -> SendOnDeltaForm:
    """Return how an encoder runs; in integers where whole samples of up to 24 bits give the same spikes.

    Thresholds that are multiples of 2^-shift keep every level on that grid, in float64 as in integers. A
    level that moves to the sample itself stays whole: then a threshold is as good as the next whole one.
    """
    begins = (encoder.means or (0.0,) * n_sensors) if encoder.learns else ()  # 0: before they are learnt
    shift, whole = 0, tuple(math.ceil(theta) for theta in encoder.thresholds)
    if encoder.reference != "value":
        shifts = range(_MOST_SHIFT + 1)
        shift = next((s for s in shifts if all((x * 2**s).is_integer() for x in encoder.thresholds)), 0)
        whole = tuple(int(x * 2**shift) for x in encoder.thresholds)
    scaled = [x * 2**shift for x in (*(() if encoder.reference == "value" else encoder.thresholds), *begins)]
    is_whole = all(x.is_integer() and abs(x) < 2**30 for x in scaled) and max(whole) < 2**30
    merged = encoder.polarity == "merged"
    return SendOnDeltaForm(
        n_sensors, encoder.thresholds, whole if is_whole else None, shift, encoder.reference, merged, begins
    )
