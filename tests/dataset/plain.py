"""The functions of `dse.dataset`, given designs as plain sections, which tests change in a line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dse import dataset
from dse.config import Sections
from dse.dataset import keys, parts
from dse.records import Dataset
from tests.spaces import sections

Design = Mapping[str, Any] | Sections


def build(design: Design, base: Path, threads: int = 1) -> tuple[Dataset, list[str]]:
    return dataset.build(sections(design), base, threads)


def build_for(design: Design, base: Path, classes: tuple[str, ...]) -> tuple[Dataset, list[str]]:
    return dataset.build_for(sections(design), base, classes)[:2]


def prepare(design: Design, base: Path, root: Path, threads: int = 1) -> Path:
    return dataset.prepare(sections(design), base, root, threads)


def load_or_prepare(design: Design, base: Path, folder: Path) -> Dataset:
    return dataset.load_or_prepare(sections(design), base, folder)


def as_prepared(design: Design, folder: Path) -> Sections:
    return dataset.as_prepared(sections(design), folder)


def dataset_key(design: Design, base: Path) -> str:
    return dataset.dataset_key(sections(design), base)


def spikes_key(design: Design, base: Path, used: Any) -> str:
    return keys.spikes_key(sections(design), base, used)


def same_spikes(design: Design) -> str:
    return dataset.same_spikes(sections(design))


def placed(recordings: Any, design: Design, *args: Any, **others: Any) -> parts.Part:
    return parts.placed(recordings, sections(design), *args, **others)


def dense(data: Dataset, i: int, first: int = 0, n: int | None = None) -> Any:
    """Return the spikes of n stored steps of a sample, (step, channel) counts; None: of all."""
    spikes = data.spikes
    n = spikes.n_steps if n is None else n
    out = np.zeros((n, spikes.n_channels), dtype=int)
    for t in range(n):
        row = i * spikes.n_steps + first + t
        np.add.at(out[t], spikes.channel[spikes.row_offsets[row] : spikes.row_offsets[row + 1]], 1)
    return out


def entries(root: Path) -> dict[str, list[str]]:
    """Return the names of the entries of a cache by what they are."""
    found: dict[str, list[str]] = {"spikes": [], "dataset": []}
    for path in root.glob("*/meta.json"):
        found["dataset" if (path.parent / "target.npy").exists() else "spikes"].append(path.parent.name)
    return found
