"""Extreme learning machine on delayed spike counts: random hidden neurons, output weights solved for.

A sample is cut into counting windows of T_w, from its end backwards (the first may be shorter):

    x(k) = counts of every channel in windows k, k - 1, ..., k - n_d + 1; those before the start are empty
    h(k) = g(W f(x(k)) + b),   y(k) = beta h(k),   answer: the class of the largest y, the lowest on ties

It answers at the end of every counting window. One net answers all of them: it is trained on every position
of the delay line, n_d T_w long and T_w apart, that lies within a training sample, and on the sample's end
where none does. With `partial` it is trained on the end of every counting window, which makes its early
answers worth more than those of the published net. Crops of training are not used.

    weights     W                                     b             f(x)
    uniform     uniform in -1..1                      as W          (x - mean) / deviation over training rows
    gaussian    normal                                uniform       the same
    lognormal   exp(sigma N(0, 1) / U_T)              0             x

The last is a chip's: the ratio of current mirrors in weak inversion whose threshold voltages differ by sigma
(15-25 mV suit most problems), all positive. W and b are scaled by one number so that the expected root mean
square of a hidden neuron's input over the training rows, before b, is `drive` times the level at which g
saturates:

    counter     g(z) = floor(2^bits min(max(z, 0), 1)) / 2^bits         a neuron's spikes, counted to the full
    tanh        g(z) = tanh(z)

beta minimises |H beta - T|^2 + lambda |beta|^2 (T one-hot) by a singular value decomposition; lambda / s_1^2,
s_1 being the largest singular value, is the one of RIDGES with the most right answers, the largest on ties:

    ridge_from validation    on the validation rows, as published
    ridge_from training      on the training rows, each answered by the other four fifths of the training
                             samples; a fifth holds consecutive samples of every class, because neighbours may
                             overlap or come from one session

Singular values below max(shape) eps s_1 count as 0, so that 0 is the pseudo-inverse of the source. A class
without training samples is never answered.

Rules of cost: W_t is W, b and beta; what is only multiplied by windows before the start is left out. Each is
one multiply-accumulate; f is folded into W and b. Every input spike is one addition, to its window's count.
Where each spike is processed on its own, every spike in the delay line adds its weight to every hidden
neuron, as does b, and beta alone is multiplied: work that follows the spike rate (`Answers.event_additions`).

Sources: Rasouli et al., an extreme learning machine for texture recognition, Eqs. (5)-(10); Yao and Basu,
IEEE Trans. VLSI Syst. 25, 2017 (lognormal, counter) (REFERENCES.md).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from dse.base.native.threads import single_threaded
from dse.base.records import Answers, Array, Dataset, Outcome, Parameters
from dse.base.registry import fixed, param, register
from dse.models.counts.rate_windows import input_lengths, tallied, window_counts
from dse.models.training import Generators, Training

RIDGES = (0.0, *(10.0 ** (x / 2) for x in range(-28, 3)))
"""lambda / s_1^2, rising."""
FOLDS = 5
"""Parts of the training samples in which the ridge is cross-validated."""
THERMAL_MV = 25.85
"""U_T at 300 K."""

_MOST_READ_OUTS = 50
_NUMBERS = 1 << 22  # of a batch of rows


@register("models", "elm")
@dataclass(frozen=True)
class ELM:
    """Extreme learning machine on the spike counts of the last windows."""

    takes_events: ClassVar[bool] = True

    hidden: int = param(128, low=1, doc="hidden neurons L")
    window_ms: float = param(100.0, low=0, low_open=True, unit="ms", doc="counting window T_w")
    windows: int = param(10, low=1, doc="number n_d of counting windows behind a prediction")
    weights: str = param(
        "uniform",
        choices=("uniform", "gaussian", "lognormal"),
        doc="distribution of the random weights; lognormal: the mismatch of a chip",
    )
    sigma_mv: float = param(
        20.0,
        low=0,
        high=200,
        unit="mV",
        doc="standard deviation of threshold voltages (for lognormal weights)",
    )
    nonlinearity: str = param(
        "counter", choices=("counter", "tanh"), doc="nonlinearity of the hidden neurons"
    )
    drive: float = param(
        0.5, low=0, low_open=True, doc="scale of the input of a hidden neuron, relative to saturation"
    )
    counter_bits: int = param(14, low=1, high=24, doc="width of the counter of a hidden neuron (for counter)")
    partial: bool = param(
        False, doc="also train on delay lines that are not full yet, as in early predictions"
    )
    ridge_from: Literal["validation", "training"] = fixed(
        "validation",
        choices=("validation", "training"),
        doc="samples whose accuracy chooses the ridge penalty: those of validation, as published, or those "
        "of training, by cross-validation",
    )
    precision: Literal["float64", "float32"] = fixed(
        "float64",
        choices=("float64", "float32"),
        doc="floating-point format of hidden values and of the solution",
    )

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        """Solve for `dataset.train`; answer on validation and, where there is one, on test.

        Args:
            dataset: spikes of any kind, targets and split.
            training: not used; nothing is iterated.
            rngs: random generators by purpose; 'hidden' gives the random weights.

        Raises:
            ValueError: there is no training sample, or windows are shorter than a step.
        """
        if not dataset.train.size:
            raise ValueError("training needs at least one training sample, got none")
        with single_threaded():
            return self._fit(dataset, rngs)

    def _fit(self, dataset: Dataset, rngs: Generators) -> Outcome:
        begin_s = time.perf_counter()
        weight, bias = self._random(dataset, rngs("hidden"))
        classes = np.unique(dataset.target[dataset.train])
        triangle = np.zeros((0, self.hidden + len(classes)), self.precision)
        least, most, n_rows = np.full(self.hidden, np.inf), np.full(self.hidden, -np.inf), 0
        for x, target in self._training_rows(dataset, dataset.train):
            h = self._hidden(x, weight, bias)
            triangle = reduced(triangle, h, (target[:, None] == classes).astype(self.precision))
            least, most = np.minimum(least, h.min(axis=0)), np.maximum(most, h.max(axis=0))
            n_rows += len(h)
        solutions, values = ridge_solutions(triangle, self.hidden, RIDGES)
        if self.ridge_from == "training":
            right = self._right_in_training(dataset, weight, bias, classes)
        else:
            samples = dataset.validation if dataset.validation.size else dataset.train
            right = self._right(dataset, samples, weight, bias, solutions, classes)
        chosen = int(len(right) - 1 - right[::-1].argmax())
        arrays = {
            "input_weight": weight,
            "bias": bias,
            "output_weight": solutions[chosen],
            "classes": classes,
        }
        fitted = Parameters(arrays, dataset.spikes.n_channels)
        train_s = time.perf_counter() - begin_s
        health = {
            "random_weights": int(weight.size + (bias.size if bias.any() else 0)),
            "training_rows": n_rows,
            "ridge": float(RIDGES[chosen]),
            "hidden_rank": len(values),
            "hidden_condition": float(values[0] / values[-1]) if len(values) else 0.0,
            "hidden_constant": float((least == most).mean()),
        }
        return Outcome(
            fitted,
            self.respond(fitted, dataset, dataset.validation),
            self.respond(fitted, dataset, dataset.test) if dataset.test.size else None,
            {},
            health,
            train_s,
        )

    def respond(self, fitted: Parameters, dataset: Dataset, samples: Array) -> Answers:
        """Answer at the end of every counting window, of 50 evenly spaced ones where there are more.

        Raises:
            ValueError: the data set has other channels than was trained on, or windows shorter than a step.
        """
        m = dataset.spikes.n_channels
        if m != fitted.n_channels:
            raise ValueError(f"samples must have {fitted.n_channels} channels as in training, got {m}")
        weight, bias, beta, classes = (
            fitted.arrays[name] for name in ("input_weight", "bias", "output_weight", "classes")
        )
        edges = self._edges(dataset)
        lengths = input_lengths(len(edges) - 1, _MOST_READ_OUTS)
        label = np.zeros((len(samples), len(lengths)), np.int64)
        spikes, in_line = np.zeros_like(label), np.zeros_like(label)
        n_met, n_active = np.zeros((2, len(lengths)))
        done = 0
        for part in self._batches(samples, len(lengths) * self.windows * m):
            counts = self._counts(dataset, part)
            x = delay_line(counts, lengths, self.windows)
            with single_threaded():
                h = self._hidden(x.reshape(-1, x.shape[2]), weight, bias)
                y = h @ beta
            here = slice(done, done + len(part))
            label[here] = classes[y.argmax(axis=1)].reshape(len(part), -1)
            spikes[here] = counts.sum(axis=2, dtype=np.int64).cumsum(axis=1)[:, lengths - 1]
            in_line[here] = x.sum(axis=2, dtype=np.int64)
            n_met += np.count_nonzero(x, axis=2).sum(axis=0)
            n_active += np.count_nonzero(h.reshape(len(part), len(lengths), -1), axis=2).sum(axis=0)
            done += len(part)
        inputs = np.minimum(lengths, self.windows) * m + int(bias.any())
        n_weights = (inputs * self.hidden + beta.size).astype(np.int64)
        program: dict[str, Array] = {}
        if self.nonlinearity == "counter":  # in C; what is 0 meets no weight
            n_features = np.minimum(lengths, self.windows) * m
            format_ = "single" if self.precision == "float32" else "double"
            n = max(1, len(samples))
            program = tallied(dataset, samples, edges[lengths], n_features) | {
                "tally_add": in_line.sum(axis=0) / n,
                f"{format_}_row": (n_met + n_active) / n,
                format_: (self.hidden * n_met + beta.shape[1] * n_active) / n,
                f"{format_}_unit": np.full(len(lengths), float(self.hidden)),
            }
            if format_ == "double":
                program["double_input"] = n_features.astype(np.float64)
        return Answers(
            label=label,
            time_ms=edges[lengths] * dataset.spikes.step_ms,
            n_weights=n_weights,
            macs=n_weights.astype(np.float64),
            additions=spikes.sum(axis=0) / max(1, len(spikes)),
            input_spikes=spikes,
            event_macs=np.full(len(lengths), float(beta.size)),
            event_additions=self.hidden * (in_line.sum(axis=0) / max(1, len(spikes)) + int(bias.any())),
            program=program,
            stored_bits=(32 if self.precision == "float32" else 64) if program else None,
        )

    def _random(self, dataset: Dataset, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return random weights (hidden, feature) and biases (hidden,), with f and the scale folded in."""
        shape = self.hidden, self.windows * dataset.spikes.n_channels
        if self.weights == "lognormal":
            sigma = self.sigma_mv / THERMAL_MV
            weight, bias = np.exp(sigma * rng.standard_normal(shape)), np.zeros(self.hidden)
            mean, square = np.exp(sigma**2 / 2), np.exp(2 * sigma**2)
        else:
            weight = rng.standard_normal(shape) if self.weights == "gaussian" else rng.uniform(-1, 1, shape)
            bias = rng.uniform(-1, 1, self.hidden)
            mean, square = 0.0, 1.0 if self.weights == "gaussian" else 1 / 3
        n, total, squares, of_sums = 0, np.zeros(shape[1]), np.zeros(shape[1]), 0.0
        for x, _ in self._training_rows(dataset, dataset.train):
            n, total, squares = n + len(x), total + x.sum(axis=0), squares + np.square(x).sum(axis=0)
            of_sums += float(np.square(x.sum(axis=1)).sum())
        if self.weights == "lognormal":
            power = mean**2 * of_sums / n + (square - mean**2) * squares.sum() / n
            offset, deviation = np.zeros(shape[1]), np.ones(shape[1])
        else:
            offset = total / n
            variance = np.maximum(squares / n - offset**2, 0.0)
            varies = variance > 1e-9 * (squares / n)  # what is left is rounding
            power = square * int(varies.sum())
            deviation = np.where(varies, np.sqrt(variance), np.inf)
        scale = self.drive / np.sqrt(power) if power > 0 else 0.0
        # A bias of the size of the weights' own spread, so that neurons switch at different levels.
        weight, bias = scale * weight / deviation, self.drive * bias
        return weight.astype(self.precision), (bias - weight @ offset).astype(self.precision)

    def _hidden(self, x: Array, weight: Array, bias: Array) -> Array:
        """Return g(W x + b), (row, hidden)."""
        z = x.astype(self.precision) @ weight.T + bias
        if self.nonlinearity == "tanh":
            return np.asarray(np.tanh(z))
        full = 2.0**self.counter_bits
        return np.asarray(np.floor(full * np.clip(z, 0, 1)) / full)

    def _right_in_training(self, dataset: Dataset, weight: Array, bias: Array, classes: Array) -> Array:
        """Return how many training rows the other folds answer right at each of RIDGES, (ridge,) int64."""
        fold = consecutive_folds(dataset.target[dataset.train], FOLDS)
        parts = [dataset.train[fold == k] for k in range(FOLDS)]
        triangles = [np.zeros((0, self.hidden + len(classes)), self.precision) for _ in parts]
        for k, part in enumerate(parts):
            for x, target in self._training_rows(dataset, part):
                one_hot = (target[:, None] == classes).astype(self.precision)
                triangles[k] = reduced(triangles[k], self._hidden(x, weight, bias), one_hot)
        right = np.zeros(len(RIDGES), np.int64)
        for k, part in enumerate(parts):
            others = np.concatenate([other for j, other in enumerate(triangles) if j != k])
            if len(part) and len(others):
                triangle = np.asarray(np.linalg.qr(others, mode="r"))
                solutions, _ = ridge_solutions(triangle, self.hidden, RIDGES)
                right += self._right(dataset, part, weight, bias, solutions, classes)
        return right

    def _right(
        self, dataset: Dataset, samples: Array, weight: Array, bias: Array, solutions: Array, classes: Array
    ) -> Array:
        """Return how many rows of some samples each solution answers right, (solution,) int64."""
        right = np.zeros(len(solutions), np.int64)
        for x, target in self._training_rows(dataset, samples):
            h = self._hidden(x, weight, bias)
            right += [int((classes[(h @ beta).argmax(axis=1)] == target).sum()) for beta in solutions]
        return right

    def _edges(self, dataset: Dataset) -> Array:
        """Return the borders of the counting windows in steps, (window + 1,), the whole window last."""
        step_ms = dataset.spikes.step_ms
        if self.window_ms < step_ms * (1 - 1e-9):
            raise ValueError(f"window_ms must be >= the step of {step_ms:g} ms, got {self.window_ms:g}")
        return borders(dataset.n_steps, round(self.window_ms / step_ms))

    def _counts(self, dataset: Dataset, samples: Array) -> Array:
        return window_counts(dataset.spikes, samples, dataset.start[samples], self._edges(dataset), "each")

    @staticmethod
    def _batches(samples: Array, n_features: int) -> Iterator[Array]:
        size = max(1, _NUMBERS // max(1, n_features))
        return (samples[k : k + size] for k in range(0, len(samples), size))

    def _training_rows(self, dataset: Dataset, samples: Array) -> Iterator[tuple[Array, Array]]:
        """Yield (row, feature) counts and (row,) targets of the positions that training looks at."""
        edges = self._edges(dataset)
        n = len(edges) - 1
        # A first window that is shorter than the others is none that a delay line is full with.
        shorter = int(n > 1 and edges[1] - edges[0] < edges[-1] - edges[-2])
        lengths = np.arange(1 if self.partial else min(n, self.windows + shorter), n + 1)
        for part in self._batches(samples, len(lengths) * self.windows * dataset.spikes.n_channels):
            x = delay_line(self._counts(dataset, part), lengths, self.windows)
            yield x.reshape(-1, x.shape[2]).astype(np.float64), np.repeat(dataset.target[part], len(lengths))


def borders(n_steps: int, width: int) -> Array:
    """Return 0, ..., n_steps, `width` apart but for the first two, which may be nearer, (window + 1,)."""
    ends = np.arange(n_steps, 0, -width)[::-1]
    return np.concatenate([[0], ends]).astype(np.int64)


def consecutive_folds(target: Array, n_folds: int) -> Array:
    """Return the fold of every sample, (n,): each holds consecutive samples of every class.

    Args:
        target: (n,) classes.
        n_folds: number of folds; one may be empty where samples are few.
    """
    fold = np.zeros(len(target), np.int64)
    for c in np.unique(target):
        members = np.flatnonzero(target == c)
        fold[members] = np.arange(len(members)) * n_folds // len(members)
    return fold


def delay_line(counts: Array, lengths: Array, windows: int) -> Array:
    """Return the counts of the last windows, newest first, (n, k, windows x channel).

    Args:
        counts: (n, window, channel).
        lengths: (k,) windows that have passed, from 1 on.
        windows: how many are looked at; those before the first are zero.
    """
    n, _, m = counts.shape
    padded = np.concatenate([np.zeros((n, windows, m), counts.dtype), counts], axis=1)
    newest_first = np.asarray(lengths)[:, None] + windows - 1 - np.arange(windows)
    return padded[:, newest_first].reshape(n, len(lengths), windows * m)


def reduced(triangle: Array, h: Array, t: Array) -> Array:
    """Add rows of H and T to what a least squares problem needs of the rows before.

    It is the triangle of [H T] = Q [R S; 0 .]; |H beta - T|^2 is |R beta - S|^2 and a constant.

    Args:
        triangle: (row, hidden + class), without rows at first.
        h: (row, hidden).
        t: (row, class).
    """
    stacked = np.concatenate([triangle, np.concatenate([h, t], axis=1)])
    return np.asarray(np.linalg.qr(stacked, mode="r"))


def ridge_solutions(triangle: Array, n_hidden: int, ridges: Sequence[float]) -> tuple[Array, Array]:
    """Return beta for several ridges, from one singular value decomposition.

        H = U S V';   beta = V diag(s / (s^2 + r s_1^2)) U' T over s > max(shape) eps s_1

    Args:
        triangle: of `reduced`, all rows.
        n_hidden: columns of H.
        ridges: r, each >= 0; 0 is the pseudo-inverse.

    Returns:
        (ridge, hidden, class), and the singular values that count, falling.
    """
    r, s = triangle[:n_hidden, :n_hidden], triangle[:n_hidden, n_hidden:]
    u, values, v = np.linalg.svd(r, full_matrices=False)
    values = values[values > max(triangle.shape) * np.finfo(values.dtype).eps * values[0]]
    rank = len(values)
    relative = values / values[0] if rank else values
    gain = relative / (relative**2 + np.array(ridges, values.dtype)[:, None]) / (values[0] if rank else 1)
    projected = u[:, :rank].T @ s
    return np.asarray(v[:rank].T @ (gain[:, :, None] * projected)), values
