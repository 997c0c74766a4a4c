"""A grid of 40 designs on recorded Braille letters: this engine in cohorts beside loops over the designs.

    DSE_DATA=... python -m benchmarks.sweep [--epochs 20] [--full] [--python snntorch=VENV/bin/python]

All train on the same batches, for the same epochs, from the same float weights, with the same schedule of
Adam. CPU seconds are those of one core for training and one answer to the validation samples. The peers are
slow: they train every fifth design, spread evenly over the grid, and their time is scaled up to 40 (`--full`:
all of them). Accuracies are means over designs with their standard error; those of the common designs
compare. snnTorch runs with its own surrogate and with that of this engine. `dse.run` trains the grid as a
study, artefacts, tables and start of its workers included; its wall time with two processes needs two idle
cores.
"""

from __future__ import annotations

import argparse
import contextlib
import pickle
import resource
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import dse
from benchmarks import grid
from benchmarks.worker import NotInstalled, Worker, pythons
from dse.config import SearchSpace

PEERS = {
    "csr loop": "torch loop, CSR first layer",
    "snntorch": "snnTorch, linear hoisted",
    "snntorch, our surrogate": "snnTorch, hoisted, our surrogate",
}


@dataclass(frozen=True)
class Result:
    """CPU seconds and accuracy by number of design; seconds of a cohort are shared out evenly."""

    seconds: Mapping[int, float]
    accuracy: Mapping[int, float]
    wall_s: float | None = None

    @property
    def whole_s(self) -> float:
        """CPU seconds of the whole grid, scaled up where only some designs were trained."""
        return sum(self.seconds.values()) / len(self.seconds) * grid.N_DESIGNS

    def mean(self, numbers: Sequence[int]) -> str:
        """Return mean accuracy and standard error over designs."""
        return mean_and_error([self.accuracy[k] for k in numbers])


def mean_and_error(values: Sequence[float]) -> str:
    """Return `mean ± standard error`."""
    return f"{np.mean(values):.3f} ± {np.std(values, ddof=1) / np.sqrt(len(values)):.3f}"


def in_cohort(folder: Path, epochs: int, arithmetic: str) -> Result:
    """Train the grid as one cohort."""
    with Worker(sys.executable, "benchmarks.sweep_contender", "dse", "") as worker:
        seconds, accuracy = worker.ask("cohort", str(folder), epochs, arithmetic)
    each = dict.fromkeys(range(grid.N_DESIGNS), seconds / grid.N_DESIGNS)
    return Result(each, dict(enumerate(accuracy)))


def in_study(space: SearchSpace, folder: Path, jobs: int) -> Result:
    """Train the grid as a study with some worker processes."""

    def cpu_s() -> float:
        return sum(
            sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        )

    began, cpu = time.perf_counter(), cpu_s()
    study = dse.run(space, folder / f"with {jobs}", jobs=jobs, progress=False)
    wall, cpu = time.perf_counter() - began, cpu_s() - cpu
    trials = study.trials.set_index("trial")["accuracy"]
    return Result(dict.fromkeys(range(grid.N_DESIGNS), cpu / grid.N_DESIGNS), dict(trials), wall)


def in_peers(path: Path, numbers: Sequence[int], python_of: Mapping[str, str]) -> dict[str, Result | None]:
    """Train some designs in each peer, in turn; None where a framework is not installed."""
    results: dict[str, tuple[dict[int, float], dict[int, float]]] = {}
    workers = {}
    with contextlib.ExitStack() as stack:
        for name in PEERS:
            python = python_of.get(name.split(",")[0], sys.executable)
            with contextlib.suppress(NotInstalled):
                worker = stack.enter_context(Worker(python, "benchmarks.sweep_contender", name, str(path)))
                worker.ask("check")
                workers[name] = worker
                results[name] = {}, {}
        for number in numbers:
            for name, worker in workers.items():
                seconds, accuracy = worker.ask("design", number)
                results[name][0][number], results[name][1][number] = seconds, accuracy
                print(f"{PEERS[name]}, design {number}: {seconds:.1f} s, {accuracy:.3f}", file=sys.stderr)
    return {name: Result(*results[name]) if name in results else None for name in PEERS}


def main() -> None:
    """Train, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--epochs", type=int, default=20)
    parser.add_argument("--full", action="store_true", help="peers train all designs")
    parser.add_argument("--python", action="append", default=[], metavar="FRAMEWORK=PATH")
    arguments = parser.parse_args()
    numbers = list(range(grid.N_DESIGNS)) if arguments.full else grid.some()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        space, data, recorded = grid.load(folder, arguments.epochs, "integer")
        real, _, _ = grid.load(folder, arguments.epochs, "float32")
        (folder / "task").write_bytes(pickle.dumps(grid.task(real, data, numbers)))
        studies = {jobs: in_study(space, folder, jobs) for jobs in (1, 2)}
        results: dict[str, Result | None] = {
            f"dse, one cohort, {arithmetic}": in_cohort(folder, arguments.epochs, arithmetic)
            for arithmetic in ("integer", "float32")
        }
        results |= {f"dse.run, processes: {jobs}": result for jobs, result in studies.items()}
        peers = in_peers(folder / "task", numbers, pythons(arguments.python))
        results |= {PEERS[name]: result for name, result in peers.items()}
    ours = results["dse, one cohort, integer"]
    assert ours is not None
    what = "recorded Braille letters" if recorded else "invented spikes (no recordings found)"
    table = Table(title=f"{grid.N_DESIGNS} designs, {arguments.epochs} epochs, {what}", title_justify="left")
    table.add_column("", no_wrap=True)
    for heading in ("designs", "CPU s", "CPU s for 40", "cohort × faster", "wall s"):
        table.add_column(heading, justify="right")
    for heading in (f"accuracy of {len(numbers)}", "less float32 cohort's", "accuracy of 40"):
        table.add_column(heading, justify="right")
    baseline = results["dse, one cohort, float32"]
    assert baseline is not None
    for label, result in results.items():
        if result is None:
            table.add_row(label, "not installed")
            continue
        table.add_row(
            label,
            str(len(result.seconds)),
            f"{sum(result.seconds.values()):.1f}",
            f"{result.whole_s:.1f}",
            f"{result.whole_s / ours.whole_s:.1f}",
            "" if result.wall_s is None else f"{result.wall_s:.1f}",
            result.mean(numbers),
            mean_and_error([result.accuracy[k] - baseline.accuracy[k] for k in numbers]),
            result.mean(range(grid.N_DESIGNS)) if len(result.accuracy) == grid.N_DESIGNS else "",
        )
    console = Console(width=150, highlight=False)
    console.print(table)
    one, two = (studies[jobs].wall_s or 0.0 for jobs in (1, 2))
    console.print(f"Two processes are {one / two:.2f} × as fast as one (wall time).")
    same = studies[1].accuracy == studies[2].accuracy == ours.accuracy
    console.print("One cohort, one process and two " + ("agree in every accuracy." if same else "DISAGREE."))


if __name__ == "__main__":
    main()
