"""One thread for matrix products, so that their sums do not depend on how many would share them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def single_threaded() -> Iterator[None]:
    """Hold the threads of BLAS and OpenMP at one, in a `with` or as a decorator."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        yield
