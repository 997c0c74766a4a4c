"""Non-dominated filtering beside moocore alone: milliseconds over n, d and kind of data.

    python benchmarks/pareto.py [--largest 1000000]

Everything is minimised. uniform: independent. anti: uniform noise projected to the plane
sum = d / 2 plus N(0, 0.02), a thin slab. corr: a common value plus N(0, 0.05). Times are CPU
milliseconds, the smallest of up to five; `same` says that both masks are equal.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import moocore
import numpy as np

from dse.skyline.pareto import non_dominated


def points(kind: str, n: int, d: int, rng: np.random.Generator) -> np.ndarray:
    """Return (n, d) points of a kind."""
    noise = rng.random((n, d))
    if kind == "anti":
        return noise - noise.mean(axis=1, keepdims=True) + 0.5 + rng.normal(0, 0.02, (n, 1))
    if kind == "corr":
        return rng.random((n, 1)) + rng.normal(0, 0.05, (n, d))
    return noise


def best_ms(function: Callable[[np.ndarray], np.ndarray], data: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the smallest CPU time of up to five calls within two seconds, and the answer."""
    times: list[float] = []
    while len(times) < 5 and sum(times) < 2:
        start = time.process_time()
        answer = function(data)
        times.append(time.process_time() - start)
    return 1e3 * min(times), answer


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=1_000_000)
    largest = parser.parse_args().largest
    print(f"{'n':>8} {'d':>2} {'data':<8} {'front':>7} {'dse ms':>9} {'moocore ms':>11} {'ratio':>6} same")
    for n in (n for n in (10_000, 100_000, 1_000_000) if n <= largest):
        for d in (2, 3, 5):
            for kind in ("uniform", "anti", "corr"):
                data = points(kind, n, d, np.random.default_rng([n, d]))
                ours, mask = best_ms(non_dominated, data)
                theirs, other = best_ms(lambda x: moocore.is_nondominated(x, keep_weakly=True), data)
                same = "yes" if (mask == other).all() else "NO"
                print(
                    f"{n:>8} {d:>2} {kind:<8} {mask.sum():>7} {ours:>9.2f} {theirs:>11.2f} "
                    f"{ours / theirs:>6.2f} {same}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
