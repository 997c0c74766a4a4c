"""This engine as one of those that are timed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.cases import (
    DECAY_CURRENT,
    DECAY_VOLTAGE,
    FALSE_RATE,
    LEARNING_RATE,
    PERIOD,
    QUALITY,
    SCALE_GRAD,
    TAU_GRAD,
    THRESHOLD,
    TRUE_RATE,
    Case,
    Variant,
)
from dse.engine import cpu
from dse.engine.events import Rows, delayed
from dse.engine.layers import Weights, prepare, weights
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.network import gradients
from dse.engine.neurons import Population, cuba_lif, resonator
from dse.engine.neurons.surrogate import exponential

SURROGATE = exponential(THRESHOLD / 64, TAU_GRAD, SCALE_GRAD)


def rows_of(x: np.ndarray) -> Rows:
    """Return (sample, step, input) 0/1 as rows: the inverse of dse.engine.events.dense."""
    n, t, c = x.shape
    flat = x.reshape(n * t, c) != 0
    offsets = np.concatenate([[0], np.cumsum(flat.sum(axis=1, dtype=np.int64))])
    return Rows(offsets, np.nonzero(flat)[1].astype(np.int32), n, t, c)


def population(n: int, variant: Variant, *, is_output: bool) -> Population[Any]:
    """Return the neurons of a layer."""
    lif = cuba_lif.Population(
        np.full(n, DECAY_CURRENT, np.int32), np.full(n, DECAY_VOLTAGE, np.int32), THRESHOLD
    )
    if is_output or not variant.share:
        return lif
    resonates = np.arange(n) < round(variant.share * n)
    c, s = (np.where(resonates, x, 0).astype(np.int32) for x in resonator.factors(PERIOD, QUALITY))
    decays = (np.where(resonates, 0, d).astype(np.int32) for d in (lif.decay_current, lif.decay_voltage))
    return resonator.Population(resonates, c, s, *decays, THRESHOLD, variant.reset)


def layers_of(case: Case, variant: Variant) -> list[Weights]:
    """Return a case's layers as they run."""
    of = case.weights_of(variant)
    last = len(of) - 1
    drawn = np.random.default_rng(3).uniform(0, variant.max_delay, of[0].shape)
    return [
        weights(
            w,
            None,
            population(w.shape[1], variant, is_output=k == last),
            np.rint(drawn) if variant.max_delay and k == 0 else None,
        )
        for k, w in enumerate(of)
    ]


class Ours:
    """Some copies of a case's network in a cohort; times are of all copies together."""

    def __init__(self, case: Case, variant: Variant, copies: int) -> None:
        arithmetic = variant.arithmetic
        self._case, self._arithmetic = case, arithmetic
        self._rows, self._layers = rows_of(case.x), layers_of(case, variant)
        self._prepared = [prepare(layer, arithmetic) for layer in self._layers]
        pool = case.pool(variant)
        alone = [layer.feed_forward for layer in self._layers]
        if pool is not None:
            alone[0] = alone[0][np.flatnonzero(np.diff(pool, prepend=-1))]
        layers = tuple(
            TrainedLayer(
                matrix,
                None,
                layer.population,
                SURROGATE,
                np.ones(layer.n_neurons, np.float32),
                delay=layer.delay.astype(np.float32) if layer.delay.size else None,
                longest_delay=variant.max_delay,
                norm_unit=np.ones(layer.n_neurons, np.float32) if variant.form == "weight norm" else None,
            )
            for matrix, layer in zip(alone, self._layers, strict=True)
        )
        if variant.form == "whitened":
            n = layers[-1].feed_forward.shape[0]
            basis = np.random.default_rng(4).normal(0, n**-0.5, (n, n)).astype(np.float32)
            layers = (*layers[:-1], replace(layers[-1], basis=basis))
        member = Member(layers, TRUE_RATE, FALSE_RATE, arithmetic, pool=pool)
        self._cohort = cpu.start([member] * copies, case.batch, case.n_steps)
        self._turns = {k: Turn(LEARNING_RATE, (None,) * len(layers), LEARNING_RATE) for k in range(copies)}

    def step(self) -> Any:
        """Train every copy on the batch."""
        return self._cohort.step(self._rows, self._case.labels, self._turns)

    def infer(self) -> np.ndarray:
        """Return the most active output of each sample, once for each copy."""
        for _ in self._turns:
            rows = self._rows
            for layer in self._prepared:
                rows = delayed(layer.forward(rows).fired)
            sample = np.repeat(np.arange(rows.n_samples), rows.per_step().sum(axis=1))
            counts = np.zeros((rows.n_samples, rows.n_inputs), np.int64)
            np.add.at(counts, (sample, rows.index), 1)
        return counts.argmax(axis=1)

    def rates(self) -> list[float]:
        """Return each layer's spikes per neuron and step."""
        return list(self.step()[0].fired)

    def gradients(self) -> list[np.ndarray]:
        """Return dL/dW of each layer."""
        found = gradients(
            self._rows,
            self._layers,
            [SURROGATE] * len(self._layers),
            self._case.labels,
            true_rate=TRUE_RATE,
            false_rate=FALSE_RATE,
            arithmetic=self._arithmetic,
            gains=[None] * len(self._layers),
        )
        return list(found.feed_forward)
