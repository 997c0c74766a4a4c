"""The records that packages share, in the order of the pipeline.

    Signals | Events  -> encoder / preprocessing -> Spikes -> Dataset
    Dataset -> model -> Network, Response | Parameters, Answers -> decision, workload -> measurements

Time series are (sample, step, channel) unless stated otherwise; event times are integer
microseconds; a *step* is one time step of the encoder (a sampling period or a time bin).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
"""An array of any dtype; the aliases below fix the kind of number."""
Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
Bools = NDArray[np.bool_]


def ranges(first: Ints, length: Ints) -> Ints:
    """Return first[0], first[0] + 1, ... of the given lengths, one range after the other."""
    before = np.cumsum(length) - length
    return np.asarray(np.repeat(first - before, length) + np.arange(int(length.sum())), dtype=np.int64)


def sum_of_products(x: Array, y: Array) -> Floats:
    """Return the sum over the last axis of x times y, broadcast together, one term after the other.

    A matrix product adds in the order of the processor's kernels, so that last bits differ between machines.
    """
    total = x[..., 0] * np.asarray(y[..., 0], np.float64)
    for place in range(1, y.shape[-1]):
        total = total + x[..., place] * y[..., place]
    return np.asarray(total)


Arithmetic = Literal["integer", "float32", "ideal"]
"""integer: 8-bit weights and integer states, as deployed; float32; ideal: real numbers in float64."""

FrontEnd = Literal["encoder", "preprocessing"]
"""The section that turns recordings into spikes."""


@dataclass(frozen=True)
class Signals:
    """Sampled recordings, concatenated; recording i is `values[offsets[i]:offsets[i+1]]`.

    values: (sum of lengths, channel) float32, in sensor counts or the file's unit.
    offsets: (n + 1,) int64, starts at 0, never decreases.
    step_ms: sampling period.
    columns: label columns, each (n,): numbers or strings.
    resampled: sentences on samples that were interpolated.
    """

    values: Floats
    offsets: Ints
    step_ms: float
    columns: Mapping[str, Array]
    resampled: tuple[str, ...] = ()
    front_end: ClassVar[FrontEnd | None] = "encoder"

    @property
    def n_recordings(self) -> int:
        return len(self.offsets) - 1

    @property
    def n_channels(self) -> int:
        return int(self.values.shape[1])

    @property
    def lengths(self) -> Ints:
        """Steps of every recording, (n,) int64."""
        return np.diff(self.offsets)

    def notes(self) -> list[str]:
        """Return what was interpolated, one sentence per file."""
        return list(self.resampled)


@dataclass(frozen=True)
class Block:
    """Consecutive events of one recording: t_us (n,) int64, x and y (n,) int32, polarity (n,) uint8."""

    t_us: Ints
    x: Ints
    y: Ints
    polarity: Ints


@dataclass(frozen=True)
class Events:
    """Event recordings, concatenated; recording i is `t_us[offsets[i]:offsets[i+1]]`.

    t_us: (n_events,) int64 microseconds, never decreasing within a recording.
    x, y: (n_events,) int32 address; taxel arrays use x = taxel and y = 0.
    polarity: (n_events,) uint8, 1 = ON, 0 = OFF.
    width, height: address ranges (x < width, y < height).
    columns: label columns, each (n,).
    """

    t_us: Ints
    x: Ints
    y: Ints
    polarity: Ints
    offsets: Ints
    width: int
    height: int
    columns: Mapping[str, Array]
    front_end: ClassVar[FrontEnd | None] = "preprocessing"
    simulated: ClassVar[bool] = False

    @property
    def n_recordings(self) -> int:
        return len(self.offsets) - 1

    def blocks(self, i: int) -> Iterator[Block]:
        """Yield recording i as a single block."""
        part = slice(int(self.offsets[i]), int(self.offsets[i + 1]))
        yield Block(self.t_us[part], self.x[part], self.y[part], self.polarity[part])

    def notes(self) -> list[str]:
        """Return no repairs: events in memory are valid."""
        return []


@dataclass(frozen=True)
class Spikes:
    """Spikes of n samples, sparse, in the order of samples and steps.

    Binary unless `t_us` is given: sorted by channel within a step, no duplicates. With `t_us` they are
    events: sorted by time within a step, and a channel may have several.

    row_offsets: (n * n_steps + 1,) int64; the spikes of sample i at step t are
        `channel[row_offsets[i * n_steps + t]:row_offsets[i * n_steps + t + 1]]`.
    channel: (n_spikes,) int32 in [0, n_channels).
    n_steps: steps stored per sample (a shorter sample has empty rows at its end).
    step_ms: duration of one step.
    t_us: (n_spikes,) int32 microseconds since the start of the sample's first stored step; None: a spike has
        the time of its step.
    """

    row_offsets: Ints
    channel: Ints
    n_steps: int
    n_channels: int
    step_ms: float
    t_us: Ints | None = None

    @classmethod
    def of_dense(cls, fired: Array, step_ms: float) -> Self:
        """Return dense spikes, (sample, step, channel) of 0 and 1, as sparse ones."""
        rows = fired.reshape(-1, fired.shape[2])
        offsets = np.concatenate([[0], np.cumsum(rows.sum(axis=1, dtype=np.int64))])
        return cls(offsets, np.nonzero(rows)[1].astype(np.int32), fired.shape[1], fired.shape[2], step_ms)

    @property
    def n_samples(self) -> int:
        return (len(self.row_offsets) - 1) // self.n_steps if self.n_steps else 0

    def pieces(self, samples: Ints, first: Ints, n_steps: int) -> Self:
        """Return steps first[k] .. first[k] + n_steps - 1 of sample samples[k] as samples."""
        row = samples * self.n_steps + first
        counts = np.diff(self.row_offsets)[ranges(row, np.full(len(row), n_steps))]
        begin, end = self.row_offsets[row], self.row_offsets[row + n_steps]
        index = ranges(begin, end - begin)
        t_us = None
        if self.t_us is not None:
            since = np.repeat(np.rint(first * self.step_ms * 1000).astype(np.int64), end - begin)
            t_us = (self.t_us[index] - since).astype(self.t_us.dtype)
        offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        return replace(self, row_offsets=offsets, channel=self.channel[index], n_steps=n_steps, t_us=t_us)


@dataclass(frozen=True)
class Rasters:
    """Recordings that are spikes, with label columns, each (n,)."""

    spikes: Spikes
    columns: Mapping[str, Array]
    front_end: ClassVar[FrontEnd | None] = None

    @property
    def n_recordings(self) -> int:
        return self.spikes.n_samples

    @property
    def n_channels(self) -> int:
        return self.spikes.n_channels

    @property
    def lengths(self) -> Ints:
        """Steps of every recording, (n,) int64: all have the same number."""
        return np.full(self.spikes.n_samples, self.spikes.n_steps)

    def notes(self) -> list[str]:
        """Return no repairs: only event files are repaired."""
        return []


@dataclass(frozen=True)
class Head:
    """One part of a joint target, e.g. the texture of (texture, profile).

    name: name of its label column.
    classes: names of its classes.
    of_class: (joint class,) int64, the class of this head in each joint class.
    """

    name: str
    classes: tuple[str, ...]
    of_class: Ints


@dataclass(frozen=True)
class Dataset:
    """Spikes with a target, a split, and the window that a classifier receives.

    target: (n,) int64 into `classes`.
    start: (n,) int32 first step of the window that is evaluated.
    start_low, start_high: (n,) int32 inclusive bounds of the first step of a training window
        (both equal `start` without jitter). Every window fits: start_high + n_steps <= spikes.n_steps.
    n_steps: window length in steps.
    train, validation, test: int64 sample indices, disjoint; test may be empty.
    positions: (n_channels, 3) int32 x, y and plane (polarity or threshold) of every input channel.
    heads: the parts of a joint target; empty for a single target.
    room_low, room_high: (n,) int32 inclusive bounds of the first step of any window whose steps are stored;
        None: those of training windows.
    rises: (n_channels,) int32 what a spike of each channel adds to the level of its place (x and y), in the
        encoder's least step; None: spikes do not add up to a signal.
    """

    spikes: Spikes
    target: Ints
    classes: tuple[str, ...]
    start: Ints
    start_low: Ints
    start_high: Ints
    n_steps: int
    train: Ints
    validation: Ints
    test: Ints
    positions: Ints
    heads: tuple[Head, ...] = ()
    room_low: Ints | None = None
    room_high: Ints | None = None
    rises: Ints | None = None

    @property
    def room(self) -> tuple[Ints, Ints]:
        """Lowest and highest first step of a window whose steps are stored, (n,) each."""
        if self.room_low is None or self.room_high is None:
            return self.start_low, self.start_high
        return self.room_low, self.room_high


@dataclass(frozen=True)
class Layer:
    """One dense layer of neurons.

    weight: (neuron, input) float32; in integer arithmetic its 8-bit rounding is deployed
        (dse.engine.neurons.fixed_point.quantise).
        Delayed copies of the inputs count as inputs: column k * n_channels + c is channel c,
        `delays[k]` steps ago.
    recurrent: (neuron, neuron) float32 or None; row = postsynaptic, acts one step later.
    parameters: parameters of the neurons by name, each (neuron,) or one number (defined in
        dse.engine.neurons). Of CUBA-LIF: decay_current and decay_voltage, (neuron,) int32 12-bit decays in
        [0, 4096], and the integer mantissa `threshold`: a neuron fires where v > threshold / 64.
    neuron: name of the kind of neurons; the outputs may be of another kind than hidden layers.
    shared: (neuron, input) int32 number of each weight, from 0: those of one number are copies of one weight;
        -1: no weight, 0. None: each weight is alone.
    delay: (neuron, input) int8 delays of the feed-forward synapses, 0 to 62 network steps; None: none has.
    """

    weight: Floats
    recurrent: Floats | None
    parameters: Mapping[str, Array]
    neuron: str = "cuba_lif"
    shared: Ints | None = None
    delay: Array | None = None

    @property
    def matrices(self) -> list[Floats]:
        """Its weights, recurrent ones last."""
        return [self.weight, *([] if self.recurrent is None else [self.recurrent])]

    @property
    def n_weights(self) -> int:
        """Number of nonzero weights, recurrent ones included; copies of a shared weight count once."""
        own = 0 if self.recurrent is None else int(np.count_nonzero(self.recurrent))
        if self.shared is None:
            return int(np.count_nonzero(self.weight)) + own
        return int(np.unique(self.shared[self.weight != 0]).size) + own

    @property
    def n_weights_dense(self) -> int:
        """Number of weights, those that are 0 included; copies of a shared weight count once."""
        own = 0 if self.recurrent is None else self.recurrent.size
        return own + (self.weight.size if self.shared is None else int(self.shared.max(initial=-1)) + 1)


@dataclass(frozen=True)
class Network:
    """A trained spiking network, as it is run and exported.

    delays: input delays in network steps (0 = the spike itself), one copy of the input each.
    steps_per_sample: network steps per input step (>= 1).
    arithmetic: 'integer' (deployable); 'float32' or 'ideal' (float64): real states, unrounded weights.
    """

    layers: tuple[Layer, ...]
    n_channels: int
    delays: tuple[int, ...]
    steps_per_sample: int
    arithmetic: Arithmetic

    @property
    def n_weights(self) -> int:
        """Number W_t of nonzero weights, with recurrent weights and those of delayed inputs.

        Training leaves no weight at exactly 0. Pruned weights, and those that round to 0, are stored as 0.
        Copies of a shared weight count once.
        """
        return sum(x.n_weights for x in self.layers)

    @property
    def n_weights_dense(self) -> int:
        """Number of weights, those that are 0 included; copies of a shared weight count once."""
        return sum(x.n_weights_dense for x in self.layers)

    @property
    def is_full(self) -> bool:
        """Whether no synapse is missing: every spike reaches all neurons of the next layer."""
        return all(np.count_nonzero(m) == m.size for x in self.layers for m in x.matrices)

    @property
    def stored(self) -> tuple[int, ...]:
        """Nonzero weights into each layer, recurrent weights and every copy of shared ones included."""
        return tuple(sum(int(np.count_nonzero(m)) for m in x.matrices) for x in self.layers)

    @property
    def delay_bits(self) -> int:
        """Bits that hold the longest delay of a synapse; 0 where synapses have none."""
        return max(
            int(x.delay.max(initial=1)).bit_length() if x.delay is not None else 0 for x in self.layers
        )

    @property
    def n_slots(self) -> int:
        """Input steps whose spikes must be remembered."""
        return max(self.delays) // self.steps_per_sample + 1

    @property
    def sizes(self) -> tuple[int, ...]:
        """Neurons per layer, input copies first."""
        return (self.layers[0].weight.shape[1], *(x.weight.shape[0] for x in self.layers))


@dataclass(frozen=True)
class Response:
    """What a network did on n samples, T network steps each.

    output: (n, T, class) uint8 output spikes, one-step shift included.
    spikes: (n, T, layer) int32 spikes per layer and step; layer 0 is the input (delayed copies counted).
    updates: (n, T, layer - 1) int32 neurons with a non-zero membrane potential before reset, or with input.
    step_ms: duration of a network step.
    peak_state: largest |u| or |v| in integer units; above 2**23 - 1 the 24-bit registers of Loihi overflow.
    synapses: per layer, input first, mean number of nonzero weights that a spike reached; None: all.
    update_work: of a classifier other than a single network, per layer after the input, how often an update
        counts (`Workload.update_work`); None: once.
    """

    output: Array
    spikes: Array
    updates: Array
    step_ms: float
    peak_state: int
    synapses: tuple[float, ...] | None = None
    update_work: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Parameters:
    """A trained classifier other than a single spiking network: named arrays that its family interprets.

    arrays: numbers or strings, never pickled objects.
    n_channels: number of input channels in training.
    """

    arrays: Mapping[str, Array]
    n_channels: int

    @property
    def n_weights(self) -> int:
        """Number of weights W_t, stored by families of spiking networks."""
        return int(self.arrays["n_weights"])


@dataclass(frozen=True)
class Answers:
    """Predictions of a classifier without output spikes for n samples, after each of k input lengths.

    label: (n, k) int64 class; column j uses only the first time_ms[j] of the window.
    time_ms: (k,) increasing; the last is the whole window.
    n_weights: (k,) int64 stored numbers W_t that the prediction after time_ms[j] needs.
    macs, additions: (k,) float64 mean multiply-accumulates and additions per inference until that prediction.
    input_spikes: (n, k) int64 input spikes until then.
    event_macs, event_additions: (k,) the same work where each input spike adds the weights that it meets;
        None of a family without such a reading.
    program: (k,) mean times of each kind of work of its C (`hardware.kinds.processor`); empty: no C.
    stored_bits: bits that its C takes per stored number; None: there is no C.
    """

    label: Array
    time_ms: Array
    n_weights: Array
    macs: Array
    additions: Array
    input_spikes: Array
    event_macs: Array | None = None
    event_additions: Array | None = None
    program: Mapping[str, Array] = field(default_factory=dict)
    stored_bits: int | None = None


@dataclass(frozen=True)
class Workload:
    """Mean activity per inference of a dense spiking network; arrays may carry leading axes (design points).

    sizes: neurons per layer, input first (delayed copies counted as inputs).
    recurrent: per layer after the input, whether it is recurrent.
    n_steps: (...,) network steps executed.
    spikes: (..., layer) spikes, input first.
    updates: (..., layer - 1) neuron updates, or None for "every neuron, every step".
    step_ms: period of a network step, by the clock of the sensor.
    synapses: per layer, input first, mean number of nonzero weights that a spike reaches (output spikes:
        0 unless recurrent); None: all. Counted over whole inferences, also for early decisions.
    stored: per layer after the input, nonzero weights into it; None: all.
    delay_bits: bits per synapse for an individual delay.
    cores: per layer after the input, the number of cores that it occupies; None: as few as possible.
    pipeline_steps: steps from n_steps until the decision has passed through the layers; decision times of
        trained networks include them.
    resonators: per layer after the input, how many of its neurons resonate (neurons.resonator): four
        multiplications per update, where others have two, by two 12-bit factors of their own; None: none.
    awake: (..., layer - 1) steps in which any neuron of a layer is updated; None: as many as its updates, at
        most all.
    copies: delayed copies of the input channels among the inputs, the undelayed ones included.
    delayed: per layer after the input, whether its forward synapses have delays; None: all, given bits.
    peak_state: largest magnitude of a state, as in `Response`; 0: not known.
    steps_per_sample: network steps per input step.
    n_slots: input steps whose spikes delayed copies still need.
    needed_bits: per matrix of the layers (`Layer.matrices`), bits of its widest weight; None: weight_bits.
    """

    sizes: tuple[int, ...]
    recurrent: tuple[bool, ...]
    n_steps: Floats
    spikes: Floats
    updates: Floats | None
    step_ms: float
    weight_bits: int = 8
    synapses: tuple[float, ...] | None = None
    stored: tuple[int, ...] | None = None
    delay_bits: int = 0
    cores: tuple[int, ...] | None = None
    pipeline_steps: int = 0
    resonators: tuple[int, ...] | None = None
    awake: Floats | None = None
    copies: int = 1
    delayed: tuple[bool, ...] | None = None
    peak_state: int = 0
    steps_per_sample: int = 1
    n_slots: int = 1
    needed_bits: tuple[int, ...] | None = None

    @property
    def n_resonators(self) -> int:
        """Neurons that resonate."""
        return sum(self.resonators or ())

    @property
    def update_work(self) -> tuple[float, ...]:
        """Per layer after the input, the mean work of an update, in updates of neurons that only decay."""
        of_layers = zip(self.sizes[1:], self.resonators or (0,) * len(self.recurrent), strict=True)
        return tuple(1 + resonators / n for n, resonators in of_layers)

    @property
    def fan_out(self) -> tuple[int, ...]:
        """Synapses that one spike of each layer reaches, input first; output spikes leave the network."""
        forward = (*self.sizes[1:], 0)
        within = (0, *(n * back for n, back in zip(self.sizes[1:], self.recurrent, strict=True)))
        return tuple(a + b for a, b in zip(forward, within, strict=True))

    @property
    def dense(self) -> tuple[int, ...]:
        """Weights into each layer after the input, those that are 0 included."""
        pairs = zip(self.sizes, self.sizes[1:], self.recurrent, strict=False)
        return tuple(n * (before + n * back) for before, n, back in pairs)

    @property
    def delayed_share(self) -> float:
        """Share of the weights whose synapses have delays."""
        weights = self.dense if self.stored is None or not sum(self.stored) else self.stored
        delayed = self.delayed or (self.delay_bits > 0,) * len(weights)
        return sum(n for n, late in zip(weights, delayed, strict=True) if late) / sum(weights)

    @property
    def number_bits(self) -> float:
        """Bits per stored number, of a weight and of its delay, in the mean over the weights."""
        return self.weight_bits + self.delay_bits * self.delayed_share

    @property
    def input_ms(self) -> Floats:
        """Time (...) until the input is complete, by the clock of the sensor."""
        return np.asarray(self.n_steps) * self.step_ms

    @property
    def counts(self) -> Floats:
        """Counts per inference, (..., F) float64: steps, spikes of each layer, updates of each layer."""
        n_steps = np.asarray(self.n_steps, np.float64)
        spikes = np.asarray(self.spikes, np.float64)
        updates = n_steps[..., None] * np.array(self.sizes[1:]) if self.updates is None else self.updates
        return np.concatenate([n_steps[..., None], spikes, np.asarray(updates, np.float64)], axis=-1)

    def step_us(self, computing_us: Floats) -> Floats:
        """Return the mean time of a step, (..., as n_steps), from that of the inference; 0 without steps."""
        steps = np.asarray(self.n_steps, np.float64)
        return np.divide(computing_us, steps, out=np.zeros_like(computing_us), where=steps > 0)

    def pipeline_us(self, step_us: Floats) -> Floats:
        """Return the time that the decision takes through the layers, at the step period."""
        return np.asarray(self.pipeline_steps * np.maximum(self.step_ms * 1e3, step_us))

    @property
    def synaptic_operations(self) -> Floats:
        """Mean synaptic operations per inference, (...): each spike counts once per target neuron.

            sum over layers l of spikes_l (n_(l+1) + n_l where l is recurrent)

        Pruned weights do not count (`synapses` replaces the brackets).
        """
        reached = self.fan_out if self.synapses is None else self.synapses
        return sum_of_products(np.asarray(self.spikes), np.array(reached, dtype=np.float64))

    @property
    def macs(self) -> Floats:
        """Mean multiply-accumulates per inference, (...): 0, because spikes only add."""
        return np.zeros(np.shape(self.spikes)[:-1])

    def mapped(self, change: Callable[[Array], Array]) -> Workload:
        """Return a copy with a function applied to every array of design points."""
        return _changed(self, ("n_steps", "spikes", "updates", "awake"), change)

    def over_steps(self) -> Workload:
        """Return the sum over steps: spikes (..., step, layer), n_steps (..., step)."""
        of_layers = _changed(self, ("spikes", "updates", "awake"), lambda x: np.asarray(x).sum(axis=-2))
        return _changed(of_layers, ("n_steps",), lambda x: np.asarray(x).sum(axis=-1))

    def check(self) -> None:
        """Check that counts are possible and shapes match.

        Raises:
            ValueError: what is wrong.
        """
        self._check_layers()
        n_steps = np.asarray(self.n_steps, np.float64)
        _check_counts("n_steps", n_steps)
        n_layers = len(self.sizes)
        for name, values, n in (
            ("spikes", self.spikes, n_layers),
            ("updates", self.updates, n_layers - 1),
            ("awake", self.awake, n_layers - 1),
        ):
            if values is None:
                continue
            values = np.asarray(values, np.float64)
            shape = (*n_steps.shape, n)
            if values.shape != shape:
                raise ValueError(f"{name} must be {shape} like n_steps and sizes, got {values.shape}")
            _check_counts(name, values)
            if (values[n_steps == 0] > 0).any():
                raise ValueError(f"{name} must be 0 where n_steps is 0")
        if not (self.step_ms > 0 and np.isfinite(self.step_ms)):
            raise ValueError(f"step_ms must be > 0, got {self.step_ms}")
        for name, number, least in (
            ("weight_bits", self.weight_bits, 1),
            ("delay_bits", self.delay_bits, 0),
            ("pipeline_steps", self.pipeline_steps, 0),
            ("copies", self.copies, 1),
            ("peak_state", self.peak_state, 0),
            ("steps_per_sample", self.steps_per_sample, 1),
            ("n_slots", self.n_slots, 1),
        ):
            if number < least:
                raise ValueError(f"{name} must be >= {least}, got {number}")

    def _check_layers(self) -> None:
        """Check the fields with one value per layer, except counts."""
        sizes, n_layers = self.sizes, len(self.sizes)
        if n_layers < 2 or min(sizes) < 1 or len(self.recurrent) != n_layers - 1:
            raise ValueError(
                "sizes must hold an input and at least one layer, and recurrent one value less, "
                f"got {sizes} and {self.recurrent}"
            )
        for name, counts, most in (
            ("synapses", self.synapses, self.fan_out),
            ("stored", self.stored, self.dense),
        ):
            if counts is not None and (
                len(counts) != len(most) or not all(0 <= a <= b for a, b in zip(counts, most, strict=True))
            ):
                raise ValueError(f"{name} must be between 0 and {most} in each layer, got {counts}")
        if self.cores is not None and (
            len(self.cores) != n_layers - 1
            or not all(1 <= n <= size for n, size in zip(self.cores, sizes[1:], strict=True))
        ):
            raise ValueError(f"cores must be between 1 and {sizes[1:]} in each layer, got {self.cores}")


@dataclass(frozen=True)
class Operations:
    """Mean work per inference of a classifier other than a stack of spiking layers.

    Arrays are (...) design points. Such a classifier computes once, when its input is complete.

    macs, additions: multiply-accumulates, and additions without multiplication.
    updates: neuron updates of a spiking classifier, each as much as one of a neuron with two states.
    n_weights: stored numbers.
    duration_ms: length of the input.
    number_bits: bits per stored number and per operand, as measured.
    event_macs, event_additions: as `macs` and `additions` where each input spike is processed on its own;
        both None of a classifier without such a reading.
    program: (...) times of each kind of work of its C (`hardware.kinds.processor`); empty: there is none.
    stored_bits: bits that its C takes per stored number; None: there is none, or it is not known.
    """

    macs: Floats
    additions: Floats
    updates: Floats
    n_weights: Floats
    duration_ms: Floats
    number_bits: int = 32
    event_macs: Floats | None = None
    event_additions: Floats | None = None
    program: Mapping[str, Floats] = field(default_factory=dict)
    stored_bits: int | None = None

    cores: ClassVar[None] = None
    """Only for networks can a user set the number of cores of a layer."""

    @property
    def is_spiking(self) -> bool:
        """Whether there are neuron updates: a spiking classifier, whose additions are of weights."""
        return bool((np.asarray(self.updates) > 0).any())

    @property
    def input_ms(self) -> Floats:
        """Time (...) until the input is complete, by the clock of the sensor."""
        return np.asarray(self.duration_ms)

    @property
    def counts(self) -> Floats:
        """Counts per inference, (..., 4) float64: 1, macs, additions, neuron updates."""
        columns = np.broadcast_arrays(1.0, self.macs, self.additions, self.updates)
        return np.stack(columns, axis=-1).astype(np.float64)

    def step_us(self, computing_us: Floats) -> Floats:
        """Return the time of the inference, which is one step."""
        return computing_us

    def pipeline_us(self, step_us: Floats) -> Floats:
        """Return 0: there are no layers for the decision to pass."""
        return np.zeros_like(step_us)

    @property
    def synaptic_operations(self) -> Floats:
        """Mean additions without multiplication per inference, (...)."""
        return self.additions

    @property
    def of_events(self) -> Operations:
        """The work where each input spike is processed on its own; this one without such a reading."""
        if self.event_macs is None or self.event_additions is None:
            return self
        return replace(self, macs=self.event_macs, additions=self.event_additions)

    def mapped(self, change: Callable[[Array], Array]) -> Operations:
        """Return a copy with a function applied to every array of design points."""
        names = ("macs", "additions", "updates", "n_weights", "duration_ms", "event_macs", "event_additions")
        program = {name: change(times) for name, times in self.program.items()}
        return _changed(replace(self, program=program), names, change)

    def check(self) -> None:
        """Check that counts are possible.

        Raises:
            ValueError: what is wrong.
        """
        for name in ("macs", "additions", "updates", "n_weights", "duration_ms"):
            _check_counts(name, np.asarray(getattr(self, name), np.float64))
        for name in ("event_macs", "event_additions"):
            if (counts := getattr(self, name)) is not None:
                _check_counts(name, np.asarray(counts, np.float64))
        if not self.number_bits >= 1:
            raise ValueError(f"number_bits must be >= 1, got {self.number_bits}")


W = TypeVar("W", Workload, Operations)


def _changed(work: W, names: Iterable[str], change: Callable[[Array], Array]) -> W:
    """Return a copy with a function applied to those of some arrays that are there."""
    arrays = {name: values for name in names if (values := getattr(work, name)) is not None}
    changed: dict[str, Any] = {name: change(values) for name, values in arrays.items()}
    return replace(work, **changed)


def _check_counts(name: str, values: Floats) -> None:
    if not (np.isfinite(values) & (values >= 0)).all():
        raise ValueError(f"{name} must be finite and >= 0")


@dataclass(frozen=True)
class DecisionSurface:
    """Decision surfaces over (phi, theta): every array (phi, theta).

    accuracy: undecided samples decide at the end by argmax (t = T).
    accuracy_strict: undecided samples count as wrong.
    decision_latency_ms: mean time of the decision (undecided: T).
    undecided: fraction of samples that never reach theta.
    ties: fraction of samples whose argmax at the decision was a tie (lowest index wins).
    work: (phi, theta, m) mean cumulative work of a sample up to the decision; empty if not requested.
    """

    phi: Array
    theta: Array
    accuracy: Array
    accuracy_strict: Array
    decision_latency_ms: Array
    undecided: Array
    ties: Array
    work: Array


@dataclass(frozen=True)
class Outcome:
    """Result of one training run (one repeat) of a design, not summarised over seeds.

    network: the trained classifier, an argument of `respond` of its family.
    validation, test: responses of a spiking family, answers of any other; test is None without a test set.
    history: epoch curves by name (loss, accuracy_train, seconds).
    health: dead and saturated units, non-finite gradients, overflow, initialisation notes.
    """

    network: Network | Parameters
    validation: Response | Answers
    test: Response | Answers | None
    history: Mapping[str, Array]
    health: Mapping[str, Any] = field(default_factory=dict)
    train_s: float = 0.0
