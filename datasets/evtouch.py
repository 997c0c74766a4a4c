"""Ev-Touch Objects: 36 objects grasped by a finger of the event skin NeuTouch.

`Ev-Objects/train` and `Ev-Objects/test` hold a file `..<number>_label_<class>.npy` per grasp: 0 or 1 per
(taxel, polarity, bin of 20 ms), of shape (39, 2, 250). The result packs the bits, ordered by number.

Source: `main.py` (folders, names), `tactileSGNet.py` (axes) and `to_graph.py` (taxels) of
github.com/clear-nus/TactileSGNet; Gu et al., IROS 2020.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.prepare import Converted, folder

FILES = ("Ev-Objects/train/*.npy", "Ev-Objects/test/*.npy")
_NAME = re.compile(r"(?:.*\D)?(\d+)_label_(\d+)\.npy")
_SHAPE = (39, 2, 250)


@register("datasets", "evtouch")
@dataclass(frozen=True)
class EvTouch:
    """36 objects grasped by a finger of the event skin NeuTouch."""

    file: ClassVar[str] = "evtouch_objects/evtouch_objects.npz"
    origin: ClassVar[str] = "github.com/clear-nus/TactileSGNet at f224d38, Ev-Objects.zip"
    licence: ClassVar[str] = ""
    files: ClassVar[tuple[str, ...]] = FILES
    digest: ClassVar[str] = "6d64d551c0e31507e1039e16eb1abca2324ab659c93a576b0e3224a9f9c62426"

    def convert(self, source: Path) -> Converted:
        """Return the grasps of both parts of the published split.

        Raises:
            RecordingError: a part is missing, or a file holds something else.
        """
        grasps = []
        for part in ("train", "test"):
            files = folder(source, f"Ev-Objects/{part}", "*_label_*.npy")
            numbered = [(*_numbers(path), part, path) for path in files]
            grasps += sorted(numbered)
        arrays: dict[str, Array] = {
            "spikes_packed": np.stack([np.packbits(_spikes(path), axis=-1) for *_, path in grasps]),
            "shape": np.array([len(grasps), *_SHAPE], np.int64),
            "label": np.array([label for _, label, *_ in grasps], np.int16),
            "split": np.array([part for *_, part, _ in grasps]),
            "source_index": np.array([number for number, *_ in grasps], np.int16),
        }
        return Converted([path for *_, path in grasps], {"evtouch_objects.npz": arrays})


def _numbers(path: Path) -> tuple[int, int]:
    match = _NAME.fullmatch(path.name)
    if match is None:
        raise RecordingError(f"{path}: must be named <number>_label_<class>.npy")
    return int(match[1]), int(match[2])


def _spikes(path: Path) -> Array:
    try:
        spikes = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise RecordingError(f"{path}: is no array: {str(error).splitlines()[0]}") from None
    if spikes.shape != _SHAPE or not ((spikes == 0) | (spikes == 1)).all():
        text = f"0 and 1 of shape {_SHAPE}, got {spikes.dtype} {spikes.shape}"
        raise RecordingError(f"{path}: must hold {text}")
    return np.asarray(spikes, bool)
