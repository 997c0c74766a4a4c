"""Numba functions that are compiled once per version of their package, and kept on disk between processes.

Numba takes half a second and 90 MB; it is imported when a kernel is first called.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import cache, partial, update_wrapper
from pathlib import Path
from threading import RLock
from typing import Any

_HERE = Path(__file__).parent
# Packages whose kernels or constants go into kernels of others.
_INLINED = (_HERE, _HERE.parents[1] / "engine" / "neurons")


@cache
def _sources(folder: Path) -> str:
    """Return a hash of every source file of a package and of those whose kernels it may call."""
    digest = hashlib.sha256()
    for path in sorted({path for place in (folder, *_INLINED) for path in place.glob("*.py")}):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator: `numba.njit` with the options, cached, without the interpreter lock.

    Numba's cache is fresh as long as the function's own file is, although the code of other files is inlined
    into it: after an update of one file it would run what was compiled from the old one. Here the cached code
    is that of all files of the function's package.

    `_nrt=False` is for kernels that allocate nothing and make no views: Numba then counts no references,
    which costs two atomic operations for every array that is passed on.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        late = Late(partial(_dispatcher, function, options), function.__globals__)
        return update_wrapper(late, function)

    return decorate


def overload(symbol: Callable[..., Any]) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator: `numba.extending.overload`, once a kernel of the module runs."""

    def register(function: Callable[..., Any]) -> Any:
        from numba import extending

        return extending.overload(symbol, strict=False)(function)

    return lambda function: Late(partial(register, function))


_LINKING = RLock()


class Late:
    """What is made when a kernel first runs, and then stands in its own place in the kernel's module.

    make: returns it.
    neighbours: the names of the module that a kernel is of, its own among them.
    """

    def __init__(self, make: Callable[[], Any], neighbours: dict[str, Any] | None = None) -> None:
        self._make, self._neighbours = make, neighbours or {}
        self._made: Any = None

    def __call__(self, *arguments: Any) -> Any:
        return self._linked()(*arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._linked(), name)

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self._linked().__reduce_ex__(protocol)  # a copy is of what it stands for

    def _linked(self) -> Any:
        with _LINKING:
            if self._made is None:
                self._made = self._make()
                for name, value in list(self._neighbours.items()):
                    if isinstance(value, Late):
                        self._neighbours[name] = value._linked()
        return self._made


def _dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    import numba  # not before a kernel runs

    dispatcher = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    index: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if hasattr(index, "_source_stamp"):
        source = sys.modules[function.__module__].__file__ or __file__
        index._source_stamp = _sources(Path(source).parent)
        index._load_index = _readable(index._load_index)
    return dispatcher


def _readable(load: Callable[[], Any]) -> Callable[[], Any]:
    """Return a reader of a function's index that takes one it cannot read for an empty one.

    The index of an older version may name types of modules that are no more.
    """

    def reader() -> Any:
        try:
            return load()
        except (ImportError, AttributeError, TypeError):
            return {}

    return reader
