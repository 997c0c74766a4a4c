"""Names of `dse.base.native.vectors` for modules of kernels, which import no Numba until a kernel runs."""

from __future__ import annotations

from typing import Any

from dse.base.native.compiled import Late


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)

    def found() -> Any:
        from dse.base.native import vectors

        return getattr(vectors, name)

    return Late(found)
