"""Speed against error of the package's own numerics: eight parts, one table.

    python -m benchmarks.numerics [--only NAME ...] [--rounds 3]

izhikevich  receptors (SA, FA rising and falling) under a current held for 10 ms: solver step and method, per
            gain, against the adaptive reference, which nothing saturates. Cost: of `Receptors.encode_all` per
            neuron and second; of the reference itself. A solver's spike is dated in the middle of its step
decay       one layer, started as the package starts one, from rest: 12-bit decays with integer states, the
            same with ideal (float64) states, and exact decays in float32, against exact decays in float64.
            The threshold is 1.25 where none is named.
            LIF: the current is gone in a step (d_u = 1). Cost: per neuron and step. Membrane: |error| / |v|
            until a neuron's trains part; then they differ by their resets
resonator   one layer likewise: integer states with factors of fewer bits, 12-bit factors with ideal states,
            and exact factors in float32, against exact factors in float64; per period and quality factor.
            Early, late: membrane of integer against ideal states, same factors, over the first and last 1000
            of 20 000 steps. 24 bits: largest state over 2^23, of these inputs, and where all inputs have the
            largest weight and fire while the resonator swings up: it overflows above 1
delay       one layer likewise, with a delay per synapse: all 0, all the longest, drawn from 0 to the longest,
            and all beyond windows of as many steps, where every spike is lost; integer against ideal states.
            Undelayed: the same weights without delays. Input: that of the definition less that of the kernel
elm         output weights of an H of given condition number, with ridge r s_1^2, against the solution of the
            same ridge in decimals of 120 digits; outputs on rows that were not seen; and how far those are
            from what the noisy targets meant. Normal equations: as they are read, in float64
decision    t_p, its accuracy (the grid's best) and t_h on grids of phi and theta against those of every phi
            to the most spikes and every 0.01 of theta: means of the absolute errors over several nets
hots        decay from a table: cut off after some tau, or of times in bins, against the exact kernel. Moved:
            events that go to another prototype; histogram: share of a recording's counts in the wrong place
rates       Rep(T) of spikes in steps, at most one per channel and step, against counts of the events:
            absolute errors over all windows, per event. Cost: binning and counting, per event

Inputs are drawn with a seed; where DSE_DATA is set, decay, decision, hots and rates take recordings too.
Spikes match where each is the nearest of the other train's to the other and they lie at most 5 ms (steps, for
`decay`) apart; the error of time is the mean over matches, the count's is relative to the reference's.
Costs are CPU times of one thread, the least of the rounds.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, localcontext
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

import dse
from benchmarks import hots
from dse.base import seeds
from dse.base.native.compiled import compiled
from dse.base.native.threads import single_threaded
from dse.base.records import Arithmetic, Array, Block, Dataset, Signals, Spikes
from dse.config.settings import Preprocessing
from dse.data import dataset
from dse.data.encoders.receptors import Receptors, parameters
from dse.data.preprocessing import pool
from dse.data.recordings.pooling import pooling
from dse.engine.definition import DefinedLayer
from dse.engine.events import Rows, dense, gather
from dse.engine.layers import Weights, prepare, weights
from dse.engine.neurons import cuba_lif, fixed_point, izhikevich, resonator
from dse.measure import decision
from dse.models.counts.elm import reduced, ridge_solutions
from dse.models.counts.rate_windows import window_counts, window_edges
from dse.models.snn.family import SNN
from dse.models.snn.initialise import initialise, populations_of
from dse.models.training import Training
from dse_papers.models.time_surfaces import NEVER, Field, Memory, Stream

MATCH_WITHIN = 5.0
DIGITS = 120
WHOLE_TAU = 40.0
"""Where a decay is taken for over: what is left is below the rounding of float64."""


class Row(NamedTuple):
    """A setting, its cost in seconds (per unit of its part), and its errors by name."""

    setting: str
    cost_s: float
    errors: Mapping[str, float]


@dataclass(frozen=True)
class Part:
    """A part of the table: what it is about, what a cost is, and its rows; `rows` takes the rounds."""

    title: str
    cost: str
    units_per_s: float
    rows: Callable[[int], Iterator[Row]]


def least_s(call: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """Return the least CPU time of the calls, short ones repeated within a round, and what one returned."""
    found = call()  # compiles
    best = np.inf
    for _ in range(rounds):
        n, start, took = 0, time.process_time(), 0.0
        while took < 0.002:
            found = call()
            n, took = n + 1, time.process_time() - start
        best = min(best, took / n)
    return best, found


class Match(NamedTuple):
    """How like a spike train is to another: relative count error, share matched, mean time error of those."""

    count: float
    matched: float
    time: float


def match(found: Sequence[Array], expected: Sequence[Array], within: float = MATCH_WITHIN) -> Match:
    """Match spike trains, (train,) rising times each, with others (the rule is the module's)."""
    n_found, n_expected = (sum(map(len, trains)) for trains in (found, expected))
    distances = [_matches(a, b) for a, b in zip(found, expected, strict=True) if len(a) and len(b)]
    apart = np.concatenate([np.zeros(0), *distances])
    apart = apart[apart <= within]
    return Match(
        (n_found - n_expected) / max(1, n_expected),
        2 * len(apart) / (n_found + n_expected) if n_found + n_expected else 1.0,
        float(apart.mean()) if len(apart) else np.nan,
    )


def _matches(a: Array, b: Array) -> Array:
    """Return the distances of spikes that are nearest to each other, (match,)."""
    there, back = _nearest(a, b), _nearest(b, a)
    mutual = back[there] == np.arange(len(a))
    return np.asarray(np.abs(a - b[there])[mutual])


def _nearest(a: Array, b: Array) -> Array:
    """Return the number of the spike of b nearest to each of a, the earlier of two."""
    after = np.searchsorted(b, a).clip(1, max(1, len(b) - 1))
    before = after - 1
    after = after.clip(max=len(b) - 1)
    return np.asarray(np.where(np.abs(a - b[before]) <= np.abs(a - b[after]), before, after))


def relative(found: Array, expected: Array) -> float:
    """Return |found - expected| / |expected|."""
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def recorded() -> bool:
    """Return whether there are recordings."""
    return bool(os.environ.get("DSE_DATA"))


def braille() -> Dataset:
    """Return the recorded Braille letters."""
    any_model = {"hidden": "40", "true_rate": "0.4", "loss": "spike_rate", "input_delays": "[0]"}
    space = dse.load_space("braille", {f"model.{key}": value for key, value in any_model.items()})
    return dataset.build(space.resolve({}), space.source.parent)[0]


def touch(n_channels: int, duration_s: float, step_ms: float, rng: np.random.Generator) -> Signals:
    """Return one recording of channels that are pressed and let go, normalised, a little noisy."""
    t = np.arange(round(duration_s * 1000 / step_ms)) * step_ms / 1000
    hz = rng.uniform(1, 4, n_channels)
    values = (
        0.5 - 0.5 * np.cos(2 * np.pi * hz * t[:, None]) + 0.01 * rng.standard_normal((len(t), n_channels))
    )
    return Signals(values.astype(np.float32), np.array([0, len(t)]), step_ms, {})


def izhikevich_rows(
    rounds: int,
    gains: Mapping[float, float] = {0.1: 2.0, 0.3: 1.0, 1: 0.4, 3: 0.4, 30: 0.2},
    steps_ms: Sequence[float] = (1.0, 0.5, 0.1),
    n_channels: int = 2,
) -> Iterator[Row]:
    """Yield the error of solver steps and methods per gain, over some seconds for each."""
    n_timed = 32  # channels: enough for the cost per neuron to be that of many
    kinds = [izhikevich.Params(*row) for row in parameters(sa=True)]
    for gain, duration_s in gains.items():
        signals = touch(n_channels, duration_s, 10.0, np.random.default_rng(0))
        timed = replace(signals, values=np.tile(signals.values, n_timed // n_channels + 1)[:, :n_timed])
        encoder = Receptors(gain=gain, spikes_per_step=16, low=(0.0,) * n_timed, high=(1.0,) * n_timed)
        currents = replace(encoder, low=(0.0,) * n_channels, high=(1.0,) * n_channels).currents(
            signals.values.astype(np.float64), signals.step_ms
        )
        by_kind = np.split(currents, len(kinds), axis=1)
        start = time.process_time()
        expected = [
            izhikevich.reference(current, kind, signals.step_ms)
            for kind, block in zip(kinds, by_kind, strict=True)
            for current in block.T
        ]
        neuron_s = len(expected) * duration_s
        reference_s = (time.process_time() - start) / neuron_s
        rate = f"gain {gain:g}, {sum(map(len, expected)) / neuron_s:.0f} spikes/s"
        yield Row(f"{rate}: reference", reference_s, {})
        for method, step_ms in product(izhikevich.METHODS, steps_ms):
            per_step = round(signals.step_ms / step_ms)
            rasters = [
                izhikevich.simulate(np.repeat(block, per_step, axis=0), kind, step_ms, method)
                for kind, block in zip(kinds, by_kind, strict=True)
            ]
            found = [(np.flatnonzero(s) + 0.5) * step_ms for raster in rasters for s in raster.T]
            solver = replace(encoder, method=method, solver_ms=step_ms)
            encode = partial(solver.encode_all, timed, np.array([0]), np.array([len(signals.values)]))
            encode_s, _ = least_s(encode, rounds)
            like = match(found, expected)
            errors = {"spike count": like.count, "matched": like.matched, "time (ms)": like.time}
            name = f"gain {gain:g}: {method.replace('_', ' ')}, {step_ms:g} ms"
            yield Row(name, encode_s / (len(kinds) * n_timed * duration_s), errors)


def drawn_rows(n_samples: int, n_steps: int, n_inputs: int, rate: float, rng: np.random.Generator) -> Rows:
    """Return random input spikes."""
    raster = rng.random((n_samples * n_steps, n_inputs)) < rate
    offsets = np.concatenate([[0], np.cumsum(raster.sum(axis=1))])
    return Rows(offsets, np.nonzero(raster)[1].astype(np.int32), n_samples, n_steps, n_inputs)


def trains(fired: Rows) -> list[Array]:
    """Return the steps of every sample's and neuron's spikes."""
    raster = dense(fired).transpose(0, 2, 1).reshape(-1, fired.n_steps)
    return [np.flatnonzero(row).astype(np.float64) for row in raster]


def exact_decays(layer: Weights, current_decay: float, voltage_decay: float) -> Weights:
    """Return a layer with decays that were not rounded."""
    decays = [np.full(layer.n_neurons, 4096 * d) for d in (current_decay, voltage_decay)]
    return replace(layer, population=cuba_lif.Population(*decays, layer.population.threshold))


def started(rows: Rows, d_u: float, d_v: float, n_hidden: int) -> Weights:
    """Return a layer that the package starts on some input spikes, its 12-bit decays all alike.

    The weights of slow neurons round to 0 under the default threshold: it is raised, four times at a time, to
    where the layer fires at a fifth of its target rate at least.

    Raises:
        ValueError: it fires nowhere.
    """
    for threshold in cuba_lif.CubaLif().threshold * 4.0 ** np.arange(6):
        model = SNN(
            hidden=(n_hidden,),
            neuron=cuba_lif.CubaLif(current_decay=(d_u,), voltage_decay=(d_v,), threshold=float(threshold)),
        )
        rng = np.random.default_rng(1)
        populations = populations_of(model, 2, 1.0, rng)
        start = initialise(rows, model, populations, 2, rng)
        target, reached = start.rates[0]
        if reached >= target / 5:
            weight, of = fixed_point.quantise(start.feed_forward[0]), populations[0]
            return weights(weight, None, of)
    raise ValueError(f"neurons of decays {d_u:g} and {d_v:g} must fire, got none that do")


def decay_rows(
    rounds: int,
    decays: Sequence[float] = (0.001, 0.003, 0.03, 0.3, 1.0),
    n_hidden: int = 64,
    n_samples: int = 8,
    n_steps: int = 1000,
) -> Iterator[Row]:
    """Yield the error of arithmetics per decay, of LIF and CUBA-LIF neurons."""
    neurons = {f"LIF {d:g}": (1.0, d) for d in decays} | {f"CUBA {d:g}": (d, d) for d in decays}
    neurons["CUBA 0.25, 0.03 (default)"] = 0.25, 0.03
    inputs = {"": drawn_rows(n_samples, n_steps, 50, 0.03, np.random.default_rng(0))}
    if recorded():
        data = braille()
        some = data.train[:n_samples]
        inputs["Braille, "] = gather(data.spikes, some, data.start[some], data.n_steps)
    for (source, rows), (kind, decays_uv) in product(inputs.items(), neurons.items()):
        layer = started(rows, *decays_uv, n_hidden)
        exact = exact_decays(layer, *decays_uv)
        expected = prepare(exact, "ideal").forward(rows, keep_voltage=True)
        threshold = layer.population.to_threshold
        of = f"{source}{kind}" + (
            f", threshold {threshold:g}" if threshold != cuba_lif.CubaLif().threshold else ""
        )
        for name, run, arithmetic in (
            ("12 bits, integer", layer, "integer"),
            ("12 bits, ideal", layer, "ideal"),
            ("exact, float32", exact, "float32"),
        ):
            found = prepare(run, arithmetic).forward(rows, keep_voltage=True)
            cost_s, _ = least_s(partial(prepare(run, arithmetic).forward, rows), rounds)
            like = match(trains(found.fired), trains(expected.fired))
            together = np.cumsum(dense(found.fired) != dense(expected.fired), axis=1) == 0
            errors = {
                "membrane": relative(found.voltage[together], expected.voltage[together]),
                "trains parted": 1 - float(together[:, -1].mean()),
                "spike count": like.count,
                "matched": like.matched,
                "time (steps)": like.time,
            }
            yield Row(f"{of}: {name}", cost_s / expected.voltage.size, errors)


def rounded_factors(period: float, quality: float, bits: int) -> tuple[int, int]:
    """Return c and s of a resonator in 1/4096 as so many bits hold them; what would grow, toward zero."""
    exact = exact_factors(period, quality)
    step = 2 ** (12 - bits)
    c, s = (int(step * np.rint(x / step)) for x in exact)
    if c * c + s * s < 4096**2:
        return c, s
    c, s = (int(step * np.trunc(x / step)) for x in exact)
    return c, s


def exact_factors(period: float, quality: float) -> tuple[float, float]:
    """Return them without rounding."""
    r = np.exp(-1 / max(quality * period / np.pi, 1.0))
    w = 2 * np.pi / period
    return float(4096 * r * np.cos(w)), float(4096 * r * np.sin(w))


def resonators(weight: Array, c: float, s: float, threshold: int) -> Weights:
    """Return a layer of resonators that are all alike."""
    n = weight.shape[1]
    factors, none = (np.full(n, x) for x in (c, s)), np.zeros(n, np.int32)
    return weights(
        weight, None, resonator.Population(np.ones(n, bool), *factors, none, none, threshold, False)
    )


def resonator_rows(
    rounds: int,
    periods: Sequence[float] = (2.2, 4.7, 12.0, 40.0),
    qualities: Sequence[float] = (1.5, 5.0, 20.0),
    bits: Sequence[int] = (2, 3, 4, 6, 8, 10, 12),
    n_hidden: int = 16,
    n_samples: int = 4,
    n_steps: int = 1000,
    n_long: int = 20_000,
) -> Iterator[Row]:
    """Yield the error of arithmetics per period and quality factor of resonators."""
    rows = drawn_rows(n_samples, n_steps, 50, 0.03, np.random.default_rng(0))
    long_rows = drawn_rows(1, n_long, 50, 0.03, np.random.default_rng(1))
    for period, quality in product(periods, qualities):
        model = SNN(
            hidden=(n_hidden,),
            neuron=resonator.Resonator(period=(period,), quality=(quality,)),
            initial_rate=0.2,
        )
        populations = populations_of(model, 2, 1.0, np.random.default_rng(1))
        start = initialise(rows, model, populations, 2, np.random.default_rng(1))
        weight, threshold = fixed_point.quantise(start.feed_forward[0]), round(64 * model.neuron.threshold)
        exact = resonators(weight, *exact_factors(period, quality), threshold)
        expected = prepare(exact, "ideal").forward(rows, keep_voltage=True)
        of_12_bits = resonators(weight, *rounded_factors(period, quality, 12), threshold)
        runs: list[tuple[str, Weights, Arithmetic]] = [
            (
                f"{b} bits, integer",
                resonators(weight, *rounded_factors(period, quality, b), threshold),
                "integer",
            )
            for b in bits
        ]
        runs += [("12 bits, ideal", of_12_bits, "ideal"), ("exact, float32", exact, "float32")]
        for name, run, arithmetic in runs:
            ready = prepare(run, arithmetic)
            found = ready.forward(rows, keep_voltage=True, count=True)
            cost_s, _ = least_s(partial(ready.forward, rows), rounds)
            like = match(trains(found.fired), trains(expected.fired))
            errors = {
                "membrane": relative(found.voltage, expected.voltage),
                "spike count": like.count,
                "matched": like.matched,
                "time (steps)": like.time,
                "24 bits": found.peak * fixed_point.STATE_SCALE / 2**23,
            }
            if name == "12 bits, integer":
                of_long = [
                    prepare(of_12_bits, x).forward(long_rows, keep_voltage=True).voltage
                    for x in ("integer", "ideal")
                ]
                for when, part in (("early", slice(0, 1000)), ("late", slice(-1000, None))):
                    errors[when] = relative(*(v[:, part] for v in of_long))
                errors["24 bits, at resonance"] = at_resonance(period, of_12_bits.population)
            yield Row(f"P {period:g}, q {quality:g}: {name}", cost_s / expected.voltage.size, errors)


def at_resonance(period: float, population: resonator.Population, n_inputs: int = 50) -> float:
    """Return the largest state over 2^23 where all inputs fire while the potential's answer is positive."""
    n_steps = int(20 * period) + 200
    raster = np.repeat(np.sin(2 * np.pi * np.arange(n_steps) / period)[:, None] > 0, n_inputs, axis=1)
    offsets = np.concatenate([[0], np.cumsum(raster.sum(axis=1))])
    rows = Rows(offsets, np.nonzero(raster)[1].astype(np.int32), 1, n_steps, n_inputs)
    weight = np.full((n_inputs, len(population.resonates)), 254 / 64, np.float32)
    forward = prepare(weights(weight, None, population), "integer").forward(rows, count=True)
    return forward.peak * fixed_point.STATE_SCALE / 2**23


def delay_rows(
    rounds: int,
    longest: int = 62,
    n_hidden: int = 64,
    n_samples: int = 8,
    n_steps: int = 1000,
) -> Iterator[Row]:
    """Yield the error of integer states of layers whose synapses have delays."""
    rows = drawn_rows(n_samples, n_steps, 50, 0.03, np.random.default_rng(0))
    short = drawn_rows(n_samples, longest, 50, 0.03, np.random.default_rng(0))
    of = started(rows, 0.3, 0.03, n_hidden)
    shape = of.feed_forward.shape
    drawn = np.random.default_rng(2).integers(0, longest + 1, shape)
    settings = [("undelayed", rows, None), ("all 0", rows, np.zeros(shape))]
    settings += [(f"0 to {longest}", rows, drawn), (f"all {longest}", rows, np.full(shape, longest))]
    settings += [(f"all beyond windows of {longest} steps", short, np.full(shape, longest))]
    for name, seen, delay in settings:
        layer = weights(of.feed_forward, None, of.population, delay)
        ready = prepare(layer, "integer")
        found = ready.forward(seen, keep_voltage=True)
        expected = prepare(layer, "ideal").forward(seen, keep_voltage=True)
        cost_s, _ = least_s(partial(ready.forward, seen), rounds)
        # Neurons that forget at once and never fire show the input of each step.
        at_once = cuba_lif.Population(np.int32(4096), np.int32(4096), 2**20)
        bare = weights(of.feed_forward, None, at_once, delay)
        by_kernel = prepare(bare, "integer").forward(seen, keep_voltage=True).voltage
        by_definition = DefinedLayer(bare, "integer").forward(seen, keep_voltage=True).voltage
        like = match(trains(found.fired), trains(expected.fired))
        errors = {
            "membrane": relative(found.voltage, expected.voltage) if found.fired.index.size else 0.0,
            "matched": like.matched,
            "time (steps)": like.time,
            "input": float(np.abs(by_definition - by_kernel).max()),
            "spikes": float(found.fired.index.size),
        }
        yield Row(name, cost_s / found.voltage.size, errors)


def conditioned(
    n_rows: int, n_hidden: int, condition: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return two matrices (row, hidden) with the same singular values and right singular vectors."""
    values = np.geomspace(1, 1 / condition, n_hidden)
    right = np.linalg.qr(rng.standard_normal((n_hidden, n_hidden)))[0]
    left = [np.linalg.qr(rng.standard_normal((n_rows, n_hidden)))[0] for _ in range(2)]
    return (left[0] * values) @ right, (left[1] * values) @ right


def solved_exactly(h: Array, t: Array, penalty: float) -> Array:
    """Return the solution of (H'H + penalty) beta = H'T in decimals of 120 digits, (hidden, class)."""
    decimals = np.frompyfunc(lambda x: Decimal(float(x)), 1, 1)
    with localcontext() as context:
        context.prec = DIGITS
        h, t = decimals(h), decimals(t)
        a = np.concatenate([h.T @ h + decimals(np.eye(h.shape[1])) * Decimal(penalty), h.T @ t], axis=1)
        n = h.shape[1]
        for k in range(n):  # positive definite: no pivoting
            a[k] = a[k] / a[k, k]
            others = np.arange(n) != k
            a[others] = a[others] - a[others, k : k + 1] * a[k]
        return a[:, n:].astype(np.float64)


def normal_equations(h: Array, t: Array, penalty: float) -> Array:
    """Return the same in the precision of H; NaN where the matrix is singular."""
    try:
        return np.linalg.solve(h.T @ h + penalty * np.eye(h.shape[1], dtype=h.dtype), h.T @ t)
    except np.linalg.LinAlgError:
        return np.full((h.shape[1], t.shape[1]), np.nan)


def elm_rows(
    rounds: int,
    conditions: Sequence[float] = (1e2, 1e4, 1e8, 1e12, 1e16),
    ridges: Sequence[float] = (0.0, 1e-10, 1e-4),
    n_rows: int = 120,
    n_hidden: int = 24,
    noise: float = 0.01,
) -> Iterator[Row]:
    """Yield the error of output weights per condition number, ridge and precision."""
    for condition, ridge in product(conditions, ridges):
        rng = np.random.default_rng(0)
        h, unseen = conditioned(n_rows, n_hidden, condition, rng)
        meant = rng.standard_normal((n_hidden, 3))
        clean = h @ meant
        t = clean + noise * np.sqrt(np.mean(clean**2)) * rng.standard_normal(clean.shape)
        penalty = ridge * float(np.linalg.norm(h, 2)) ** 2
        expected = solved_exactly(h, t, penalty)

        def by_svd(kind: type, h: Array = h, t: Array = t, ridge: float = ridge) -> Array:
            triangle = np.zeros((0, h.shape[1] + t.shape[1]), kind)
            return ridge_solutions(reduced(triangle, h.astype(kind), t.astype(kind)), h.shape[1], [ridge])[0][
                0
            ]

        for name, solve in (
            ("float64", partial(by_svd, np.float64)),
            ("float32", partial(by_svd, np.float32)),
            ("normal equations", partial(normal_equations, h, t, penalty)),
        ):
            with single_threaded():
                cost_s, beta = least_s(solve, rounds)
            beta = beta.astype(np.float64)
            errors = {
                "weights": relative(beta, expected),
                "outputs": relative(unseen @ beta, unseen @ expected),
                "outputs to meant": relative(unseen @ beta, unseen @ meant),
            }
            yield Row(f"condition {condition:.0e}, ridge {ridge:g}: {name}", cost_s, errors)


def answers(seed: int, n: int = 200, n_steps: int = 1000, n_classes: int = 12) -> tuple[Array, Array]:
    """Return output spikes (n, step, class) of a net that is sure of some samples and not of others."""
    rng = np.random.default_rng(seed)
    target = rng.integers(0, n_classes, n)
    rate = 0.01 * rng.gamma(4, 0.25, (n, n_classes))
    rate[np.arange(n), target] += 0.03 * rng.gamma(1, 1, n)
    return (rng.random((n, n_steps, n_classes)) < np.minimum(rate, 0.5)[:, None]).astype(np.uint8), target


def recorded_answers(seed: int, epochs: int = 8) -> tuple[Array, Array]:
    """Return output spikes and classes of the validation part of the letters, of a net trained shortly."""
    data = braille()
    model = SNN(
        hidden=(40,),
        true_rate=0.4,
        neuron=cuba_lif.CubaLif(threshold=5.0, current_decay=(0.3, 1.0), voltage_decay=(0.12, 0.96)),
    )
    outcome = model.fit(data, Training(epochs=epochs, learning_rate=0.1), partial(seeds.generator, seed, {}))
    return outcome.validation.output, data.target[data.validation]


def grid(high: float, step: float, low: float = 0.0) -> Array:
    """Return low, low + step, ... up to high, to the digits they mean."""
    return np.round(np.arange(low, high + step / 2, step), 6)


GRIDS: Mapping[str, tuple[Array | None, Array]] = {
    "phi to 60 by 1, theta 0.2..1 by 0.01": (grid(60, 1), grid(1, 0.01, 0.2)),
    "phi to 60 by 2, theta 0.2..1 by 0.05 (default)": (grid(60, 2), grid(1, 0.05, 0.2)),
    "phi to 60 by 4, theta 0.2..0.9 by 0.1 (quickstart)": (grid(60, 4), grid(0.9, 0.1, 0.2)),
    "phi to 60 by 10, theta 0.2..1 by 0.2": (grid(60, 10), grid(1, 0.2, 0.2)),
    "phi to 60 by 20, theta 0.2..1 by 0.4": (grid(60, 20), grid(1, 0.4, 0.2)),
    "phi to the end by 2, theta 0..1 by 0.05": (None, grid(1, 0.05)),
}
"""Grids of phi and theta; None: every other phi up to the most spikes of a sample."""


def decision_rows(
    rounds: int,
    n_nets: int = 6,
    n: int = 200,
    n_steps: int = 1000,
    grids: Mapping[str, tuple[Array | None, Array]] = GRIDS,
) -> Iterator[Row]:
    """Yield the error of grids of phi and theta."""
    nets = {"": ([answers(seed, n, n_steps) for seed in range(n_nets)], 1.0)}
    if recorded():
        nets["Braille, "] = [recorded_answers(seed) for seed in range(2)], 5.0
    for source, (outputs, step_ms) in nets.items():
        most = max(int(output.sum(axis=(1, 2)).max()) for output, _ in outputs)
        finest = grid(most, 1), grid(1, 0.01)
        every: dict[str, tuple[Array, Array]] = {f"every phi to {most}, theta 0..1 by 0.01": finest}
        every |= {name: (grid(most, 2) if p is None else p, q) for name, (p, q) in grids.items()}
        expected = None
        for name, (phi, theta) in every.items():
            cost_s, found = least_s(partial(_fastest, outputs, phi, theta, step_ms), rounds)
            expected = found if expected is None else expected
            wrong = [_mean(column) for column in np.abs(found - expected).T]
            errors = dict(zip(("t_p (ms)", "best accuracy", "t_h (ms)"), wrong, strict=True))
            missed = np.isnan(found[:, 2]) & ~np.isnan(expected[:, 2])
            yield Row(f"{source}{name}", cost_s / len(outputs), errors | {"t_h missed": float(missed.mean())})


def _mean(values: Array) -> float:
    """Return the mean of the numbers among values; NaN where there are none."""
    numbers = values[~np.isnan(values)]
    return float(numbers.mean()) if len(numbers) else np.nan


def _fastest(outputs: Sequence[tuple[Array, Array]], phi: Array, theta: Array, step_ms: float) -> Array:
    """Return t_p, its accuracy and t_h (NaN: none) of every net, (net, 3)."""
    found = []
    for output, target in outputs:
        surface = decision.surface(output, target, phi, theta, step_ms)
        peak, human = decision.t_p(surface), decision.t_h(surface)
        last = np.nan if human is None else human.decision_latency_ms
        found.append((peak.decision_latency_ms, peak.accuracy, last))
    return np.array(found)


def edges_swept(seed: int, n: int, side: int = 24, duration_us: int = 1_000_000) -> Stream:
    """Return events of an edge that sweeps to and fro over a square frame, with a tenth of noise."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, duration_us, n))
    phase = t / 100_000 % 2  # to in 100 ms, fro in 100 ms
    at = side * np.where(phase < 1, phase, 2 - phase) + rng.normal(0, 0.7, n)
    noise = rng.random(n) < 0.1
    x = np.where(noise, rng.integers(0, side, n), at.clip(0, side - 1).astype(np.int64))
    plane = np.where(noise, rng.integers(0, 2, n), phase < 1)
    y = rng.integers(0, side, n)
    return Stream(t.astype(np.int64), x.astype(np.int32), y.astype(np.int32), plane.astype(np.int32))


@compiled(_nrt=False)
def _by_table(t, x, y, plane, last, reach_x, reach_y, decay, columns, half_squares, score, label):
    """Assign events to prototypes as the exact kernel, the decay looked up by age and 0 beyond the table."""
    n_prototypes = columns.shape[1]
    for i in range(len(t)):
        last[y[i] + reach_y, x[i] + reach_x, plane[i]] = t[i]
        for k in range(n_prototypes):
            score[k] = half_squares[k]
        place = 0
        for row in range(y[i], y[i] + 2 * reach_y + 1):
            for column in range(x[i], x[i] + 2 * reach_x + 1):
                for p in range(last.shape[2]):
                    seen = last[row, column, p]
                    if seen != NEVER and t[i] - seen < len(decay):
                        s = decay[t[i] - seen]
                        for k in range(n_prototypes):
                            score[k] -= s * columns[place, k]
                    place += 1
        best = 0
        for k in range(1, n_prototypes):
            if score[k] < score[best]:
                best = k
        label[i] = best


def by_table(events: Stream, field: Field, prototypes: Array, bin_us: int, reach_tau: float) -> Array:
    """Return the nearest prototype of every event, times in bins, nothing older than some tau, (n,)."""
    reach_x, reach_y = field.reach
    shape = field.height + 2 * reach_y, field.width + 2 * reach_x, field.n_planes
    decay = np.exp(-np.arange(int(reach_tau * field.tau_us / bin_us) + 1) * bin_us / field.tau_us)
    columns, label = np.array(prototypes.T, order="C"), np.empty(len(events.t_us), np.int32)
    last, half_squares = np.full(shape, NEVER), 0.5 * (columns**2).sum(axis=0)
    t, (_, x, y, plane) = events.t_us // bin_us, events
    _by_table(
        t,
        x,
        y,
        plane,
        last,
        reach_x,
        reach_y,
        decay,
        columns,
        half_squares,
        np.empty(len(half_squares)),
        label,
    )
    return label


def hots_rows(
    rounds: int,
    n: int = 20_000,
    cuts: Sequence[float] = (1, 3, 5),
    bins_ms: Sequence[float] = (0.1, 1, 10),
    n_compared: int = 4000,
) -> Iterator[Row]:
    """Yield the error of truncated decay and of binned time."""
    recordings = {"": (edges_swept(0, n), 24, 24)}
    if recorded():
        events, width, height = hots.fingers()
        recordings["fingers, "] = hots.head(events, n), width, height
    for source, (events, width, height) in recordings.items():
        ((field, prototypes),) = layers = hots.stack(events, width, height, 2, 1)
        chosen = np.arange(min(n_compared, len(events.t_us)))
        exact = Memory(field).surfaces(hots.head(events, len(chosen)), chosen)
        exact_s, (expected,) = least_s(partial(hots.by_kernel, events, layers), rounds)
        yield Row(f"{source}exact", exact_s / len(events.t_us), {})
        settings = [("exact, by table", 1, WHOLE_TAU)]
        settings += [(f"0 after {cut:g} tau", 1, cut) for cut in cuts]
        settings += [(f"bins of {ms:g} ms", round(1000 * ms), WHOLE_TAU) for ms in bins_ms]
        for name, bin_us, reach_tau in settings:
            cost_s, label = least_s(partial(by_table, events, field, prototypes, bin_us, reach_tau), rounds)
            binned = events._replace(t_us=events.t_us // bin_us * bin_us)
            other = Memory(field).surfaces(hots.head(binned, len(chosen)), chosen)
            other = np.where(other < np.exp(-reach_tau), 0, other)
            counts = [np.bincount(x, minlength=len(prototypes)) for x in (label, expected)]
            errors = {
                "surface": relative(other, exact),
                "moved": float((label != expected).mean()),
                "histogram": float(np.abs(counts[0] - counts[1]).sum() / 2 / len(label)),
            }
            yield Row(f"{source}{name}", cost_s / len(events.t_us), errors)


def counted(events: Stream, width: int, height: int, window_ms: float) -> Array:
    """Return events per window and channel, (window, channel): Rep(n, w) from their times."""
    window = (events.t_us - events.t_us[0]) // round(1000 * window_ms)
    channel = (events.plane * height + events.y) * width + events.x
    n_channels = 2 * width * height
    n = np.bincount(window * n_channels + channel, minlength=(int(window[-1]) + 1) * n_channels)
    return n.reshape(-1, n_channels)


def counted_in_steps(events: Stream, width: int, height: int, window_ms: float, step_ms: float) -> Array:
    """Return the same from spikes, as the package makes them of events."""
    block = Block(events.t_us, events.x, events.y, events.plane.astype(np.uint8))
    pools = pooling(Preprocessing(step_ms), width, height)
    n_steps = pools.n_bins(int(events.t_us[-1] - events.t_us[0]) + 1)
    counts, channel = pool([block], pools, int(events.t_us[0]), 0, n_steps)
    spikes = Spikes(np.concatenate([[0], np.cumsum(counts)]), channel, n_steps, pools.n_channels, step_ms)
    edges = window_edges(n_steps, step_ms, window_ms)
    return window_counts(spikes, np.array([0]), np.array([0]), edges, "each")[0]


def rates_rows(
    rounds: int,
    n: int = 20_000,
    windows_ms: Sequence[float] = (50, 100),
    steps_ms: Sequence[float] = (1, 5, 20),
) -> Iterator[Row]:
    """Yield the error of counts of binned events."""
    recordings = {"": (edges_swept(0, n), 24, 24)}
    if recorded():
        recordings["fingers, "] = hots.fingers()
    for (source, recording), window_ms in product(recordings.items(), windows_ms):
        cost_s, expected = least_s(partial(counted, *recording, window_ms), rounds)
        n_events = int(expected.sum())
        yield Row(f"{source}T = {window_ms:g} ms: events", cost_s / n_events, {})
        for step_ms in steps_ms:
            cost_s, found = least_s(partial(counted_in_steps, *recording, window_ms, step_ms), rounds)
            wrong = np.zeros((max(len(found), len(expected)), expected.shape[1]), np.int64)
            wrong[: len(expected)] -= expected
            wrong[: len(found)] += found
            errors = {
                "total": float(wrong.sum() / n_events),
                "summed": float(np.abs(wrong.sum(axis=1)).sum() / n_events),
                "per channel": float(np.abs(wrong).sum() / n_events),
            }
            yield Row(f"{source}T = {window_ms:g} ms: steps of {step_ms:g} ms", cost_s / n_events, errors)


PARTS: Mapping[str, Part] = {
    "izhikevich": Part("Izhikevich: step and method per gain", "us / neuron s", 1e6, izhikevich_rows),
    "decay": Part("LIF and CUBA-LIF: decays and states", "ns / neuron step", 1e9, decay_rows),
    "resonator": Part("Resonators: factors and states", "ns / neuron step", 1e9, resonator_rows),
    "delay": Part("Delays per synapse", "ns / neuron step", 1e9, delay_rows),
    "elm": Part("ELM: precision and ridge per condition number", "us / solution", 1e6, elm_rows),
    "decision": Part("Decision: grids of phi and theta", "ms / net", 1e3, decision_rows),
    "hots": Part("HOTS: truncated decay, binned time", "ns / event", 1e9, hots_rows),
    "rates": Part("Rep(T): events or steps", "ns / event", 1e9, rates_rows),
}


def table(names: Sequence[str], rounds: int) -> Table:
    """Return the table of some parts; each begins with a row that names its columns."""
    found = Table(show_header=False, title="Numerics: speed against error")
    for name in names:
        part = PARTS[name]
        rows = list(part.rows(rounds))
        heads = list(dict.fromkeys(head for row in rows for head in row.errors))
        found.add_row(f"[bold]{part.title}", *(f"[bold]{x}" for x in (part.cost, *heads)), end_section=True)
        for row in rows:
            errors = [f"{row.errors[head]:.3g}" if head in row.errors else "" for head in heads]
            found.add_row(row.setting, f"{row.cost_s * part.units_per_s:.3g}", *errors)
        found.add_section()
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS), metavar="NAME")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    Console(width=150).print(table(given.only, given.rounds))


if __name__ == "__main__":
    main()
