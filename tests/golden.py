"""The golden vectors of the CUBA network, read from the shared reference folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

FILE = Path(__file__).resolve().parents[1] / ".." / "shared" / "reference" / "cuba_golden.npz"
MODES = ("quant", "slayerfloat", "ideal")


@cache
def _arrays() -> Mapping[str, np.ndarray]:
    with np.load(FILE) as file:
        return {name: file[name] for name in file.files}


@cache
def _index() -> dict[str, Any]:
    found = json.loads(str(_arrays()["index_json"]))
    assert isinstance(found, dict)
    return found


@dataclass(frozen=True)
class Case:
    """One golden network in one arithmetic mode; arrays are (sample, step, neuron)."""

    name: str
    mode: str

    @property
    def settings(self) -> dict[str, Any]:
        return dict(_index()[self.name])

    @property
    def n_layers(self) -> int:
        return int(self.settings["n_weight_layers"])

    @property
    def integer(self) -> bool:
        return self.mode != "ideal"

    def given(self, key: str) -> np.ndarray:
        """Return an input of the case: x (sample, step, channel), labels, w1, ..."""
        found = _arrays()[f"{self.name}/{key}"]
        return found.transpose(0, 2, 1) if key == "x" else found

    def expected(self, key: str) -> np.ndarray:
        """Return a result of the mode; states and spikes with time before neurons."""
        found = _arrays()[f"{self.name}/{self.mode}/{key}"]
        return found.transpose(0, 2, 1) if found.ndim == 3 else found

    def state(self, kind: str, layer: int) -> np.ndarray:
        """Return `cur` or `vol` of a layer (from 1) in weight units."""
        if self.integer:
            return self.expected(f"{kind}{layer}_int") / 4096
        return self.expected(f"{kind}{layer}")


def cases() -> list[Any]:
    """Return one pytest parameter per case and mode, or one that skips with its reason."""
    if not FILE.exists():
        return [
            pytest.param(None, marks=pytest.mark.skip(reason="shared/reference/cuba_golden.npz is absent"))
        ]
    return [pytest.param(Case(name, mode), id=f"{name}-{mode}") for name in _index() for mode in MODES]
