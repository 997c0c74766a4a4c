"""Random classifiers and recordings of spikes, with what the engine does on them."""

import re
import tempfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dse.base.records import Head, Layer, Network
from dse.data.recordings.pooling import pooling
from dse.deploy.bundle import Bundle, Input
from dse.deploy.c import host
from dse.deploy.targets import TargetError
from dse.engine.neurons import cuba_lif, parameters_of, resonator, xylo_lif
from dse.models.snn.quantise import rounded
from tests.deploy import bundles
from tests.spaces import RASTER, sections

STEP_MS = 5.0


def has_compiler():
    """Return whether there is a C compiler."""
    try:
        host.compiler()
    except TargetError:
        return False
    return True


needs_compiler = pytest.mark.skipif(not has_compiler(), reason="no C compiler is installed")


def bundle(network, n_steps, **changes):
    """Return a bundle of a network on spikes that answers at the end of its window."""
    made = Bundle(
        fitted=network,
        sections=sections({**RASTER, "model": {"kind": "snn", "hidden": [3]}}),
        classes=tuple(f"class {k}" for k in range(network.sizes[-1])),
        input=Input("spikes", network.n_channels, 0, 0, n_steps, STEP_MS),
    )
    return replace(made, **changes)


def pools_of(design, taken):
    """Return the pools of a design of events."""
    return pooling(design.preprocessing, taken.width, taken.height)


def reference(made, fired):
    """Return what the engine of a bundle does on recordings of spikes, (sample, step, channel)."""
    with tempfile.TemporaryDirectory() as folder:
        return bundles.reference(made, fired, Path(folder))


def faithful(target, made, engine, folder):
    """Write a target, run it as an engine did, and return its verdict, which must be faithful."""
    target.write(made, folder)
    return seen_faithful(target, made, engine, folder)


def seen_faithful(target, made, engine, folder):
    """Return the verdict on the files of a target, which must be faithful to what an engine did."""
    verdict = target.verify(made, folder, engine)
    assert verdict.kind == "faithful" and verdict.n_recordings == engine.n_recordings, verdict.reason
    return verdict


def spoil(source):
    """Change the weights of the first layer in a C source."""
    text = source.read_text()
    begin = text.index("weights_1[")
    table = text[begin : text.index("}", begin)]
    source.write_text(text.replace(table, re.sub(r"-?\b\d+,", "3,", table)))


def case(number):
    """Return random classifier `number` and its recordings, (sample, step, channel) of 0 and 1.

    Numbers take turns at layers, resonators, recurrence, delays of inputs and of synapses, bits, pruning,
    extreme weights and heads; the recordings are silent, sparse, dense, saturated and random bursts.
    """
    rng = np.random.default_rng([18, number])
    n_channels = int(rng.choice([1, 5, 12, 33, 70]))
    n_steps = int(rng.choice([1, 9, 30, 61]))
    per_sample = int(rng.choice([1, 1, 1, 2, 3]))
    delays = ((0,), (0,), (0, 3, 7), (2, 5), (0, 40), (1,))[number % 6]
    hidden = [int(rng.choice([1, 4, 17, 40])) for _ in range(number % 4)]
    n_outputs = int(rng.choice([3, 7] if number % 5 == 3 else [2, 3, 7]))
    sizes = [n_channels * len(delays), *hidden, n_outputs]
    extreme, bits, pruned = number % 5 == 4, 2 + number % 7, (0.0, 0.5, 0.9)[number % 3]
    layers = []
    for depth, (before, n) in enumerate(pairwise(sizes)):
        is_output = depth == len(hidden)
        scale = 4.0 if extreme else 2.0 / np.sqrt(before)
        weight = rng.normal(0.3 * scale, scale, (n, before)).astype(np.float32)
        ring = None
        if not is_output and rng.random() < 0.5:
            ring = rng.normal(0, scale, (n, n)).astype(np.float32)
        layers.append(_layer(weight, ring, rng, is_output, number % 3 == 1, number % 10 == 9))
    network = Network(tuple(layers), n_channels, delays, per_sample, "integer")
    network = rounded(network, bits, pruned)
    if number % 6 in (0, 5):
        delays = [rng.integers(0, 13, x.weight.shape).astype(np.int8) for x in network.layers]
        layers = [replace(x, delay=delay) for x, delay in zip(network.layers, delays, strict=True)]
        network = replace(network, layers=tuple(layers))
    return _ruled(bundle(network, n_steps), number, rng), _recordings(rng, n_steps, n_channels)


def xylo_case(number):
    """Return random classifier `number` of `xylo_lif` neurons, and recordings as of `case`."""
    rng = np.random.default_rng([31, number])
    n_channels, is_recurrent = int(rng.choice([3, 16, 40])), bool(number % 2)
    delays = (0, 3) if is_recurrent else (0,)
    sizes = [n_channels * len(delays), *map(int, rng.choice([1, 9, 30], number % 3)), 4]
    layers = []
    for depth, (before, n) in enumerate(pairwise(sizes), 2):
        is_output, scale = depth == len(sizes), 4.0 if number % 4 == 3 else 3 / np.sqrt(before)
        weight = rng.normal(0.3 * scale, scale, (n, before)).astype(np.float32)
        ring = rng.normal(0, 1, (n, n)).astype(np.float32) if is_recurrent and not is_output else None
        population = xylo_lif.Population(
            rng.integers(1, 9, n).astype(np.int32),
            rng.integers(0, 9, n).astype(np.int32) if number % 3 else np.full(n, 3, np.int32),
            threshold=int(rng.choice([1, 40, 1024, 20000])),
            weight_shift=int(rng.integers(0, 9)),
            most_spikes=1 if is_output else 31,
        )
        layers.append(Layer(weight, ring, parameters_of(population), "xylo_lif"))
    network = Network(tuple(layers), n_channels, delays, 1 + number % 2, "integer")
    return _ruled(bundle(network, 30), number, rng), _recordings(rng, 30, n_channels)


def _layer(weight, ring, rng, is_output, resonates, sums):
    """Return a layer; one that sums does not decay."""
    n = len(weight)
    alike = rng.random() < 0.5
    decays = [rng.integers(0, 4097, 1 if alike else n).astype(np.int32) for _ in range(2)]
    if sums:
        decays = [np.zeros(1, np.int32)] * 2
    elif rng.random() < 0.2:
        decays[int(rng.integers(2))][:] = rng.choice([0, 4096])
    threshold = int(rng.choice([1, 40, 80, 320]))
    others = cuba_lif.Population(*(np.broadcast_to(d, n).copy() for d in decays), threshold)
    if is_output or not resonates:
        return Layer(weight, ring, parameters_of(others))
    turns = rng.random(n) < rng.choice([0.3, 1.0])
    if rng.random() < 0.5:
        turns = np.sort(turns)[::-1]
    c, s = resonator.factors(rng.uniform(2.0, 40.0, n), rng.uniform(0.5, 20.0, n))
    population = resonator.Population(
        resonates=turns,
        cosine=np.where(turns, c, 0).astype(np.int32),
        sine=np.where(turns, s, 0).astype(np.int32),
        decay_current=np.where(turns, 0, others.decay_current).astype(np.int32),
        decay_voltage=np.where(turns, 0, others.decay_voltage).astype(np.int32),
        threshold=threshold,
        reset=bool(rng.random() < 0.5),
    )
    return Layer(weight, ring, parameters_of(population), "resonator")


def _ruled(made, number, rng):
    """Return the bundle with one of the rules: confidence, a fixed time, heads, one head of two."""
    n = len(made.classes)
    which = number % 5
    if which in (0, 1):
        phi, theta = (
            float(rng.choice([0, 1, 5.5])),
            float(rng.choice([0.0, 0.35, 0.2 + 3 * 0.05, 2 / 3, 1.0])),
        )
        return replace(made, phi=phi, theta=theta)
    if which == 2:
        return replace(made, read_out_ms=float(rng.uniform(0, 300)))
    if which == 3 and n > 2:
        sizes = (2, n - 2)
        pairs = np.array([(a, b) for a in range(sizes[0]) for b in range(sizes[1])])[1:]
        heads = tuple(
            Head(name, tuple(f"{name} {k}" for k in range(size)), pairs[:, h])
            for h, (name, size) in enumerate(zip(("shape", "speed"), sizes, strict=True))
        )
        head = ("", "shape", "speed")[number % 3]
        rule = {"phi": 2.0, "theta": 0.5} if head and number % 2 else {}
        return replace(made, heads=heads, head=head, classes=tuple(map(str, range(len(pairs)))), **rule)
    return made


def _recordings(rng, n_steps, n_channels):
    rates = np.array([0.0, 0.02, 0.2, 0.6, 1.0])[:, None, None]
    fired = rng.random((5, n_steps, n_channels)) < rates
    burst = fired[3] & (np.arange(n_steps)[:, None] % 7 < 2)
    return np.concatenate([fired, burst[None]]).astype(np.uint8)
