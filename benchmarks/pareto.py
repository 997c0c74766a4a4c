"""Non-dominated filtering beside moocore, paretoset and pymoo: CPU milliseconds over n, d and kind of data.

    python benchmarks/pareto.py [--n 10000 100000 ...] [--d 2 3 5] [--data uniform anti corr] [--limit 20]
                                [--python paretoset=VENV/bin/python ...]

Everything is minimised. uniform: independent. anti: uniform noise projected to the plane sum = d / 2 plus
N(0, 0.02), a thin slab. corr: a common value plus N(0, 0.05). A peer is looked for in this Python unless
`--python` names another for it; each system runs in a process of its own. Times are CPU milliseconds of the
process, all threads together, the smallest of up to five; `wall` is the elapsed time of dse. `x best` is the
time of dse over that of the fastest peer. A system is left out (-) where its time at the smaller n predicts
more than `--limit` seconds. `same` says that all masks are equal.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

SYSTEMS = ("dse", "moocore", "paretoset", "pymoo")
_GROWTH = 1.1  # times grow as n to this power, at least


def points(kind: str, n: int, d: int, rng: np.random.Generator) -> np.ndarray:
    """Return (n, d) points of a kind."""
    noise = rng.random((n, d))
    if kind == "anti":
        return noise - noise.mean(axis=1, keepdims=True) + 0.5 + rng.normal(0, 0.02, (n, 1))
    if kind == "corr":
        return rng.random((n, 1)) + rng.normal(0, 0.05, (n, d))
    return noise


def function_of(system: str) -> Callable[[np.ndarray], Any]:
    """Return the function of a system that tells which points are non-dominated, as a mask or as indices.

    Raises:
        ImportError: it is not installed.
    """
    if system == "dse":
        from dse.skyline.pareto import non_dominated

        return non_dominated
    if system == "moocore":
        import moocore

        return lambda data: moocore.is_nondominated(data, keep_weakly=True)
    if system == "paretoset":
        import numba  # noqa: F401  (without it paretoset is a hundred times slower)
        from paretoset import paretoset

        return lambda data: paretoset(data, distinct=False)
    from pymoo.util.nds.non_dominated_sorting import find_non_dominated

    return find_non_dominated


def best(function: Callable[[np.ndarray], Any], data: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Return the smallest CPU and wall time of up to five calls within two seconds, and the mask."""
    cpu, wall = [], []
    while len(cpu) < 5 and sum(cpu) < 2:
        began_cpu, began = time.process_time(), time.perf_counter()
        answer = function(data)
        cpu.append(time.process_time() - began_cpu)
        wall.append(time.perf_counter() - began)
    mask = np.zeros(len(data), dtype=bool)
    mask[np.asarray(answer)] = True
    return min(cpu), min(wall), mask


def measure(
    system: str, sizes: Sequence[int], ds: Sequence[int], kinds: Sequence[str], limit_s: float
) -> None:
    """Print one line of JSON per case that a system can do in time."""
    function = function_of(system)
    for d in ds:
        function(points("uniform", 10_000, d, np.random.default_rng(0)))  # compiles
        for kind in kinds:
            last_n, last_s = 1, 0.0
            for n in sorted(sizes):
                if last_s * (n / last_n) ** _GROWTH > limit_s:
                    break
                cpu, wall, mask = best(function, points(kind, n, d, np.random.default_rng([n, d])))
                last_n, last_s = n, cpu
                row = {"case": [n, d, kind], "cpu": cpu, "wall": wall, "front": int(mask.sum())}
                print(json.dumps(row | {"crc": zlib.crc32(np.packbits(mask).tobytes())}), flush=True)


def rows_of(python: str, system: str, arguments: Sequence[str]) -> dict[tuple[Any, ...], dict[str, Any]]:
    """Return the rows of a system, measured by another process; none if it is not installed there."""
    command = [python, str(Path(__file__)), "--measure", system, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"{system} left out: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return {tuple(row["case"]): row for row in rows}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--n", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--d", type=int, nargs="+", default=[2, 3, 5])
    parser.add_argument("--data", nargs="+", default=["uniform", "anti", "corr"])
    parser.add_argument("--limit", type=float, default=20.0, help="seconds that a system may take for a case")
    parser.add_argument("--python", action="append", default=[], metavar="SYSTEM=PATH")
    parser.add_argument("--measure", choices=SYSTEMS, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.measure:
        measure(chosen.measure, chosen.n, chosen.d, chosen.data, chosen.limit)
        return
    pythons = dict(pair.split("=", 1) for pair in chosen.python)
    arguments = ["--n", *map(str, chosen.n), "--d", *map(str, chosen.d), "--data", *chosen.data]
    arguments += ["--limit", str(chosen.limit)]
    found = {name: rows_of(pythons.get(name, sys.executable), name, arguments) for name in SYSTEMS}
    head = f"{'n':>8} {'d':>2} {'data':<8} {'front':>7} {'dse ms':>9} {'wall ms':>9}"
    print(head + "".join(f" {name:>10}" for name in SYSTEMS[1:]) + " x best same")
    for case in found["dse"]:
        n, d, kind = case
        ours = found["dse"][case]
        peers = [found[name].get(case) for name in SYSTEMS[1:]]
        cells = "".join(f" {1e3 * row['cpu']:>10.2f}" if row else f" {'-':>10}" for row in peers)
        times = [row["cpu"] for row in peers if row]
        ratio = f"{ours['cpu'] / min(times):6.2f}" if times else f"{'-':>6}"
        same = "yes" if all(row["crc"] == ours["crc"] for row in peers if row) else "NO"
        print(
            f"{n:>8} {d:>2} {kind:<8} {ours['front']:>7} {1e3 * ours['cpu']:>9.2f} {1e3 * ours['wall']:>9.2f}"
            f"{cells} {ratio} {same}"
        )


if __name__ == "__main__":
    main()
