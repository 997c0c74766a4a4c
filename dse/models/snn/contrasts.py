"""The start `contrasts` of a first layer: neurons that compare two inputs, those that the labels need.

A candidate is excited by one input and inhibited by another, in units of the inputs' mean spikes:

    drive(t) = x_a(t) / <x_a> - s * x_b(t) / <x_b>,    s in [0, 1]

Its weights are scaled so that the drive, averaged over as many steps as the neuron remembers, exceeds the
threshold for a share of the time. Drives that follow one common rate differ in what they are compared with,
so that counts tell more than that rate.

Which candidates stay is found by the labels: a least-squares readout of the spike counts of all of them
loses one neuron after the other, each time that whose loss raises the squared error least, minus the price
of its spikes. Removing neuron j from a readout with weights W raises the error by |W_j|^2 / P_jj, where P is
the inverse of the second moments. Candidates close to those that stayed then compete with them, a few times.
Sums of counts are exact, and all others run in one order: the choice is the same everywhere.

Source: Hassibi and Stork 1993, optimal brain surgeon, of a linear readout (REFERENCES.md).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Self

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array, Bools, Floats, Ints
from dse.engine.events import Rows
from dse.engine.forward import Prepared
from dse.engine.neurons import Population, taken
from dse.engine.neurons.response import dc_gain, response_norm
from dse.models.snn.whiten import covariance, inverse

NO_DRIVE = 1e-35
"""Weight of an input that does not drive a neuron: 0 would be no weight. Its square is 0 in float32."""
_CANDIDATES = 1024  # to choose among at first, at least; four times as many as are kept, if that is more
_ROUNDS = 4  # of candidates close to those that stayed: twice as many, or half of the first ones
SHARES = (
    0.02,
    0.95,
)  # least and largest share of the time with a positive drive that lies above the threshold
_NEAR = 0.2, 0.5  # of the share of an inhibition, and of the logarithm of the time: half the width
_OTHER = 0.3  # of those close by, how many are inhibited by another input
_PEAK_SAMPLES = 512  # whose potentials are kept, a few at a time


class Candidates:
    """Neurons of which some stay, a dataclass of arrays (neuron,), `time` and `neuron` among them.

    ridge: added to the second moments of scaled counts in the readout that decides which stay.
    absent: weight of an input that does not drive a neuron; an input whose weight is 0 never does.
    """

    ridge: ClassVar[float]
    absent: ClassVar[float]
    time: Floats
    neuron: Ints

    @classmethod
    @abstractmethod
    def drawn(cls, n_inputs: int, n: int, n_neurons: int, rng: np.random.Generator) -> Self:
        """Draw candidates of some inputs that fire."""

    @abstractmethod
    def near(self, n_inputs: int, n: int, rng: np.random.Generator) -> Self:
        """Draw candidates that these compete with."""

    @abstractmethod
    def drive(self, j: int, drives: Drives) -> tuple[Ints, Floats]:
        """Return which of the inputs that fire drive a candidate, and how much, in units of their means."""

    @classmethod
    def stored(cls, rows: Floats) -> Self:
        """Return candidates from a row per field."""
        pairs = zip(fields(cls), rows, strict=True)  # type: ignore[arg-type]
        return cls(*(row.astype(np.int64) if x.type == "Ints" else row for x, row in pairs))

    def __getitem__(self, which: Ints) -> Self:
        return type(self)(*(getattr(self, f.name)[which] for f in fields(self)))  # type: ignore[arg-type]

    def __add__(self, other: Self) -> Self:
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))  # type: ignore[arg-type]
        return type(self)(*(np.append(*pair) for pair in pairs))


@dataclass(frozen=True)
class Contrasts(Candidates):
    """What neurons compare, (neuron,) each.

    excited, inhibited: number of the input, among those that fire.
    share: of the mean of the inhibiting input, in that of the exciting one.
    time: share of the time with a positive drive for which it exceeds the threshold.
    neuron: which of the layer's neurons it is: they can differ.
    """

    excited: Ints
    inhibited: Ints
    share: Floats
    time: Floats
    neuron: Ints

    ridge: ClassVar[float] = 0.003
    absent: ClassVar[float] = NO_DRIVE

    @classmethod
    def drawn(cls, n_inputs: int, n: int, n_neurons: int, rng: np.random.Generator) -> Self:
        """Draw candidates: inputs in turn, times spread evenly on a logarithmic scale."""
        turn, excited = np.divmod(np.arange(n), n_inputs)
        low, high = np.log(SHARES)
        time = np.exp(low + (turn + 0.5) / -(-n // n_inputs) * (high - low))
        inhibited = _another(excited, n_inputs, rng)
        return cls(excited, inhibited, rng.random(n), time, np.arange(n) % n_neurons)

    def near(self, n_inputs: int, n: int, rng: np.random.Generator) -> Self:
        """Draw candidates that differ little from some of these."""
        of = self[rng.integers(self.share.size, size=n)]
        other = np.where(rng.random(n) < _OTHER, _another(of.excited, n_inputs, rng), of.inhibited)
        share = np.clip(of.share + rng.uniform(-_NEAR[0], _NEAR[0], n), 0, 1)
        time = np.clip(of.time * np.exp(rng.uniform(-_NEAR[1], _NEAR[1], n)), *SHARES)
        return type(self)(of.excited, other, share, time, of.neuron)

    def drive(self, j: int, drives: Drives) -> tuple[Ints, Floats]:
        """Return the two inputs, or the one, and how much of each."""
        inputs = np.array([self.excited[j], self.inhibited[j]])
        return (inputs[:1], np.ones(1)) if inputs[0] == inputs[1] else (inputs, np.array([1, -self.share[j]]))


def _another(inputs: Ints, n_inputs: int, rng: np.random.Generator) -> Ints:
    """Draw an input for each, not itself if there are several."""
    return (inputs + rng.integers(1, max(2, n_inputs), inputs.size)) % n_inputs


@dataclass(frozen=True)
class Choice:
    """What decides which candidates stay.

    run: return the spikes of candidates on training samples, (sample, candidate), and whether each leaves the
        range of a state, (candidate,), given their weights and neurons.
    targets: (sample, output) 1 where an output stands for a label of the sample, else 0.
    price: of a spike, in squared errors of a sample.
    made: what was chosen before, as returned by `first_layer`; None: nothing yet.
    wiring: of `Drives`.
    """

    run: Callable[[Floats, Population[Any]], tuple[Ints, Bools]]
    targets: Floats
    price: float
    made: Floats | None = None
    wiring: Mapping[str, Array] = field(default_factory=dict)


class Drives:
    """Weights of candidates of one layer.

    Args:
        rows: input spikes of a probe batch.
        population: the layer's neurons.
        n_neurons: how many they are.
        most_below: thresholds by which mean potentials may lie below rest, where no reset ends it; weights of
            a neuron that would lie lower are scaled down.
        wiring: `place` and `sign` of the channels, for kernels.
    """

    def __init__(
        self,
        rows: Rows,
        population: Population[Any],
        n_neurons: int,
        most_below: float,
        wiring: Mapping[str, Array] | None = None,
    ) -> None:
        self.wiring = wiring or {}
        self.population, self.most_below = population, most_below
        self.gain = dc_gain(population, n_neurons)
        norm = response_norm(population, n_neurons, rows.n_steps)
        memory = float(np.median((self.gain / norm) ** 2))
        seen = mean_counts(rows, min(max(1, round(memory)), rows.n_steps))
        self.n_inputs, self.active = rows.n_inputs, np.flatnonzero(seen.any(axis=0))
        self.means = seen.mean(axis=0)[self.active]
        self.seen = seen[:, self.active] / self.means

    def weights(self, candidates: Candidates) -> Floats:
        """Return weights, (input, neuron), of inputs that fire in the rows."""
        weights = np.full((self.n_inputs, candidates.time.size), candidates.absent)
        for j in range(candidates.time.size if self.active.size else 0):
            inputs, shares = candidates.drive(j, self)
            drive = np.zeros(len(self.seen))
            for share, seen in zip(shares, self.seen.T[inputs], strict=True):
                drive += share * seen
            above = np.sort(drive)[::-1]
            least = above[min(int(candidates.time[j] * np.count_nonzero(above > 0)), above.size - 1)]
            unit = max(least if least > 0 else above[0], -drive.min() / self.most_below)
            weights[self.active[inputs], j] = shares / (self.means[inputs] * (unit if unit > 0 else 1.0))
        scale = np.broadcast_to(self.population.to_threshold / self.gain, self.gain.shape)
        return np.asarray(weights * scale[candidates.neuron])


def first_layer(
    kind: type[Candidates], drives: Drives, n_neurons: int, rng: np.random.Generator, choice: Choice
) -> tuple[Floats, Population[Any], Floats]:
    """Return the weights of a first layer, (input, neuron), its neurons, and which they are, to be stored.

    The last is (field, neuron) float64, a row per field of the candidates.

    Args:
        kind: of candidates.
        drives: of its neurons.
        n_neurons: how many.
        rng: draws the candidates; it moves as far whether or not the choice was made before.
        choice: what decides which stay.
    """
    own, size = np.random.default_rng(rng.integers(2**63)), max(1, drives.active.size)
    if choice.made is not None:
        stay = kind.stored(choice.made)
    else:
        copies = -(-max(_CANDIDATES, 4 * n_neurons) // n_neurons)
        stay = kind.drawn(size, copies * n_neurons, n_neurons, own)
        counts, out = _run(drives, stay, choice)
        for turn in range(_ROUNDS + 1):
            kept = chosen(counts, choice.targets, n_neurons, choice.price, out, kind.ridge)
            stay, counts, out = stay[kept], counts[:, kept], out[kept]
            if turn < _ROUNDS:
                near = stay.near(size, max(_CANDIDATES // 2, 2 * n_neurons), own)
                fired, leaves = _run(drives, near, choice)
                stay, counts, out = stay + near, np.hstack([counts, fired]), np.append(out, leaves)
    stored = np.array([getattr(stay, f.name) for f in fields(stay)], np.float64)  # type: ignore[arg-type]
    return drives.weights(stay), taken(drives.population, stay.neuron), stored


def _run(drives: Drives, candidates: Candidates, choice: Choice) -> tuple[Ints, Bools]:
    return choice.run(drives.weights(candidates), taken(drives.population, candidates.neuron))


def mean_counts(rows: Rows, n_steps: int) -> Floats:
    """Return the mean spikes per step of every input over whole stretches of steps, (stretch, input)."""
    n_stretches = rows.n_steps // n_steps
    sample, step = np.divmod(np.repeat(np.arange(rows.offsets.size - 1), np.diff(rows.offsets)), rows.n_steps)
    stretch = np.minimum(step // n_steps, n_stretches)  # the last holds what is left over
    cell = (sample * (n_stretches + 1) + stretch) * rows.n_inputs + rows.index
    shape = rows.n_samples, n_stretches + 1, rows.n_inputs
    counts = np.bincount(cell, rows.times if rows.times.size else None, math.prod(shape)).reshape(shape)
    return np.asarray(counts[:, :-1].reshape(-1, rows.n_inputs) / n_steps)


def run_candidates(
    layer: Prepared,
    to_threshold: Floats | float,
    windows: Callable[[int, int], Iterable[Rows]],
    most_peak: float,
) -> tuple[Ints, Bools]:
    """Return the spikes of candidates, (sample, candidate), and which leave the range of a state.

    Args:
        layer: the candidates as they run.
        to_threshold: of their potentials, weight units.
        windows: return the inputs of the first so many training samples (0: of all), so many at a time.
        most_peak: thresholds that potentials are to stay within, on some of the samples.
    """
    counts = [layer.forward(rows).fired.per_input() for rows in windows(0, 64)]
    peaks = np.zeros(layer.n_neurons)
    for rows in windows(_PEAK_SAMPLES, 8) if math.isfinite(most_peak) else ():
        reached = np.abs(layer.forward(rows, keep_voltage=True).voltage).max(axis=(0, 1))
        peaks = np.maximum(peaks, reached / to_threshold)
    return np.concatenate(counts), peaks > most_peak


def chosen(
    counts: Ints, targets: Floats, n_neurons: int, price: float, out: Bools, ridge: float = Contrasts.ridge
) -> Ints:
    """Return which neurons stay, (n_neurons,) increasing.

    Args:
        counts: (sample, candidate) spikes.
        targets: (sample, output) 1 where an output stands for a label of the sample, else 0.
        n_neurons: how many stay.
        price: of a spike, in squared errors of a sample.
        out: (candidate,) bool, those that go first, whatever they tell.
        ridge: added to the second moments of scaled counts.
    """
    whole, n = counts.astype(np.float64), len(counts)
    totals = whole.sum(axis=0)
    scales, powers = covariance(counts)
    powers[np.diag_indices_from(powers)] += ridge
    share = targets.mean(axis=0)
    with_targets = (
        (whole.T @ targets - totals[:, None] * share) / n * scales[:, None]
    )  # sums of whole numbers
    left = np.ones(len(scales), np.bool_)
    prices = np.where(out, np.inf, price * totals / n)
    _remove(powers, with_targets, left, len(scales) - n_neurons, prices)
    return np.flatnonzero(left)


@compiled()
def _remove(powers: Array, with_targets: Array, left: Array, n_removed: int, prices: Array) -> None:
    """Clear `left` of the neurons that a least-squares readout misses least, one after the other."""
    inverted = inverse(powers)
    n, n_outputs = with_targets.shape
    readout = np.zeros((n, n_outputs))
    for i in range(n):
        for k in range(n):
            for c in range(n_outputs):
                readout[i, c] += inverted[i, k] * with_targets[k, c]
    for _ in range(n_removed):
        least, worst = np.inf, -1
        for j in range(n):
            if left[j]:
                squared = 0.0
                for c in range(n_outputs):
                    squared += readout[j, c] ** 2
                missed = squared / inverted[j, j] - prices[j]
                if worst < 0 or missed < least:
                    least, worst = missed, j
        left[worst] = False
        row = inverted[worst].copy()
        for i in range(n):
            if left[i]:
                factor = row[i] / row[worst]
                for k in range(n):
                    inverted[i, k] -= factor * row[k]
                for c in range(n_outputs):
                    readout[i, c] -= factor * readout[worst, c]
