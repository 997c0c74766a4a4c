"""Random dilated kernels over levels of spikes: how often each is above its thresholds, and a linear readout.

    level[p](t) = sum of what each spike of place p up to bin t adds to it (`dse.models.counts.levels`)
    z[g](t)     = sum over the places p of group g of s[g, p] level[p](t),     s = 1 or -1; 16 bits, held at
                  their ends
    c[k](t)     = 3 sum over 3 of 9 taps j of z[g](t - j d)  -  sum over all 9 taps of z[g](t - j d)
    x[k, m]     = bins t with c[k](t) > b[k, m]

Before the window a level is 0. What ON and OFF spikes (planes 1 and 0, 3 and 2, ...) of a place add up to is
the signal that they are changes of, and of the digits of `quantised` the quantised signal itself.
Kernels, whose weights -1 and 2 sum to 0, see its shape and not where it starts. Kernel k has dilation d =
2^(k mod D), the D powers of 2 whose nine taps the window holds, and group k // D: up to `places` places and
their signs, drawn. Its 3 taps are drawn; its M thresholds rise: each is a quantile of its values on some
training recordings, drawn from an M-th of 0.1 to 0.9. The sums are what costs, so that several thresholds
tell more at the price of one kernel.

In every other group, kernels whose taps span half the window at most (the first `whole` dilations) are
counted anew once all taps lie in the window, from bin 8 d on: how the window began does not reach these.

All numbers are integers, and the state is a ring of 8 d + 1 bins per group. The readout is that of `linear`.
Source: [Dempster et al., MiniRocket in REFERENCES.md]: kernels, dilations, quantiles, half of them without
what lies beyond the window, all of the signal itself.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import numpy as np

from dse.base.records import Array, Dataset, Ints, Parameters
from dse.base.registry import fixed, param, register
from dse.models.counts.levels import is_wired, wiring
from dse.models.counts.linear import Regressed
from dse.models.counts.rate_windows import Learnt, window_edges
from dse.models.training import Generators

TAPS = 9
MOST_LEVEL = 2**15 - 1
_TRIPLES = np.array(list(combinations(range(TAPS), 3)))
_NONE = np.array(0, np.uint8)
_OF_A_QUANTILE = 32  # recordings
_BATCH = 256


class Sliding(Regressed):
    """A readout of what slides over the levels of places, bin by bin.

    most_in_bin: that an input of the readout grows by in a bin.
    """

    most_in_bin: ClassVar[int] = 1

    @abstractmethod
    def n_inputs(self, arrays: Mapping[str, Array]) -> int:
        """Return how many inputs the readout has."""

    def wiring(self, dataset: Dataset) -> Mapping[str, Array]:
        """Return the place of each channel, and what its spike adds to the level."""
        return wiring(dataset)

    def counts(self, dataset: Dataset, samples: Array, wiring: Mapping[str, Array]) -> Array:
        """Return what the level of each place rises by in each bin, (n, bin, place) int32."""
        place, n_places = wiring["place"].astype(np.int64), int(wiring["place"].max()) + 1
        values, copy = np.unique(wiring["sign"], return_inverse=True)
        found = self.counted(dataset, samples, place + n_places * copy)
        rises = np.zeros((*found.shape[:2], n_places), np.int32)
        for k, value in enumerate(values.tolist()):
            part = found[:, :, k * n_places : (k + 1) * n_places]
            rises[:, :, : part.shape[2]] += value * part
        return rises

    def most(self, dataset: Dataset) -> int:
        """Return the largest input of the readout: that of all bins."""
        n_bins = len(window_edges(dataset.n_steps, dataset.spikes.step_ms, self.window_ms)) - 1
        return n_bins * self.most_in_bin


@register("models", "kernels")
@dataclass(frozen=True)
class Kernels(Sliding):
    """Random dilated kernels over levels of spikes, and a linear readout, in integers.

    Cost: W_t = weights of the readout and the thresholds; which places and taps a kernel sums is not
    counted. Every weight of the readout is one multiply-accumulate; an addition is one spike, one place of a
    group in a bin, and twelve of a kernel in a bin.
    Health: converged, whether every readout ended before `epochs`.
    """

    window_ms: float = param(20.0, low=0, low_open=True, unit="ms", doc="bin in which spikes add up")
    kernels: int = param(300, low=1, doc="number of kernels")
    thresholds: int = param(1, low=1, high=16, doc="thresholds of each kernel, at rising quantiles")
    places: int = param(4, low=1, doc="largest number of places (taxels, pools) of a kernel")
    read_outs: int = fixed(
        10, low=1, high=50, doc="largest number of input lengths with a prediction, evenly spaced"
    )

    def n_inputs(self, arrays: Mapping[str, Array]) -> int:
        """Return how many inputs the readout has: one per threshold."""
        return len(arrays["thresholds"])

    def learn(self, counts: Array, target: Array, lengths: Array, most: int, rngs: Generators) -> Learnt:
        """Draw kernels, set their thresholds, train and round a readout per input length."""
        arrays = self._drawn(counts, rngs("kernels")) | {"classes": np.unique(target)}
        return self.regressed(arrays, counts, target, lengths, counts.shape[1])

    def _drawn(self, counts: Array, rng: np.random.Generator) -> dict[str, Array]:
        """Return the kernels: what each group sums, dilations, taps and thresholds."""
        n, n_bins, n_places = counts.shape
        n_dilations = max(1, ((n_bins - 1) // (TAPS - 1)).bit_length())
        groups = np.zeros((-(-self.kernels // n_dilations), n_places), np.int8)
        for group in groups:
            chosen = rng.choice(n_places, rng.integers(1, min(self.places, n_places) + 1), replace=False)
            group[chosen] = rng.choice([-1, 1], len(chosen))
        arrays = {
            "groups": groups,
            "dilations": 2 ** np.arange(n_dilations),
            "taps": _TRIPLES[rng.integers(len(_TRIPLES), size=self.kernels)].astype(np.uint8),
            "whole": np.array((n_bins // (2 * (TAPS - 1))).bit_length(), np.uint8),
        }
        thresholds = np.zeros((self.kernels, self.thresholds), np.int32)
        ends = np.linspace(0.1, 0.9, self.thresholds + 1)
        for k, (taps, anew) in enumerate(zip(arrays["taps"], begins(arrays), strict=True)):
            group, dilation = groups[k // n_dilations], 1 << k % n_dilations
            some = counts[rng.choice(n, min(n, _OF_A_QUANTILE), replace=False)]
            values = convolved(summed(some, group), dilation, taps)[:, anew:]
            thresholds[k] = np.floor(np.quantile(values, rng.uniform(ends[:-1], ends[1:])))
        return arrays | {"thresholds": thresholds.ravel()}

    def inputs(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Iterator[Array]:
        """Yield how often kernels are above each of their thresholds in each input length, (n, threshold)."""
        dilations = arrays["dilations"].tolist()
        thresholds = arrays["thresholds"].reshape(len(arrays["taps"]), -1)
        since = np.concatenate([[0], lengths[:-1]])
        above = np.empty((len(lengths), len(counts), *thresholds.shape), np.int32)
        for first in range(0, len(counts), _BATCH):
            part = slice(first, first + _BATCH)
            z = summed(counts[part], arrays["groups"])
            for k, (taps, anew) in enumerate(zip(arrays["taps"], begins(arrays), strict=True)):
                values = convolved(z[:, :, k // len(dilations)], dilations[k % len(dilations)], taps)
                for m, threshold in enumerate(thresholds[k]):
                    is_above = values[:, : lengths[-1]] > threshold
                    between = np.add.reduceat(is_above, since, axis=1, dtype=np.int32)
                    above[:, part, k, m] = between.cumsum(axis=1).T
                    if anew:
                        above[lengths >= anew, part, k, m] -= is_above[:, :anew].sum(axis=1)
        yield from above.reshape(len(lengths), len(counts), -1)

    def n_weights(self, arrays: Mapping[str, Array], n_features: Array) -> Array:
        """Return the weights of the readout and the thresholds."""
        return super().n_weights(arrays, n_features) + len(arrays["thresholds"])

    def operations(self, arrays: Mapping[str, Array], n_features: Array) -> tuple[Array, Array | float]:
        """Return the weights of the readout, and the additions of groups and kernels in all bins."""
        in_bin = np.count_nonzero(arrays["groups"]) + 12 * len(arrays["taps"])
        return super().n_weights(arrays, n_features).astype(np.float64), arrays["lengths"] * float(in_bin)

    def program(
        self, arrays: Mapping[str, Array], counts: Array, lengths: Array
    ) -> Mapping[str, Array | list[float]]:
        """Return the work of the readout, of places and kernels in all bins, and of further thresholds."""
        inputs = list(self._inputs(arrays, counts, lengths))
        work: dict[str, Array | list[float]] = {
            **self.worked(arrays, inputs),
            "kernel_place": lengths * np.count_nonzero(arrays["groups"]),
            "kernel": lengths * len(arrays["taps"]),
        }
        if len(arrays["thresholds"]) > len(arrays["taps"]):
            above = [x.reshape(len(x), len(arrays["taps"]), -1)[:, :, 1:].sum(axis=(1, 2)) for x in inputs]
            work["kernel_more"] = [float(x.mean()) for x in above] or [0.0] * len(lengths)
        return work

    def check_fitted(self, fitted: Parameters, n_outputs: int) -> None:
        """Check arrays that index others (`dse.config.contracts.Family`).

        Raises:
            ValueError: one has a wrong shape or range.
        """
        super().check_fitted(fitted, n_outputs)
        arrays, n = fitted.arrays, fitted.n_channels
        n_places = arrays["groups"].shape[1]
        n_dilations = len(arrays["dilations"])
        is_right = (
            is_wired(arrays, n)
            and arrays["taps"].shape[1:] == (3,)
            and len(arrays["thresholds"]) % max(1, len(arrays["taps"])) == 0
            and len(arrays["groups"]) == -(-len(arrays["taps"]) // n_dilations)
            and arrays["dilations"].tolist() == [1 << k for k in range(n_dilations)]
            and n_dilations < 32
            and arrays["place"].max() + 1 == n_places
            and np.isin(arrays["groups"], (-1, 0, 1)).all()
            and arrays.get("whole", _NONE).shape == ()
            and (arrays["taps"] < TAPS).all()
        )
        if not is_right:
            raise ValueError("its kernels must fit its places, groups, taps and dilations")


def begins(arrays: Mapping[str, Array]) -> Ints:
    """Return the bin from which on each kernel is counted anew, (kernel,); 0 of arrays of older versions."""
    dilations = arrays["dilations"]
    group, k = np.divmod(np.arange(len(arrays["taps"])), len(dilations))
    is_whole = (group % 2 == 1) & (k < arrays.get("whole", _NONE))
    return np.where(is_whole, (TAPS - 1) * dilations[k], 0)


def ring_bins(arrays: Mapping[str, Array]) -> int:
    """Return the bins that the longest kernel sees."""
    return (TAPS - 1) * int(arrays["dilations"].max()) + 1


def summed(rises: Ints, groups: Array) -> Ints:
    """Return what groups sum in each bin, (n, bin, group), or (n, bin) of a single one.

    Args:
        rises: (n, bin, place) int32 of the levels.
        groups: (group, place), or (place,), 1 or -1 of the places of a group, else 0.
    """
    z = np.cumsum(rises @ groups.T.astype(np.int32), axis=1, dtype=np.int32)
    return np.clip(z, -MOST_LEVEL, MOST_LEVEL, out=z)


def convolved(z: Ints, dilation: int, taps: Array) -> Ints:
    """Return what a kernel makes of each bin, (n, bin): 3 times three taps less all nine.

    Args:
        z: (n, bin) levels; before the first bin they are 0.
        dilation: bins from tap to tap, tap 0 is the bin itself.
        taps: (3,) those that count 3 times.
    """
    n_bins = z.shape[1]
    before = np.zeros((len(z), (TAPS - 1) * dilation), z.dtype)
    padded = np.concatenate([before, z], axis=1)
    ends = [before.shape[1] - j * dilation for j in range(TAPS)]
    found = np.zeros_like(z)
    for j, first in enumerate(ends):
        found += padded[:, first : first + n_bins] * (2 if j in taps else -1)
    return found
