"""A temporal convolutional network in 8 bits: causal dilated convolutions, sums over time, a linear readout.

    x[0][p](t)   = what place p adds up to in bin t, or up to it (`reads`), >> r[p], held within -128 and 127
    y[k](t)      = b[k] + sum over K taps j of x[k](t - j 2^k) W[k][j]          W int8, b and y int32
    x[k+1](t)    = min(max(y[k](t), 0) >> shift[k], 127)                        bins t = S-1, 2S-1, ... alone
    features     = sum over t of x[last](t)

K is `kernel_size` and S `stride`: layer k computes once in S of the bins that it reads, so that the deepest
one computes once in S^layers. Before the window everything is 0. r[p] and shift[k] are the least at which no
training sample exceeds 8 bits; others are held there. All numbers are integers, and this is their
definition: a scale and its sums are those of `dse.models.counts.integers`, so that 32 bits hold every sum.
The readout is that of `linear`, one per input length, on the integers of the trained convolutions.

Convolutions train in float32 with a linear layer on the mean over time, by cross-entropy and Adam in batches
of 32, at a step size that falls as half a cosine. Weights and activations are rounded to 8 bits on the way;
their gradients pass as if they were not.
Source: [Bai et al. 2018 in REFERENCES.md], without residual connections;
rounding in training [Jacob et al. 2018 in REFERENCES.md], here with shifts between layers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from dse.base.native.extras import require_torch
from dse.base.records import Array, Dataset, Floats, Ints, Parameters
from dse.base.registry import fixed, param, register
from dse.config.parts import KeyFault, Part, Written
from dse.config.settings import missing_package
from dse.models.counts.integers import MOST_WEIGHT, rounded
from dse.models.counts.kernels import Sliding
from dse.models.counts.levels import is_wired
from dse.models.counts.rate_windows import Learnt
from dse.models.counts.readouts import scaling, unscaled
from dse.models.training import Generators, TrainingDiverged

LOWEST, HIGHEST = -128, 127
_BATCH = 32
_SOLVER_STEPS = 1000
_LEAST_SCALE = 0.1
"""Share of the largest deviation of an input, below which none counts as less in training."""


@register("models", "tcn")
@dataclass(frozen=True)
class TCN(Sliding):
    """Temporal convolutional network in 8-bit integers, trained by torch; it works bin by bin.

    Cost: W_t = weights of convolutions and readout, without biases; each is one multiply-accumulate whenever
    its layer computes. Its C skips inputs that are 0.
    Health: converged, whether every readout ended within 1000 steps; loss of every epoch.
    """

    most_in_bin: ClassVar[int] = HIGHEST

    window_ms: float = param(20.0, low=0, low_open=True, unit="ms", doc="bin in which spikes add up")
    reads: Literal["counts", "levels", "changes"] = param(
        "counts",
        choices=("counts", "levels", "changes"),
        doc="what of a bin is read: the spikes of each channel; of every place the level that they have "
        "added up to, of encoder quantised the signal; or what they have changed that level by",
    )
    hidden: tuple[int, ...] = param((16, 16), low=4, high=64, doc="channels of each layer, of 1 to 3")
    kernel_size: int = param(5, low=3, high=8, doc="taps of a convolution; layer k has dilation 2^k")
    stride: int = param(1, low=1, high=3, doc="bins of its input after which a layer computes")
    learning_rate: float = param(0.01, low=0, low_open=True, doc="first step size of Adam")
    epochs: int = param(40, low=1, doc="passes over the training samples")
    read_outs: int = fixed(
        10, low=1, high=50, doc="largest number of input lengths with a prediction, evenly spaced"
    )

    def n_inputs(self, arrays: Mapping[str, Array]) -> int:
        """Return how many inputs the readout has: the channels of the last layer."""
        return self.hidden[-1]

    def __post_init__(self) -> None:
        """Check the number of layers."""
        if not 1 <= len(self.hidden) <= 3:
            raise ValueError(f"hidden must have 1 to 3 layers, got {len(self.hidden)}")

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield that torch is not installed."""
        if space.is_run and (lack := missing_package("torch", "torch")):
            yield part.fault("kind", f"'tcn' {lack}")

    def wiring(self, dataset: Dataset) -> Mapping[str, Array]:
        """Return the place of each channel, and what its spike adds; for counts a place each, and 1."""
        if self.reads != "counts":
            return super().wiring(dataset)
        n = dataset.spikes.n_channels
        return {"place": np.arange(n, dtype=np.int32), "sign": np.ones(n, np.int8)}

    def learn(self, counts: Array, target: Array, lengths: Array, most: int, rngs: Generators) -> Learnt:
        """Train convolutions, round them, then train and round a readout per input length.

        Raises:
            MissingExtra: torch is not installed.
            TrainingDiverged: weights became infinite or NaN.
            ValueError: the window ends before the deepest layer computes.
        """
        require_torch("training a tcn")
        if counts.shape[1] < self.stride ** len(self.hidden):
            raise ValueError(
                f"model.stride {self.stride} leaves the last of {len(self.hidden)} layers none of "
                f"{counts.shape[1]} bins of model.window_ms {self.window_ms:g}"
            )
        levels = self._levels(counts)
        lowest, highest = levels.min(axis=(0, 1)), levels.max(axis=(0, 1))
        bits = [max(int(max(-1 - a, b)).bit_length() - 7, 0) for a, b in zip(lowest, highest, strict=True)]
        arrays: dict[str, Array] = {"level_shifts": np.array(bits, np.uint8), "classes": np.unique(target)}
        x = held(levels, arrays["level_shifts"])
        mean, scale = scaling(x.reshape(-1, x.shape[2]))
        scale = np.maximum(scale, _LEAST_SCALE * scale.max())
        classes = np.searchsorted(arrays["classes"], target)
        trained, losses = self._trained(x, mean, scale, classes, rngs("tcn"))
        filters = unscaled(trained, *(np.tile(values, self.kernel_size) for values in (mean, scale)))
        shifts, unit = [], 1.0  # that an input stands for
        for k, (weight, bias) in enumerate(filters):
            seen = self._seen(x, k)
            layer = rounded([(unit * weight, bias)], seen.reshape(-1, seen.shape[2]), -LOWEST)
            arrays |= {f"filter/{k}": layer.weights[0], f"offset/{k}": layer.biases[0]}
            y = self._convolved(x, arrays, k)
            shifts.append(max(int(y.max(initial=0)).bit_length() - 7, 0))
            x, unit = rectified(y, shifts[-1]), 2.0 ** shifts[-1] / layer.scale
        arrays["filter_shifts"] = np.array(shifts, np.uint8)
        readouts = replace(self, epochs=_SOLVER_STEPS)  # `epochs` are those of the convolutions
        learnt = readouts.regressed(arrays, counts, target, lengths, counts.shape[1] * HIGHEST)
        return Learnt(learnt.arrays, {"loss": losses}, learnt.health)

    def _levels(self, counts: Array) -> Ints:
        """Return what each bin reads, (n, bin, place), of what it adds."""
        return np.cumsum(counts, axis=1, dtype=np.int32) if self.reads == "levels" else counts

    def _trained(
        self, x: Array, mean: Floats, scale: Floats, target: Array, rng: np.random.Generator
    ) -> tuple[list[tuple[Floats, Floats]], Floats]:
        """Return weight (tap x input, channel) and bias (channel,) of each layer in double, and losses.

        Args:
            x: (n, bin, place) integers.
            mean: (place,) that is taken off x.
            scale: (place,) that the rest is divided by.
            target: (n,) classes from 0.
            rng: of first weights and of the order of samples.
        """
        import torch
        from torch.nn.functional import conv1d, cross_entropy, pad

        def drawn(*shape: int) -> Any:
            bound = np.sqrt(6 / np.prod(shape[1:]))
            return torch.tensor(rng.uniform(-bound, bound, shape), dtype=torch.float32, requires_grad=True)

        sizes, n_classes = (x.shape[2], *self.hidden), int(target.max()) + 1
        weights = [drawn(n, m, self.kernel_size) for m, n in zip(sizes, self.hidden, strict=False)]
        biases = [torch.zeros(n, requires_grad=True) for n in self.hidden]
        head, rest = drawn(n_classes, sizes[-1]), torch.zeros(n_classes, requires_grad=True)
        # What lies before the window is 0 before it is scaled, as it is in integers.
        padded = np.pad(x, ((0, 0), (self.kernel_size - self.stride, 0), (0, 0)))
        given = torch.tensor(np.moveaxis((padded - mean) / scale, 1, 2), dtype=torch.float32)
        classes = torch.tensor(target)
        optimiser = torch.optim.Adam([*weights, *biases, head, rest], lr=self.learning_rate)
        falling = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, self.epochs)
        losses, n_threads = np.zeros(self.epochs), torch.get_num_threads()
        torch.set_num_threads(1)  # sums depend on how many share them
        try:
            for epoch in range(self.epochs):
                for batch in np.array_split(rng.permutation(len(x)), -(-len(x) // _BATCH)):
                    passed = given[batch]
                    for k, (w, b) in enumerate(zip(weights, biases, strict=True)):
                        before = (self.kernel_size - 1) * 2**k + 1 - self.stride if k else 0
                        step = w.detach().abs().max().clamp(min=1e-6) / MOST_WEIGHT
                        w8 = w + ((w / step).round() * step - w).detach()
                        y = conv1d(pad(passed, (before, 0)), w8, b, self.stride, dilation=2**k).relu()
                        # A shift wastes up to a bit.
                        step = y.detach().max().clamp(min=1e-6) / (HIGHEST // 2)
                        passed = y + ((y / step).floor() * step - y).detach()
                    loss = cross_entropy(passed.mean(dim=2) @ head.T + rest, classes[batch])
                    optimiser.zero_grad()
                    loss.backward()  # type: ignore[no-untyped-call]
                    optimiser.step()
                    losses[epoch] += float(loss.detach()) * len(batch) / len(x)
                falling.step()
        finally:
            torch.set_num_threads(n_threads)
        if not np.isfinite(losses).all():
            raise TrainingDiverged(
                f"the weights became infinite or NaN with learning rate {self.learning_rate:g}"
            )
        layers = []
        for w, b in zip(weights, biases, strict=True):
            newest_first = w.detach().double().numpy()[:, :, ::-1].transpose(2, 1, 0)
            layers.append((newest_first.reshape(-1, len(b)), b.detach().double().numpy()))
        return layers, losses

    def _seen(self, x: Ints, k: int) -> Ints:
        """Return what the taps of layer k see, (n, bin, tap x channel), in the bins in which it computes."""
        bins, late = np.arange(self.stride - 1, x.shape[1], self.stride), (self.kernel_size - 1) * 2**k
        padded = np.pad(x, ((0, 0), (late, 0), (0, 0)))
        taps = [padded[:, bins + late - j * 2**k] for j in range(self.kernel_size)]
        return np.concatenate(taps, axis=2)

    def _convolved(self, x: Ints, arrays: Mapping[str, Array], k: int) -> Ints:
        """Return the sums of layer k, (n, bin, channel) int64, in the bins in which it computes."""
        weight = arrays[f"filter/{k}"].astype(np.float64)  # below 2^53 sums are exact in double
        return (self._seen(x, k) @ weight).astype(np.int64) + arrays[f"offset/{k}"]

    def passed(self, arrays: Mapping[str, Array], counts: Array) -> list[Ints]:
        """Return what each layer sees, and last what is summed over time, each (n, bin, channel)."""
        found = [held(self._levels(counts), arrays["level_shifts"])]
        for k, shift in enumerate(arrays["filter_shifts"].tolist()):
            found.append(rectified(self._convolved(found[-1], arrays, k), shift))
        return found

    def inputs(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Iterator[Array]:
        """Yield what each channel of the last layer has summed up to in each input length, (n, channel)."""
        last = self.passed(arrays, counts)[-1]
        summed = np.zeros((len(last), last.shape[1] + 1, last.shape[2]), np.int64)
        np.cumsum(last, axis=1, out=summed[:, 1:])
        for length in lengths:
            yield summed[:, length // self.stride ** len(self.hidden)]

    def n_weights(self, arrays: Mapping[str, Array], n_features: Array) -> Array:
        """Return the weights of convolutions and readout."""
        filters = sum(arrays[f"filter/{k}"].size for k in range(len(self.hidden)))
        return super().n_weights(arrays, n_features) + filters

    def operations(self, arrays: Mapping[str, Array], n_features: Array) -> tuple[Array, Array | float]:
        """Return the weights of the readout, and those of convolutions each time that they compute."""
        macs = super().n_weights(arrays, n_features).astype(np.float64)
        for k in range(len(self.hidden)):
            macs = macs + arrays[f"filter/{k}"].size * (arrays["lengths"] // self.stride ** (k + 1))
        return macs, 0.0

    def program(
        self, arrays: Mapping[str, Array], counts: Array, lengths: Array
    ) -> Mapping[str, Array | list[float]]:
        """Return the work of the readout, and that of convolutions each time that they compute.

        It is priced as what costs as much in a readout of integers: a level, and an input that is looked at,
        as a unit; an input other than 0 and a tap as a row; a channel as two units.
        """
        work = {kind: np.array(x, np.float64) for kind, x in super().program(arrays, counts, lengths).items()}
        layers = self.passed(arrays, counts)[:-1] if len(arrays["classes"]) > 1 else []
        for k, x in enumerate(layers):
            n_out, times = len(arrays[f"offset/{k}"]), lengths // self.stride ** (k + 1)
            computes = np.arange(self.stride - 1, x.shape[1], self.stride)
            not_0, rows = np.count_nonzero(x, axis=(0, 2)) / max(1, len(x)), np.zeros(len(computes) + 1)
            for j in range(self.kernel_size):
                seen = computes - j * 2**k
                rows[1:] += np.cumsum(np.where(seen < 0, 0, not_0[np.maximum(seen, 0)]))
            units = times * (self.kernel_size * x.shape[2] + 2 * n_out)
            work["integer_unit"] += units if k else units + lengths * x.shape[2]
            work["integer_row"] += rows[times] + times * self.kernel_size
            work["integer"] += rows[times] * n_out
        return work

    def check_fitted(self, fitted: Parameters, n_outputs: int) -> None:
        """Check arrays that index others (`dse.config.contracts.Family`).

        Raises:
            ValueError: one has a wrong shape or range.
        """
        super().check_fitted(fitted, n_outputs)
        arrays, n_layers = fitted.arrays, len(self.hidden)
        sizes = (int(arrays["place"].max()) + 1, *self.hidden)
        is_right = is_wired(arrays, fitted.n_channels) and all(
            arrays[f"{name}_shifts"].shape == (n,) and (arrays[f"{name}_shifts"] < 32).all()
            for name, n in (("level", sizes[0]), ("filter", n_layers))
        )
        for k, n in enumerate(self.hidden):
            weight, bias = arrays[f"filter/{k}"], arrays[f"offset/{k}"]
            is_right &= weight.dtype == np.int8 and weight.shape == (self.kernel_size * sizes[k], n)
            is_right &= bias.dtype == np.int32 and bias.shape == (n,)
        if not is_right:
            raise ValueError("its layers must fit its places, channels and taps, in 8 bits")


def held(levels: Ints, shifts: Array) -> Ints:
    """Return levels, (n, bin, place), in 8 bits: shifted right by (place,) bits and held."""
    return np.asarray(np.clip(levels >> shifts, LOWEST, HIGHEST))


def rectified(y: Ints, shift: int) -> Ints:
    """Return what a layer passes on of its sums: 0 to 127."""
    return np.asarray(np.minimum(np.maximum(y, 0) >> shift, HIGHEST))
