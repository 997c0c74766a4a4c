"""What a bundle takes in every form: time, energy, decisions that differ.

    python -m benchmarks.targets BUNDLE RECORDINGS [BUNDLE RECORDINGS ...] [--core cortex_m4 ...] [--csv FILE]
    python -m benchmarks.targets --random 30 --target ice40 [--target riscv32 ...] [--csv FILE]

A row per net and form: the engine in float32 and in integers, C on this machine, C on an emulated core, the
stream. `ms` is the time of an inference: of the engine per recording of one batch, without preparation;
of C and of the stream the median up to the answer, encoder and preprocessing included, without compilation
(`dse measure`). That of the emulated core is cycles / clock of its profile, without the encoder; `predicted`
is what the cost model says of the same recordings. `uJ` is modelled for the core, elsewhere measured; empty
without a counter. Decisions are compared with those in integers; of targets that the bundle was verified for
they are those of its verdict, and nothing is run again.

With `--random`, a row per target and random network of `benchmarks.instructions` that it holds: what
`dse.testing.check_target` finds on all ones, bursts, every other step, silence and noise; then the decisions
and spikes that differ where windows follow each other after a reset alone, and the decisions where half of
another window, broken off, comes before each. Gate arrays are simulated, not placed.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from benchmarks.instructions import STEP_MS, network, work_of
from dse.base.records import Array, Ints, Network
from dse.base.registry import known
from dse.deploy import bundle
from dse.deploy.bundle import Bundle
from dse.deploy.c import replay
from dse.deploy.measure import measure
from dse.deploy.reference import Reference, answered, decided, of_recordings, of_spikes
from dse.deploy.targets import compare
from dse.deploy.targets.fpga import Ecp5, Fpga, Ice40, run_of
from dse.deploy.verdict import Verdict
from dse.deploy.verilog import circuit, tools
from dse.deploy.verilog.circuit import Circuit
from dse.measure.hardware.profile import load
from dse.testing import check_target

_STEPS = 40
"""Of a window of a random network, at most."""
CHIPS = {"cortex_m4": "mcu_m4", "cortex_m7": "mcu_m7", "cortex_m33": "mcu_m33"}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("paths", nargs="*", help="bundle and recordings, in turns")
    parser.add_argument("--core", choices=CHIPS, action="append", help="repeatable; default: cortex_m4")
    parser.add_argument("--random", type=int, default=0, help="random networks per target")
    parser.add_argument("--target", action="append", default=[], help="that holds them; repeatable")
    parser.add_argument("--csv", help="file for the rows, as they come")
    options = parser.parse_args()
    of_bundles = (
        rows(folder, data, options.core or ["cortex_m4"])
        for folder, data in zip(options.paths[::2], options.paths[1::2], strict=True)
    )
    of_random = (contract(name, options.random) for name in options.target)
    table = pd.DataFrame()
    for row in itertools.chain.from_iterable((*of_bundles, *of_random)):
        table = pd.concat([table, pd.DataFrame([row])], ignore_index=True)
        if options.csv:  # a run that is stopped keeps its rows
            table.to_csv(options.csv, index=False)
    shown = Table(*table.columns)
    for values in table.itertuples(index=False):
        shown.add_row(*("" if pd.isna(x) else f"{x:.4g}" if isinstance(x, float) else str(x) for x in values))
    Console(width=140).print(shown)


def rows(folder: str, data_file: str, cores: Sequence[str]) -> Iterator[dict[str, object]]:
    """Yield the rows of one bundle."""
    made = bundle.read(folder)
    reference = of_recordings(made, data_file)
    name, n = Path(folder).name, max(1, reference.n_recordings)
    for arithmetic in ("float32", "integer") if isinstance(made.fitted, Network) else ("",):
        ms, differ = _engine(made, reference, data_file, arithmetic)
        yield {"net": name, "form": f"engine, {arithmetic}".rstrip(", "), "ms": ms / n, "differ": differ}
    stream, c99 = measure(made, data_file, rest_s=0.1)
    in_c = _verdict(made, Path(folder), "c99", reference)
    yield {"net": name, "form": "C here", **_taken(c99), "differ": in_c.decisions_differ}
    for core in cores:
        if known("targets")[core]().refusal(made):
            continue
        chip, on_core = load(CHIPS[core]), _verdict(made, Path(folder), core, reference)
        cycles = on_core.figures["cycles_per_inference"]
        predicted = _predicted(made, reference, CHIPS[core])
        yield {
            "net": name,
            "form": known("targets")[core].label,
            "ms": cycles / chip.clock_mhz.value / 1e3,
            "uJ": cycles * chip.cycle_nj.value / 1e3,
            "differ": on_core.decisions_differ,
            "cycles": cycles,
            "predicted": f"{predicted / cycles - 1:+.1%}",
        }
    quantiles = {f"step_us_p{q}": float(np.percentile(stream.step_us, q)) for q in (50, 99)}
    yield {"net": name, "form": "stream", **_taken(stream), **quantiles}


def contract(name: str, n_networks: int) -> Iterator[dict[str, object]]:
    """Yield a row per random network that a target holds, of at most `_STEPS` steps a window."""
    target = UNPLACED.get(name) or known("targets")[name]()
    held = (seed for seed in itertools.count() if not target.refusal(_short(seed)[0]))
    for seed in itertools.islice(held, n_networks):
        made, fired = _short(seed)
        reference = of_spikes(made, adversarial(fired), STEP_MS)
        verdict = check_target(target, made, reference)
        assert verdict is not None
        windows = [x[1:] for x in replay.of_spikes(reference)]
        half = np.full(len(windows), reference.n_steps // 2)
        halves = [x[1:-1] for x in replay.of_spikes(reference, half)]
        in_turn = _played(target, made, reference, windows)
        pairs = zip([halves[-1], *halves], windows, strict=False)
        broken = _played(target, made, reference, [np.concatenate(pair) for pair in pairs])
        yield {
            "target": name,
            "seed": seed,
            "net": "-".join(map(str, made.fitted.sizes)),  # type: ignore[union-attr]
            "recordings": reference.n_recordings,
            "spikes": sum(map(len, reference.fired)),
            "verdict": verdict.kind,
            "decide otherwise": verdict.decisions_differ,
            "spike otherwise": verdict.spikes_differ,
            "after reset alone": in_turn.decisions_differ + in_turn.spikes_differ,
            "after half a window": broken.decisions_differ,
        }


def _short(seed: int) -> tuple[Bundle, Array]:
    """Return random network `seed` with a window of at most `_STEPS` steps, and spikes of two windows."""
    made, fired, _ = network(seed)
    assert made.input is not None
    taken = dataclasses.replace(made.input, n_steps=min(_STEPS, made.input.n_steps))
    return dataclasses.replace(made, input=taken), fired[:, : taken.n_steps]


def adversarial(fired: Array) -> Array:
    """Return all ones, bursts, every other step, silence and noise, and the given spikes."""
    step = np.arange(fired.shape[1])[:, None]
    made = [np.broadcast_to(x, fired.shape[1:]) for x in (step >= 0, step % 7 < 2, step % 2 == 0, step < 0)]
    noise = np.random.default_rng(0).random(fired.shape[1:]) < 0.5
    return np.concatenate([np.stack([*made, noise]).astype(np.uint8), fired])


def _played(target: Any, made: Bundle, reference: Reference, commands: list[Ints]) -> Verdict:
    """Return how what a target does on commands differs from a reference."""
    with tempfile.TemporaryDirectory() as place:
        target.write(made, Path(place))
        form = target.form(made)
        if isinstance(target, Fpga):
            return compare(
                reference, run_of(tools.simulated(target.board, Path(place), commands), form, reference)
            )
        done = target.executed(form, Path(place), reference, replay.Recorded(commands))
        return compare(reference, replay.run_of(done.played, form, reference))


class Unplaced:
    """A target whose Verilog is written and simulated, not placed."""

    def emit(self, form: Circuit, bundle: Bundle, folder: Path) -> None:
        circuit.write(form, folder)
        (folder / "report.json").write_text("{}", encoding="utf-8")


@dataclass(frozen=True)
class UnplacedIce40(Unplaced, Ice40):
    """Verilog of the size of an iCE40 UP5K."""


@dataclass(frozen=True)
class UnplacedEcp5(Unplaced, Ecp5):
    """Verilog of the size of an ECP5 LFE5U-12F."""


UNPLACED = {"ice40": UnplacedIce40(), "ecp5": UnplacedEcp5()}


def _taken(times: object) -> dict[str, object]:
    """Return the median time and the mean energy of an inference."""
    us, energy = times.inference_us, times.energy_uj  # type: ignore[attr-defined]
    return {"ms": float(np.median(us)) / 1e3, "uJ": np.nan if energy is None else energy}


def _verdict(made: Bundle, folder: Path, name: str, reference: Reference) -> Verdict:
    """Return the verdict that a bundle states of a target, or that of a run."""
    stated = made.targets.get(name)
    if stated is not None and stated.n_recordings == reference.n_recordings:
        return stated
    target = known("targets")[name]()
    with tempfile.TemporaryDirectory() as place:
        target.write(made, Path(place))
        verdict: Verdict = target.verify(made, Path(place), reference)
    return verdict


def _predicted(made: Bundle, reference: Reference, profile: str) -> float:
    """Return the cycles of an inference that the cost model predicts for these recordings."""
    bits = int((made.evidence.get("precision") or {}).get("weight_bits", 8))
    figures = load(profile).at("value")
    work = work_of(made, reference, bits)
    return figures["wait_factor"] * sum(figures[kind] * n for kind, n in work.items())


def _engine(made: Bundle, reference: Reference, data_file: str, arithmetic: str) -> tuple[float, float]:
    """Return the time of all recordings in ms, and the share of decisions that differ from the reference."""
    other = made
    if isinstance(made.fitted, Network):
        other = dataclasses.replace(made, fitted=dataclasses.replace(made.fitted, arithmetic=arithmetic))
    answered(other, reference.dataset, data_file)  # compiles
    began = time.perf_counter()
    response = answered(other, reference.dataset, data_file)
    elapsed_ms = (time.perf_counter() - began) * 1e3
    label, time_ms, _ = decided(other, reference.dataset, response)
    differ = (label != reference.label) | ~np.isclose(time_ms, reference.time_ms)
    return elapsed_ms, float(differ.mean())


if __name__ == "__main__":
    main()
