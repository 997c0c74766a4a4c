"""One random generator per (study seed, design, purpose): results never depend on order or worker."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt


def design_key(design: Mapping[str, Any]) -> str:
    """Return the canonical text of a design's parameters: sorted keys, exact numbers."""
    return json.dumps(dict(design), sort_keys=True, separators=(",", ":"), default=str)


def generator(study_seed: int, design: Mapping[str, Any], purpose: str, *index: int) -> np.random.Generator:
    """Return a counter-based generator (Philox) that belongs to one purpose of one design.

    Args:
        study_seed: seed of the study.
        design: parameters of the design ({} for what the whole study shares).
        purpose: what the numbers are for ('initialisation', 'batches', 'dropout', ...).
        index: further counters, such as the repeat and the epoch.
    """
    text = "\x1f".join([str(study_seed), design_key(design), purpose, *map(str, index)])
    key = np.frombuffer(hashlib.sha256(text.encode()).digest()[:16], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key))


def position(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Return where a generator stands in its sequence, as the bytes of a JSON text."""
    text = json.dumps(rng.bit_generator.state, default=lambda array: array.tolist())
    return np.frombuffer(text.encode(), np.uint8)


def move_to(rng: np.random.Generator, place: npt.NDArray[np.uint8]) -> None:
    """Let a generator go on from a `position` of the same kind of generator."""
    rng.bit_generator.state = json.loads(place.tobytes())
