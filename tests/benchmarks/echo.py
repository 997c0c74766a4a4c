"""A worker for tests."""

import os

from benchmarks.worker import serve


def echo(*words):
    print("a library says something")
    return list(words)


def fail():
    raise ValueError("no such thing")


def missing():
    import no_such_framework  # noqa: F401


if __name__ == "__main__":
    serve({"echo": echo, "fail": fail, "missing": missing, "threads": lambda: os.environ["OMP_NUM_THREADS"]})
