"""What a design costs on a chip, in closed form: speed beside error. Four parts, a table each.

    python -m benchmarks.cost [--only simulation counts points bits] [--quick] [--rounds 3]
                              [--nets 1600-450-11 ...] [--python sanafe=VENV/bin/python] [--cycle]

simulation  energy and time of a step, from counts, beside a chip simulated neuron by neuron and message by
            message (benchmarks.chip_simulation) on the same spikes: `means` from the counts of the whole run,
            `steps` from those of every step. Bursty: all input comes in a fifth of the steps. Queues: the
            simulation with a network whose links and inputs hold 16 messages each; `in range`: whether the
            closed form's interval, from means, holds its time. SANA-FE simulates the same weights and inputs
            where this Python or `--python` has it, inputs sent by cores of their own after the others, as
            `queues so` has them; `cycle` is its cycle-accurate network (a minute per case and more)
counts      the mean over inferences and steps, or over the steps of each inference, instead of every step's
            own counts: drawn in bursts, and, where DSE_DATA is set, those of networks on recorded touch,
            trained ones and such as training starts from
points      a million design points of one architecture or of many, on one core, beside a loop that prices one
            at a time; memory is the peak of the process, the points included
bits        weights of fewer bits, and fewer weights, without further training, where DSE_DATA is set: a power
            of two per layer that errs least, as is deployed, beside one scale for the whole network, whose
            full range is its largest weight. `least`: accuracy of the worst of the nets

Spikes per step are those of the inputs, and of all neurons. Times are CPU times of one thread, the least of
the rounds. Errors are signed and relative to the simulation, or to every step's own counts.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Column, Table

import dse
from benchmarks import chip_simulation
from benchmarks.mapped_cases import Case
from benchmarks.worker import NotInstalled, Worker, pythons
from dse.base import seeds
from dse.base.records import Array, Dataset, Floats, Network, Response, Workload
from dse.data import dataset
from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.fixed_point import quantise
from dse.measure.hardware.cost import Cost, cost, cost_of_steps
from dse.measure.hardware.profile import Profile, load
from dse.measure.run import read_out
from dse.models.snn.family import SNN
from dse.models.snn.quantise import rounded
from dse.models.snn.respond import respond
from dse.models.training import Training

HARDWARE = "loihi1_silicon"
STEP_MS, N_STEPS = 1.0, 100
SANAFE = "sanafe"


@dataclass(frozen=True)
class Settings:
    """What the command line asks for.

    quick: small cases of every kind, as a test needs them.
    nets: which networks are simulated.
    python: interpreter that has SANA-FE.
    cycle: its cycle-accurate model too.
    """

    rounds: int = 3
    quick: bool = False
    nets: Sequence[str] = ()
    python: str = sys.executable
    cycle: bool = False


def least_s(call: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """Return the least CPU time of the calls, after one that is not counted, and what the last returned."""
    result, best = call(), np.inf
    for _ in range(rounds):
        began = time.process_time()
        result = call()
        best = min(best, time.process_time() - began)
    return best, result


def percent(value: float, expected: float) -> str:
    """Return how far a number is from another."""
    off = 100 * (value / expected - 1) if expected else 0.0
    return "0" if abs(off) < 1e-10 else f"{off:+.2g}"


NETS: Mapping[str, tuple[tuple[int, ...], tuple[bool, ...], float]] = {
    "24-50-7": ((24, 50, 7), (False, False), 1.0),
    "256-100-12": ((256, 100, 12), (False, False), 1.0),
    "900-660-11": ((900, 660, 11), (False, False), 1.0),
    "1600-450-11": ((1600, 450, 11), (False, False), 1.0),
    "96-300r-12": ((96, 300, 12), (True, False), 1.0),
    "900-660-11 pruned": ((900, 660, 11), (False, False), 0.2),
}
"""Sizes, which layers are recurrent (r), and the share of weights that is left."""

ACTIVITY: Mapping[str, tuple[float, float, bool]] = {
    "quiet": (0.005, 0.02, False),
    "usual": (0.02, 0.1, False),
    "busy": (0.1, 0.2, False),
    "bursty": (0.02, 0.1, True),
}
"""Spikes per input and step, per neuron and step (roughly), and whether the input comes in bursts."""


def cases(settings: Settings) -> Iterator[tuple[str, str, Case]]:
    """Yield networks and activities with their case."""
    for net in settings.nets:
        sizes, recurrent, weights_left = NETS[net]
        for activity, (inputs, rate, bursty) in ACTIVITY.items():
            yield net, activity, Case(sizes, recurrent, N_STEPS, inputs, rate, weights_left, bursty)


def loads(case: Case) -> tuple[Workload, Workload]:
    """Return the workload of a case, from the counts of the whole run and from those of every step."""
    fired, updated = case.activity
    spikes = np.stack([x.sum(axis=1) for x in fired], axis=1).astype(np.float64)
    updates = np.stack([x.sum(axis=1) for x in updated], axis=1).astype(np.float64)
    steps = Workload(case.sizes, case.recurrent, np.ones(case.n_steps), spikes, updates, STEP_MS)
    if case.weights_left < 1:
        reached = [x.sum(axis=0) @ n for x, n in zip(fired, case.targets, strict=True)]
        synapses = tuple(
            float(n / max(1, total)) for n, total in zip(reached, spikes.sum(axis=0), strict=True)
        )
        steps = replace(steps, synapses=synapses, stored=tuple(int(x.sum()) for x in case.connected))
    return whole(steps), steps


def whole(steps: Workload) -> Workload:
    """Return the workload of an inference from those of its steps, (..., step)."""
    updates = None if steps.updates is None else steps.updates.sum(axis=-2)
    return replace(
        steps, n_steps=steps.n_steps.sum(axis=-1), spikes=steps.spikes.sum(axis=-2), updates=updates
    )


def mean_of(steps: Workload) -> Workload:
    """Return the mean workload of inferences from those of their steps, (inference, step)."""
    each = whole(steps)
    updates = None if each.updates is None else each.updates.mean(axis=0)
    return replace(each, n_steps=each.n_steps.mean(axis=0), spikes=each.spikes.mean(axis=0), updates=updates)


@dataclass(frozen=True)
class Peer:
    """A running SANA-FE."""

    worker: Worker

    def __call__(self, case: Case, cores: Sequence[int], timings: Sequence[str]) -> list[Mapping[str, float]]:
        """Return CPU seconds, energy and step time of a case for each of the peer's models of time.

        Raises:
            RuntimeError: its neurons do not fire as the case's.
        """
        runs: list[Mapping[str, float]] = self.worker.ask(SANAFE, asdict(case), list(cores), list(timings))
        spikes = sum(int(x.sum()) for x in case.activity[0])
        if any(x["spikes"] != spikes for x in runs):
            raise RuntimeError(f"SANA-FE must fire {spikes} spikes of {case}, got {runs}")
        return runs


def peer_heads(settings: Settings) -> list[str]:
    """Return the headings of the peer's columns."""
    timed = [f"{name}\nms, %" for name in ("simple", "detailed", *(["cycle"] if settings.cycle else []))]
    return ["queues so, %", "SANA-FE\nenergy, %", *timed]


def simulation(settings: Settings) -> Table:
    """Return the closed form beside the chip simulated."""
    profile = load(HARDWARE)
    table = Table(
        Column("net", no_wrap=True),
        Column("activity", no_wrap=True),
        "cores",
        Column("spikes / step", no_wrap=True),
        *("us / step", "simulated\nms", "queues, ms", "means, us", "steps, us"),
        *("energy, %", "means, %", "steps, %", "queues, %", "in range", *peer_heads(settings)),
        title=f"{HARDWARE}: closed form beside simulation of {N_STEPS} steps; errors, of time and of energy "
        "where it says so, against it without queues",
    )
    with contextlib.ExitStack() as stack:
        peer = None
        try:
            worker = stack.enter_context(Worker(settings.python, "benchmarks.cost_contender", SANAFE))
            peer = Peer(worker) if worker.ask("ready") else None
        except NotInstalled:
            table.caption = (
                f"SANA-FE is left out: {settings.python} does not have it (pip install sanafe==2.2.9)"
            )
        for net, activity, case in cases(settings):
            table.add_row(
                net, activity, *simulated(profile, case, settings), *beside(profile, case, peer, settings)
            )
    return table


def simulated(profile: Profile, case: Case, settings: Settings) -> list[str]:
    """Return the cells of a case that need no peer."""
    means, steps = loads(case)
    chip = chip_simulation.layout(profile, means, case.connected)
    run = partial(chip_simulation.simulate, profile, chip, *case.activity)
    plain_s, plain = least_s(partial(run, None), settings.rounds)
    queues_s, queues = least_s(partial(run, chip_simulation.BUFFER), settings.rounds)
    means_s, of_means = least_s(partial(cost, profile, means), settings.rounds)
    steps_s, of_steps = least_s(partial(cost_of_steps, profile, steps), settings.rounds)
    plain_us, queues_us = (float(x.step_ns.mean()) * 1e-3 for x in (plain, queues))
    held = float(of_means.step_time_us.low) <= queues_us <= float(of_means.step_time_us.high)
    inputs, *neurons = means.spikes / case.n_steps
    return [
        str(chip.n_cores),
        f"{inputs:.3g}, {sum(neurons):.3g}",
        f"{plain_us:.3f}",
        f"{1e3 * plain_s:.2f}",
        f"{1e3 * queues_s:.2f}",
        f"{1e6 * means_s:.0f}",
        f"{1e6 * steps_s:.0f}",
        percent(float(of_steps.dynamic_uj), plain.energy_pj * 1e-6),
        percent(float(of_means.step_time_us.value), plain_us),
        percent(float(of_steps.step_time_us.value), plain_us),
        percent(queues_us, plain_us),
        "yes" if held else "NO",
    ]


def beside(profile: Profile, case: Case, peer: Peer | None, settings: Settings) -> list[str]:
    """Return the cells of a case that are a peer's: its errors against the simulation without queues."""
    if peer is None:
        return ["-"] * len(peer_heads(settings))
    means, _ = loads(case)
    placement = profile.plan(means, profile.ends).placement
    assert placement is not None
    chip = chip_simulation.layout(profile, means, case.connected, ports_last=True)
    ours, queues = (
        chip_simulation.simulate(profile, chip, *case.activity, n) for n in (None, chip_simulation.BUFFER)
    )
    ours_us, queues_us = (float(x.step_ns.mean()) * 1e-3 for x in (ours, queues))
    runs = peer(case, placement.cores, ("simple", "detailed"))
    if settings.cycle:  # its network runs once per process
        with Worker(settings.python, "benchmarks.cost_contender", SANAFE) as worker:
            runs += Peer(worker)(case, placement.cores, ("cycle",))
    times = [f"{1e3 * x['cpu_s']:.0f}, {percent(x['step_us'], ours_us)}" for x in runs]
    return [percent(queues_us, ours_us), percent(runs[0]["energy_uj"], ours.energy_pj * 1e-6), *times]


def drawn_counts(
    sizes: tuple[int, ...], n: int, n_steps: int, burst: float, rng: np.random.Generator
) -> Workload:
    """Return counts of every step of n inferences, (n, step).

    Args:
        sizes: neurons per layer, input first.
        n: inferences; how active each is is drawn too.
        n_steps: of each.
        burst: all spikes come in 1 / burst of the steps, in stretches of ten.
        rng: the source of chance.
    """
    mean = 0.04 * rng.gamma(4, 0.25, (n, 1)).clip(0.2, 4)
    stretch = rng.random((n, -(-n_steps // 10))) < 1 / burst
    rate = np.minimum(np.repeat(stretch, 10, axis=1)[:, :n_steps] * burst * mean, 0.9)
    spikes = rng.binomial(sizes, rate[..., None], (n, n_steps, len(sizes))).astype(np.float64)
    chance = 1 - np.exp(-5 * rate)
    updates = rng.binomial(sizes[1:], chance[..., None], (n, n_steps, len(sizes) - 1)).astype(np.float64)
    return Workload(sizes, (False,) * (len(sizes) - 1), np.ones((n, n_steps)), spikes, updates, STEP_MS)


def of_response(network: Network, response: Response) -> Workload:
    """Return counts of every step of what a network did, (n, step)."""
    return Workload(
        network.sizes,
        tuple(layer.recurrent is not None for layer in network.layers),
        np.ones(response.spikes.shape[:2]),
        response.spikes.astype(np.float64),
        response.updates.astype(np.float64),
        response.step_ms,
        synapses=response.synapses,
        stored=network.stored,
    )


@dataclass(frozen=True)
class Touch:
    """Recorded touch: a search space, what is chosen of it, and how a small network of it is trained."""

    space: str
    chosen: Mapping[str, str]
    model: SNN
    training: Training

    def data(self) -> Dataset:
        """Return the samples."""
        space = dse.load_space(self.space, dict(self.chosen))
        return dataset.build(space.resolve({}), space.source.parent)[0]


_NEURON = CubaLif(
    threshold=5.0, current_decay=(0.3, 1.0), voltage_decay=(0.12, 0.96), output_current_decay=0.12
)
_START = {"initial_rate": 0.2, "output_tau_grad": 0.3}
_TRAINING = Training(
    epochs=100, learning_rate=0.1, warmup_epochs=3, lr_every=16, average_epochs=10, dropout=0.1
)
TOUCH: Mapping[str, Touch] = {
    "fabric": Touch(
        "fabric_texture",
        {"model.hidden": "60", "model.pruned": "0.0", "model.input_delays": "[0]",
         "encoder.thresholds": "[1, 2, 4, 8, 16]"},
        SNN(hidden=(60,), true_rate=0.5, neuron=replace(_NEURON, output_voltage_decay=0.05), **_START),
        _TRAINING,
    ),
    "Braille": Touch(
        "braille",
        {"model.hidden": "40", "model.true_rate": "0.4", "model.threshold": "5.0",
         "model.input_delays": "[0]"},
        SNN(hidden=(40,), true_rate=0.4, neuron=_NEURON, **_START),
        _TRAINING,
    ),
}  # fmt: skip


def touches(settings: Settings) -> Mapping[str, Touch]:
    """Return the recordings that there are."""
    if not os.environ.get("DSE_DATA"):
        return {}
    if settings.quick:
        return {name: replace(x, training=replace(x.training, epochs=1)) for name, x in TOUCH.items()}
    return TOUCH


def responses(settings: Settings) -> Iterator[tuple[str, Workload]]:
    """Yield names and every step's counts of networks on recorded touch: trained, and as training starts."""
    for name, touch in touches(settings).items():
        data = touch.data()
        untrained = replace(touch.training, epochs=1, learning_rate=1e-9)
        for how, model, training in (
            ("trained", touch.model, touch.training),
            ("450 hidden, untrained", replace(touch.model, hidden=(450,)), untrained),
        ):
            outcome = model.fit(data, training, partial(seeds.generator, 0, {}))
            assert isinstance(outcome.network, Network) and isinstance(outcome.validation, Response)
            yield f"{name}, {how}", of_response(outcome.network, outcome.validation)


def counts(settings: Settings) -> Table:
    """Return mean counts beside those of every step."""
    profile = load(HARDWARE)
    table = Table(
        Column("activity", no_wrap=True),
        Column("net", no_wrap=True),
        *("inferences", "steps"),
        Column("spikes / step", no_wrap=True),
        *("us / step", "ns / inference: mean", "of each", "steps"),
        *("dynamic, %: mean", "of each", "time, %: mean", "of each", "worst", "flat out, %: mean", "of each"),
        title=f"{HARDWARE}: mean counts instead of every step's own; errors of energies and of step time",
    )
    rng = np.random.default_rng(0)
    n, n_steps = (4, 50) if settings.quick else (100, 250)
    drawn = [
        (f"drawn, bursts {burst:g} ×", drawn_counts(sizes, n, n_steps, burst, rng))
        for sizes in ((24, 50, 7), (256, 100, 12), (1600, 450, 11))[: 1 if settings.quick else 3]
        for burst in (1, 2, 5, 20)
    ]
    for name, steps in (*drawn, *responses(settings)):
        table.add_row(name, "-".join(map(str, steps.sizes)), *mean_errors(profile, steps, settings.rounds))
    return table


def mean_errors(profile: Profile, steps: Workload, rounds: int) -> list[str]:
    """Return the cells of mean counts: what they leave out of dynamic energy, of time, of all flat out."""
    n = len(steps.spikes)
    each, mean = whole(steps), mean_of(steps)

    def of_every_step() -> list[Any]:
        assert steps.updates is not None
        pairs = zip(steps.n_steps, steps.spikes, steps.updates, strict=True)
        return [cost_of_steps(profile, replace(steps, n_steps=t, spikes=s, updates=u)) for t, s, u in pairs]

    mean_s, of_mean = least_s(partial(cost, profile, mean), rounds)
    each_s, of_each = least_s(partial(cost, profile, each), rounds)
    steps_s, exact = least_s(of_every_step, rounds)

    def against(figure: Callable[[Cost], Floats]) -> list[str]:
        expected = np.array([float(figure(x)) for x in exact])
        approximate = float(figure(of_mean)), float(figure(of_each).mean())
        return [percent(x, float(expected.mean())) for x in approximate]

    inputs, *neurons = steps.spikes.mean(axis=(0, 1))
    step_us = np.array([float(x.step_time_us.value) for x in exact])
    worst = float((of_each.step_time_us.value / step_us).min())
    return [
        str(n),
        str(steps.spikes.shape[1]),
        ", ".join(f"{x:.3g}" for x in (inputs, sum(neurons))),
        f"{step_us.mean():.3f}",
        *(f"{1e9 * s / n:.0f}" for s in (mean_s, each_s, steps_s)),
        *against(lambda x: x.dynamic_uj),
        *against(lambda x: x.step_time_us.value),
        percent(worst, 1.0),
        *against(lambda x: x.energy_uj.value),
    ]


SHAPES = ((1, 1_000_000), (2_000, 500), (10_000, 100))
"""Architectures, and points of each."""


def points(settings: Settings) -> Table:
    """Return seconds and memory of pricing a million points."""
    table = Table(
        *("architectures", "points of each", "s", "us / point", "peak GiB", "before", "loop, us / point"),
        *("faster", "largest difference"),
        title=f"{HARDWARE}: a million design points on one core",
    )
    for n_architectures, n_points in [(2, 300)] if settings.quick else SHAPES:
        answers = []
        for _ in range(
            settings.rounds
        ):  # a process each: nothing is kept from the last, and the peak is its own
            with Worker(sys.executable, "benchmarks.cost_contender", "price") as worker:
                answers.append(worker.ask("price", HARDWARE, n_architectures, n_points))
        fastest = min(answers, key=lambda x: x["cpu_s"])
        per_point = fastest["cpu_s"] / (n_architectures * n_points)
        table.add_row(
            f"{n_architectures:,}",
            f"{n_points:,}",
            f"{fastest['cpu_s']:.2f}",
            f"{1e6 * per_point:.2f}",
            f"{fastest['peak_gib']:.2f}",
            f"{fastest['before_gib']:.2f}",
            f"{1e6 * fastest['loop_s']:.0f}",
            f"{fastest['loop_s'] / per_point:,.0f} ×",
            f"{max(x['error'] for x in answers):.1g}",
        )
    return table


SETTINGS = (*((n, 0.0) for n in (8, 7, 6, 5, 4, 3, 2)), (8, 0.5), (4, 0.5), (8, 0.75), (4, 0.75))
"""Bits of a weight and the share that is removed."""


def one_scale(network: Network, weight_bits: int) -> Network:
    """Return a network with one scale: its largest weight is the largest whole number of so many bits.

    Its weights are those that are deployed with 8 bits, and go back to that grid, for the same engine to run.
    """
    unit = max(float(np.abs(quantise(w)).max()) for w in matrices(network)) / (2 ** (weight_bits - 1) - 1)

    def on_grid(w: Array) -> Array:
        return np.asarray(np.rint(quantise(w) / unit) * unit, np.float32)

    layers = tuple(
        replace(x, weight=on_grid(x.weight), recurrent=None if x.recurrent is None else on_grid(x.recurrent))
        for x in network.layers
    )
    return replace(network, layers=layers)


def matrices(network: Network) -> list[Array]:
    """Return all weights of a network."""
    return [w for x in network.layers for w in (x.weight, x.recurrent) if w is not None]


def bits(settings: Settings) -> Table:
    """Return accuracy, memory and energy of trained networks at fewer bits and with fewer weights."""
    profile, n_nets = load(HARDWARE), 1 if settings.quick else 3
    table = Table(
        *("recording", "net", "bits", "removed", "accuracy", "least", "one scale", "W_t", "bytes", "cores"),
        *("dynamic, uJ", "energy, %", "flat out, uJ"),
        title=f"Fewer bits, validation, mean of {n_nets} trained nets; {HARDWARE}; energy against 8 bits",
    )
    recorded = touches(settings)
    if not recorded:
        table.caption = "Left out: DSE_DATA names no recordings."
    for name, touch in recorded.items():
        data = touch.data()
        truth = data.target[data.validation]
        nets = []
        for seed in range(n_nets):
            outcome = touch.model.fit(data, touch.training, partial(seeds.generator, seed, {}))
            assert isinstance(outcome.network, Network)
            nets.append(outcome.network)
        whole_uj = None
        for weight_bits, removed in SETTINGS:
            rows = [
                bits_row(profile, data, truth, rounded(net, weight_bits, removed), weight_bits)
                for net in nets
            ]
            accuracy, n_weights, n_cores, dynamic_uj, flat_uj = np.mean(rows, axis=0)
            naive = "-"
            if not removed:
                answers = [respond(one_scale(net, weight_bits), data, data.validation) for net in nets]
                naive = f"{np.mean([read_out(x.output) == truth for x in answers]):.3f}"
            whole_uj = dynamic_uj if whole_uj is None else whole_uj
            table.add_row(
                name,
                "-".join(map(str, nets[0].sizes)),
                str(weight_bits),
                f"{removed:g}",
                f"{accuracy:.3f}",
                f"{min(row[0] for row in rows):.3f}",
                naive,
                f"{n_weights:,.0f}",
                f"{n_weights * weight_bits / 8:,.0f}",
                f"{n_cores:g}",
                f"{dynamic_uj:.3f}",
                percent(dynamic_uj, whole_uj),
                f"{flat_uj:.2f}",
            )
        table.add_section()
    return table


def bits_row(
    profile: Profile, data: Dataset, truth: Array, network: Network, weight_bits: int
) -> tuple[float, ...]:
    """Return accuracy, stored weights, cores, dynamic energy and energy flat out, in uJ, of a network."""
    response = respond(network, data, data.validation)
    priced = cost(profile, replace(mean_of(of_response(network, response)), weight_bits=weight_bits))
    accuracy = float(np.mean(read_out(response.output) == truth))
    energy_uj = float(priced.energy_uj.value)
    return accuracy, network.n_weights, priced.n_cores.value, float(priced.dynamic_uj), energy_uj


PARTS: Mapping[str, Callable[[Settings], Table]] = {
    "simulation": simulation,
    "counts": counts,
    "points": points,
    "bits": bits,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS), metavar="NAME")
    parser.add_argument("--nets", nargs="+", choices=list(NETS), default=[], metavar="NET", help="simulated")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="small cases, to see whether all runs")
    parser.add_argument("--python", action="append", default=[], metavar="FRAMEWORK=PATH")
    parser.add_argument("--cycle", action="store_true", help="SANA-FE's cycle-accurate network too")
    options = parser.parse_args(arguments)
    python = pythons(options.python).get(SANAFE, sys.executable)
    nets = options.nets or list(NETS)[: 1 if options.quick else None]
    settings = Settings(options.rounds, options.quick, nets, python, options.cycle)
    console = Console(width=220)
    for name in options.only:
        console.print(PARTS[name](settings))


if __name__ == "__main__":
    main()
