"""A worker for tests."""

from __future__ import annotations

import os
from typing import NoReturn

from benchmarks.worker import serve


def echo(*words: object) -> list[object]:
    print("a library says something")
    return list(words)


def fail() -> NoReturn:
    raise ValueError("no such thing")


def missing() -> None:
    import no_such_framework  # noqa: F401


if __name__ == "__main__":
    serve({"echo": echo, "fail": fail, "missing": missing, "threads": lambda: os.environ["OMP_NUM_THREADS"]})
