"""The worker behind benchmarks.sweep: trains designs in a peer, or the whole grid as a cohort of this engine.

python -m benchmarks.sweep_contender NAME FILE      FILE: a pickled benchmarks.peer_training.Task, for peers
"""

from __future__ import annotations

import pickle
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.worker import serve


def peer_functions(name: str, path: Path) -> dict[str, Any]:
    """Return what a peer answers to."""
    task = pickle.loads(path.read_bytes())

    def design(number: int) -> tuple[float, float]:
        """Return CPU seconds and accuracy of one design."""
        began = time.process_time()
        accuracy = task.train(name, number)
        return time.process_time() - began, accuracy

    def check() -> None:
        """Import what the peer needs."""
        task.network(name, next(iter(task.designs)))

    return {"check": check, "design": design}


def our_functions() -> dict[str, Any]:
    """Return what this engine answers to."""
    from benchmarks import grid

    def cohort(folder: str, epochs: int, arithmetic: str) -> tuple[float, list[float]]:
        """Return CPU seconds and accuracies of all designs."""
        space, data, _ = grid.load(Path(folder), epochs, arithmetic)
        began = time.process_time()
        found = grid.accuracies(space, data)
        return time.process_time() - began, found

    return {"cohort": cohort}


def main() -> None:
    """Answer the parent."""
    name, path = sys.argv[1:]
    serve(our_functions() if name == "dse" else peer_functions(name, Path(path)))


if __name__ == "__main__":
    main()
