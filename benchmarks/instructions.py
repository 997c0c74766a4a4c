"""Cycles of the C on Cortex-M: fitted on random classifiers, predicted for others that were not used.

    python -m benchmarks.instructions [--core cortex_m4] [--compiler gcc] [--of counts] [--fit 130]
        [--test 20] [--csv FILE]

Every classifier is written as C (target `c99`), compiled for the core and executed in an emulator on two
recordings of random spikes; all its decisions are checked. The cycles per kind of work, which profiles
`mcu_*` quote, minimise the squared relative errors over the networks of the fit. What is work, and the
prediction, are those of `dse.measure.hardware.kinds.processor`.
Networks are like those of search spaces: hidden neurons with decays of their own or resonators, outputs that
share their decays, one to three hidden layers, recurrent or not, delayed inputs, delays of synapses, pruned,
8 or 4 bits, both rules. Classifiers of spike counts take turns: nearest neighbours, naive Bayes, perceptrons,
and extreme learning machines in double and in single precision, all trained on random spikes of classes whose
channels differ in rate. Of integers: linear classifiers, perceptrons of 8 bits and kernels, whose counting
costs what it costs the others: what the profile quotes is taken off, and the rest is fitted; convolutions can
be fitted with them (--of integers convolutions). Without a fit (--fit 0) it is the profile that predicts, of
gcc `mcu_*_gcc`.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import nnls

from benchmarks.gcc import by_gcc
from dse.base.records import Array, Dataset, Layer, Network, Parameters, Workload
from dse.base.registry import known, name_of
from dse.config import Sections
from dse.config.settings import Training
from dse.deploy.bundle import Bundle, Input
from dse.deploy.reference import Reference, of_spikes
from dse.deploy.targets.c99 import C99
from dse.deploy.targets.emulated import Emulated
from dse.deploy.targets.thumb import CORES
from dse.engine.neurons import cuba_lif, parameters_of, resonator
from dse.measure.hardware.kinds.processor import counts_of, network_work
from dse.measure.hardware.profile import load
from dse.measure.run import load_of
from dse.models.counts.elm import ELM
from dse.models.counts.kernels import Kernels
from dse.models.counts.knn import KNN
from dse.models.counts.linear import Linear
from dse.models.counts.mlp import MLP
from dse.models.counts.naive_bayes import NaiveBayes
from dse.models.counts.tcn import TCN
from dse.models.snn.quantise import rounded
from dse.models.snn.respond import respond
from dse.testing.small import places, spikes_of

STEP_MS = 5.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--core", choices=CORES, default="cortex_m4")
    parser.add_argument("--compiler", choices=("clang", "gcc"), default="clang")
    all_of = ("networks", *FAMILIES)
    parser.add_argument("--of", choices=all_of, nargs="+", default=["networks"], help="classifiers")
    parser.add_argument("--fit", type=int, default=130, help="classifiers to fit, after those to predict")
    parser.add_argument("--test", type=int, default=20, help="classifiers to predict, of each kind")
    parser.add_argument("--csv", help="file for a row per classifier")
    options = parser.parse_args()
    target = known("targets")[options.core]()
    profile = target.core.profile
    if options.compiler == "gcc":
        target, profile = by_gcc(target), f"{profile}_gcc"
    rows, names = [], []
    for seed, of in product(range(options.test + options.fit), options.of):
        made = made_network(seed) if of == "networks" else made_of_counts(seed, of)
        rows.append(counted(target, *made))
        names.append(made[0].sections.kinds["model"])
    kinds = list(dict.fromkeys(kind for of_kinds, _, _ in rows for kind in of_kinds))
    work = np.array([[of_kinds.get(kind, 0.0) for kind in kinds] for of_kinds, _, _ in rows])
    instructions, cycles = (np.array(column) for column in list(zip(*rows, strict=True))[1:])
    n_tested = options.test * len(options.of)
    fit = slice(n_tested, None)
    costs = np.full(len(kinds), np.nan)
    if "integers" in options.of or not options.fit:
        costs = quoted(profile, kinds, "tally" if options.fit else "")
    free = np.isnan(costs)
    left = 1 - work[:, ~free] @ costs[~free] / cycles
    if free.any():
        costs[free] = nnls((work[:, free] / cycles[:, None])[fit], left[fit])[0]
    for kind, cost in zip(kinds, costs, strict=True):
        print(f"{kind}: {cost:.3g}")
    per_instruction = cycles / instructions
    low, mean, high = (f(per_instruction) for f in (np.min, np.mean, np.max))
    print(f"cycles per instruction: {mean:.3f} ({low:.3f}-{high:.3f})")
    error = work @ costs / cycles - 1
    for what, errors in (("fit", error[fit]), ("not used", error[:n_tested])):
        if not len(errors):
            continue
        off = np.abs(errors)
        within = np.count_nonzero(off <= 0.05)
        print(
            f"{what}: {len(off)} classifiers, {within} within 5 %, error {off.mean():.1%} in the mean, "
            f"{off.max():.1%} at most"
        )
    for name in dict.fromkeys(names):
        off = np.abs(error[:n_tested][[each == name for each in names[:n_tested]]])
        print(f"not used, {name}: {len(off)}, {off.mean():.1%} in the mean, {off.max(initial=0):.1%} at most")
    if options.csv:
        columns = {"model": names} | dict(zip(kinds, work.T, strict=True))
        table = pd.DataFrame(columns | {"instructions": instructions, "cycles": cycles, "error": error})
        table.to_csv(options.csv, index_label="classifier")


def counted(
    target: Emulated, made: Bundle, reference: Reference, bits: int
) -> tuple[dict[str, float], float, float]:
    """Return the work of an inference of a classifier by kind, its instructions and cycles."""
    with tempfile.TemporaryDirectory() as folder:
        C99().write(made, Path(folder) / "c")
        machine, answers = target.inferred(Path(folder) / "c", reference)
    assert np.array_equal(answers.label, reference.label)
    counts, n = machine.counts(), reference.n_recordings
    return work_of(made, reference, bits), counts.instructions / n, counts.cycles(target.core) / n


def made_network(seed: int) -> tuple[Bundle, Reference, int]:
    """Return random network `seed`, what it answers to two recordings, and bits per weight."""
    made, fired, bits = network(seed)
    return made, of_spikes(made, fired, STEP_MS), bits


def quoted(profile: str, kinds: list[str], begin: str) -> Array:
    """Return the cycles that a profile quotes of the kinds whose names begin so, NaN of other kinds."""
    figures = load(profile).at("value")
    return np.array([figures[kind] if kind.startswith(begin) else np.nan for kind in kinds], np.float64)


_OF_INTEGERS: dict[str, Any] = {"channels": "each", "epochs": 3, "read_outs": 1, "precision": "int8"}
FAMILIES: dict[str, Callable[[float, list[int], np.random.Generator], tuple[Any, ...]]] = {
    "counts": lambda window_ms, hidden, rng: (
        KNN(window_ms=window_ms, channels="each", k=int(rng.choice([1, 3, 5]))),
        NaiveBayes(window_ms=window_ms, channels="each", var_smoothing=0.1),
        MLP(window_ms=window_ms, channels="each", hidden=tuple(hidden), epochs=3, read_outs=1),
        ELM(window_ms=window_ms, windows=int(rng.choice([2, 4])), hidden=8 + hidden[0]),
        ELM(window_ms=window_ms, windows=3, hidden=8 + hidden[0], precision="float32"),
    ),
    "integers": lambda window_ms, hidden, rng: (
        Linear(window_ms=window_ms, read_outs=1, epochs=20),
        MLP(window_ms=window_ms, hidden=tuple(hidden), **_OF_INTEGERS),
        Kernels(
            window_ms=window_ms / 4,
            kernels=4 * hidden[0],
            places=int(rng.integers(1, 6)),
            thresholds=int(rng.choice([1, 1, 2, 4])),
            read_outs=1,
        ),
    ),
    "levels": lambda window_ms, hidden, rng: (
        Linear(window_ms=window_ms, read_outs=1, epochs=3, reads="levels"),
        MLP(window_ms=window_ms, hidden=tuple(hidden), reads="levels", **_OF_INTEGERS),
    ),
    "convolutions": lambda window_ms, hidden, rng: (
        TCN(
            window_ms=window_ms / 4,
            hidden=tuple(min(n // 2, 64) for n in hidden),
            kernel_size=int(rng.integers(3, 9)),
            stride=int(rng.choice([1, 1, 2])),
            reads=str(rng.choice(["counts", "levels", "changes"])),
            epochs=1,
            read_outs=1,
        ),
    ),
}


def made_of_counts(seed: int, of: str = "counts") -> tuple[Bundle, Reference, int]:
    """Return random classifier of counts `seed`, what it answers to four recordings, and bits per number."""
    rng = np.random.default_rng([80, seed])
    n_channels, n_steps = int(rng.choice([4, 12, 32, 64, 128, 400])), int(rng.choice([32, 64, 128, 200]))
    n_classes, n_samples = int(rng.choice([2, 4, 7, 12])), int(rng.integers(40, 121))
    target = rng.permutation(np.arange(n_samples) % n_classes)
    rate = float(rng.choice([0.01, 0.03, 0.1, 0.2])) * rng.uniform(0.2, 1.8, (n_classes, 1, n_channels))
    fired = (rng.random((n_samples, n_steps, n_channels)) < rate[target]).astype(np.uint8)
    window_ms = STEP_MS * int(rng.choice([4, 8, 16]))
    hidden = [int(n) for n in rng.integers(8, 101, int(rng.choice([1, 1, 2, 3])))]
    models = FAMILIES[of](window_ms, hidden, rng)
    model = models[seed % len(models)]
    kind = name_of("models", model)
    test = np.arange(n_samples - 4, n_samples)
    data = replace(
        _dataset(fired, tuple(f"class {k}" for k in range(n_classes))),
        target=target,
        train=np.arange(n_samples - 4),
        validation=test,
        test=test,
    )
    outcome = model.fit(data, Training(), lambda *purpose: np.random.default_rng([81, seed]))
    made = _bundle(outcome.network, n_steps, data.classes, n_channels)
    made = replace(
        made, sections=replace(made.sections, model=model, kinds={**made.sections.kinds, "model": kind})
    )
    return made, of_spikes(made, fired[test], STEP_MS), 32


def network(seed: int) -> tuple[Bundle, Array, int]:
    """Return a random network, spikes of two recordings, (recording, step, channel), and bits per weight."""
    rng = np.random.default_rng([78, seed])
    n_channels, n_steps = int(rng.choice([12, 16, 32, 64, 78, 128])), int(rng.choice([32, 64, 128, 200]))
    per_sample = int(rng.choice([1, 1, 1, 1, 2]))
    delays = ((0,), (0,), (0, 4, 8, 16), (0, 3, 8, 20))[rng.integers(4)]
    hidden = [int(rng.integers(20, 161)) for _ in range(rng.choice([1, 1, 2, 3]))]
    sizes = [n_channels * len(delays), *hidden, int(rng.choice([4, 6, 7, 12, 36]))]
    rate = float(rng.choice([0.002, 0.01, 0.03, 0.1, 0.2]))
    fired = (rng.random((2, n_steps, n_channels)) < rate).astype(np.uint8)
    recurrent, resonating = rng.random() < 0.4, rng.random() < 0.25
    bits, pruned = int(rng.choice([8, 8, 8, 8, 4])), float(rng.choice([0, 0, 0.5, 0.9]))
    threshold = int(rng.choice([192, 320]))
    slowest = float(rng.choice([0.05, 0.3])), float(rng.choice([0.03, 0.12]))
    layers = []
    for depth, (before, n) in enumerate(pairwise(sizes)):
        is_output = depth == len(hidden)
        if is_output:
            decays = [np.full(n, int(cuba_lif.round_decay(x))) for x in (0.12, rng.choice([0.03, 0.05]))]
        else:
            ends = [np.log(-1 / np.log(1 - np.array(x))) for x in ((slowest[0], 0.99), (slowest[1], 0.96))]
            decays = [
                cuba_lif.round_decay(1 - np.exp(-1 / np.exp(rng.uniform(last, first, n))))
                for first, last in ends
            ]
        gain = min(4096**2 / np.mean(decays[0]) / np.mean(decays[1]), 60)
        rate = rate if depth == 0 else 0.05
        scale = threshold / 64 / np.sqrt(max(before * rate, 0.5) * gain) * rng.uniform(0.5, 1.0)
        weight = rng.normal(0.05 * scale, scale, (n, before)).astype(np.float32)
        ring = None
        if recurrent and not is_output:
            ring = rng.normal(0, 0.3 * scale, (n, n)).astype(np.float32)
        current, voltage = (np.asarray(x, np.int32) for x in decays)
        if resonating and not is_output:
            turns = np.arange(n) < max(1, round(rng.choice([0.5, 1.0]) * n))
            c, s = resonator.factors(np.exp(rng.uniform(np.log(2.2), np.log(40), n)), rng.uniform(1.5, 5, n))
            c, s = (np.where(turns, x, 0).astype(np.int32) for x in (c, s))
            current, voltage = (np.where(turns, 0, x).astype(np.int32) for x in (current, voltage))
            mixed = resonator.Population(turns, c, s, current, voltage, threshold, False)
            layers.append(Layer(weight, ring, parameters_of(mixed), "resonator"))
        else:
            layers.append(
                Layer(weight, ring, parameters_of(cuba_lif.Population(current, voltage, threshold)))
            )
    net = rounded(Network(tuple(layers), n_channels, delays, per_sample, "integer"), bits, pruned)
    apart = np.random.default_rng([79, seed])
    if apart.random() < 0.15:
        slowest_step = int(apart.choice([8, 20, 40]))
        n_delayed = 1 if recurrent or apart.random() < 0.5 else len(net.layers)
        delayed = [
            replace(x, delay=apart.integers(0, slowest_step, x.weight.shape)) for x in net.layers[:n_delayed]
        ]
        net = replace(net, layers=(*delayed, *net.layers[n_delayed:]))
    made = _bundle(net, n_steps, tuple(f"class {k}" for k in range(net.sizes[-1])), n_channels)
    if rng.random() < 0.5:
        made = replace(made, phi=float(rng.integers(0, 40)), theta=float(rng.choice([0.3, 0.5, 0.7])))
    return made, fired, bits


def _bundle(fitted: Network | Parameters, n_steps: int, classes: tuple[str, ...], n_channels: int) -> Bundle:
    sections = Sections.from_plain(
        {
            "data": {"kind": "raster", "file": "none.npz", "step_ms": STEP_MS},
            "task": {"target": "class"},
            "split": {"stratified": {"validation": 0.2}},
            "model": {"kind": "snn"},
            "training": {},
        },
        "a random network",
    )
    taken = Input("spikes", n_channels, 0, 0, n_steps, STEP_MS)
    return Bundle(fitted, sections, classes, None, None, record={}, evidence={}, input=taken)


def _dataset(fired: Array, classes: tuple[str, ...]) -> Dataset:
    """Return recordings of spikes, (recording, step, channel), which are tested whole."""
    n, n_steps, n_channels = fired.shape
    start, none = np.zeros(n, np.int32), np.zeros(0, np.int64)
    return Dataset(
        spikes=spikes_of(fired, STEP_MS),
        target=np.zeros(n, np.int64),
        classes=classes,
        start=start,
        start_low=start,
        start_high=start,
        n_steps=n_steps,
        train=none,
        validation=none,
        test=np.arange(n),
        positions=places(n_channels),
    )


def work_of(made: Bundle, reference: Reference, bits: int) -> dict[str, float]:
    """Return how often each kind of work is done in an inference, from what dse records of a design."""
    net, data = made.fitted, reference.dataset
    if isinstance(net, Parameters):
        answers = made.sections.model.respond(net, data, data.test)
        column = int(np.abs(answers.time_ms - reference.time_ms[0]).argmin())
        return {f"{kind}_cycles": float(times[column]) for kind, times in answers.program.items()}
    response = respond(net, data, data.test)
    steps = np.rint(reference.time_ms / reference.step_ms)
    before = np.arange(response.spikes.shape[1]) < steps[:, None]
    counted = np.concatenate([response.spikes, response.updates, response.updates > 0], axis=2)
    mean = (counted * before[..., None]).sum(axis=(0, 1)) / len(steps)
    load = load_of(net, response, mean, np.asarray(steps.mean()), bits)
    assert isinstance(load, Workload)
    return {kind: float(counts_of(load) @ per_count) for kind, per_count in network_work(load).items()}


if __name__ == "__main__":
    main()
