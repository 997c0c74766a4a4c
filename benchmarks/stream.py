"""A stream beside the batch: microseconds per step, memory over a long stream, decisions that differ.

    python -m benchmarks.stream [--steps 1000000] [--sizes 6084-425-12]

A network of random 8-bit weights takes random spikes at several densities, one window after the other, on one
core. `spikes` are given to it as they are; `events` pass the pooling first, a block per bin. A step is timed
from its first spike or event to its decision, if there is one.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from dse.base.records import Array, Block, Dataset, Layer, Network, Spikes
from dse.config import Sections
from dse.deploy.bundle import Bundle, Input
from dse.deploy.stream import Spiking, Stream, Windows
from dse.engine.neurons import cuba_lif, parameters_of
from dse.models.snn.respond import respond

STEP_MS, N_STEPS, DISTINCT = 4.0, 250, 1000
_NONE = np.zeros(0, np.int64)


def bundle(sizes: tuple[int, ...], density: float, kind: str) -> Bundle:
    """Return a bundle of a random network whose hidden neurons fire at some per cent."""
    rng = np.random.default_rng(0)
    layers = []
    rates = [density, *[0.05] * (len(sizes) - 2)]
    for (n_in, n), rate in zip(pairwise(sizes), rates, strict=True):
        weight = rng.normal(0, 1 / np.sqrt(max(1.0, n_in * rate)), (n, n_in)).astype(np.float32)
        population = cuba_lif.Population(np.full(n, 1500, np.int32), np.full(n, 1000, np.int32), 400)
        layers.append(Layer(weight, None, parameters_of(population)))
    side = round(sizes[0] ** 0.5)
    plain = {
        "data": {"kind": "events", "file": "x.npz", "width": side, "height": side, "x": "x", "y": "y"},
        "task": {"target": "x"},
        "window": {"n_steps": N_STEPS, "at": "start"},
        "split": {"stratified": {"validation": 0.5}},
        "model": {"kind": "snn"},
        "training": {},
    }
    recordings = Input("spikes", sizes[0], 0, 0, N_STEPS, STEP_MS)
    if kind == "events":
        plain["preprocessing"] = {"bin_ms": STEP_MS, "polarity": "merge"}
        recordings = Input("events", 0, side, side, N_STEPS, STEP_MS)
    return Bundle(
        fitted=Network(tuple(layers), sizes[0], (0,), 1, "integer"),
        sections=Sections.from_plain(plain, "benchmark"),
        classes=tuple(map(str, range(sizes[-1]))),
        phi=20.0,
        theta=0.3,
        record={},
        evidence={},
        input=recordings,
    )


def steps(n_channels: int, density: float) -> list[Array]:
    """Return the channels that spike in each of some steps."""
    rng = np.random.default_rng(1)
    return [np.flatnonzero(rng.random(n_channels) < density).astype(np.int32) for _ in range(DISTINCT)]


def calls(stream: Stream, kind: str, spikes: list[Array], n_channels: int) -> Iterator[Callable[[], object]]:
    """Yield what takes the next step."""
    side, k = round(n_channels**0.5), 0
    while True:
        channels = spikes[k % len(spikes)]
        if kind == "spikes":
            yield lambda channels=channels: stream.push(Spiking(channels))
        else:
            y, x = np.divmod(channels, side)
            t_us = np.full(len(channels), round(k * STEP_MS * 1000))
            block = Block(t_us, x.astype(np.int32), y.astype(np.int32), np.ones(len(channels), np.uint8))
            yield lambda block=block: stream.push(block)
        k += 1


def timed(stream: Stream, kind: str, spikes: list[Array], n_channels: int, n_steps: int) -> Array:
    """Return the microseconds of every step, (2, step): by the clock, and of this thread alone.

    The first steps, which compile, are left out.
    """
    taken = np.empty((2, n_steps))
    each = calls(stream, kind, spikes, n_channels)
    for _ in range(100):
        next(each)()
    for k in range(n_steps):
        call = next(each)
        began, worked = time.perf_counter(), time.thread_time()
        call()
        taken[:, k] = time.perf_counter() - began, time.thread_time() - worked
    return taken * 1e6


def differing(made: Bundle, spikes: list[Array], n_windows: int = 20) -> tuple[int, int]:
    """Return how many windows of a stream are decided otherwise than in one batch, and of how many."""
    stream = Stream(made, Windows("every", every=N_STEPS))
    decisions = [x for k in range(n_windows * N_STEPS) for x in stream.push(Spiking(spikes[k % DISTINCT]))]
    rows = [spikes[k % DISTINCT] for k in range(n_windows * N_STEPS)]
    offsets = np.concatenate([[0], np.cumsum([len(row) for row in rows])])
    stored = Spikes(offsets, np.concatenate(rows), N_STEPS, made.fitted.n_channels, STEP_MS)
    zero = np.zeros(n_windows, np.int32)
    data = Dataset(
        spikes=stored, target=zero, classes=made.classes, start=zero, start_low=zero, start_high=zero,
        n_steps=N_STEPS, train=_NONE, validation=_NONE, test=np.arange(n_windows),
        positions=np.zeros((made.fitted.n_channels, 3), np.int32),
    )  # fmt: skip
    from dse.deploy.reference import decided

    assert isinstance(made.fitted, Network)
    label, time_ms, sure = decided(made, data, respond(made.fitted, data, data.test))
    whole = [(made.classes[a], float(b), bool(c)) for a, b, c in zip(label, time_ms, sure, strict=True)]
    streamed = [(x.answer, x.time_ms, x.decided) for x in sorted(decisions)]
    return sum(a != b for a, b in zip(streamed, whole, strict=True)), n_windows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--sizes", default="6084-425-12")
    arguments = parser.parse_args()
    sizes = tuple(map(int, arguments.sizes.split("-")))
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    print(f"{arguments.sizes}, one core\n")
    print(f"{'':>17} {'us by the clock':>20} {'us of the processor':>20}")
    print(f"{'input':>8} {'spikes':>8} {'median':>12} {'p99':>7} {'median':>12} {'p99':>7} {'differ':>9}")
    for kind, density in [
        *(("spikes", x) for x in (0.0, 0.005, 0.02, 0.1)),
        *(("events", x) for x in (0.005, 0.02)),
    ]:
        made, spikes = bundle(sizes, max(density, 0.005), kind), steps(sizes[0], density)
        us = timed(Stream(made), kind, spikes, sizes[0], min(20_000, arguments.steps))
        wrong, n = differing(bundle(sizes, max(density, 0.005), "spikes"), spikes)
        clock, processor = (f"{np.median(x):>12.1f} {np.percentile(x, 99):>7.1f}" for x in us)
        print(f"{kind:>8} {density:>8.1%} {clock} {processor} {f'{wrong} of {n}':>9}", flush=True)
    made, spikes = bundle(sizes, 0.02, "spikes"), steps(sizes[0], 0.02)
    stream = Stream(made)
    each = calls(stream, "spikes", spikes, sizes[0])
    for _ in range(10_000):
        next(each)()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(arguments.steps):
        next(each)()
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(f"\npeak memory grows by {grown} KiB over {arguments.steps} steps")


if __name__ == "__main__":
    main()
