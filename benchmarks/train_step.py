"""One training step (forward, SpikeRate loss, backward, Adam) and one inference pass, beside peers.

    python -m benchmarks.train_step [CASE ...] [--rounds 3] [--python snntorch=VENV/bin/python ...]

CPU time, median (and minimum) of all calls in all rounds, one thread pinned to one core. Each row runs in a
process of its own; the rows take turns, round by round, so that ratios come from the same run. A framework is
looked for in this Python unless `--python` names another for it. Input spikes are random. All start from the
same weights, drawn as torch draws them; integer weights are those on the 8-bit grid, rounded up or down by
chance. The time of a cohort is per design. Resonators share a period; their weights are stronger.

The gradient error is the largest difference from a torch loop in float64 with the same weights and
arithmetic, relative to the gradient's largest entry: a spike that float32 alone fires or loses is in it.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.cases import CASES, FALSE_RATE, TRUE_RATE, Case, Variant
from benchmarks.ours import SURROGATE, layers_of, rows_of
from benchmarks.step_contender import OURS
from benchmarks.worker import NotInstalled, Worker, pythons

ROWS = {
    "loop": "torch loop, dense",
    "csr loop": "torch loop, CSR first layer",
    "snntorch": "snnTorch, linear hoisted",
    "snntorch in loop": "snnTorch, linear in the loop",
    "spikingjelly": "SpikingJelly CUBALIF, multi-step",
    "norse": "Norse LIF",
    **{name: name for name in OURS if "resonators" not in name},
    "loop, resonators": "torch loop, resonators",
    "spikingjelly, resonators": "SpikingJelly RAF, multi-step",
    "norse, resonators": "Norse Izhikevich, resonator",
    **{name: name for name in OURS if "resonators" in name},
}
EXACT = {
    "loop": Variant("ideal"),
    "csr loop": Variant("ideal"),
    "loop, resonators": Variant("ideal", 1.0),
    "spikingjelly, resonators": Variant("ideal", 1.0, reset=True, delayed=False),
    **{n: variant for n, (variant, _) in OURS.items() if not variant.max_delay and variant.form == "free"},
}
"""What the rows whose gradients are compared with the definition train."""

ELSEWHERE = {
    "lava-dl SLAYER": {"A": 0.325, "B": 0.131, "C": 1.06},
    "fused prototype in C": {"A": 0.033, "B": 0.0050, "C": 0.068},
    "its floor: gather, scatter, Adam": {"A": 0.014, "B": 0.0028, "C": 0.058},
}
CSR_LOOP_ELSEWHERE = {"A": 0.093, "B": 0.039, "C": 0.231}
"""CPU seconds per training step measured on another machine."""


CUBA_LIF = [name for name, (x, _) in OURS.items() if x == Variant(x.arithmetic)]


@dataclass
class Row:
    """Seconds of every step and of every inference pass, spikes per neuron and step, gradient error."""

    rates: list[float]
    step: list[float] = field(default_factory=list)
    infer: list[float] = field(default_factory=list)
    error: float | None = None


def exact_gradients(case: Case) -> dict[Variant, list[np.ndarray]]:
    """Return dL/dW of each layer by automatic differentiation in float64, of every variant of `EXACT`."""
    from dse.engine.autograd import gradients  # and with it torch, which takes seconds

    exact = {variant: _in_float64(variant) for variant in EXACT.values()}
    by_autograd = {
        variant: gradients(
            rows_of(case.x),
            layers_of(case, variant),
            [SURROGATE] * 2,
            case.labels,
            true_rate=TRUE_RATE,
            false_rate=FALSE_RATE,
            arithmetic=variant.arithmetic,
            gains=[None] * 2,
            shift=variant.delayed,
        )[1]
        for variant in set(exact.values())
    }
    return {variant: by_autograd[other] for variant, other in exact.items()}


def _in_float64(variant: Variant) -> Variant:
    return replace(variant, arithmetic="ideal") if variant.arithmetic == "float32" else variant


def error(found: Sequence[np.ndarray], exact: Sequence[np.ndarray]) -> float:
    """Return the largest difference relative to the largest entry, over layers."""
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(found, exact, strict=True))


def measure(case: str, rounds: int, seconds: float, python_of: dict[str, str]) -> dict[str, Row | None]:
    """Return each row of a case; None where its framework is not installed."""
    exact = exact_gradients(CASES[case])
    found: dict[str, Row | None] = dict.fromkeys(ROWS)
    running: dict[str, tuple[Worker, Row]] = {}
    with contextlib.ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        for name in ROWS:
            python = python_of.get(name.split()[0].strip(","), sys.executable)
            with contextlib.suppress(NotInstalled):
                worker = stack.enter_context(Worker(python, "benchmarks.step_contender", name, case))
                found[name] = row = Row(worker.ask("rates"))
                running[name] = worker, row
                if name in EXACT:
                    path = Path(folder) / f"{name}.npz"
                    worker.ask("gradients", str(path))
                    with np.load(path) as file:
                        row.error = error([file[k] for k in file.files], exact[EXACT[name]])
        for _ in range(rounds):
            for worker, row in running.values():
                row.step += worker.ask("timed", "step", seconds, 3)
                row.infer += worker.ask("timed", "infer", seconds / 3, 3)
    return found


def table_of(name: str, rows: dict[str, Row | None]) -> Table:
    """Return the table of a case."""
    case = CASES[name]
    sizes = "-".join(map(str, case.sizes))
    what = (
        f"{name}: {sizes}, {case.n_steps} steps, batch {case.batch}, {100 * case.density:.0f} % input spikes"
    )
    table = Table(title=what, title_justify="left")
    of_step = ("step, ms", "min", "× CSR", "× snnTorch", "gradient error")
    for heading in ("", *of_step, "inference, ms", "× CSR", "× snnTorch", "fired, %"):
        table.add_column(heading, no_wrap=True, justify="right" if heading else "left")

    def faster_than(other: str, row: Row, what: str) -> str:
        slow = rows[other]
        return f"{median(getattr(slow, what)) / median(getattr(row, what)):.1f}" if slow else "-"

    for key, row in rows.items():
        if row is None:
            table.add_row(ROWS[key], "not installed")
            continue
        table.add_row(
            ROWS[key],
            f"{1e3 * median(row.step):.2f}",
            f"{1e3 * min(row.step):.2f}",
            faster_than("csr loop", row, "step"),
            faster_than("snntorch", row, "step"),
            "-" if row.error is None else f"{row.error:.1e}",
            f"{1e3 * median(row.infer):.2f}",
            faster_than("csr loop", row, "infer"),
            faster_than("snntorch", row, "infer"),
            " / ".join(f"{100 * rate:.1f}" for rate in row.rates),
        )
    return table


def add_elsewhere(table: Table, case: str, rows: dict[str, Row | None]) -> None:
    """Add how far ahead of the figures of another machine a case is, scaled by the CSR loops of the two."""
    loop = rows["csr loop"]
    if case not in CSR_LOOP_ELSEWHERE or loop is None:
        return
    scale = median(loop.step) / CSR_LOOP_ELSEWHERE[case]
    for what, seconds in ELSEWHERE.items():
        scaled = seconds[case] * scale
        ours = [f"{scaled / median(row.step):.2f}" for key, row in rows.items() if key in CUBA_LIF and row]
        table.add_row(case, what, f"{1e3 * seconds[case]:.1f}", f"{1e3 * scaled:.1f}", *ours)
    table.add_section()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=1.0, help="of steps per row and round (3 at least)")
    parser.add_argument("--python", action="append", default=[], metavar="FRAMEWORK=PATH")
    asked = parser.parse_args()
    console = Console(width=150, highlight=False)
    elsewhere = Table(
        "case",
        "measured on another machine",
        "its ms",
        "scaled, ms",
        *(f"× {name}" for name in CUBA_LIF),
        title="Times faster than figures of another machine, scaled by the CSR loops of the two",
        title_justify="left",
    )
    for name in asked.cases or [name for name in CASES if name != "tiny"]:
        rows = measure(name, asked.rounds, asked.seconds, pythons(asked.python))
        console.print(table_of(name, rows))
        add_elsewhere(elsewhere, name, rows)
    if elsewhere.row_count:
        console.print(elsewhere)


if __name__ == "__main__":
    main()
